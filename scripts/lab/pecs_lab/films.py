"""Films that lenses light."""

import pecs

FILMS_MM = ((36.0, 24.0), (6.2208, 3.4992))  # full frame; 1280 x 720 pixels of 4.86 um
LEAST_LIGHT = 0.02  # of the corner, relative to the middle


def covered(name: str) -> tuple[tuple[float, float], dict]:
    """The largest film that a lens of lens_data lights to its corners, and its `Lens.info` there."""
    with pecs.Lens(name) as lens:
        for width, height in FILMS_MM:
            info = lens.info(lambda_nm=587.5618, field_rows=9, film_width_mm=width, film_height_mm=height)
            if info["field"][-1]["relative_illumination"] > LEAST_LIGHT:
                return (width, height), info
    raise SystemExit(f"{name}: lights no film of {FILMS_MM} mm")
