"""SAM as ONNX: an encoder and a decoder, run by ONNX Runtime without PyTorch."""
import pathlib

import numpy as np

from sam_masks.automatic import PromptedModel
from sam_masks.backends import BackendError
from sam_masks.model_frame import ModelFrame

FOREGROUND, PADDING = 1, -1  # labels of points


class OnnxModel(PromptedModel):
    """Encoder: `input` 1 x 3 x side x side, normalised RGB. Decoder: as segment_anything's export script writes it."""

    def __init__(self, encoder, decoder, threads=2, device="cpu", input_size=0, attend_padding=True):
        """input_size: longest side of the image in the model's input [px]; 0: all of it."""
        runtime, prepare_decoder, unsuitable = _import()
        for file in (encoder, decoder):
            if not pathlib.Path(file).is_file():
                raise BackendError("{}: no such model; './bootstrap sam' fetches one, or name your export with the "
                                   "parameters onnx/encoder and onnx/decoder".format(file))
        options = runtime.SessionOptions()
        options.intra_op_num_threads = threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle ones leave the core
        providers = ["CPUExecutionProvider"] if device == "cpu" else ["CUDAExecutionProvider", "CPUExecutionProvider"]
        if providers[0] not in runtime.get_available_providers():
            raise BackendError("device '{}': this ONNX Runtime has only {}; install onnxruntime-gpu, or set device "
                               "to cpu".format(device, ", ".join(runtime.get_available_providers())))

        def session(model):
            try:
                return runtime.InferenceSession(model, options, providers=providers)
            except Exception as error:  # ONNX Runtime has no common base for its errors
                name = decoder if isinstance(model, bytes) else model
                raise BackendError("{}: ONNX Runtime refuses it: {}".format(name, error)) from error

        self.encoder = session(str(encoder))
        self.side = _side(self.encoder, encoder)
        if not 0 <= input_size <= self.side:
            raise BackendError("input_size {}: the encoder takes at most {} px".format(input_size, self.side))
        self.longest_side = input_size or self.side
        try:
            model, *self.outputs = prepare_decoder(decoder, attend_padding)
        except unsuitable as error:
            raise BackendError("{}: this is not SAM's decoder as segment_anything's export script writes it: {}".format(
                decoder, error)) from error
        self.decoder = session(model)
        self.frame = self.embedding = None

    def encode(self, image):
        self.frame = ModelFrame(image.shape[0], image.shape[1], self.longest_side, self.side)
        self.embedding, = self.encoder.run(None, {self.encoder.get_inputs()[0].name: self.frame.input(image)})

    def decode(self, points):
        count = len(points)
        prompts = np.zeros((count, 2, 2), np.float32)
        prompts[:, 0] = self.frame.points(points)  # the second is the padding that a prompt without a box has
        side = self.side // 4
        given = {
            "image_embeddings": self.embedding,
            "point_coords": prompts,
            "point_labels": np.tile(np.float32([FOREGROUND, PADDING]), (count, 1)),
            "mask_input": np.zeros((1, 1, side, side), np.float32),
            "has_mask_input": np.zeros(1, np.float32),
            "decoded_patches": np.array(self.frame.patches, np.int64),
        }
        wanted = {node.name for node in self.decoder.get_inputs()}
        scores, logits = self.decoder.run(self.outputs, {name: given[name] for name in given if name in wanted})
        # The first of four is the mask for several prompts; a point alone is ambiguous and has the other three.
        return (scores[:, 1:], logits[:, 1:]) if scores.shape[1] == 4 else (scores, logits)

    def enlarge(self, logits):
        return self.frame.enlarge(logits)


def _import():
    try:
        import onnxruntime
        from sam_masks.backends.onnx_decoder import Unsuitable, prepare_decoder
    except ImportError as error:
        raise BackendError("backend onnx needs the Python packages onnxruntime and onnx ({}); './bootstrap sam' installs "
                           "them".format(error)) from error
    return onnxruntime, prepare_decoder, Unsuitable


def _side(encoder, file):
    shape = encoder.get_inputs()[0].shape
    if len(shape) != 4 or shape[1] != 3 or not isinstance(shape[3], int) or shape[2] != shape[3]:
        raise BackendError("{}: the encoder takes {} instead of [1, 3, side, side]: normalised RGB of a fixed size".format(
            file, shape))
    return shape[3]
