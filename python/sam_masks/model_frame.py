"""The geometry of SAM's input: the image's longest side has a fixed length, below and beside it there is padding."""
import cv2
import numpy as np

MEAN = np.float32([123.675, 116.28, 103.53])  # of RGB
DEVIATION = np.float32([58.395, 57.12, 57.375])
LOW_RESOLUTION = 4  # input pixels per pixel of the decoded logits
PATCH = 16  # input pixels per pixel of the embedding


class ModelFrame:
    """Where an image lies in the square input of a model."""

    def __init__(self, height, width, longest_side, model_side):
        """@param longest_side of the image in the input, at most model_side, the side of the square [px]"""
        self.scale = longest_side / max(height, width)
        self.height, self.width = int(height * self.scale + 0.5), int(width * self.scale + 0.5)
        self.model_side = model_side

    @property
    def patches(self):
        """@return rows and columns of the embedding that see the image, not only padding."""
        return [-(-self.height // PATCH), -(-self.width // PATCH)]

    def input(self, image):
        """@param image RGB, uint8  @return float32 1 x 3 x side x side, normalised, then padded with zeros"""
        method = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_LINEAR
        resized = cv2.resize(image, (self.width, self.height), interpolation=method)
        result = np.zeros((1, 3, self.model_side, self.model_side), np.float32)
        result[0, :, :self.height, :self.width] = ((resized - MEAN) / DEVIATION).transpose(2, 0, 1)
        return result

    def points(self, points):
        """@param points N x 2 [px of the image]  @return the same in the input"""
        return np.asarray(points, np.float32) * np.float32(self.scale)

    def enlarge(self, logits):
        """@param logits of low resolution, with or without those of the padding  @return the image's part"""
        height, width = logits.shape
        enlarged = cv2.resize(logits, (LOW_RESOLUTION * width, LOW_RESOLUTION * height), interpolation=cv2.INTER_LINEAR)
        return enlarged[:self.height, :self.width]
