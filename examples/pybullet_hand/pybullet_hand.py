"""An event camera on the hand of a robot in PyBullet: a new image as soon as the hand has moved by a pixel.

python examples/pybullet_hand/pybullet_hand.py [OUTPUT]        OUTPUT: hand.raw, or .npz, .mcap, …
"""

import sys

import numpy as np
import pecs
import pybullet as bullet
import pybullet_data

WIDTH, HEIGHT, FOV_DEGREES, DURATION_S, STEP_S = 160, 120, 60, 0.25, 1 / 4000
MOST_PX = 0.7  # between two images, so that their pixels need no motion
FOCAL_PX = HEIGHT / 2 / np.tan(np.radians(FOV_DEGREES) / 2)
NEAR_M, FAR_M = 0.05, 10


def image(eye, turn):
    """[HEIGHT, WIDTH] of sRGB and the least depth [m]. TinyRenderer draws hard edges: four samples for each pixel."""
    view = bullet.computeViewMatrix(eye, eye + turn[:, 2], turn[:, 1])
    lens = bullet.computeProjectionMatrixFOV(FOV_DEGREES, WIDTH / HEIGHT, NEAR_M, FAR_M)
    _, _, rgba, depth, _ = bullet.getCameraImage(
        2 * WIDTH, 2 * HEIGHT, view, lens, renderer=bullet.ER_TINY_RENDERER, lightDirection=[1, 1, 2]
    )
    grey = np.reshape(rgba, (HEIGHT, 2, WIDTH, 2, 4))[..., :3].mean((1, 3, 4))
    least_m = FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * np.min(depth))
    return np.uint8(grey), least_m


def main() -> None:
    output = sys.argv[1] if len(sys.argv) > 1 else "hand.raw"
    bullet.connect(bullet.DIRECT)
    bullet.setAdditionalSearchPath(pybullet_data.getDataPath())
    bullet.setGravity(0, 0, -9.81)
    bullet.setTimeStep(STEP_S)
    bullet.loadURDF("plane.urdf")
    bullet.loadURDF("duck_vhacd.urdf", [0.75, 0.05, 0.05], [0.5, 0.5, 0.5, 0.5], globalScaling=2)
    robot = bullet.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
    joints, pose = range(bullet.getNumJoints(robot)), np.array([0, 0.6, 0, -1.3, 0, 1.2, 0])
    for joint in joints:
        bullet.resetJointState(robot, joint, pose[joint])
    due_s, frames, parts = 0.0, 0, []
    with pecs.Sensor(WIDTH, HEIGHT, "davis346", photocurrent_a=1e-12, seed=1) as sensor:
        for i in range(int(DURATION_S / STEP_S)):
            t_s = i * STEP_S
            swing = 0.2 * np.sin(2 * np.pi * 2 * t_s) * np.array([1, 0.3, 0, 0, 0, 0, 2])
            bullet.setJointMotorControlArray(robot, joints, bullet.POSITION_CONTROL, pose + swing)
            bullet.stepSimulation()
            if t_s < due_s:
                continue
            state = bullet.getLinkState(robot, 6, computeLinkVelocity=1, computeForwardKinematics=1)
            turn = np.reshape(bullet.getMatrixFromQuaternion(state[5]), (3, 3))
            frame, least_m = image(np.array(state[4]) + 0.1 * turn[:, 2], turn)
            parts.append(sensor.push(frame, 1e6 * t_s))
            corner = 1 + (np.hypot(WIDTH, HEIGHT) / 2 / FOCAL_PX) ** 2  # pixels there move faster
            speed_px = FOCAL_PX * corner * (np.linalg.norm(state[6]) / least_m + np.linalg.norm(state[7]))
            due_s, frames = t_s + min(MOST_PX / max(speed_px, 1e-3), 0.01), frames + 1
        parts.append(sensor.finish())
    events = pecs.Events(np.concatenate(parts), WIDTH, HEIGHT)
    pecs.write(output, events)
    print(f"{output}: {len(events)} events from {frames} frames, one per {1e3 * DURATION_S / frames:.2f} ms")


if __name__ == "__main__":
    main()
