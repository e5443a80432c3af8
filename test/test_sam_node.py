#!/usr/bin/env python3
"""sam_masks and mask_player on a master of their own: what they publish for which image."""

import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

import cv2
import numpy as np
import rospy
import rostest
import tf2_ros
from cv_bridge import CvBridge
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CompressedImage, Image

PACKAGE = "lidar_camera_recalibration"
WAIT = 30.0  # [s]


def picture(width=200, height=120):
    image = np.full((height, width, 3), 60, np.uint8)
    image[20:60, 30:100] = (20, 20, 220)
    image[70:110, 110:180] = (220, 20, 20)
    return image


def image_message(stamp, image=None):
    message = CvBridge().cv2_to_imgmsg(picture() if image is None else image, "bgr8")
    message.header.stamp = rospy.Time.from_sec(stamp)
    message.header.frame_id = "camera"
    return message


class Inbox:
    """Keeps what comes on a topic."""

    def __init__(self, topic, kind):
        self.messages = []
        self.subscriber = rospy.Subscriber(topic, kind, self.messages.append, queue_size=100)

    def wait(self, condition, what):
        end = time.monotonic() + WAIT
        while time.monotonic() < end:
            if condition(self.messages):
                return
            time.sleep(0.05)
        raise AssertionError("{} did not come on {}; {} messages came".format(what, self.subscriber.resolved_name,
                                                                            len(self.messages)))

    def wait_for_stamp(self, stamp):
        self.wait(lambda messages: any(abs(m.header.stamp.to_sec() - stamp) < 1e-6 for m in messages),
                  "stamp {}".format(stamp))

    @property
    def stamps(self):
        return [round(message.header.stamp.to_sec(), 6) for message in self.messages]


def publisher(topic, kind):
    """@return a publisher that is connected"""
    result = rospy.Publisher(topic, kind, queue_size=100)
    end = time.monotonic() + WAIT
    while result.get_num_connections() == 0:
        if time.monotonic() > end:
            raise AssertionError("nobody subscribes " + topic)
        time.sleep(0.05)
    return result


def ids(message):
    """@return height x width x layers"""
    kind = np.uint8 if message.encoding.startswith("8") else np.uint16
    return np.frombuffer(message.data, kind).reshape(message.height, message.width, -1)


class SamMasksTest(unittest.TestCase):
    def setUp(self):
        self.masks = Inbox("/camera/masks", Image)
        self.images = publisher("/camera/image_raw", Image)

    def test_masks_of_an_image(self):
        overlay = Inbox("/sam_masks/overlay", Image)
        diagnostics = Inbox("/diagnostics", DiagnosticArray)
        time.sleep(0.5)  # for the connections to the node's publishers
        self.images.publish(image_message(100.25))
        self.masks.wait_for_stamp(100.25)
        message = self.masks.messages[-1]
        self.assertEqual((message.header.frame_id, message.width, message.height, message.encoding),
                         ("camera", 200, 120, "8UC1"))
        layer = ids(message)[:, :, 0]
        self.assertTrue((layer > 0).all())
        self.assertEqual(len({layer[40, 60], layer[90, 150], layer[5, 5]}), 3)
        self.assertEqual(len(np.unique(layer[25:55, 35:95])), 1)
        overlay.wait_for_stamp(100.25)
        self.assertEqual((overlay.messages[-1].encoding, overlay.messages[-1].width), ("bgr8", 200))

        def told(messages):
            for status in (status for message in messages for status in message.status):
                values = {value.key: value.value for value in status.values}
                if status.name.startswith("sam_masks") and values.get("images segmented", "0") != "0":
                    return float(values["time for the last image [s]"]) >= 0.0 and \
                        int(values["masks of the last image"]) >= 3 and status.level == DiagnosticStatus.OK
            return False
        diagnostics.wait(told, "a status with masks and time")

    def test_a_bad_image_is_told_and_the_next_one_taken(self):
        diagnostics = Inbox("/diagnostics", DiagnosticArray)
        bad = image_message(200.0)
        bad.encoding = "no such encoding"
        self.images.publish(bad)
        diagnostics.wait(lambda messages: any(
            status.level == DiagnosticStatus.WARN and "no such encoding" in status.message
            for message in messages for status in message.status), "a warning")
        self.images.publish(image_message(201.0))
        self.masks.wait_for_stamp(201.0)
        self.assertNotIn(200.0, self.masks.stamps)

    def test_only_the_newest_image_is_taken(self):
        large = cv2.resize(picture(), (1600, 1000))
        for k in range(20):
            self.images.publish(image_message(300.0 + k, large))
        self.masks.wait_for_stamp(319.0)
        self.assertLess(len(self.masks.messages), 15)
        self.assertEqual(self.masks.stamps, sorted(self.masks.stamps))


class MovingTest(unittest.TestCase):
    def test_images_are_taken_when_the_camera_has_moved(self):
        masks = Inbox("/moving_masks", Image)
        images = publisher("/moving_image/compressed", CompressedImage)
        broadcaster = tf2_ros.TransformBroadcaster()
        time.sleep(1.0)  # for the listener's connection
        data = cv2.imencode(".png", picture())[1].tobytes()
        for stamp, place in ((1.0, 0.0), (2.0, 4.0), (3.0, 6.0), (4.0, 8.0), (5.0, 20.0)):
            transform = TransformStamped()
            transform.header.stamp = rospy.Time.from_sec(stamp)
            transform.header.frame_id, transform.child_frame_id = "map", "camera"
            transform.transform.translation.x = place
            transform.transform.rotation.w = 1.0
            broadcaster.sendTransform(transform)
            message = CompressedImage(format="png", data=data)
            message.header.stamp, message.header.frame_id = transform.header.stamp, "camera"
            images.publish(message)
            time.sleep(1.0)
        masks.wait_for_stamp(5.0)
        self.assertEqual(masks.stamps, [1.0, 3.0, 5.0])


class MaskPlayerTest(unittest.TestCase):
    def play(self, names, stamps, *parameters):
        """@return ids of the masks that came, by stamp; file k holds one mask of k + 1 rows"""
        topic = "/player_{}".format(abs(hash((tuple(names), parameters))))
        with tempfile.TemporaryDirectory() as folder:
            for k, name in enumerate(names):
                labels = np.zeros((120, 200), np.uint16)
                labels[:k + 1] = 7
                cv2.imwrite(str(pathlib.Path(folder) / (name + ".png")), labels)
            player = subprocess.Popen(
                ["rosrun", PACKAGE, "mask_player", "__name:=player{}".format(topic[8:]), "_folder:=" + folder,
                 "image:={}/image".format(topic), "masks:={}/masks".format(topic)] + list(parameters))
            try:
                masks = Inbox(topic + "/masks", Image)
                images = publisher(topic + "/image", Image)
                time.sleep(0.5)
                for stamp in stamps:
                    images.publish(image_message(stamp))
                    time.sleep(0.1)
                masks.wait(lambda messages: len(messages) >= 2, "two masks")
                time.sleep(0.5)
            finally:
                player.terminate()
                player.wait(20)
        return [(message.header.stamp.to_sec(), int((ids(message)[:, 0, 0] > 0).sum())) for message in masks.messages]

    def test_by_stamp(self):
        self.assertEqual(self.play(["10.5", "12.25", "14000000000000000"], [10.5, 11.5, 12.252]),
                         [(10.5, 1), (12.252, 2)])

    def test_by_order_and_again(self):
        self.assertEqual(self.play(["a", "b"], [1.0, 2.0, 3.0, 1.0], "_match:=order"), [(1.0, 1), (2.0, 2), (1.0, 1)])

    def test_bad_parameters_end_it_with_a_message(self):
        for parameters, words in (("_folder:=/nowhere",), "no such folder"), (("_folder:=/", "_match:=luck"), "luck"):
            run = subprocess.run(["rosrun", PACKAGE, "mask_player", *parameters], stdout=subprocess.PIPE,
                                 stderr=subprocess.STDOUT, universal_newlines=True, timeout=60)
            self.assertEqual(run.returncode, 1)
            self.assertIn(words, run.stdout)


if __name__ == "__main__":
    rospy.init_node("test_sam_masks")
    rostest.rosrun(PACKAGE, "test_sam_masks", sys.modules["__main__"].__name__)
