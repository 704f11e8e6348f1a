"""The recurrent network that makes a picture of each window of events.

forward(planes [N, bins + 1, H, W], states) -> (picture [N, 1, H, W], states): `planes` as
`pecs.learning.reconstruct.planes` makes them. `states` is a list of tensors, `start_states` before the first window;
state i has the size of the picture over 2**state_levels[i]. H and W: multiples of 2**levels.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from .limits import NetworkConfig

SUBPIXEL_CHANNELS = 4  # of each of the 2x2 pixels that the finest level decodes


def _conv(inside: int, outside: int, size: int = 3, stride: int = 1) -> nn.Conv2d:
    """Initial weights of He et al. (ICCV 2015): with PyTorch's default most of few channels are dead after ReLU."""
    conv = nn.Conv2d(inside, outside, size, stride, size // 2)
    nn.init.kaiming_normal_(conv.weight, nonlinearity="relu")
    nn.init.zeros_(conv.bias)
    return conv


class _Residual(nn.Module):
    def __init__(self, channels: int):
        super().__init__()
        self.first, self.second = _conv(channels, channels), _conv(channels, channels)
        nn.init.zeros_(self.second.weight)  # the block starts as the identity

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.second(torch.relu(self.first(x))))


class _ConvGru(nn.Module):
    """ConvGRU of Ballas et al., ICLR 2016, eq. 5-8, with 3x3 kernels."""

    def __init__(self, channels: int):
        super().__init__()
        self.gates, self.candidate = _conv(2 * channels, 2 * channels), _conv(2 * channels, channels)

    def forward(self, x: Tensor, state: Tensor) -> Tensor:
        # In single precision, also where convolutions are not: the state remembers for many windows.
        reset, update = torch.sigmoid(self.gates(torch.cat([x, state], 1)).float()).chunk(2, 1)
        new = torch.tanh(self.candidate(torch.cat([x, reset * state], 1)).float())
        return state + update * (new - state)


class RecurrentUNet(nn.Module):
    """A UNet whose encoders are recurrent, as E2VID (Rebecq et al., TPAMI 2019), with ConvGRUs as FireNet (Scheerlinck
    et al., WACV 2020). Its finest level has half the picture's size and decodes 2x2 pixels, which halves the cost."""

    def __init__(self, config: NetworkConfig):
        super().__init__()
        c, levels = config.channels, config.levels
        self.config, self.state_levels, self.state_channels = config, tuple(range(1, levels + 1)), (c,) * levels
        self.down = nn.ModuleList(_conv(c if i else config.bins + 1, c, 3 if i else 5, 2) for i in range(levels))
        self.recurrent = nn.ModuleList(_ConvGru(c) for _ in range(levels))
        self.residual = _Residual(c)
        self.up = nn.ModuleList(_conv(c, c) for _ in range(levels - 1))
        self.subpixels, self.prediction = _conv(c, 4 * SUBPIXEL_CHANNELS), _conv(SUBPIXEL_CHANNELS, 1)

    def forward(self, planes: Tensor, states: list[Tensor]) -> tuple[Tensor, list[Tensor]]:
        x, after = planes, []
        for down, recurrent, state in zip(self.down, self.recurrent, states, strict=True):
            x = recurrent(torch.relu(down(x)), state)
            after.append(x)
        x = self.residual(x)
        for up, skip in zip(self.up, reversed(after[:-1]), strict=True):
            x = nn.functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
            x = torch.relu(up(x)) + skip
        x = nn.functional.pixel_shuffle(torch.relu(self.subpixels(x)), 2)
        return torch.sigmoid(self.prediction(x).float()), after


def start_states(net: RecurrentUNet, count: int, height: int, width: int) -> list[Tensor]:
    """Zeros on the device of the network's weights."""
    like = next(net.parameters())
    sizes = zip(net.state_channels, net.state_levels, strict=True)
    return [like.new_zeros(count, channels, height >> level, width >> level) for channels, level in sizes]
