"""From parameters to the segmenter that they describe."""
import os
import pathlib

import cv2

from sam_masks.automatic import AutomaticMasks, AutomaticSettings
from sam_masks.backends.graph import GraphSegmenter, GraphSettings
from sam_masks.parameters import group


def make_segmenter(values, home):
    """@param values as `parameters.read` returns them; home: folder of the model that './bootstrap sam' fetched

    @return an object with segment(image): RGB uint8 to masks
    @throw BackendError
    """
    cv2.setNumThreads(values["threads"])
    if values["backend"] == "graph":
        return GraphSegmenter(GraphSettings(**group(values, "graph")), values["input_size"])
    common = {name: values[name] for name in ("threads", "device", "input_size")}
    if values["backend"] == "torch":
        from sam_masks.backends.torch import load_torch_model
        model = load_torch_model(**group(values, "torch"), **common)
    else:
        from sam_masks.backends.onnx import OnnxModel
        given = group(values, "onnx")
        model = OnnxModel(
            given["encoder"] or pathlib.Path(home) / "encoder.onnx",
            given["decoder"] or pathlib.Path(home) / "decoder.onnx",
            attend_padding=given["attend_padding"], **common)
    return AutomaticMasks(model, AutomaticSettings(**group(values, "automatic")))


def step_back(nice):
    """The vehicle's own processes come first."""
    os.nice(nice)
