"""The classical fallback without a model: graph-based segmentation by colour (Felzenszwalb and Huttenlocher, 2004)."""
import dataclasses

import cv2
import numpy as np

from sam_masks.backends import BackendError
from sam_masks.masks import Mask


@dataclasses.dataclass
class GraphSettings:
    """Of OpenCV's GraphSegmentation."""

    scale: float = 300.0  # k: larger joins more
    blur: float = 0.8  # sigma [px]
    min_area: int = 100  # smaller segments join a neighbour [px of the image]


class GraphSegmenter:
    """Its masks are patches of even colour and do not overlap: they know edges, not things."""

    def __init__(self, settings=None, input_size=0):
        """input_size: a larger image is shrunk to this longest side before [px]; 0: never"""
        if not hasattr(cv2, "ximgproc"):
            raise BackendError("backend graph needs OpenCV's contributed module ximgproc, which this cv2 lacks; "
                               "install python3-opencv of the system, or opencv-contrib-python")
        self.settings, self.input_size = settings or GraphSettings(), input_size

    def segment(self, image, stop=None):
        """@param image RGB, uint8; stop: not asked, it is quick  @return masks, largest first."""
        height, width = image.shape[:2]
        factor = min(1.0, self.input_size / max(height, width)) if self.input_size else 1.0
        small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) if factor < 1.0 else image
        settings = self.settings
        labels = cv2.ximgproc.segmentation.createGraphSegmentation(
            sigma=settings.blur, k=settings.scale, min_size=max(1, round(settings.min_area * factor ** 2))
        ).processImage(cv2.cvtColor(small, cv2.COLOR_RGB2Lab))
        labels = cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST)
        return masks_of_labels(labels)


def masks_of_labels(labels):
    """@param labels int32, each value a segment  @return masks, largest first"""
    flat = labels.ravel()
    order = np.argsort(flat, kind="stable")
    starts = np.flatnonzero(np.diff(flat[order], prepend=flat[order[0]] - 1))
    masks = []
    for pixels in np.split(order, starts[1:]):
        y, x = np.divmod(pixels, labels.shape[1])
        left, top = int(x.min()), int(y.min())
        inside = np.zeros((int(y.max()) - top + 1, int(x.max()) - left + 1), bool)
        inside[y - top, x - left] = True
        masks.append(Mask(left, top, inside))
    return sorted(masks, key=lambda mask: -mask.area)
