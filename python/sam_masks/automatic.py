"""Segment everything with a model that is asked point by point: a grid of prompts, and a choice of the answers."""
import dataclasses

import cv2
import numpy as np

from sam_masks.masks import Mask, clean, suppress_doubles


@dataclasses.dataclass
class AutomaticSettings:
    """What is asked and what is kept. The thresholds suit MobileSAM; SAM's own (0.88, 0.95) lose half of its masks."""

    points_per_side: int = 32  # prompts along either side of the image
    points_per_batch: int = 8  # prompts decoded at once: memory against speed
    min_predicted_iou: float = 0.78  # the model's own opinion of a mask
    min_stability: float = 0.87  # area above +offset over area above -offset
    stability_offset: float = 0.9
    max_box_overlap: float = 0.5  # of two masks whose boxes overlap more the better one stays
    min_area: int = 100  # of masks, islands and holes [px of the image]
    skip_covered: bool = False  # do not ask at points that a good mask covers already


class PromptedModel:
    """What `AutomaticMasks` asks; a backend implements it."""

    def encode(self, image):
        """Takes an RGB image; the other methods are about it from then on."""
        raise NotImplementedError

    def decode(self, points):
        """@param points N x 2: x, y [px of the image]

        @return scores N x K, logits N x K x h x w: K proposals a point, of a resolution that the model chooses
        """
        raise NotImplementedError

    def enlarge(self, logits):
        """@param logits h x w, as decoded  @return the image's part of them, at the resolution of the model's input"""
        raise NotImplementedError


def point_grid(per_side, height, width):
    """@return points N x 2: x, y [px], the middles of per_side x per_side equal tiles, coarse before fine."""
    middles = (np.arange(per_side) + 0.5) / per_side
    x, y = np.meshgrid(middles * width, middles * height)
    # Every fourth row and column first: what they find may spare the others (skip_covered).
    i, j = np.meshgrid(np.arange(per_side), np.arange(per_side))
    fineness = np.where((i % 4 == 1) & (j % 4 == 1), 0, np.where((i % 2 == 1) & (j % 2 == 1), 1, 2))
    order = np.argsort(fineness.ravel(), kind="stable")
    return np.stack([x.ravel(), y.ravel()], axis=1)[order]


class _Proposal:
    def __init__(self, logits, score, box):
        self.logits, self.score, self.box = logits, score, box


class AutomaticMasks:
    """A segmenter made of a prompted model."""

    def __init__(self, model, settings=None):
        self.model, self.settings = model, settings or AutomaticSettings()

    def segment(self, image, stop=lambda: False):
        """@param image RGB, uint8; stop: asked between batches

        @return the masks of everything in it, largest first; None if it was stopped
        """
        self.model.encode(image)
        proposals = self._proposals(image.shape[0], image.shape[1], stop)
        if proposals is None:
            return None
        kept = suppress_doubles([p.box for p in proposals], [p.score for p in proposals],
                                self.settings.max_box_overlap)
        masks = [mask for mask in (self._mask(proposals[i], image.shape) for i in kept) if mask]
        # Cleaned masks may have become doubles.
        kept = suppress_doubles([mask.box for mask in masks], [mask.score for mask in masks],
                                self.settings.max_box_overlap)
        return sorted((masks[i] for i in kept), key=lambda mask: -mask.area)

    def _proposals(self, height, width, stop):
        points = point_grid(self.settings.points_per_side, height, width)
        covered = np.zeros((height, width), bool)
        proposals = []
        while len(points):
            if stop():
                return None
            batch, points = np.split(points, [self.settings.points_per_batch])
            good = self._good_ones(*self.model.decode(batch), width)
            proposals += good
            if self.settings.skip_covered:
                for proposal in good:
                    enlarged = self.model.enlarge(proposal.logits)
                    covered |= cv2.resize((enlarged > 0).astype(np.uint8), (width, height),
                                          interpolation=cv2.INTER_NEAREST) > 0
                pixel = points.astype(int)
                points = points[~covered[pixel[:, 1], pixel[:, 0]]]
        return proposals

    def _good_ones(self, scores, logits, width):
        """@return what passes the thresholds."""
        settings, good = self.settings, []
        for n, k in zip(*np.nonzero(scores >= settings.min_predicted_iou)):
            enlarged = self.model.enlarge(logits[n, k])
            sure = np.count_nonzero(enlarged > settings.stability_offset)
            possible = np.count_nonzero(enlarged > -settings.stability_offset)
            pixels_per_pixel = (width / enlarged.shape[1]) ** 2  # of the image, for one of the model
            if sure * pixels_per_pixel >= settings.min_area and sure >= settings.min_stability * possible:
                left, top, box_width, box_height = cv2.boundingRect((enlarged > 0).astype(np.uint8))
                good.append(_Proposal(logits[n, k].copy(), float(scores[n, k]),
                                      (left, top, left + box_width, top + box_height)))
        return good

    def _mask(self, proposal, shape):
        size = (shape[1], shape[0])
        inside = cv2.resize(self.model.enlarge(proposal.logits), size, interpolation=cv2.INTER_LINEAR) > 0
        inside = clean(inside, self.settings.min_area)
        return Mask.of_image(inside, proposal.score)
