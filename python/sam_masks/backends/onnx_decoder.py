"""Makes a decoder for segment-everything of SAM's ONNX export, which decodes one prompt and returns one mask.

The graph stays SAM's. What is changed, none of which alters a mask: all of the decoder's proposals become outputs; the
batch of prompts is free; what depends on the image alone is computed once a batch instead of once a prompt; the part of
the padding that holds nothing of the image is not enlarged to masks.
"""
import numpy as np
import onnx
from google.protobuf.message import DecodeError
from onnx import TensorProto, helper, numpy_helper

PATCHES = "decoded_patches"  # added input: rows and columns of the embedding that are decoded
PREFIX = "segment_everything/"  # of added names


class Unsuitable(Exception):
    """The graph is not SAM's decoder as its own export script writes it."""


def prepare_decoder(path, attend_padding=True):
    """@return the model as bytes, its outputs (scores N x K, logits N x K x h x w) by name.

    attend_padding: the prompts see the padding as well, as SAM was trained. False: it is left out of everything; faster,
    but that does alter the masks.
    """
    try:
        model = onnx.load(str(path))
    except DecodeError as error:
        raise Unsuitable("it is no ONNX model") from error
    graph = _Graph(model.graph)
    logits, scores = _proposals(graph)
    _free_batch(model.graph)
    _share_image(graph)
    _crop(graph, attend_padding)
    del model.graph.output[:]
    model.graph.output.extend(helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in (scores, logits))
    graph.prune()
    return model.SerializeToString(), scores, logits


class _Graph:
    def __init__(self, graph):
        self.graph = graph
        self.producers = {name: node for node in graph.node for name in node.output}

    def of_type(self, kind):
        return [node for node in self.graph.node if node.op_type == kind]

    def users(self, name):
        return [node for node in self.graph.node if name in node.input]

    def replace(self, name, by):
        """Who used `name` uses `by`."""
        for node in self.users(name):
            for i, given in enumerate(node.input):
                if given == name:
                    node.input[i] = by

    def insert_before(self, node, added):
        self.graph.node.insert(list(self.graph.node).index(node), added)

    def constant(self, name, values):
        self.graph.initializer.append(numpy_helper.from_array(np.array(values, np.int64), PREFIX + name))
        return PREFIX + name

    def prune(self):
        """Drops nodes, inputs and constants on which no output depends."""
        needed = {output.name for output in self.graph.output}
        kept = []
        for node in reversed(self.graph.node):  # sorted: producers come first
            if needed.intersection(node.output):
                kept.append(node)
                needed.update(node.input)
        for field, items in (("node", kept[::-1]), ("input", [i for i in self.graph.input if i.name in needed]),
                             ("initializer", [i for i in self.graph.initializer if i.name in needed])):
            del getattr(self.graph, field)[:]
            getattr(self.graph, field).extend(items)


def _proposals(graph):
    """@return names of all proposals' logits and scores."""
    best = graph.of_type("ArgMax")  # the export for one mask chooses among the proposals by their scores
    if not best:
        names = {output.name for output in graph.graph.output}
        if not {"low_res_masks", "iou_predictions"} <= names:
            raise Unsuitable("it has outputs {} instead of low_res_masks and iou_predictions".format(sorted(names)))
        return "low_res_masks", "iou_predictions"
    chosen = [gather for add in graph.users(best[0].output[0]) for gather in graph.users(add.output[0])
              if gather.op_type == "Gather" and gather.input[1] == add.output[0]]
    flat = [graph.producers.get(gather.input[0]) for gather in chosen]
    if len(flat) != 2 or any(node is None or node.op_type != "Flatten" for node in flat):
        raise Unsuitable("the choice of the best mask is not written as SAM's export script does")
    return flat[0].input[0], flat[1].input[0]  # in the order of the script: masks, then scores


def _free_batch(graph):
    for given in graph.input:
        if given.name in ("point_coords", "point_labels"):
            given.type.tensor_type.shape.dim[0].dim_param = "prompts"


def _share_image(graph):
    """The export repeats embedding and positions for every prompt (Unsqueeze, Tile, Reshape); broadcasting does as well."""
    for tile in graph.of_type("Tile"):
        before, after = graph.producers.get(tile.input[0]), graph.users(tile.output[0])
        reshapes = [node for node in after if node.op_type == "Reshape"]
        if before is None or before.op_type != "Unsqueeze" or len(reshapes) != 1:
            raise Unsuitable("the repetition of the embedding is not written as SAM's export script does")
        graph.replace(reshapes[0].output[0], before.input[0])


def _crop(graph, attend_padding):
    convolutions = graph.of_type("ConvTranspose")
    if not convolutions or graph.producers[convolutions[0].input[0]].op_type != "Reshape":
        raise Unsuitable("the enlargement of the masks is not written as SAM's export script does")
    image = graph.producers[convolutions[0].input[0]]  # patches in a row become an image again
    channels, rows, columns = _embedding_shape(graph.graph)
    graph.graph.input.append(helper.make_tensor_value_info(PATCHES, TensorProto.INT64, [2]))
    first, axes = graph.constant("first", [0, 0]), graph.constant("axes", [2, 3])

    def cut(name):
        added = helper.make_node("Slice", [name, first, PATCHES, axes], [PREFIX + "cut" + name])
        users = graph.users(name)
        graph.replace(name, added.output[0])
        graph.insert_before(users[0], added)

    decoded = graph.constant("all_patches", [rows, columns]) if attend_padding else PATCHES
    shape = helper.make_node("Concat", [graph.constant("batch", [-1, channels]), decoded], [PREFIX + "shape"], axis=0)
    graph.insert_before(image, shape)
    image.input[1] = shape.output[0]
    if attend_padding:
        cut(image.output[0])
    else:
        for name in _images(graph, channels):
            cut(name)


def _embedding_shape(graph):
    for given in graph.input:
        if given.name == "image_embeddings":
            return [dim.dim_value for dim in given.type.tensor_type.shape.dim][1:]
    raise Unsuitable("it has no input image_embeddings")


def _images(graph, channels):
    """@return names of the embedding with the prompt's mask added, and of the positions: what the transformer reads."""
    flattened = []
    for reshape in graph.of_type("Reshape"):
        target = graph.producers.get(reshape.input[1])
        scope = reshape.name.rsplit("/", 1)[0] if "/" in reshape.name else ""
        after = graph.users(reshape.output[0])
        if target is not None and target.op_type == "Concat" and scope.endswith("transformer") \
                and len(after) == 1 and after[0].op_type == "Transpose":
            flattened.append(reshape.input[0])
    if len(flattened) != 2:
        raise Unsuitable("the transformer's inputs are not written as SAM's export script does")
    return flattened
