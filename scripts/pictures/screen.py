"""Shared by the scripts that take pictures of Blender's window: areas, and the screen by ImageMagick's `import`."""

import subprocess
from pathlib import Path

import bpy


def window():
    return bpy.context.window_manager.windows[0]


def area(kind: str):
    return next(a for a in window().screen.areas if a.type == kind)


def over(one, **more):
    """The context of an area's main region."""
    region = next(r for r in one.regions if r.type == "WINDOW")
    return bpy.context.temp_override(window=window(), area=one, region=region, **more)


def grab(path: Path, crop: str = "", colours: int = 0) -> None:
    """The screen, or a part of it (WIDTHxHEIGHT+X+Y); colours: their greatest number, 0 for all."""
    words = ["-crop", crop, "+repage"] if crop else []
    words += ["+dither", "-colors", str(colours)] if colours else []
    words += ["-define", "png:compression-level=9", f"PNG8:{path}" if colours else str(path)]
    subprocess.run(["import", "-window", "root", *words], check=True)
