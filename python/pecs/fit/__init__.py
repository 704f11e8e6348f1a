"""A chip profile from recordings of a camera (docs/howto/fit_camera.md).

    found = pecs.fit.fit([Steps("lamp.raw", (1, 0.1)), Still("cap.raw", 0)], chip="imx636")
    found.values["contrast_threshold_on"].value, found.values["contrast_threshold_on"].interval
    found.write("my_camera.json")

The model is the sensor: `pecs.Sensor` simulates the same switches and the same still light with the profile's values,
and the values are chosen so that the statistics of both agree.
"""

from typing import TYPE_CHECKING

from .._lazy import attributes

if TYPE_CHECKING:
    from .davis_fit import fit_davis
    from .davis_recording import Davis
    from .estimate import Fitted, Value, fit
    from .pixel_map import PixelMap
    from .recordings import Disk, Flash, Screen, Steps, Still, Stimulus
    from .stimulus import stimulus_page

__all__ = [
    "Davis", "Disk", "Fitted", "Flash", "PixelMap", "Screen", "Steps", "Still", "Stimulus", "Value", "fit", "fit_davis",
    "stimulus_page",
]  # fmt: skip
_MODULES = {
    "davis_fit": "fit_davis",
    "davis_recording": "Davis",
    "estimate": "Fitted Value fit",
    "pixel_map": "PixelMap",
    "recordings": "Disk Flash Screen Steps Still Stimulus",
    "stimulus": "stimulus_page",
}
__getattr__, __dir__ = attributes(__name__, _MODULES)
