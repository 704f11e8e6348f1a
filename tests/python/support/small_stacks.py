"""Small stacks for tests of `pecs sense`, and a call of it that must succeed."""

import numpy as np
import pytest
from pecs.stack import StackWriter
from pecs_lab.scenes import stack_json

W, H, N = 40, 30, 24


def write(folder, frames=N, level=1e-6, change=None, size=(H, W), **more):
    """A bright bar that moves one turn in `frames` frames of 1 ms, on a film irradiance of `level` W m^-2 nm^-1."""
    stack = stack_json(size[1], size[0], [i * 1_000_000 for i in range(frames)], **more)
    with StackWriter(folder, stack) as writer:
        for i in range(frames):
            x = np.arange(size[1])
            image = level * (1 + 4 * np.exp(4 * np.cos(2 * np.pi * (x / size[1] - i / frames)) - 4))
            values = np.broadcast_to(image, (1, *size)).astype(np.float32)
            if change:
                values = change(i, values.copy())
            writer.write_frame(i, values)
    return folder


def unroll(i, values):
    """Frames of `write` with 4 N frames move a quarter as fast: draw those of N again."""
    x = np.arange(W)
    image = 1e-5 * (1 + 4 * np.exp(4 * np.cos(2 * np.pi * (x / W - (i % N) / N)) - 4))
    return np.broadcast_to(image, values.shape).astype(np.float32)


def read_csv(path):
    lines = [line for line in path.read_text().splitlines() if line and line[0].isdigit()]
    return np.array([[int(v) for v in line.replace(",", " ").split()] for line in lines])


def sense(pecs_program, *args):
    done = pecs_program("sense", *args, "--quiet", check=True)
    return done


def write_exr(path, channels, kind="float", corner=(0, 0), full=None, **attributes):
    """Channels {name: [H, W]} by OpenImageIO, `corner` the first pixel of a picture of `full` size."""
    oiio = pytest.importorskip("OpenImageIO")
    values = np.stack(list(channels.values()), axis=-1).astype(np.float32)
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
    spec.channelnames = list(channels)
    spec.x, spec.y = corner
    spec.full_width, spec.full_height = full or (values.shape[1], values.shape[0])
    for key, value in attributes.items():
        spec.attribute(key, *([f"float[{len(value)}]"] if isinstance(value, tuple) else []), value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec) and out.write_image(values) and out.close()
