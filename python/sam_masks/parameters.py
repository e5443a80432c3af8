"""All parameters of sam_masks with their defaults and ranges. config/sam_masks.yaml explains them; a test compares."""
from sam_masks.automatic import AutomaticSettings
from sam_masks.backends.graph import GraphSettings


class ParameterError(Exception):
    """The message names the parameter and what is allowed."""


class Choice:
    def __init__(self, default, *words):
        self.default, self.words = default, words

    def problem(self, value):
        return None if value in self.words else "one of " + ", ".join('"{}"'.format(word) for word in self.words)


class Text:
    def __init__(self, default):
        self.default = default

    def problem(self, value):
        return None if isinstance(value, str) else "text"


class Flag:
    def __init__(self, default):
        self.default = default

    def problem(self, value):
        return None if isinstance(value, bool) else "true or false"


class Number:
    """A default of type int takes whole numbers only."""

    def __init__(self, default, low, high):
        self.default, self.low, self.high = default, low, high

    def problem(self, value):
        whole = isinstance(self.default, int)
        right = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
        if right and self.low <= value <= self.high:
            return None
        return "a {}number from {} to {}".format("whole " if whole else "", self.low, self.high)


_automatic, _graph = AutomaticSettings(), GraphSettings()

PARAMETERS = {
    "backend": Choice("onnx", "onnx", "torch", "graph"),
    "device": Choice("cpu", "cpu", "cuda"),
    "threads": Number(2, 1, 256),
    "nice": Number(10, 0, 19),
    "input_size": Number(0, 0, 16384),
    "max_layers": Number(6, 1, 16),
    "compressed": Flag(False),
    "min_interval": Number(0.0, 0.0, 3600.0),
    "min_distance": Number(0.0, 0.0, 10000.0),
    "fixed_frame": Text("odom"),
    "automatic/points_per_side": Number(_automatic.points_per_side, 1, 256),
    "automatic/points_per_batch": Number(_automatic.points_per_batch, 1, 1024),
    "automatic/min_predicted_iou": Number(_automatic.min_predicted_iou, 0.0, 1.0),
    "automatic/min_stability": Number(_automatic.min_stability, 0.0, 1.0),
    "automatic/stability_offset": Number(_automatic.stability_offset, 0.0, 10.0),
    "automatic/max_box_overlap": Number(_automatic.max_box_overlap, 0.0, 1.0),
    "automatic/min_area": Number(_automatic.min_area, 1, 1000000),
    "automatic/skip_covered": Flag(_automatic.skip_covered),
    "onnx/encoder": Text(""),
    "onnx/decoder": Text(""),
    "onnx/attend_padding": Flag(True),
    "torch/model": Text("vit_t"),
    "torch/checkpoint": Text(""),
    "graph/scale": Number(_graph.scale, 1.0, 1000000.0),
    "graph/blur": Number(_graph.blur, 0.0, 20.0),
    "graph/min_area": Number(_graph.min_area, 1, 1000000),
}


def read(given):
    """@param given nested dictionary, e.g. a node's private parameters

    @return value of every parameter by its name with slashes, and the names that are no parameters
    @throw ParameterError
    """
    flat = dict(flatten(given))
    values = {}
    for name, parameter in PARAMETERS.items():
        values[name] = flat.pop(name, parameter.default)
        problem = parameter.problem(values[name])
        if problem:
            raise ParameterError("parameter {} is {!r}; allowed: {}".format(name, values[name], problem))
    return values, sorted(flat)


def flatten(nested, prefix=""):
    for name, value in nested.items():
        if isinstance(value, dict):
            yield from flatten(value, prefix + name + "/")
        else:
            yield prefix + name, value


def group(values, name):
    """@return the parameters below name/ without it."""
    return {key[len(name) + 1:]: value for key, value in values.items() if key.startswith(name + "/")}
