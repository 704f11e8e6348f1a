"""What a set says of itself: datasheet.md for people (Gebru et al. 2021), croissant.json for machines (MLCommons
Croissant 1.0)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .._files import write_json, write_text
from .recipe import Recipe

CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "includes": "cr:includes",
    "containedIn": "cr:containedIn",
    "md5": "cr:md5",
}
SETS = {  # of files: id, what, pattern, type
    "events": ("events in DSEC's HDF5 layout", "sequences/*/*/events.h5", "application/x-hdf5"),
    "causes": (
        "cause of each event (`pecs.sensor.LABELS`)",
        "sequences/*/*/causes.npy",
        "application/octet-stream",
    ),
    "objects": ("object of each event at its own time", "sequences/*/*/objects.npy", "application/octet-stream"),
    "pictures": ("pictures of RGB cameras", "sequences/*/*/rgb/*.png", "image/png"),
    "truth": ("depth, normals, objects, flow (EXR)", "sequences/*/*/truth/*.exr", "image/x-exr"),
    "calibration": ("cameras, what was drawn", "sequences/*/sequence.json", "application/json"),
    "poses": ("poses of the rig, TUM", "sequences/*/poses.txt", "text/plain"),
}


def write_cards(recipe: Recipe, manifest: dict[str, Any], output: Path) -> None:
    write_json(output / "croissant.json", _croissant(recipe, manifest))
    write_text(output / "datasheet.md", _datasheet(recipe, manifest))


def _croissant(recipe: Recipe, manifest: dict[str, Any]) -> dict[str, Any]:
    repository = {
        "@type": "cr:FileObject",
        "@id": "set",
        "name": "set",
        "description": "The folder; SHA-256 of all files stand in files.json of each sequence.",
        "contentUrl": ".",
        "encodingFormat": "inode/directory",
        "sha256": recipe.sha256,
    }
    inside = {"@type": "cr:FileSet", "containedIn": {"@id": "set"}}
    files = [
        inside | {"@id": name, "name": name, "description": what, "encodingFormat": kind, "includes": pattern}
        for name, (what, pattern, kind) in SETS.items()
    ]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": recipe.name,
        "description": recipe.about.get("description", f"Simulated events with ground truth: {recipe.name}"),
        "license": recipe.about.get("licence", "not stated"),
        "version": manifest["versions"]["pecs"],
        "distribution": [repository, *files],
    }


def _datasheet(recipe: Recipe, manifest: dict[str, Any]) -> str:
    splits: dict[str, int] = {}
    for row in manifest["sequences"]:
        splits[row["split"]] = splits.get(row["split"], 0) + 1
    scenes = "\n".join(f"- `{s.name}`: {s.path.name}" for s in recipe.scenes)
    cameras = "\n".join(
        f"- `{c.name}`: {c.kind}, {c.chip or 'RGB film'}, lens {c.lens or f'of {c.pixels_of}'}" for c in recipe.cameras
    )
    about = "\n".join(f"- {key}: {value}" for key, value in recipe.about.items())
    return f"""# {recipe.name}

{about}

## What it is
{len(manifest["sequences"])} simulated sequences ({", ".join(f"{n} {name}" for name, n in splits.items())}), made by
PECS {manifest["versions"]["pecs"]} from the recipe in dataset.json (SHA-256 {recipe.sha256}). No person was recorded.

## Scenes
{scenes}

## Cameras
{cameras}

## Ground truth
At {recipe.truth["fps"]:g} Hz: {", ".join(recipe.truth["layers"])}; per event: cause, and object at its own time.
Poses and IMU ({recipe.imu["part"] if recipe.imu else "none"}). Pages report.html say how well the parts agree.

## What it lacks
Thresholds, noise and lamps are drawn from the ranges of the recipe, which may be wider or narrower than those of real
cameras. Motion blur of sharp reflections and refractions is that of the rendered instants.
"""
