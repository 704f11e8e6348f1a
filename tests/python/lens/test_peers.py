"""Our tracer against optiland and rayoptics (PyPI), which share no code with it or each other."""

import csv
import io
import json
import math

import numpy as np
import pytest

LAMBDA_NM = 550.0


def prescriptions(root):
    """Those shipped, and those whose stop's plane cuts its neighbour."""
    return sorted([*(root / "lens_data/lenses").glob("*.json"), *(root / "tests/lens/lenses").glob("*.json")])


def pytest_generate_tests(metafunc):
    from conftest import ROOT

    if "lens_path" in metafunc.fixturenames:
        metafunc.parametrize("lens_path", prescriptions(ROOT), ids=lambda p: p.stem)


@pytest.fixture
def lens(lens_path, pecs_program):
    """The prescription, the index behind each surface at LAMBDA_NM, and first-order data."""
    data = json.loads(lens_path.read_text())
    done = pecs_program("lens", "info", lens_path, "--wavelength", LAMBDA_NM, "--json", check=True)
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
    done = pecs_program(
        "lens", "trace", lens_path, "--wavelength", LAMBDA_NM, "--to-z", repr(z), input=lines, check=True
    )
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    return (
        np.array([row["status"] == "ok" for row in rows]),
        np.array([[float(row[k]) for k in ("x", "y", "z", "dx", "dy", "dz")] for row in rows]),
    )


def tolerance_mm(surfaces):
    return 1e-8 if any(s["type"] == "asphere" for s in surfaces) else 1e-9


def powers(surface):
    return {int(p): c for key in ("even_coeffs", "odd_coeffs") for p, c in surface.get(key, {}).items()}


def optiland_trace(surfaces, n, stop, last_thickness):
    """Optiland's tracer of surfaces with index n behind each: (start, direction) -> hits per surface and directions at
    the end, NaN where a ray fails; and its EFL."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic
    from optiland.rays import RealRays

    model = Optic()
    model.surfaces.add(index=0, radius=math.inf, thickness=math.inf)
    for i, s in enumerate(surfaces):
        thickness = last_thickness if i + 1 == len(surfaces) else s["thickness"]
        options = {"radius": s["radius"] or math.inf, "thickness": thickness, "is_stop": i == stop}
        if s["type"] == "asphere":
            terms = powers(s)
            options |= {"surface_type": "even_asphere", "conic": s.get("k", 0.0), "tol": 1e-13}
            options["coefficients"] = [terms.get(p, 0.0) for p in range(2, 18, 2)]
        model.surfaces.add(index=i + 1, material=IdealMaterial(n=n[i]), **options)
    model.surfaces.add(index=len(surfaces) + 1)
    model.set_aperture(aperture_type="EPD", value=1.0)
    model.fields.set_type(field_type="angle")
    model.fields.add(y=0)
    model.wavelengths.add(value=LAMBDA_NM * 1e-3, is_primary=True)

    def trace(start, direction):
        one = np.ones(len(start))
        rays = RealRays(*np.transpose(start), *np.transpose(direction), one, one * LAMBDA_NM * 1e-3)
        model.surfaces.trace(rays, skip=1)  # the object surface lies at infinity
        hits = np.stack([np.array(model.surfaces.x), np.array(model.surfaces.y)], axis=-1)
        return hits.reshape(len(surfaces) + 1, -1, 2), np.column_stack([rays.L, rays.M, rays.N])

    return trace, float(model.paraxial.f2())


def rayoptics_trace(surfaces, n, last_thickness, start_z):
    """The same of rayoptics, from the plane start_z; a ray that fails raises."""
    from rayoptics.elem import profiles
    from rayoptics.elem.surface import Surface
    from rayoptics.raytr import raytrace

    # Its raw trace takes a path: (interface, gap, transform to the next, index, z direction).
    shapes = [profiles.Spherical(c=0.0)]
    for s in surfaces:
        c = 1 / s["radius"] if s["radius"] else 0.0
        if s["type"] == "asphere":
            terms = powers(s)
            shapes.append(
                profiles.EvenPolynomial(c=c, cc=s.get("k", 0.0), coefs=[terms.get(p, 0.0) for p in range(2, 18, 2)])
            )
        else:
            shapes.append(profiles.Spherical(c=c))
    thickness = [-start_z] + [s["thickness"] for s in surfaces[:-1]] + [last_thickness]
    path = [
        (Surface(profile=shape, interact_mode="transmit"), None, (np.identity(3), np.array([0.0, 0.0, t])), index, 1.0)
        for shape, t, index in zip(shapes, thickness, [1.0, *n], strict=True)
    ]
    path.append((Surface(profile=profiles.Spherical(c=0.0), interact_mode="transmit"), None, None, 1.0, 1.0))

    def trace(start, direction):
        rays = [
            raytrace.trace_raw(iter(path), np.array([*p[:2], 0.0]), d, LAMBDA_NM)[0]
            for p, d in zip(start, direction, strict=True)
        ]
        hits = np.array([[segment[0][:2] for segment in ray[1:]] for ray in rays]).transpose(1, 0, 2)
        return hits, np.array([ray[-2][1] for ray in rays])

    return trace


def field_of(pecs_program, lens_path):
    """Our info over the largest of two films that the lens lights."""
    for film in (("--film-width", 36, "--film-height", 24), ()):
        done = pecs_program(
            "lens", "info", lens_path, "--wavelength", LAMBDA_NM, "--field-rows", 3, "--json", *film, check=True
        )
        info = json.loads(done.stdout)
        if info["field"][-1]["relative_illumination"] > 0.02:
            return info
    raise AssertionError("the lens lights no film")


def check_distortion_and_bfl(trace, stop, info, start_z):
    """By the other tracer's real rays: the back focus of a ray near the axis, and for our field angles the film radius
    of the ray through the stop's centre."""

    def through(tangent, x_entrance):
        x = np.atleast_1d(x_entrance) + tangent * start_z  # given where the ray crosses z = 0
        start = np.column_stack([x, np.zeros((len(x), 1)), np.full(len(x), start_z)])
        direction = np.tile(np.array([tangent, 0, 1]) / math.hypot(tangent, 1), (len(x), 1))
        return trace(start, direction)

    def chief_radius(tangent):
        x0 = -tangent * info["entrance_pupil_z_mm"]
        x1 = x0 + 1e-3
        h0, h1 = (through(tangent, x)[0][stop, 0, 0] for x in (x0, x1))
        for _ in range(40):
            if abs(h1) < 1e-11 or h1 == h0:
                break
            x0, x1 = x1, x1 - h1 * (x1 - x0) / (h1 - h0)
            h0, h1 = h1, through(tangent, x1)[0][stop, 0, 0]
        assert abs(h1) < 1e-9
        return through(tangent, x1)[0][-1, 0, 0]

    h = 1e-5 * info["efl_mm"]
    hits, direction = through(0.0, h)
    slope = direction[0, 0] / direction[0, 2]
    assert -hits[-2, 0, 0] / slope == pytest.approx(info["bfl_mm"], rel=1e-6)
    assert -h / slope == pytest.approx(info["efl_mm"], rel=1e-6)
    small = 1e-4
    k = chief_radius(small) / small
    for row in info["field"][1:]:
        tangent = math.tan(math.radians(row["angle_deg"]))
        theirs = 100 * (abs(chief_radius(tangent)) / (abs(k) * tangent) - 1)
        print(f"distortion at {row['r_mm']:.3f} mm: {row['distortion_percent']:.6f} %, theirs {theirs:.6f} %")
        assert theirs == pytest.approx(row["distortion_percent"], abs=1e-3)


def test_against_optiland(lens, lens_path, pecs_program):
    pytest.importorskip("optiland")
    surfaces, n, stop, info = lens
    gap = info["film_z_mm"] - info["rear_vertex_z_mm"]
    trace, efl = optiland_trace(surfaces, n, stop, gap)
    assert efl == pytest.approx(info["efl_mm"], rel=1e-6)
    start, direction = bundle(surfaces, info)
    ok, mine = ours(pecs_program, lens_path, start, direction, info["film_z_mm"])
    assert ok.sum() > 30
    hits, _ = trace(start[ok], direction[ok])
    worst = np.abs(hits[-1] - mine[ok, :2]).max()
    print(f"{lens_path.stem}: {worst:.2g} mm")
    assert worst < tolerance_mm(surfaces)
    check_distortion_and_bfl(trace, stop, field_of(pecs_program, lens_path), -20.0)


def test_relative_illumination_against_optiland(lens, lens_path, pecs_program):
    pytest.importorskip("optiland")
    surfaces, n, stop, _ = lens
    info = field_of(pecs_program, lens_path)
    # The lens turned round: light from the film point to a grid on the plane of the rear vertex.
    turned = []
    for i, s in enumerate(reversed(surfaces)):
        new = s | {
            "radius": s["radius"] and -s["radius"],
            "thickness": surfaces[-2 - i]["thickness"] if i + 1 < len(surfaces) else 1.0,
        }
        for key in ("even_coeffs", "odd_coeffs"):
            if key in s:
                new[key] = {p: -c for p, c in s[key].items()}
        turned.append(new)
    trace, _ = optiland_trace(turned, [*n[-2::-1], 1.0], len(surfaces) - 1 - stop, 1.0)
    gap, semi = info["film_z_mm"] - info["rear_vertex_z_mm"], np.array([s["semi_diameter"] for s in turned])

    def passing(r, left, right, up, count):
        """(1 / d^4, x, y, cell) of the rays that get through, from a grid over half a rectangle of that plane."""
        x, y = np.meshgrid(
            left + (np.arange(count) + 0.5) / count * (right - left), (np.arange(count) + 0.5) / count * up
        )
        way = np.column_stack([x.ravel() - r, y.ravel(), np.full(x.size, gap)])
        length = np.linalg.norm(way, axis=1)
        hits, _ = trace(np.tile([r, 0.0, -gap], (x.size, 1)), way / length[:, None])
        with np.errstate(invalid="ignore"):
            ok = (np.linalg.norm(hits[:-1], axis=2) <= semi[:, None]).all(axis=0)
        return length[ok] ** -4.0, x.ravel()[ok], y.ravel()[ok], (right - left) * up / count**2

    def irradiance(r):
        reach = 1.4 * semi[0]
        _, x, y, _ = passing(r, -reach, reach, reach, 120)
        step = 2 * reach / 120
        value, _, _, cell = passing(r, x.min() - step, x.max() + step, y.max() + step, 300)
        return gap**2 * cell * value.sum()

    axis = irradiance(0.0)
    for row in info["field"][1:]:
        theirs = irradiance(row["r_mm"]) / axis
        print(f"{lens_path.stem}: {row['r_mm']:.3f} mm: {row['relative_illumination']:.5f}, theirs {theirs:.5f}")
        assert theirs == pytest.approx(row["relative_illumination"], abs=2e-3)


def test_against_rayoptics(lens, lens_path, pecs_program):
    pytest.importorskip("rayoptics")
    surfaces, n, stop, info = lens
    trace = rayoptics_trace(surfaces, n, info["film_z_mm"] - info["rear_vertex_z_mm"], -20.0)
    start, direction = bundle(surfaces, info)
    ok, mine = ours(pecs_program, lens_path, start, direction, info["film_z_mm"])
    some = np.flatnonzero(ok)[:120]
    hits, _ = trace(start[some], direction[some])
    worst = np.abs(hits[-1] - mine[some, :2]).max()
    print(f"{lens_path.stem}: {worst:.2g} mm")
    assert worst < tolerance_mm(surfaces)
    check_distortion_and_bfl(trace, stop, field_of(pecs_program, lens_path), -20.0)
