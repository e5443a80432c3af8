"""Images and masks as ROS messages."""
import cv2
import numpy as np
import rospy
from cv_bridge import CvBridge, CvBridgeError
from sensor_msgs.msg import CompressedImage, Image


class ImageError(Exception):
    """An image message cannot be used; the message says why."""


def subscribe_images(callback, compressed):
    """The topic `image`, or `image/compressed` of the same camera; only the newest message waits."""
    topic, kind = rospy.resolve_name("image"), Image
    if compressed:
        topic, kind = topic + "/compressed", CompressedImage
    # The buffer takes a whole message, or old ones would wait in the socket.
    return rospy.Subscriber(topic, kind, callback, queue_size=1, buff_size=1 << 27)


def rgb_image(message):
    """@return RGB, uint8  @throw ImageError"""
    if hasattr(message, "format"):
        image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise ImageError("its data is no image that OpenCV reads (format '{}')".format(message.format))
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    try:
        image = CvBridge().imgmsg_to_cv2(message, "rgb8")
    except (CvBridgeError, ValueError, TypeError) as error:
        raise ImageError("encoding '{}', {} x {} px: {}".format(message.encoding, message.width, message.height,
                                                                error)) from error
    if image.size == 0:
        raise ImageError("it is empty")
    return np.ascontiguousarray(image)


def mask_message(header, layers):
    """@param header of the image itself; layers: height x width x n of uint8 or uint16"""
    return _message(header, "{}UC{}".format(8 * layers.itemsize, layers.shape[2]), layers)


def picture_message(header, image):
    """@param image BGR"""
    return _message(header, "bgr8", image)


def _message(header, encoding, array):
    array = np.ascontiguousarray(array)
    little = array.dtype.newbyteorder("<")
    message = Image(header=header, height=array.shape[0], width=array.shape[1], encoding=encoding, is_bigendian=0,
                    step=array.strides[0])
    message.data = array.astype(little, copy=False).tobytes()
    return message
