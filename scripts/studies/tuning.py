"""Published networks for video from events, tuned with the events of simulators.

    tuning.py STUDY.py EVREAL PIENET OUT NETWORK SIMULATOR [SEED STEPS]

STUDY.py is scripts/studies/reconstruction.py of 7f0022a0 (PARTS = () for the simulators alone), which draws the 48
sequences of light, simulates them and scores the recordings; EVREAL a checkout of github.com/ercanburak/EVREAL, PIENET
the unpacked wheel event-pienet 1.1.3 of PyPI. NETWORK: fire (FireNet+) or pie (PIE-Net-Lite). SIMULATOR: pecs, pecs2
(with v2e's range of thresholds), esim, v2e, or "before".

Plan, written before the first step (2026-11-29): 500 steps of one clip of 80x80 pixels and 24 windows of 10 to 40 ms,
250 if a step takes more than half a second of CPU (it does); gradients through 12 windows; the loss of `pecs train`;
Adam, 2e-4, which falls to 0 over the second half; each simulator's own noise alone. Scores as in the study: correlation
on camerashake after motion, in stillness, on cups (means of windows of 20 and 40 ms), edges of the disk with its corner
frequency (10 and 20 ms). A simulator tunes better than another if it is above it in three of the four.
"""

import functools
import importlib.util
import json
import pickle
import sys
from pathlib import Path

import numpy as np
import torch
from pecs.learning import clips
from pecs.learning.limits import Augmentation, ClipConfig, TrainConfig
from pecs.learning.train import losses_of
from pecs.representations import voxel_grid

STUDY, EVREAL, PIENET, OUT = map(Path, sys.argv[1:5])
REAL, RATE, CHUNK = Path("../shared/data/real"), 2e-4, 12
ALLOWED = {("collections", "OrderedDict"), ("torch._utils", "_rebuild_tensor_v2"), ("torch", "FloatStorage")}


class Tensors(pickle.Unpickler):
    """Nothing but tensors; other things become None."""

    load_ = staticmethod(lambda file, **options: Tensors(file, **options).load())

    def find_class(self, module, name):
        return super().find_class(module, name) if (module, name) in ALLOWED else lambda *a, **k: None


class FireNet(torch.nn.Module):
    def __init__(self):
        super().__init__()
        sys.path.insert(0, str(EVREAL))
        from model.model import FireNet as Network

        loader = type("Loader", (), {"Unpickler": Tensors, "load": Tensors.load_})
        path = EVREAL / "pretrained/FireNet+/model.pth"
        self.net = Network()
        self.net.load_state_dict(torch.load(path, map_location="cpu", pickle_module=loader)["state_dict"])

    def start(self):
        self.net.reset_states()

    def detach(self):
        self.net._states = [state.detach() for state in self.net._states]

    def forward(self, grid):
        return self.net(grid)["image"]


class PieNet(torch.nn.Module):
    """Its forward, which cuts the gradients after each window, is written out without that."""

    def __init__(self):
        super().__init__()
        sys.path.insert(0, str(PIENET))
        from pie_net import load_model

        self.net = load_model(device="cpu", variant="pie-net-lite")

    def start(self):
        self.net.reset_states()

    def detach(self):
        net = self.net
        net.f0, net.prev_var = net.f0.detach(), net.prev_var.detach()
        net.p_states = [(h.detach(), c.detach()) for h, c in net.p_states]

    def forward(self, grid):
        from pie_net.model import SoftClamp

        net = self.net
        if net.f0 is None:
            net.f0 = torch.zeros(len(grid), 1, *grid.shape[2:])
        features, states = net.model(x_event=grid, x_frame=net.f0, p_states=net.p_states, var_map=net.prev_var)
        parts = [net.posify(features[:, i : i + 1]) for i in range(3)]
        mean, variance = net.Z_to_f1(parts[0], parts[1], net.posify(net.cal_k(features)), parts[2])
        net.f0, net.p_states, net.prev_var = SoftClamp.apply(mean), states, variance
        return net.f0


class Method:
    def __init__(self, net, width, height):
        self.net, self.size = net.eval(), (height, width)
        net.start()

    def __call__(self, window):
        height, width = self.size
        grid = voxel_grid(window.events, width, height, 5, window.begin_us, window.end_us)
        grid = np.pad(grid, ((0, 0), (0, -height % 8), (0, -width % 8)))[None].astype(np.float32)
        with torch.no_grad():
            return self.net(torch.from_numpy(grid))[0, 0, :height, :width].numpy().astype(np.float64)


def tuned(net, study, simulator, seed, steps):
    torch.manual_seed(seed)
    data = study.simulated({"pecs2": study.AGAIN}.get(simulator, simulator), OUT / "sequences")
    shape = {"windows": 24, "chunk": CHUNK, "crop": 80, "augmentation": Augmentation(noise_hz=0, bursts=0)}
    config = TrainConfig(clips=ClipConfig(**shape), steps=steps, decay_steps=steps // 2, batch=1, learning_rate=RATE)
    clips.compressed = lambda grid, window_us: grid  # the networks take plain voxel grids
    items = clips.Clips(data, config.clips, 5, seed, steps)
    adam = torch.optim.Adam(net.parameters(), RATE)
    net.train()
    for step in range(steps):
        adam.param_groups[0]["lr"] = config.rate(step)
        net.start()
        planes, wanted = items[step]["planes"], items[step]["picture"]
        for first in range(0, len(planes), CHUNK):
            skip = 0 if first else 1
            made = torch.cat([net(planes[None, k]) for k in range(first, first + CHUNK)])
            adam.zero_grad()
            losses_of(made[skip:], wanted[first + skip : first + CHUNK], config).loss.backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            adam.step()
            net.detach()


def main():
    spec = importlib.util.spec_from_file_location("study", STUDY)
    study = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(study)
    name, simulator, *how = sys.argv[5:]
    net = {"fire": FireNet, "pie": PieNet}[name]()
    if simulator != "before":
        tuned(net, study, simulator, *map(int, how))
    make, found = functools.partial(Method, net), {}
    tests = [study.camerashake(make, REAL / "camerashake", us)[0] for us in (20e3, 40e3)]
    tests += [study.cups(make, REAL / "cups", us)[0] for us in (20e3, 40e3)]
    tests += [study.disk(make, REAL / "R_360_L.hdf5", us, study.DISK_HZ)[0] for us in (10e3, 20e3)]
    for test, measures in ((test, measures) for one in tests for test, measures in one.items()):
        for measure, value in measures.items():
            found.setdefault(f"{test}, {measure}", []).append(np.nan if value is None else value)
    print(name, simulator, *how, json.dumps({key: round(float(np.mean(v)), 4) for key, v in found.items()}))


if __name__ == "__main__":
    main()
