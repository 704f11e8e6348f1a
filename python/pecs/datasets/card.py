"""Descriptions of a set: datasheet.md for people (Gebru et al. 2021), croissant.json for machines (MLCommons
Croissant 1.0)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .._files import sha256, write_json, write_text
from .._text import markdown
from .recipe import Recipe
from .sequence import Sequence, sequences

CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    **{name: f"cr:{name}" for name in "fileObject fileSet includes containedIn md5 recordSet field".split()},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    **{name: f"cr:{name}" for name in "source extract jsonPath column fileProperty transform regex key".split()},
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
    "frames": ("frames of DAVIS cameras", "sequences/*/*/frames/images/*.png", "image/png"),
    "truth": ("depth, normals, objects, flow (EXR)", "sequences/*/*/truth/*.exr", "image/x-exr"),
    "calibration": ("cameras, what was drawn", "sequences/*/sequence.json", "application/json"),
    "poses": ("poses of the rig, TUM", "sequences/*/poses.txt", "text/plain"),
    "imu": ("samples of the IMU, EuRoC's columns", "sequences/*/imu.csv", "text/csv"),
}
COLUMNS = {  # of the record set `sequences`: what, type, JSONPath in dataset.json
    "name": ("folder in sequences/", "sc:Text"),
    "split": ("train, val or test", "sc:Text"),
    "scene": ("scene of the recipe", "sc:Text"),
    "sha256": ("SHA-256 of its files.json", "sc:Text"),
}
SPDX = re.compile(r"[A-Za-z0-9]+(-[A-Za-z0-9.+]*[A-Za-z0-9+])+")


def write_cards(recipe: Recipe, manifest: dict[str, Any], output: Path) -> None:
    write_json(output / "croissant.json", _croissant(recipe, manifest, output))
    write_text(output / "datasheet.md", _datasheet(recipe, manifest, sequences(output)))


def _licence(text: str) -> str:
    """The page of an SPDX identifier at the text's start; the text itself without one."""
    found = SPDX.match(text)
    return f"https://spdx.org/licenses/{found[0]}.html" if found else text


def _croissant(recipe: Recipe, manifest: dict[str, Any], output: Path) -> dict[str, Any]:
    listing = {
        "@type": "cr:FileObject",
        "@id": "dataset.json",
        "name": "dataset.json",
        "description": "All sequences, with the SHA-256 of their files.json, which lists all files.",
        "contentUrl": "dataset.json",
        "encodingFormat": "application/json",
        "sha256": sha256(output / "dataset.json"),
    }
    files = [
        {"@type": "cr:FileSet", "@id": name, "name": name, "description": what}
        | {"encodingFormat": kind, "includes": pattern}
        for name, (what, pattern, kind) in SETS.items()
    ]
    fields = [
        {"@type": "cr:Field", "@id": f"sequences/{name}", "name": name, "description": what, "dataType": kind}
        | {"source": {"fileObject": {"@id": "dataset.json"}, "extract": {"jsonPath": f"$.sequences[*].{name}"}}}
        for name, (what, kind) in COLUMNS.items()
    ]
    record_set = {"@type": "cr:RecordSet", "@id": "sequences", "name": "sequences", "key": {"@id": "sequences/name"}}
    about = recipe.about
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": recipe.name,
        "description": about.get("description", f"Simulated events with ground truth: {recipe.name}"),
        **({"license": _licence(about["licence"])} if "licence" in about else {}),
        "version": manifest["versions"]["pecs"],
        "distribution": [listing, *files],
        "recordSet": [record_set | {"description": "One row for each sequence.", "field": fields}],
    }


def _datasheet(recipe: Recipe, manifest: dict[str, Any], made: list[Sequence]) -> str:
    """The datasheet of the sequences that were made, by their own records."""
    shares = ", ".join(f"{n} {markdown(split)}" for split, n in _counts(sequence.split for sequence in made).items())
    scenes = "\n".join(f"- {markdown(name)}: {count}" for name, count in _counts(s.info["scene"] for s in made).items())
    cameras = {
        f"- {markdown(c.name)}: {c.kind}, {c.width} x {c.height}, "
        f"{markdown(c.info['chip'] or 'RGB film')}, lens {markdown(c.info['lens'])}": None
        for sequence in made
        for c in sequence.cameras.values()
    }
    truths = {c.truth for s in made for c in s.cameras.values() if c.has_truth and not c.info["pixels_of"]}
    layers = sorted({layer for truth in truths for layer in truth.layers})
    rates = {float(f"{1e6 / (truth.times_us[1] - truth.times_us[0]):g}") for truth in truths if len(truth) > 1}
    layers_at = f"At {', '.join(f'{hz:g}' for hz in sorted(rates))} Hz: {', '.join(map(markdown, layers))}"
    objects = {"objects", "motion"} <= set(recipe.truth.layers)
    parts = sorted({s.info["imu"]["part"] for s in made if s.info["imu"]}) or ["none"]
    about = "\n".join(f"- {markdown(key)}: {markdown(value)}" for key, value in recipe.about.items())
    seconds = sum(sequence.duration_us for sequence in made) * 1e-6
    outside = [
        f"- {markdown(row['name'])}: {markdown(line)}"
        for row in manifest["sequences"]
        for line in row["outside_limits"]
    ]
    return f"""# {markdown(recipe.name)}

{about}

## What it is
{len(made)} simulated sequences of {seconds:g} s in all ({shares}), made by
PECS {manifest["versions"]["pecs"]} from the recipe in dataset.json (SHA-256 {recipe.sha256}). No person was recorded.

## Scenes
{scenes}

## Cameras
{chr(10).join(cameras)}

## Ground truth
{layers_at if rates else "No layers"}; per event: cause{", and object at its own time" if objects else ""}.
Poses and IMU ({", ".join(map(markdown, parts))}). The page report.html of each sequence shows how well the parts agree.

## Outside the recipe's limits
{chr(10).join(outside) or "None."}

## What it lacks
Thresholds, noise and lamps are drawn from the ranges of the recipe, which may be wider or narrower than those of real
cameras. Motion blur of sharp reflections and refractions is that of the rendered instants.
"""


def _counts(names: Iterable[str]) -> dict[str, int]:
    return dict(Counter(names))
