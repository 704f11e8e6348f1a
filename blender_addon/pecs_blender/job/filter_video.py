# SPDX-License-Identifier: GPL-3.0-or-later
"""Video from events with the filter of `pecs reconstruct`, encoded by Blender, whose Python has no OpenCV."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import pecs
from pecs._errors import PecsOutputError, UsageError, bad_input
from pecs._files import PartialFile, check_outputs
from pecs._progress import Progress
from pecs.learning.reconstruct import Filter, windows

from .. import stop
from ..scene.cycles import fill
from ..scene.cycles import quiet as no_words

MAX_PICTURES = 100_000


def write(
    events: Path, output: Path, *, fps: float, playback_fps: float, cutoff_hz: float, quiet: bool, verbose: bool
) -> int:
    """Writes an .mp4 with `fps` frames per second of recorded time; returns the number of frames. Odd sizes lose a row
    or column for H.264. Raises PecsError."""
    if output.suffix.lower() != ".mp4":
        raise UsageError(f"-o {output}: the extension must be .mp4")
    check_outputs([events], [output])
    with pecs.EventReader(events) as reader:  # to the end: for the size, which a header may lack, and for progress
        ends_us = [(int(block["t"][0]), int(block["t"][-1])) for block in reader]
        size = reader.info["width"], reader.info["height"]
    if not ends_us or not all(size):
        raise bad_input(events, "", "no events" if all(size) else "no size in pixels", "events of a known size")
    count = int((ends_us[-1][1] - ends_us[0][0]) * fps * 1e-6) + 1
    if count > MAX_PICTURES:
        raise UsageError(f"--fps: got {count} pictures, wanted at most {MAX_PICTURES}")
    progress = Progress("reconstruct", count, quiet=quiet, verbose=verbose)
    with (
        PartialFile(output, keeps_extension=True) as video,
        tempfile.TemporaryDirectory(prefix="pecs_", dir=video.path.absolute().parent) as scratch,
    ):
        stop.remove_at_exit(Path(scratch))
        method, image = Filter(*size, cutoff_hz), bpy.data.images.new("picture", *size)
        image.file_format = "PNG"
        with pecs.EventReader(events) as reader:
            for number, window in enumerate(windows(reader, 1e6 / fps), 1):
                fill(image, method(window)[..., None])
                image.filepath_raw = f"{scratch}/{number:06d}.png"
                _written(output, image.save)
                if Path(image.filepath_raw).read_bytes()[-8:-4] != b"IEND":  # Blender reports no full disk
                    raise PecsOutputError(f"{output}: cannot be written: no space for its pictures")
                progress.at(min(number, count))
                stop.check()
        pictures = sorted(path.name for path in Path(scratch).iterdir())
        with no_words(2):
            _written(output, lambda: _encode(Path(scratch), pictures, size, playback_fps, video))
        video.commit()
    return len(pictures)


def _written(output: Path, write: Callable[[], Any]) -> None:
    """Blender's errors become PecsOutputError."""
    try:
        write()
    except RuntimeError as e:
        raise PecsOutputError(f"{output}: cannot be written: {' '.join(str(e).split())}") from None


def _encode(folder: Path, pictures: list[str], size: tuple[int, int], fps: float, video: PartialFile) -> None:
    """The pictures of the folder as .mp4. Raises PecsOutputError unless all can be read back."""
    scene = bpy.data.scenes.new("video")
    strip = scene.sequence_editor_create().strips.new_image(
        name="pictures", filepath=str(folder / pictures[0]), channel=1, frame_start=1, fit_method="ORIGINAL"
    )
    for name in pictures[1:]:
        strip.elements.append(name)
    scene.frame_start, scene.frame_end = 1, len(pictures)
    render = scene.render
    render.resolution_x, render.resolution_y = (max(2, n // 2 * 2) for n in size)
    render.resolution_percentage = 100
    render.fps, render.fps_base = 1000, 1000 / fps
    scene.view_settings.view_transform = "Standard"  # keeps the pictures' values
    if hasattr(render.image_settings, "media_type"):  # Blender 5
        render.image_settings.media_type = "VIDEO"
    render.image_settings.file_format = "FFMPEG"
    render.ffmpeg.format, render.ffmpeg.codec, render.ffmpeg.constant_rate_factor = "MPEG4", "H264", "HIGH"
    render.use_file_extension = False
    render.filepath = str(video.partial.absolute())
    bpy.ops.render.render(animation=True, scene=scene.name)
    clip = bpy.data.movieclips.load(render.filepath)
    got, wanted = (clip.frame_duration, *clip.size), (len(pictures), render.resolution_x, render.resolution_y)
    if got != wanted:
        why = "got {} readable pictures of {} x {}, wanted {} of {} x {} (disk full?)".format(*got, *wanted)
        raise PecsOutputError(f"{video.path}: cannot be written: {why}")
