"""SAM from a PyTorch checkpoint: segment_anything, MobileSAM or SAM 2, whichever of them the user has installed."""
import importlib
import pathlib

import cv2
import numpy as np

from sam_masks.automatic import PromptedModel
from sam_masks.backends import BackendError
from sam_masks.model_frame import ModelFrame

# Model: Python package, and how it is installed. Every other name is a configuration of SAM 2.
PACKAGES = {name: ("segment_anything", "segment-anything") for name in ("vit_h", "vit_l", "vit_b")}
PACKAGES["vit_t"] = ("mobile_sam", "MobileSAM from its repository ChaoningZhang/MobileSAM")
SAM2 = ("sam2", "sam2")


def load_torch_model(model, checkpoint, threads, device, input_size):
    """@param model vit_h, vit_l, vit_b, vit_t, or a configuration of SAM 2 such as configs/sam2.1/sam2.1_hiera_s.yaml"""
    package, how = PACKAGES.get(model, SAM2)
    torch = _import("torch", "torch")
    _import(package, how)
    if not pathlib.Path(checkpoint).is_file():
        raise BackendError("torch/checkpoint '{}': there is no such file; give it the checkpoint of {}".format(
            checkpoint, model))
    if device == "cuda" and not torch.cuda.is_available():
        raise BackendError("device 'cuda': PyTorch finds no GPU; set device to cpu")
    torch.set_num_threads(threads)
    try:
        if package == "sam2":
            return Sam2Model(torch, model, checkpoint, device, input_size)
        return SamModel(torch, package, model, checkpoint, device, input_size)
    except BackendError:
        raise
    except Exception as error:  # whatever the package throws at a file that is not its checkpoint
        raise BackendError("torch/checkpoint '{}': {} cannot load it as {}: {}".format(
            checkpoint, package, model, error)) from error


def _import(package, how):
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise BackendError("backend torch needs the Python package {} for this model ({}); install {} into the environment "
                           "of sam_masks, or choose backend onnx".format(package, error, how)) from error


class SamModel(PromptedModel):
    """segment_anything's Sam, or MobileSAM's, which has the same parts."""

    def __init__(self, torch, package, model, checkpoint, device, input_size):
        self.torch, self.device = torch, device
        self.sam = importlib.import_module(package).sam_model_registry[model](checkpoint=str(checkpoint))
        self.sam.to(device).eval()
        self.side = self.sam.image_encoder.img_size
        if not 0 <= input_size <= self.side:
            raise BackendError("input_size {}: the encoder takes at most {} px".format(input_size, self.side))
        self.longest_side = input_size or self.side
        self.frame = self.embedding = None

    def encode(self, image):
        self.frame = ModelFrame(image.shape[0], image.shape[1], self.longest_side, self.side)
        with self.torch.no_grad():
            self.embedding = self.sam.image_encoder(self._tensor(self.frame.input(image)))

    def decode(self, points):
        with self.torch.no_grad():
            coordinates = self._tensor(self.frame.points(points)[:, None])
            labels = self.torch.ones(coordinates.shape[:2], dtype=self.torch.int, device=self.device)
            sparse, dense = self.sam.prompt_encoder(points=(coordinates, labels), boxes=None, masks=None)
            logits, scores = self.sam.mask_decoder(
                image_embeddings=self.embedding, image_pe=self.sam.prompt_encoder.get_dense_pe(),
                sparse_prompt_embeddings=sparse, dense_prompt_embeddings=dense, multimask_output=True)
        return scores.float().cpu().numpy(), logits.float().cpu().numpy()

    def enlarge(self, logits):
        return self.frame.enlarge(logits)

    def _tensor(self, values):
        return self.torch.as_tensor(values, device=self.device)


class Sam2Model(PromptedModel):
    """SAM 2's image predictor. It stretches every image to a square, so nothing is padding."""

    def __init__(self, torch, model, checkpoint, device, input_size):
        if input_size:
            raise BackendError("input_size {}: SAM 2 has a fixed one; leave it at 0".format(input_size))
        build = importlib.import_module("sam2.build_sam").build_sam2
        predictor = importlib.import_module("sam2.sam2_image_predictor").SAM2ImagePredictor
        self.predictor = predictor(build(model, str(checkpoint), device=device))
        self.size = None

    def encode(self, image):
        self.size = (image.shape[1], image.shape[0])
        self.predictor.set_image(image)

    def decode(self, points):
        count = len(points)
        _, scores, logits = self.predictor.predict(
            point_coords=np.asarray(points, np.float32)[:, None], point_labels=np.ones((count, 1), np.int32),
            multimask_output=True, return_logits=True)
        # It drops the dimension of a batch of one.
        return scores.reshape(count, -1), logits.reshape((count, -1) + logits.shape[-2:])

    def enlarge(self, logits):
        return cv2.resize(logits, self.size, interpolation=cv2.INTER_LINEAR)
