"""Our tracer against optiland and rayoptics (PyPI), which share no code with it or each other."""

import csv
import io
import json
import math

import numpy as np
import pytest

LAMBDA_NM = 550.0


def shipped(root):
    return sorted((root / "lens_data/lenses").glob("*.json"))


def pytest_generate_tests(metafunc):
    from conftest import ROOT

    if "lens_path" in metafunc.fixturenames:
        metafunc.parametrize("lens_path", shipped(ROOT), ids=lambda p: p.stem)


@pytest.fixture
def lens(lens_path, pecs_program):
    """The prescription, the index behind each surface at LAMBDA_NM, and first-order data."""
    data = json.loads(lens_path.read_text())
    done = pecs_program("lens", "info", lens_path, "--lambda-nm", LAMBDA_NM, "--json")
    assert done.returncode == 0, done.stderr
    info = json.loads(done.stdout)
    index = {g["surface"]: g["n"] for g in info["glasses"]}
    return data["surfaces"], [index.get(i, 1.0) for i in range(len(data["surfaces"]))], data["stop_index"], info


def bundle(surfaces, info, count=300):
    """Rays through and around the entrance pupil, up to 0.3 rad, from the plane z = -20 mm."""
    random = np.random.default_rng(1)
    slope = 0.3 * min(1.0, 8.0 / info["efl_mm"])
    radius = 0.5 * info["entrance_pupil_diameter_mm"]
    aim = radius * random.uniform(-0.8, 0.8, (count, 2))
    tangent = random.uniform(-slope, slope, (count, 2))
    start = aim + tangent * (-20 - info["entrance_pupil_z_mm"])
    direction = np.column_stack([tangent, np.ones(count)])
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return np.column_stack([start, np.full(count, -20.0)]), direction


def ours(pecs_program, lens_path, start, direction, z):
    lines = "\n".join(",".join(map(repr, map(float, row))) for row in np.hstack([start, direction]))
    done = pecs_program("lens", "trace", lens_path, "--lambda-nm", LAMBDA_NM, "--to-z-mm", repr(z), input=lines)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    return (
        np.array([row["status"] == "ok" for row in rows]),
        np.array([[float(row[k]) for k in ("x", "y", "z", "dx", "dy", "dz")] for row in rows]),
    )


def tolerance_mm(surfaces):
    return 1e-8 if any(s["type"] == "asphere" for s in surfaces) else 1e-9


def powers(surface):
    return {int(p): c for key in ("even_coeffs", "odd_coeffs") for p, c in surface.get(key, {}).items()}


def test_against_optiland(lens, lens_path, pecs_program):
    optic = pytest.importorskip("optiland.optic")
    materials = pytest.importorskip("optiland.materials")
    from optiland.rays import RealRays

    surfaces, n, stop, info = lens
    film_z = info["film_z_mm"]
    model = optic.Optic()
    model.surfaces.add(index=0, radius=math.inf, thickness=math.inf)
    z = 0.0
    for i, s in enumerate(surfaces):
        last = i + 1 == len(surfaces)
        thickness = film_z - z if last else s["thickness"]
        options = {"radius": s["radius"] or math.inf, "thickness": thickness, "is_stop": i == stop}
        if s["type"] == "asphere":
            terms = powers(s)
            options |= {"surface_type": "even_asphere", "conic": s.get("k", 0.0), "tol": 1e-13}
            options["coefficients"] = [terms.get(p, 0.0) for p in range(2, 18, 2)]
        model.surfaces.add(index=i + 1, material=materials.IdealMaterial(n=n[i]), **options)
        z += thickness
    model.surfaces.add(index=len(surfaces) + 1)
    model.set_aperture(aperture_type="EPD", value=1.0)
    model.fields.set_type(field_type="angle")
    model.fields.add(y=0)
    model.wavelengths.add(value=LAMBDA_NM * 1e-3, is_primary=True)

    assert float(model.paraxial.f2()) == pytest.approx(info["efl_mm"], rel=1e-6)
    start, direction = bundle(surfaces, info)
    ok, mine = ours(pecs_program, lens_path, start, direction, film_z)
    assert ok.sum() > 30
    one = np.ones(ok.sum())
    rays = RealRays(*start[ok].T, *direction[ok].T, one, one * LAMBDA_NM * 1e-3)
    model.surfaces.trace(rays, skip=1)  # the object surface lies at infinity
    theirs = np.column_stack([np.ravel(rays.x), np.ravel(rays.y)])
    assert np.abs(theirs - mine[ok, :2]).max() < tolerance_mm(surfaces)


def test_against_rayoptics(lens, lens_path, pecs_program):
    pytest.importorskip("rayoptics")
    from rayoptics.elem import profiles
    from rayoptics.raytr import raytrace

    surfaces, n, _, info = lens
    film_z = info["film_z_mm"]
    # rayoptics' raw trace takes a path: (interface, gap, transform to the next, index, z direction).
    from rayoptics.elem.surface import Surface

    start, direction = bundle(surfaces, info)
    ok, mine = ours(pecs_program, lens_path, start, direction, film_z)
    shapes = []
    for s in surfaces:
        c = 1 / s["radius"] if s["radius"] else 0.0
        if s["type"] == "asphere":
            terms = powers(s)
            shape = profiles.EvenPolynomial(c=c, cc=s.get("k", 0.0), coefs=[terms.get(p, 0.0) for p in range(2, 18, 2)])
        else:
            shape = profiles.Spherical(c=c)
        shapes.append(Surface(profile=shape, interact_mode="transmit"))
    dummy = [Surface(profile=profiles.Spherical(c=0.0), interact_mode="transmit") for _ in range(2)]
    thickness = [20.0] + [s["thickness"] for s in surfaces[:-1]]
    thickness.append(film_z - sum(thickness[1:]))
    path = []
    identity = np.identity(3)
    for shape, t, index in zip([dummy[0], *shapes], thickness, [1.0, *n], strict=True):
        path.append((shape, None, (identity, np.array([0.0, 0.0, t])), index, 1.0))
    path.append((dummy[1], None, None, 1.0, 1.0))
    worst = 0.0
    for i in np.flatnonzero(ok)[:120]:
        ray, _, _ = raytrace.trace_raw(iter(path), np.array([*start[i, :2], 0.0]), direction[i], LAMBDA_NM)
        worst = max(worst, np.abs(ray[-1][0][:2] - mine[i, :2]).max())
    assert worst < tolerance_mm(surfaces)
