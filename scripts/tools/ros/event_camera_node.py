"""A ROS 2 node: images of a camera in, events out, by pecs.Sensor.

python scripts/tools/ros/event_camera_node.py --ros-args -p chip:=davis346 -r image_raw:=/camera/image_raw
"""

import numpy as np
import pecs
import rclpy
from event_camera_msgs.msg import EventPacket
from rclpy.node import Node
from sensor_msgs.msg import Image

CHANNELS = {"mono8": 1, "rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "32FC1": 1}


class EventCamera(Node):
    """image_raw (sensor_msgs/Image) to events (event_camera_msgs/EventPacket, encoding mono). Images of integers are
    sRGB, 32FC1 is linear light. The first image gives size and start."""

    def __init__(self):
        super().__init__("event_camera")
        self.chip = self.declare_parameter("chip", "imx636").value
        self.photocurrent_a = self.declare_parameter("photocurrent_a", 1e-12).value  # of a white pixel
        self.sensor, self.last_ns, self.count = None, -1, 0
        self.publisher = self.create_publisher(EventPacket, "events", 100)
        self.create_subscription(Image, "image_raw", self.on_image, 100)

    def on_image(self, message):
        if message.encoding not in CHANNELS:
            raise ValueError(f"image_raw: got encoding {message.encoding}, wanted one of {', '.join(CHANNELS)}")
        t_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if t_ns <= self.last_ns:
            self.get_logger().warning(f"image_raw: an image of {t_ns} ns after {self.last_ns} ns was left out")
            return
        if self.sensor is None:
            size = message.width, message.height
            self.sensor = pecs.Sensor(*size, self.chip, photocurrent_a=self.photocurrent_a, seed=1)
            self.start_ns = t_ns
        events = self.sensor.push(self.frame(message), (t_ns - self.start_ns) / 1000)
        self.last_ns = t_ns
        if len(events):
            self.publisher.publish(self.packet(message, events))

    @staticmethod
    def frame(message):
        rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
        rows = rows if message.encoding != "32FC1" else rows.view("<f4")
        channels = CHANNELS[message.encoding]
        pixels = rows[:, : message.width * channels].reshape(message.height, message.width, channels)
        return pixels[..., 0] if channels == 1 else pixels[..., :3].mean(-1).astype(np.uint8)

    def packet(self, image, events):
        """p in bit 63, y from 48, x from 32, ns after time_base from 0."""
        t, x, y, p = (events[name].astype(np.uint64) for name in "txyp")
        packet = EventPacket(height=image.height, width=image.width, encoding="mono", seq=self.count)
        packet.header.frame_id = image.header.frame_id
        packet.time_base = self.start_ns + 1000 * int(t[0])
        packet.header.stamp.sec, packet.header.stamp.nanosec = divmod(packet.time_base, 10**9)
        words = p << np.uint64(63) | y << np.uint64(48) | x << np.uint64(32) | 1000 * (t - t[0])
        packet.events.frombytes(words.astype("<u8").tobytes())
        self.count += 1
        return packet


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(EventCamera())
