# SPDX-License-Identifier: GPL-3.0-or-later
"""Bands: the parts of the spectrum that a pass renders, and the value that a spectrum has in each.

Placement "means": a band is an interval. In it, light has its mean weighted by the chip's response lambda QE, and a
reflectance its mean weighted by response and lamp (Ward & Eydelberg-Vileshin, Picture Perfect RGB Rendering Using
Spectral Prefiltering and Sharp Color Primaries, Eurographics Workshop on Rendering 2002). The photocurrent of direct
light of one lamp is then exact with any number of bands; what remains is the error of products of reflectances, and of
lamps that differ from their mixture. The intervals are chosen so that this error is small for the scene's own colours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pecs
from pecs._errors import bad_input

from .spectra import Spectrum, srgb_reflectances

STEP_NM = 1.0  # of the integrals
LEAST_STEPS = 4  # of a band
CANDIDATES = (3, 6, 9, 12, 15, 18, 21, 24)  # numbers of bands for --bands auto: whole passes
TOLERANCE = 0.1  # of --bands auto, in contrast thresholds
FINE = 1e-3  # RMS error of ln(photocurrent) below which edges are not moved
RGB_EDGES_NM = (493.0, 588.0)  # between the blue, green and red of RGB colours (spectra.srgb_reflectances)
MOST_MOVED = 12  # bands; with more, equal shares of the light suffice


@dataclass(frozen=True, kw_only=True)
class Bands:
    """The light, and the wavelengths at which it is rendered."""

    chip: pecs.Chip
    count: int | None  # None: as many as the scene's colours and lamps require
    placement: str
    per_pass: int
    min_nm: float | None
    max_nm: float | None
    illuminant: Spectrum  # of emitters that name no spectrum
    light_scale: float
    lux: float | None  # replaces light_scale
    tolerance: float  # RMS error of ln(photocurrent), for count None


@dataclass(frozen=True)
class BandSet:
    """lambda_nm [k]: wavelengths at which lens and glass are traced. grid_nm [n]. of_light, of_reflectance [k, n]: the
    mean in each band of values on the grid; rows have the sum 1."""

    lambda_nm: np.ndarray
    grid_nm: np.ndarray
    of_light: np.ndarray
    of_reflectance: np.ndarray

    def light(self, s: Spectrum) -> np.ndarray:
        return self.of_light @ s(self.grid_nm)

    def reflectance(self, s: Spectrum) -> np.ndarray:
        return self.of_reflectance @ s.reflectance(self.grid_nm)

    def srgb(self) -> np.ndarray:
        """[k, 3]: reflectances = matrix @ linear Rec. 709."""
        return self.of_reflectance @ srgb_reflectances(self.grid_nm)

    def filtered(self, s: Spectrum) -> np.ndarray:
        """[k, 3]: light of s through filters of linear Rec. 709, relative to light(s)."""
        rows = self.of_light * s(self.grid_nm)
        total = rows.sum(axis=1, keepdims=True)
        rows = np.divide(rows, total, out=self.of_light.copy(), where=total > 0)
        return rows @ srgb_reflectances(self.grid_nm)

    def of_pass(self, bands: slice) -> BandSet:
        """The bands of an RGB pass; one of fewer than three bands repeats its last."""
        three = np.arange(bands.start, bands.start + 3).clip(max=bands.stop - 1)
        return BandSet(self.lambda_nm[three], self.grid_nm, self.of_light[three], self.of_reflectance[three])


def points(lambda_nm) -> BandSet:
    """Single wavelengths."""
    at = np.asarray(lambda_nm, float)
    return BandSet(at, at, np.eye(len(at)), np.eye(len(at)))


def passes(n_bands: int, per_pass: int = 3) -> list[slice]:
    """Neighbouring bands share an RGB pass; the last pass may have fewer."""
    return [slice(i, min(i + per_pass, n_bands)) for i in range(0, n_bands, per_pass)]


@dataclass(frozen=True)
class Colours:
    """Spectra of a scene, from which its bands follow. surfaces: reflectances as functions of a grid, `weights` how
    often each occurs; lamps: powers, with their `shares` of the light."""

    surfaces: list
    weights: np.ndarray
    lamps: list
    shares: np.ndarray


@dataclass(frozen=True)
class Chosen:
    """entries: bands as stack.json lists them. Of placement "means": edges_nm; errors of ln(photocurrent); seen [n, k],
    photocurrent in each band of each surface lit by each lamp, weighted by how often they occur."""

    bands: BandSet
    entries: list[dict[str, float]]
    edges_nm: list[float] | None = None
    rms: float | None = None
    largest: float | None = None
    seen: np.ndarray | None = None

    def shares(self, bands: slice) -> dict[str, list[float]]:
        """Shares of these bands in the photocurrent of the scene, and how much they vary with its colours, as options
        of pecs.Lens.camera."""
        seen = np.empty((0, 0)) if self.seen is None else self.seen[:, bands]
        if not seen.any():
            return {}
        weights, mean = seen.sum(1), seen.sum(0) / seen.sum()
        seen, weights = seen[weights > 0], weights[weights > 0]
        off = np.cumsum(seen / weights[:, None] - mean, axis=1)[:, :-1]
        spreads = np.sqrt(np.average(off**2, axis=0, weights=weights))
        return {"band_shares": mean.tolist(), "share_spreads": spreads.tolist()}

    @property
    def record(self) -> dict:
        """For stack.json."""
        if not self.edges_nm:
            return {}
        errors = {"rms": round(self.rms, 4), "largest": round(self.largest, 4)}  # equal on every machine
        return {"band_edges_nm": self.edges_nm, "band_error": errors}


def at_points(chip: pecs.Chip, count: int, placement: str, lamps, min_nm: float | None, max_nm: float | None) -> Chosen:
    entries = pecs.bands(chip, count, placement, lamps, min_nm, max_nm)
    return Chosen(points([band["lambda_nm"] for band in entries]), entries)


def means(
    chip: pecs.Chip,
    count: int | None,
    colours: Colours,
    min_nm: float | None,
    max_nm: float | None,
    tolerance: float,
) -> Chosen:
    """count None: the smallest number of CANDIDATES whose RMS error of ln(photocurrent) is below the tolerance."""
    problem = Problem(chip, colours, min_nm, max_nm)
    if count:
        cells = problem.edges(count, tolerance)
    else:
        for candidate in CANDIDATES:
            cells = problem.edges(min(candidate, problem.most), tolerance)
            if problem.error(cells)[0] <= tolerance:
                break
    return problem.chosen(cells)


class Problem:
    """The spectra on a grid of equal cells; band edges are indices of cells."""

    def __init__(self, chip: pecs.Chip, colours: Colours, min_nm: float | None, max_nm: float | None):
        curve = chip.info["relative_qe"]["lambda_nm"]
        low, high = float(curve[0]), float(curve[-1])
        wide = np.arange(low, high + STEP_NM, STEP_NM)
        lit = wide[_mixture(colours, wide) * _response(chip, wide) > 0]
        if not lit.size:
            raise bad_input("bands", "illuminant", "no light where the chip sees", "lamps inside the QE's range")
        low, high = max(low, lit[0] - STEP_NM), min(high, lit[-1] + STEP_NM)
        low, high = _inside(min_nm, low, high, "--min-wavelength"), _inside(max_nm, low, high, "--max-wavelength")
        if not low < high:
            raise bad_input("bands", "range", f"{low:g} to {high:g} nm", "an increasing range")
        cells = max(LEAST_STEPS, round((high - low) / STEP_NM))
        self._bounds_nm = np.linspace(low, high, cells + 1)
        self.grid_nm = (self._bounds_nm[1:] + self._bounds_nm[:-1]) / 2
        self.most = min(256, cells // LEAST_STEPS)
        self._chip, self._step_nm = chip, (high - low) / cells
        self._response = _response(chip, self.grid_nm) * self._step_nm
        lamps = np.array([lamp(self.grid_nm) for lamp in colours.lamps])
        surfaces = np.array([surface(self.grid_nm) for surface in colours.surfaces]).reshape(-1, cells)
        seen = colours.shares > 0
        self._shares, lamps = colours.shares[seen] / colours.shares[seen].sum(), lamps[seen]
        self._occurrence = colours.weights / colours.weights.sum()
        self._weights = np.outer(self._occurrence, self._occurrence).ravel()
        self._mixture = self._shares @ lamps
        if not (self._mixture * self._response).sum() > 0:
            raise bad_input("bands", "range", f"{low:g} to {high:g} nm, without light", "a range with light")
        twice = 1 + surfaces + surfaces**2
        passed, parts = _filters(chip, self.grid_nm)
        self._pixel_shares = np.outer(parts, self._shares).ravel()  # of each filter and lamp
        lit = [(surfaces * self._response * lamp * part) @ twice.T for part in passed for lamp in lamps]
        self._truth = np.array(lit)
        self._sums = (_sums(self._response), _sums(self._response * lamps), _sums(self._response * self._mixture))
        self._surface_sums = _sums(self._response * self._mixture * surfaces)
        self._nm_sums = _sums(self._response * self._mixture * self.grid_nm)

    def error(self, cells: np.ndarray) -> tuple[float, float]:
        """RMS and largest error of ln(photocurrent), a common factor removed: each surface lit by each lamp, directly
        and by two bounces on each other surface, which fills its view; behind each filter of the chip, which the
        sensor takes at a band's wavelength."""
        light, reflectance = self._rendered(cells)
        twice = (1 + reflectance + reflectance**2).T
        lit = np.diff(self._sums[2][cells])
        lambda_nm = np.diff(self._nm_sums[cells]) / np.where(lit > 0, lit, 1)
        passed, _ = _filters(self._chip, lambda_nm)
        current = np.array([(reflectance * one * part) @ twice for part in passed for one in light])
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.log(current / self._truth).reshape(len(current), -1)
        weights = np.where(np.isfinite(errors), self._pixel_shares[:, None] * self._weights, 0)
        if not (total := weights.sum()) > 0:
            return 0.0, 0.0
        errors = np.where(weights > 0, errors, 0)
        errors = np.where(weights > 0, errors - (weights * errors).sum() / total, 0)
        return float(np.sqrt((weights * errors**2).sum() / total)), float(np.abs(errors).max())

    def seen(self, cells: np.ndarray) -> np.ndarray:
        """Chosen.seen: each pair of a surface and a lamp with its share as weight."""
        light, reflectance = self._rendered(cells)
        seen = (light[:, None] * reflectance).reshape(-1, len(cells) - 1)
        total = seen.sum(1, keepdims=True)
        return np.outer(self._shares, self._occurrence).reshape(-1, 1) * seen / np.where(total > 0, total, 1)

    def _rendered(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Photocurrent of each lamp's own light, and each surface's reflectance, in each band."""
        lit = np.diff(self._sums[2][cells])
        return np.diff(self._sums[1][:, cells]), np.diff(self._surface_sums[:, cells]) / np.where(lit > 0, lit, 1)

    def edges(self, count: int, tolerance: float) -> np.ndarray:
        """Three bands: blue, green and red if the error is tolerable, so that pictures of the stack have colours. Else
        equal shares of the light, unless edges where the scene's colours change have a smaller error: one edge after
        another is added where it helps most, and all are moved while that helps."""
        if not 1 <= count <= self.most:
            raise bad_input("--bands", "count", count, f"1 to {self.most} in this range of wavelengths")
        inner = np.round((np.array(RGB_EDGES_NM) - self._bounds_nm[0]) / self._step_nm).astype(int)
        rgb = np.array([0, *inner, len(self.grid_nm)])
        if count == 3 and np.diff(rgb).min() >= LEAST_STEPS and self.error(rgb)[0] <= tolerance:
            return rgb
        equal = self._equal(count)
        rms = self.error(equal)[0]
        if rms <= FINE or count > MOST_MOVED:
            return equal
        cells = np.array([0, len(self.grid_nm)])
        while len(cells) <= count:
            cells = self._moved(min(self._split(cells), key=lambda one: self.error(one)[0]))
        return cells if self.error(cells)[0] < rms else equal

    def chosen(self, cells: np.ndarray) -> Chosen:
        inside = (np.arange(len(self.grid_nm)) >= cells[:-1, None]) & (np.arange(len(self.grid_nm)) < cells[1:, None])
        of_light = inside * self._response
        share = of_light.sum(axis=1)
        if not (share > 0).all():
            raise bad_input("bands", "range", "a band that the chip does not see", "a range inside its response")
        of_light /= share[:, None]
        lit = inside * self._response * self._mixture
        power = lit.sum(axis=1, keepdims=True)
        of_reflectance = np.divide(lit, power, out=of_light.copy(), where=power > 0)
        lambda_nm = of_reflectance @ self.grid_nm
        weights_nm = share / _response(self._chip, lambda_nm)
        entries = [
            {"lambda_nm": float(nm), "weight_nm": float(weight)}
            for nm, weight in zip(lambda_nm, weights_nm, strict=True)
        ]
        edges_nm = [float(f"{nm:.7g}") for nm in self._bounds_nm[cells]]
        band_set = BandSet(lambda_nm, self.grid_nm, of_light, of_reflectance)
        return Chosen(band_set, entries, edges_nm, *self.error(cells), self.seen(cells))

    def _equal(self, count: int) -> np.ndarray:
        """Bands of equal light, each of LEAST_STEPS cells at least."""
        light = self._sums[2]
        cells = np.interp(np.linspace(0, light[-1], count + 1), light, np.arange(len(light))).round().astype(int)
        cells[0], cells[-1] = 0, len(self.grid_nm)
        for k in range(1, count):
            cells[k] = max(cells[k], cells[k - 1] + LEAST_STEPS)
        for k in range(count - 1, 0, -1):
            cells[k] = min(cells[k], cells[k + 1] - LEAST_STEPS)
        return cells

    def _split(self, cells: np.ndarray) -> Iterator[np.ndarray]:
        for begin, end in zip(cells, cells[1:], strict=False):
            step = max(LEAST_STEPS, (end - begin) // 16)
            for at in range(begin + LEAST_STEPS, end - LEAST_STEPS + 1, step):
                yield np.sort(np.append(cells, at))

    def _moved(self, cells: np.ndarray) -> np.ndarray:
        """Coordinate descent. Gains below a thousandth do not count, so that every machine finds the same edges."""
        best, step = self.error(cells)[0], 16
        while step:
            gained = False
            for k in range(1, len(cells) - 1):
                for by in (-step, step):
                    tried = cells.copy()
                    tried[k] += by
                    if min(tried[k] - tried[k - 1], tried[k + 1] - tried[k]) < LEAST_STEPS:
                        continue
                    if (error := self.error(tried)[0]) < 0.999 * best:
                        best, cells, gained = error, tried, True
            step = step if gained else step // 2
        return cells


def _mixture(colours: Colours, nm: np.ndarray) -> np.ndarray:
    return sum(share * lamp(nm) for share, lamp in zip(colours.shares, colours.lamps, strict=True))


def _response(chip: pecs.Chip, nm: np.ndarray) -> np.ndarray:
    """Photocurrent per spectral irradiance and nm, lambda QE up to a factor."""
    return np.array(chip.amperes_per_unit([{"lambda_nm": float(one), "weight_nm": 1.0} for one in nm]))


def _filters(chip: pecs.Chip, nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[filter, nm]: what the filters of the chip's mosaic let pass, and their parts of the pixels; 1 without mosaic."""
    mosaic = chip.info.get("mosaic")
    if not mosaic:
        return np.ones((1, len(nm))), np.ones(1)
    pattern = "".join(mosaic["pattern"])
    curves = [np.interp(nm, one["lambda_nm"], one["value"], 0, 0) for one in mosaic["filters"].values()]
    return np.array(curves), np.array([pattern.count(name) / len(pattern) for name in mosaic["filters"]])


def _inside(nm: float | None, low: float, high: float, name: str) -> float:
    if nm is None:
        return low if name == "--min-wavelength" else high
    if not low <= nm <= high:
        raise bad_input("bands", name, f"{nm:g} nm", f"{low:g} to {high:g} nm, where lamps and chip's response overlap")
    return nm


def _sums(values: np.ndarray) -> np.ndarray:
    """Sums up to each edge of cells, along the last axis."""
    return np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
