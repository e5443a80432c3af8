"""Masks of one image: what a mask is, how it is cleaned, and how masks become layers of ids."""
import cv2
import numpy as np


class Mask:
    """The pixels of one segment, kept as the part of the image that they span.

    left, top: of that part [px]; pixels: bool array of its size; score: how sure the segmenter is, 0..1.
    """

    def __init__(self, left, top, pixels, score=1.0):
        self.left, self.top, self.pixels, self.score = left, top, pixels, score
        self.area = int(np.count_nonzero(pixels))

    @classmethod
    def of_image(cls, inside, score=1.0):
        """@return the mask of a bool array of the image's size; None if nothing is inside."""
        left, top, width, height = cv2.boundingRect(inside.astype(np.uint8))
        if width == 0:
            return None
        return cls(left, top, inside[top:top + height, left:left + width].copy(), score)

    @property
    def box(self):
        """@return left, top, right, bottom [px], the last two beyond the mask."""
        height, width = self.pixels.shape
        return self.left, self.top, self.left + width, self.top + height

    def window(self, image):
        """@return the part of an array of the image's size that the mask spans, as a view."""
        left, top, right, bottom = self.box
        return image[top:bottom, left:right]

    def in_image(self, height, width):
        """@return bool array of the image's size."""
        inside = np.zeros((height, width), bool)
        self.window(inside)[:] = self.pixels
        return inside


def clean(inside, min_area):
    """Removes islands and fills holes of fewer than `min_area` pixels.

    @param inside bool array  @return the same, cleaned. The largest island always stays.
    """
    for value in (False, True):  # holes first: they may join islands
        count, labels, stats, _ = cv2.connectedComponentsWithStats((inside == value).astype(np.uint8), connectivity=8)
        areas = stats[:, cv2.CC_STAT_AREA]
        small = areas < min_area
        small[0] = False  # what is not `value`
        if value and count > 1:
            small[1 + int(np.argmax(areas[1:]))] = False
        if small.any():
            inside = inside ^ small[labels]
    return inside


def box_overlap(boxes, box):
    """@return intersection over union of each row of `boxes` with `box`."""
    low = np.maximum(boxes[:, :2], box[:2])
    high = np.minimum(boxes[:, 2:], box[2:])
    common = np.prod(np.clip(high - low, 0, None), axis=1)
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    return common / (areas + np.prod(box[2:] - box[:2]) - common)


def suppress_doubles(boxes, scores, max_overlap):
    """Non-maximum suppression by boxes.

    @param boxes N x 4: left, top, right, bottom  @return indices of what stays, best score first
    """
    boxes = np.asarray(boxes, float).reshape(-1, 4)
    order = np.argsort(-np.asarray(scores), kind="stable")
    kept = []
    while len(order):
        best, order = order[0], order[1:]
        kept.append(int(best))
        order = order[box_overlap(boxes[order], boxes[best]) <= max_overlap]
    return kept


def pack_layers(masks, height, width, max_layers):
    """Lays masks into layers of ids, largest first, each into the first layer in which it overlaps nothing.

    Mask i of the sorted masks has the id i + 1; 0 is no mask.
    @return array height x width x layers of uint8 or, for more than 255 masks, uint16; number of masks that fit nowhere
    """
    masks = sorted(masks, key=lambda mask: -mask.area)[:65535]
    layers, left_out = [], 0
    for i, mask in enumerate(masks):
        for layer in layers:
            if not (mask.window(layer) * mask.pixels).any():
                break
        else:
            if len(layers) == max_layers:
                left_out += 1
                continue
            layer = np.zeros((height, width), np.uint16)
            layers.append(layer)
        mask.window(layer)[mask.pixels] = i + 1
    if not layers:
        layers = [np.zeros((height, width), np.uint16)]
    packed = np.stack(layers, axis=2)
    return (packed if len(masks) > 255 else packed.astype(np.uint8)), left_out


def unpack_layers(layers):
    """@return the masks of an array height x width (x layers) of ids, largest first."""
    layers = layers.reshape(layers.shape[0], layers.shape[1], -1)
    found = {}
    for k in range(layers.shape[2]):
        for i in np.unique(layers[:, :, k]):
            if i:
                inside = layers[:, :, k] == i
                found[i] = inside | found[i] if i in found else inside
    return sorted((Mask.of_image(inside) for inside in found.values()), key=lambda mask: -mask.area)


def coverage(masks, height, width):
    """@return share of the pixels that are in a mask, 0..1."""
    covered = np.zeros((height, width), bool)
    for mask in masks:
        mask.window(covered)[mask.pixels] = True
    return float(covered.mean())


def agreement(masks, others):
    """How well `others` know the masks: the best intersection over union of each, weighted with its area. 0..1"""
    total = sum(mask.area for mask in masks)
    return sum(mask.area * max((_overlap(mask, other) for other in others), default=0.0) for mask in masks) / total


def _overlap(a, b):
    left, top = max(a.left, b.left), max(a.top, b.top)
    right, bottom = min(a.box[2], b.box[2]), min(a.box[3], b.box[3])
    if left >= right or top >= bottom:
        return 0.0
    part = [m.pixels[top - m.top:bottom - m.top, left - m.left:right - m.left] for m in (a, b)]
    common = np.count_nonzero(part[0] & part[1])
    return common / (a.area + b.area - common)


def draw(image, masks):
    """@param image BGR  @return it with the masks in colours and their borders in white, small ones on top"""
    picture = image.copy()
    borders = np.zeros(image.shape[:2], np.uint8)
    for i, mask in enumerate(sorted(masks, key=lambda mask: -mask.area)):
        hue = np.uint8([[[int(i * 180 * 0.618) % 180, 200, 255]]])  # golden ratio: neighbours differ
        color = cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0].astype(np.float32)
        part = mask.window(picture)
        part[mask.pixels] = (0.5 * mask.window(image)[mask.pixels] + 0.5 * color).astype(np.uint8)
        contours, _ = cv2.findContours(mask.pixels.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE,
                                       offset=(mask.left, mask.top))[-2:]
        cv2.drawContours(borders, contours, -1, 255, 1)
    picture[borders > 0] = 255
    return picture
