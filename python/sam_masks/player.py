"""The ROS node that publishes masks from files for the images that come by."""
import rospy
from sensor_msgs.msg import Image

from sam_masks.mask_files import MaskFileError, entries, read_layers
from sam_masks.messages import mask_message, subscribe_images


class UnusableName(Exception):
    """A file's name is no stamp."""


class ByStamp:
    """The file whose name is the image's stamp, in seconds (12.345) or whole nanoseconds (12345000000)."""

    def __init__(self, found, tolerance):
        """@param found (name, path) of each image; tolerance [s]"""
        self.tolerance = tolerance
        self.stamps = sorted((_seconds(name), path) for name, path in found)

    def path(self, stamp):
        """@param stamp [s]  @return path of the nearest file within the tolerance, or None"""
        distance, path = min(((abs(seconds - stamp), path) for seconds, path in self.stamps), key=lambda pair: pair[0])
        return path if distance <= self.tolerance else None


class ByOrder:
    """The first file for the first image, and so on; from the start again when the stamps go back."""

    def __init__(self, found):
        self.paths = [path for _, path in found]
        self.next = 0
        self.last_stamp = None

    def path(self, stamp):
        if self.last_stamp is not None and stamp < self.last_stamp:
            self.next = 0
        self.last_stamp = stamp
        self.next += 1
        return self.paths[self.next - 1] if self.next <= len(self.paths) else None


def _seconds(name):
    try:
        return int(name) * 1e-9 if name.isdigit() and len(name) > 12 else float(name)
    except ValueError as error:
        raise UnusableName("'{}' is no stamp in seconds or nanoseconds; name the files so, or set match to order".format(
            name)) from error


class MaskPlayer:
    def __init__(self, matcher, max_layers, compressed):
        self.matcher, self.max_layers = matcher, max_layers
        self.publisher = rospy.Publisher("masks", Image, queue_size=10)
        self.subscriber = subscribe_images(self.on_image, compressed)

    def on_image(self, message):
        path = self.matcher.path(message.header.stamp.to_sec())
        if path is None:
            rospy.logwarn_throttle(10.0, "no masks for the image of stamp {:.6f}".format(message.header.stamp.to_sec()))
            return
        try:
            layers = read_layers(path, self.max_layers)
        except MaskFileError as problem:
            rospy.logwarn_throttle(10.0, str(problem))
            return
        if hasattr(message, "width") and layers.shape[:2] != (message.height, message.width):
            rospy.logwarn_throttle(10.0, "{}: masks of {} x {} px for an image of {} x {} px are not published".format(
                path, layers.shape[1], layers.shape[0], message.width, message.height))
            return
        self.publisher.publish(mask_message(message.header, layers))


def main():
    """@return exit status"""
    rospy.init_node("mask_player")
    match = rospy.get_param("~match", "stamp")
    try:
        found = entries(rospy.get_param("~folder", ""))
        if match not in ("stamp", "order"):
            raise MaskFileError('parameter ~match is {!r}; allowed: "stamp", "order"'.format(match))
        matcher = ByOrder(found) if match == "order" else ByStamp(found, float(rospy.get_param("~tolerance", 0.01)))
        player = MaskPlayer(matcher, int(rospy.get_param("~max_layers", 16)), bool(rospy.get_param("~compressed", False)))
    except (MaskFileError, UnusableName, ValueError, TypeError) as problem:
        rospy.logfatal("%s", problem)
        return 1
    rospy.loginfo("masks of %d images from %s, by %s", len(found), rospy.get_param("~folder"), match)
    rospy.spin()
    del player
    return 0
