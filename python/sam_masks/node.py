"""The ROS node: newest image in, masks with its stamp out."""
import time

import cv2
import diagnostic_updater
import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Image

from sam_masks import parameters
from sam_masks.backends import BackendError
from sam_masks.masks import draw, pack_layers
from sam_masks.messages import ImageError, mask_message, picture_message, rgb_image, subscribe_images
from sam_masks.newest import Gate, Newest
from sam_masks.segmenter import make_segmenter, step_back

WARN_EVERY = 10.0  # the same warning [s]


class Statistics:
    """What the diagnostics tell. Written and read by different threads, value by value."""

    def __init__(self):
        self.images = self.refused = self.masks = self.left_out = 0
        self.seconds = self.mean_seconds = 0.0
        self.problem = ""

    def count(self, seconds, masks, left_out):
        self.images += 1
        self.seconds, self.masks, self.left_out = seconds, masks, left_out
        self.mean_seconds += (seconds - self.mean_seconds) / self.images
        self.problem = ""


class SamMasksNode:
    """Segments one image after the other in the thread that calls `run`; callbacks only keep the newest."""

    def __init__(self, values, segmenter):
        self.values, self.segmenter = values, segmenter
        self.gate = Gate(values["min_interval"], values["min_distance"])
        self.newest, self.statistics = Newest(), Statistics()
        self.masks = rospy.Publisher("masks", Image, queue_size=2)
        self.overlay = rospy.Publisher("~overlay", Image, queue_size=1)
        self.tf = self._listen_to_tf() if values["min_distance"] > 0.0 else None
        self.updater = diagnostic_updater.Updater()
        self.updater.setHardwareID(values["backend"])
        self.updater.add("masks", self._diagnose)
        self.timer = rospy.Timer(rospy.Duration(1.0), lambda event: self.updater.update(), reset=True)
        self.subscriber = subscribe_images(self.newest.put, values["compressed"])

    def run(self):
        while not rospy.is_shutdown():
            message = self.newest.take(timeout=0.2)
            if message is None or not self._wanted(message.header):
                continue
            try:
                self._process(message)
            except ImageError as problem:
                self._complain("an image on {} is refused: {}".format(self.subscriber.resolved_name, problem))
            except Exception as problem:  # a backend's library may throw anything; the next image may do
                self._complain("segmenting an image failed: {}: {}".format(type(problem).__name__, problem))

    def _process(self, message):
        start = time.monotonic()
        image = rgb_image(message)
        masks = self.segmenter.segment(image, stop=rospy.is_shutdown)
        if masks is None:
            return
        layers, left_out = pack_layers(masks, image.shape[0], image.shape[1], self.values["max_layers"])
        self.masks.publish(mask_message(message.header, layers))
        self.statistics.count(time.monotonic() - start, len(masks), left_out)
        rospy.loginfo("%d masks in %.1f s", len(masks), self.statistics.seconds)
        if self.overlay.get_num_connections() > 0:
            picture = draw(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), masks)
            self.overlay.publish(picture_message(message.header, picture))

    def _wanted(self, header):
        place = None
        if self.tf is not None:
            place = self._place(header)
            if place is None:
                return False
        return self.gate.passes(header.stamp.to_sec(), place)

    def _listen_to_tf(self):
        buffer = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(buffer)
        return buffer

    def _place(self, header):
        """@return where the camera was, in the fixed frame [m]; None if tf does not tell"""
        fixed = self.values["fixed_frame"]
        try:
            transform = self.tf.lookup_transform(fixed, header.frame_id, header.stamp, rospy.Duration(0.2))
        except tf2_ros.TransformException as problem:
            self._complain("min_distance needs tf from '{}' to '{}', set fixed_frame to a frame in which the vehicle "
                           "moves or min_distance to 0: {}".format(fixed, header.frame_id, problem))
            return None
        place = transform.transform.translation
        return place.x, place.y, place.z

    def _complain(self, problem):
        self.statistics.refused += 1
        self.statistics.problem = problem
        rospy.logwarn_throttle(WARN_EVERY, problem)

    def _diagnose(self, status):
        statistics = self.statistics
        if statistics.problem:
            status.summary(DiagnosticStatus.WARN, statistics.problem)
        elif self.subscriber.get_num_connections() == 0:
            status.summary(DiagnosticStatus.WARN, "nobody publishes " + self.subscriber.resolved_name)
        elif statistics.images == 0:
            status.summary(DiagnosticStatus.OK, "no image segmented yet")
        else:
            status.summary(DiagnosticStatus.OK, "{} masks in {:.1f} s".format(statistics.masks, statistics.seconds))
        for name, value in (("backend", self.values["backend"]),
                            ("images segmented", statistics.images),
                            ("masks of the last image", statistics.masks),
                            ("masks of the last image that fit into no layer", statistics.left_out),
                            ("time for the last image [s]", "{:.2f}".format(statistics.seconds)),
                            ("time per image, mean [s]", "{:.2f}".format(statistics.mean_seconds)),
                            ("images passed over for a newer one", self.newest.replaced),
                            ("images refused", statistics.refused)):
            status.add(name, str(value))
        return status


def main(home):
    """@param home folder of what './bootstrap sam' made  @return exit status"""
    rospy.init_node("sam_masks")
    try:
        values, unknown = parameters.read(rospy.get_param("~", {}))
        for name in unknown:
            rospy.logwarn("parameter ~%s is not known; config/sam_masks.yaml lists all", name)
        step_back(values["nice"])
        segmenter = make_segmenter(values, home)
    except (parameters.ParameterError, BackendError) as problem:
        rospy.logfatal("%s", problem)
        return 1
    rospy.loginfo("backend %s is ready", values["backend"])
    SamMasksNode(values, segmenter).run()
    return 0
