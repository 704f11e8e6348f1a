# SPDX-License-Identifier: GPL-3.0-or-later
"""The live view's drawing: where its picture lies in the viewport, the events in it, and what stands beside."""

from __future__ import annotations

import blf
import bpy
import gpu
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector

INSET = 0.35  # of the viewport's width, for a camera that it does not look through
MARGIN_PX = 12

_VERTEX = """
void main() {
  uv = pos;
  gl_Position = ModelViewProjectionMatrix * vec4(corner + pos * size, 0.0, 1.0);
}
"""
# The hues of pecs view on dark ground, sky blue for ON and orange for OFF; linear: the viewport's framebuffer is sRGB.
_FRAGMENT = """
void main() {
  float t_s = texture(last_s, uv).r;
  float strength = t_s == 0.0 ? 0.0 : exp((abs(t_s) - now_s) / decay_s);
  vec3 hue = t_s > 0.0 ? vec3(0.093, 0.456, 0.815) : vec3(0.871, 0.262, 0.021);
  vec3 paper = vec3(0.007, 0.0086, 0.011);
  colour = vec4(mix(paper, hue, max(strength, 1.0 - paper_alpha)), max(strength, paper_alpha));
}
"""


class EventShader:
    """Draws a picture of signed times: `core.live.LiveSensor.last_s`."""

    def __init__(self) -> None:
        info = gpu.types.GPUShaderCreateInfo()
        passed = gpu.types.GPUStageInterfaceInfo("pecs_live_passed")
        passed.smooth("VEC2", "uv")
        info.push_constant("MAT4", "ModelViewProjectionMatrix")
        for kind, name in (("VEC2", "corner"), ("VEC2", "size")):
            info.push_constant(kind, name)
        for name in ("now_s", "decay_s", "paper_alpha"):
            info.push_constant("FLOAT", name)
        info.sampler(0, "FLOAT_2D", "last_s")
        info.vertex_in(0, "VEC2", "pos")
        info.vertex_out(passed)
        info.fragment_out(0, "VEC4", "colour")
        info.vertex_source(_VERTEX)
        info.fragment_source(_FRAGMENT)
        self._shader = gpu.shader.create_from_info(info)
        self._batch = batch_for_shader(self._shader, "TRI_FAN", {"pos": ((0, 0), (1, 0), (1, 1), (0, 1))})

    def draw(self, texture, rectangle: Rectangle, now_s: float, decay_s: float, paper_alpha: float) -> None:
        shader = self._shader
        shader.bind()
        shader.uniform_sampler("last_s", texture)
        shader.uniform_float("corner", rectangle[:2])
        shader.uniform_float("size", rectangle[2:])
        for name, value in (("now_s", now_s), ("decay_s", decay_s), ("paper_alpha", paper_alpha)):
            shader.uniform_float(name, value)
        gpu.state.blend_set("ALPHA")
        self._batch.draw(shader)
        gpu.state.blend_set("NONE")


Rectangle = tuple[float, float, float, float]  # x, y of the lower left corner, width, height in the region's pixels


def centred(width: float, height: float, region) -> Rectangle:
    """The largest of that shape in the middle of the region."""
    scale = min(region.width / width, region.height / height)
    width, height = width * scale, height * scale
    return (region.width - width) / 2, (region.height - height) / 2, width, height


def inset(width: float, height: float, region) -> Rectangle:
    shown = region.width * INSET
    return MARGIN_PX, MARGIN_PX, shown, shown * height / width


def of_camera(camera_matrix: Matrix, projection: Matrix, region, region_3d) -> Rectangle | None:
    """Where a viewport that looks through the camera shows what `projection` shows."""
    from_clip = camera_matrix @ projection.inverted()
    corners = []
    for x, y in ((-1, -1), (1, 1)):
        point = from_clip @ Vector((x, y, 0, 1))
        corners.append(location_3d_to_region_2d(region, region_3d, point.xyz / point.w))
    if None in corners:
        return None
    low, high = corners
    return low.x, low.y, high.x - low.x, high.y - low.y


def part_of_view(projection: Matrix, rectangle: Rectangle, region) -> Matrix:
    """The viewport's projection, of a rectangle in its middle."""
    return Matrix.Diagonal((region.width / rectangle[2], region.height / rectangle[3], 1, 1)) @ projection


def write(lines: list[tuple[str, tuple]], area) -> None:
    """Lines with their colour, from the lower left corner up, beside the tools."""
    scale = bpy.context.preferences.system.ui_scale
    left = sum(r.width for r in area.regions if r.type == "TOOLS") + MARGIN_PX
    blf.size(0, 12 * scale)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 5, 0, 0, 0, 0.9)
    for i, (text, colour) in enumerate(reversed(lines)):
        blf.color(0, *colour)
        blf.position(0, left, MARGIN_PX + 18 * scale * i, 0)
        blf.draw(0, text)
    blf.disable(0, blf.SHADOW)
