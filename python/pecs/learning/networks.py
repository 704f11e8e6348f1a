"""Recurrent networks that make a picture of each window's voxel grid, written from their papers.

forward(grid [N, bins, H, W], states) -> (picture [N, 1, H, W], states). `states` is a list of tensors, `start_states`
before the first window; state i has the size of the picture over 2**state_levels[i]. H and W: multiples of 2**levels.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from .limits import NetworkConfig


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

    def __init__(self, inside: int, channels: int):
        super().__init__()
        self.gates, self.candidate = _conv(inside + channels, 2 * channels), _conv(inside + channels, channels)

    def forward(self, x: Tensor, state: Tensor) -> Tensor:
        reset, update = torch.sigmoid(self.gates(torch.cat([x, state], 1))).chunk(2, 1)
        new = torch.tanh(self.candidate(torch.cat([x, reset * state], 1)))
        return (1 - update) * state + update * new


class _ConvLstm(nn.Module):
    """ConvLSTM of Shi et al., NeurIPS 2015, eq. 3 without peepholes; the state is hidden and cell, concatenated."""

    def __init__(self, channels: int):
        super().__init__()
        self.gates = _conv(2 * channels, 4 * channels)

    def forward(self, x: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        hidden, cell = state.chunk(2, 1)
        enter, forget, leave, new = self.gates(torch.cat([x, hidden], 1)).chunk(4, 1)
        cell = torch.sigmoid(forget) * cell + torch.sigmoid(enter) * torch.tanh(new)
        hidden = torch.sigmoid(leave) * torch.tanh(cell)
        return hidden, torch.cat([hidden, cell], 1)


class FireNet(nn.Module):
    """Scheerlinck et al., WACV 2020: head, two pairs of ConvGRU and residual block, prediction."""

    def __init__(self, config: NetworkConfig):
        super().__init__()
        c = config.channels
        self.config, self.state_levels, self.state_channels = config, (0, 0), (c, c)
        self.head = _conv(config.bins, c)
        self.recurrent = nn.ModuleList(_ConvGru(c, c) for _ in range(2))
        self.residual = nn.ModuleList(_Residual(c) for _ in range(2))
        self.prediction = _conv(c, 1, 1)

    def forward(self, grid: Tensor, states: list[Tensor]) -> tuple[Tensor, list[Tensor]]:
        x, after = torch.relu(self.head(grid)), []
        for recurrent, residual, state in zip(self.recurrent, self.residual, states, strict=True):
            x = recurrent(x, state)
            after.append(x)
            x = residual(x)
        return torch.sigmoid(self.prediction(x)), after


class E2Vid(nn.Module):
    """Rebecq et al., TPAMI 2019: UNet whose encoders are recurrent, skip connections are sums."""

    def __init__(self, config: NetworkConfig):
        super().__init__()
        widths = [config.channels * 2**i for i in range(config.levels + 1)]
        self.config, self.state_levels = config, tuple(range(1, config.levels + 1))
        self.state_channels = tuple(2 * w for w in widths[1:])
        self.head = _conv(config.bins, widths[0], 5)
        self.down = nn.ModuleList(_conv(a, b, 5, 2) for a, b in pairwise(widths))
        self.recurrent = nn.ModuleList(_ConvLstm(w) for w in widths[1:])
        self.residual = nn.Sequential(_Residual(widths[-1]), _Residual(widths[-1]))
        self.up = nn.ModuleList(_conv(b, a, 5) for a, b in reversed([*pairwise(widths)]))
        self.prediction = _conv(widths[0], 1, 1)

    def forward(self, grid: Tensor, states: list[Tensor]) -> tuple[Tensor, list[Tensor]]:
        x = torch.relu(self.head(grid))
        skips, after = [x], []
        for down, recurrent, state in zip(self.down, self.recurrent, states, strict=True):
            x, state = recurrent(torch.relu(down(x)), state)
            after.append(state)
            skips.append(x)
        x = self.residual(x)
        for up in self.up:
            x = nn.functional.interpolate(x + skips.pop(), scale_factor=2.0, mode="bilinear", align_corners=False)
            x = torch.relu(up(x))
        return torch.sigmoid(self.prediction(x + skips.pop())), after


def network(config: NetworkConfig) -> FireNet | E2Vid:
    return FireNet(config) if config.kind == "firenet" else E2Vid(config)


def start_states(net: FireNet | E2Vid, count: int, height: int, width: int) -> list[Tensor]:
    """Zeros on the device of the network's weights."""
    like = next(net.parameters())
    sizes = zip(net.state_channels, net.state_levels, strict=True)
    return [like.new_zeros(count, channels, height >> level, width >> level) for channels, level in sizes]
