"""An event camera in MuJoCo: its images, depth and poses in, events out. A fast scene has more frames.

MUJOCO_GL=egl python examples/mujoco_camera/mujoco_camera.py [OUTPUT]        OUTPUT: robot.raw, or .npz, .mcap, …
"""

import sys

import mujoco
import numpy as np
import pecs

WIDTH, HEIGHT, DURATION_S = 240, 180, 0.3
MOST_PX = 4.0  # between two frames
SCENE = """<mujoco><option timestep="0.0005"/>
<asset><texture type="skybox" builtin="gradient" rgb1=".6 .7 .8" rgb2=".4 .5 .6" width="64" height="384"/>
<texture name="check" type="2d" builtin="checker" rgb1=".8 .7 .6" rgb2=".2 .3 .4" width="256" height="256"/>
<material name="floor" texture="check" texrepeat="6 6"/><material name="side" texture="check" texrepeat="1 1"/></asset>
<worldbody><light pos="0 -1 3" dir="0 .3 -1" diffuse=".9 .9 .9"/><geom type="plane" size="3 3 .1" material="floor"/>
<camera name="eye" pos="0 -2.3 1" xyaxes="1 0 0 0 .2 1" fovy="45"/>
<body pos="-.5 0 .7"><freejoint/><geom type="box" size=".15 .15 .15" material="side"/></body>
<body pos=".4 0 1"><joint type="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 -.1" size=".05"
rgba=".9 .4 .2 1"/></body></worldbody></mujoco>"""


class Eye:
    """An image with what its motion requires: depth and geom of each pixel, and the poses of camera and geoms."""

    def __init__(self, renderers, data):
        for renderer in renderers:
            renderer.update_scene(data, "eye")
        self.image, self.depth_m, ids = (renderer.render() for renderer in renderers)
        self.geom = np.where(ids[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, ids[..., 0], 0)
        self.places, self.turns = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()
        self.place, self.turn = data.cam_xpos[0].copy(), data.cam_xmat[0].reshape(3, 3) @ np.diag([1, -1, -1])

    def flow(self, other, focal_px):
        """Where the surface points of this image are in another one: [2, HEIGHT, WIDTH] in pixels, x right, y down."""
        y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        ray = np.stack([(x - WIDTH / 2) / focal_px, (y - HEIGHT / 2) / focal_px, np.ones_like(x)], -1)
        world = (ray * self.depth_m[..., None]) @ self.turn.T + self.place
        on_geom = np.einsum("hwji,hwj->hwi", self.turns[self.geom], world - self.places[self.geom])
        world = np.einsum("hwij,hwj->hwi", other.turns[self.geom], on_geom) + other.places[self.geom]
        seen = (world - other.place) @ other.turn
        seen = focal_px * seen[..., :2] / seen[..., 2:]
        return np.stack([seen[..., 0] + WIDTH / 2 - x, seen[..., 1] + HEIGHT / 2 - y])


def main() -> None:
    output = sys.argv[1] if len(sys.argv) > 1 else "robot.raw"
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.qvel[:6] = 1.5, 0, 1, 3, 9, 2  # of the box
    focal_px = HEIGHT / 2 / np.tan(np.radians(model.cam_fovy[0]) / 2)
    renderers = [mujoco.Renderer(model, HEIGHT, WIDTH) for _ in range(3)]
    renderers[1].enable_depth_rendering()
    renderers[2].enable_segmentation_rendering()
    mujoco.mj_forward(model, data)
    frames, steps, before, parts = 0, 1, None, []
    with pecs.Sensor(WIDTH, HEIGHT, "davis346", photocurrent_a=1e-12, seed=1) as sensor:
        while data.time < DURATION_S:
            now = Eye(renderers, data)
            motion = None
            if before:
                motion = np.concatenate([before.flow(now, focal_px), now.flow(before, focal_px)])
                steps = int(np.clip(steps * MOST_PX / max(np.hypot(*motion[:2]).max(), 0.1), 1, 40))
            parts.append(sensor.push(now.image.mean(-1).astype(np.uint8), 1e6 * data.time, motion=motion))
            before, frames = now, frames + 1
            for _ in range(steps):
                mujoco.mj_step(model, data)
        parts.append(sensor.finish())
    events = pecs.Events(np.concatenate(parts), WIDTH, HEIGHT)
    pecs.write(output, events)
    print(f"{output}: {len(events)} events from {frames} frames, one per {1e3 * data.time / frames:.1f} ms")


if __name__ == "__main__":
    main()
