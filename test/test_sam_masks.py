#!/usr/bin/env python3
"""python/sam_masks without ROS and without a model: masks, layers, the choice among proposals, parameters, files."""

import contextlib
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import types
import unittest
from unittest import mock

import cv2
import numpy as np
import yaml

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(PACKAGE / "python"))

from sam_masks import folder_tool, mask_files, parameters  # noqa: E402
from sam_masks.automatic import AutomaticMasks, AutomaticSettings, PromptedModel, point_grid  # noqa: E402
from sam_masks.backends import BackendError  # noqa: E402
from sam_masks.backends.graph import GraphSegmenter, GraphSettings, masks_of_labels  # noqa: E402
from sam_masks.backends.torch import load_torch_model  # noqa: E402
from sam_masks.masks import (Mask, agreement, clean, coverage, draw, pack_layers, suppress_doubles,  # noqa: E402
                             unpack_layers)
from sam_masks.model_frame import ModelFrame  # noqa: E402
from sam_masks.newest import Gate, Newest  # noqa: E402
from sam_masks.segmenter import make_segmenter  # noqa: E402

HEIGHT, WIDTH = 60, 100


def rectangle(left, top, right, bottom, score=1.0):
    return Mask(left, top, np.ones((bottom - top, right - left), bool), score)


class MasksTest(unittest.TestCase):
    def test_a_mask_keeps_its_part_of_the_image(self):
        inside = np.zeros((HEIGHT, WIDTH), bool)
        inside[10:20, 30:35] = True
        inside[12, 32] = False
        mask = Mask.of_image(inside)
        self.assertEqual(mask.box, (30, 10, 35, 20))
        self.assertEqual(mask.area, 49)
        np.testing.assert_array_equal(mask.in_image(HEIGHT, WIDTH), inside)
        self.assertIsNone(Mask.of_image(np.zeros((HEIGHT, WIDTH), bool)))

    def test_small_islands_and_holes_go(self):
        inside = np.zeros((HEIGHT, WIDTH), bool)
        inside[5:35, 5:35] = True
        wanted = inside.copy()
        inside[10:12, 10:12] = False  # a small hole
        inside[50:52, 50:52] = True  # a small island
        np.testing.assert_array_equal(clean(inside, 10), wanted)
        np.testing.assert_array_equal(clean(wanted, 10), wanted)

    def test_large_holes_and_the_largest_island_stay(self):
        inside = np.zeros((HEIGHT, WIDTH), bool)
        inside[5:8, 5:8] = True
        inside[20:22, 20:22] = True
        self.assertEqual(np.count_nonzero(clean(inside, 100)), 9)
        ring = np.zeros((HEIGHT, WIDTH), bool)
        ring[5:45, 5:45] = True
        ring[15:35, 15:35] = False
        np.testing.assert_array_equal(clean(ring, 100), ring)

    def test_doubles_are_suppressed_in_favour_of_the_better(self):
        boxes = [(0, 0, 10, 10), (1, 0, 11, 10), (0, 0, 10, 4), (50, 50, 60, 60)]
        self.assertEqual(suppress_doubles(boxes, [0.8, 0.9, 0.85, 0.7], 0.5), [1, 2, 3])
        self.assertEqual(suppress_doubles(boxes, [0.8, 0.9, 0.85, 0.7], 0.9), [1, 2, 0, 3])
        self.assertEqual(suppress_doubles([], [], 0.5), [])

    def test_overlapping_masks_go_to_layers(self):
        masks = [rectangle(10, 10, 20, 20), rectangle(0, 0, 50, 50), rectangle(60, 0, 70, 50), rectangle(12, 12, 14, 14)]
        layers, left_out = pack_layers(masks, HEIGHT, WIDTH, 4)
        self.assertEqual((layers.shape, layers.dtype, left_out), ((HEIGHT, WIDTH, 3), np.uint8, 0))
        self.assertEqual(list(layers[13, 13]), [1, 3, 4])  # largest first
        self.assertEqual(list(layers[0, 65]), [2, 0, 0])
        self.assertEqual(list(layers[59, 99]), [0, 0, 0])
        again = unpack_layers(layers)
        self.assertEqual([mask.area for mask in again], [2500, 500, 100, 4])
        self.assertEqual([mask.box for mask in again][2], (10, 10, 20, 20))

    def test_what_fits_into_no_layer_is_counted(self):
        masks = [rectangle(0, 0, 50, 50), rectangle(10, 10, 20, 20), rectangle(12, 12, 14, 14)]
        layers, left_out = pack_layers(masks, HEIGHT, WIDTH, 2)
        self.assertEqual((layers.shape[2], left_out), (2, 1))
        self.assertEqual(sorted(np.unique(layers)), [0, 1, 2])

    def test_many_masks_need_wider_ids(self):
        masks = [rectangle(x, y, x + 1, y + 1) for x in range(20) for y in range(20)]
        layers, left_out = pack_layers(masks, HEIGHT, WIDTH, 4)
        self.assertEqual((layers.dtype, layers.shape[2], left_out), (np.uint16, 1, 0))
        self.assertEqual(len(np.unique(layers)), 401)

    def test_no_mask_is_an_empty_layer(self):
        layers, _ = pack_layers([], HEIGHT, WIDTH, 4)
        self.assertEqual((layers.shape, layers.any()), ((HEIGHT, WIDTH, 1), False))

    def test_coverage_and_agreement(self):
        masks = [rectangle(0, 0, 50, 60), rectangle(0, 0, 10, 60)]
        self.assertEqual(coverage(masks, HEIGHT, WIDTH), 0.5)
        self.assertEqual(agreement(masks, masks), 1.0)
        self.assertEqual(agreement(masks, []), 0.0)
        half = [rectangle(0, 0, 25, 60)]  # IoU 0.5 with the large one, 0.4 with the small one
        self.assertAlmostEqual(agreement(masks, half), (0.5 * 3000 + 0.4 * 600) / 3600)

    def test_the_overlay_shows_masks_and_borders(self):
        image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
        picture = draw(image, [rectangle(10, 10, 40, 40)])
        self.assertTrue((picture[0, 0] == 100).all())
        self.assertTrue((picture[10, 20] == 255).all())
        self.assertFalse((picture[20, 20] == 100).all())


class FrameTest(unittest.TestCase):
    def test_the_image_lies_at_the_top_left(self):
        frame = ModelFrame(376, 1241, 1024, 1024)
        self.assertEqual((frame.height, frame.width), (310, 1024))
        self.assertEqual(frame.patches, [20, 64])
        given = frame.input(np.full((376, 1241, 3), 255, np.uint8))
        self.assertEqual(given.shape, (1, 3, 1024, 1024))
        self.assertAlmostEqual(given[0, 0, 100, 100], (255 - 123.675) / 58.395, places=4)
        self.assertEqual(given[0, :, 310:].any(), False)
        np.testing.assert_allclose(frame.points([[1240.0, 0.0]]), [[1023.17, 0.0]], atol=0.01)

    def test_logits_are_enlarged_without_the_padding(self):
        frame = ModelFrame(376, 1241, 1024, 1024)
        logits = np.tile(np.arange(256, dtype=np.float32), (256, 1))
        enlarged = frame.enlarge(logits)
        self.assertEqual(enlarged.shape, (310, 1024))
        self.assertAlmostEqual(enlarged[5, 401], 100 - 0.125, places=4)  # pixel middles, as PyTorch does
        np.testing.assert_array_equal(frame.enlarge(logits[:80]), enlarged)

    def test_a_smaller_input_decodes_less(self):
        self.assertEqual(ModelFrame(1200, 1920, 512, 1024).patches, [20, 32])


class DiscModel(PromptedModel):
    """Answers each point with the discs that it lies in: a clear, a vague and a bad proposal each."""

    def __init__(self, discs):
        self.discs, self.asked = discs, []

    def encode(self, image):
        self.size = image.shape[:2]

    def decode(self, points):
        self.asked += [tuple(point) for point in points]
        y, x = np.mgrid[:self.size[0] // 2, :self.size[1] // 2] * 2.0 + 0.5
        scores, logits = np.zeros((len(points), 3)), np.full((len(points), 3) + x.shape, -20.0, np.float32)
        for n, (u, v) in enumerate(points):
            for center_x, center_y, radius in self.discs:
                if math.hypot(u - center_x, v - center_y) < radius:
                    inside = radius - np.hypot(x - center_x, y - center_y)
                    logits[n] = np.stack([20 * inside, 0.1 * inside, 20 * inside])
                    scores[n] = 0.95, 0.99, 0.3
        return scores, logits

    def enlarge(self, logits):
        return cv2.resize(logits, (self.size[1], self.size[0]), interpolation=cv2.INTER_LINEAR)


class AutomaticTest(unittest.TestCase):
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)

    def segment(self, discs, **settings):
        model = DiscModel(discs)
        return AutomaticMasks(model, AutomaticSettings(**settings)).segment(self.image), model

    def test_the_grid_covers_the_image_coarse_first(self):
        points = point_grid(8, HEIGHT, WIDTH)
        self.assertEqual(len({tuple(point) for point in points}), 64)
        np.testing.assert_allclose(points.mean(axis=0), [WIDTH / 2, HEIGHT / 2])
        np.testing.assert_allclose(sorted(set(points[:, 0]))[:2], [6.25, 18.75])
        self.assertEqual(len({tuple(point) for point in points[:4] // [50, 30]}), 4)  # one in each quarter

    def test_each_thing_becomes_one_mask(self):
        masks, model = self.segment([(25, 30, 15), (75, 30, 10)], points_per_side=16, min_area=50)
        self.assertEqual(len(masks), 2)  # doubles and vague or bad proposals are gone
        self.assertEqual(len(model.asked), 256)
        for mask, (x, radius) in zip(masks, ((25, 15), (75, 10))):
            self.assertAlmostEqual(mask.area, math.pi * radius ** 2, delta=0.08 * math.pi * radius ** 2)
            left, top, right, bottom = mask.box
            np.testing.assert_allclose([(left + right) / 2, (top + bottom) / 2], [x, 30], atol=1.0)
            self.assertEqual(mask.score, 0.95)

    def test_thresholds(self):
        discs = [(25, 30, 15), (75, 30, 10)]
        self.assertEqual(len(self.segment(discs, min_area=500)[0]), 1)
        self.assertEqual(len(self.segment(discs, min_predicted_iou=0.97)[0]), 0)
        vague, _ = self.segment([(25, 30, 20), (75, 30, 20)], min_predicted_iou=0.97, min_stability=0.0)
        self.assertEqual([mask.score for mask in vague], [0.99, 0.99])
        nested = [(50, 30, 28), (50, 30, 24)]
        self.assertEqual(len(self.segment(nested, points_per_side=16, max_box_overlap=0.5)[0]), 1)
        self.assertEqual(len(self.segment(nested, points_per_side=16, max_box_overlap=0.9)[0]), 2)

    def test_covered_points_are_not_asked(self):
        discs = [(50, 30, 28)]
        masks, model = self.segment(discs, points_per_side=16)
        fewer, quicker = self.segment(discs, points_per_side=16, skip_covered=True)
        self.assertLess(len(quicker.asked), 0.8 * len(model.asked))
        self.assertEqual([mask.box for mask in fewer], [mask.box for mask in masks])

    def test_it_can_be_stopped(self):
        model = DiscModel([(50, 30, 28)])
        stopped = AutomaticMasks(model).segment(self.image, stop=lambda: len(model.asked) >= 100)
        self.assertIsNone(stopped)
        self.assertEqual(len(model.asked), 104)  # whole batches

    def test_an_empty_image_has_no_masks(self):
        self.assertEqual(self.segment([])[0], [])


class GraphTest(unittest.TestCase):
    def test_patches_of_even_colour(self):
        image = np.full((400, 600, 3), 40, np.uint8)
        image[100:200, 100:300] = (200, 30, 30)
        image[240:360, 400:560] = (30, 200, 30)
        for input_size in (0, 300):
            masks = GraphSegmenter(GraphSettings(), input_size).segment(image)
            self.assertEqual(coverage(masks, 400, 600), 1.0)
            self.assertEqual(sum(mask.area for mask in masks), 400 * 600)  # no overlap
            for mask, area, box in zip(masks, (200800, 20000, 19200), ((0, 0, 600, 400), (100, 100, 300, 200),
                                                                      (400, 240, 560, 360))):
                self.assertAlmostEqual(mask.area, area, delta=0.15 * area)  # the blurred border may be a patch
                np.testing.assert_allclose(mask.box, box, atol=5)

    def test_labels_become_masks(self):
        masks = masks_of_labels(np.int32([[0, 0, 5], [0, 7, 5]]))
        self.assertEqual([(mask.box, mask.area) for mask in masks],
                         [((0, 0, 2, 2), 3), ((2, 0, 3, 2), 2), ((1, 1, 2, 2), 1)])

    def test_without_ximgproc_it_says_what_to_install(self):
        with mock.patch("sam_masks.backends.graph.cv2", types.SimpleNamespace()):
            with self.assertRaisesRegex(BackendError, "opencv-contrib-python"):
                GraphSegmenter()


class NewestTest(unittest.TestCase):
    def test_only_the_newest_is_taken(self):
        newest = Newest()
        self.assertIsNone(newest.take(0.01))
        for thing in "abc":
            newest.put(thing)
        self.assertEqual((newest.take(0.01), newest.replaced), ("c", 2))
        self.assertIsNone(newest.take(0.01))

    def test_interval(self):
        gate = Gate(min_interval=2.0, min_distance=0.0)
        self.assertEqual([gate.passes(stamp) for stamp in (10.0, 11.0, 12.0, 13.9, 14.5)], [True, False, True, False, True])
        self.assertTrue(gate.passes(3.0))  # the bag is played again
        self.assertFalse(gate.passes(4.0))

    def test_distance(self):
        gate = Gate(min_interval=0.0, min_distance=5.0)
        self.assertEqual([gate.passes(t, (x, 0.0, 0.0)) for t, x in ((0, 0), (1, 3), (2, 4.9), (3, 5), (4, 6), (5, 0))],
                         [True, False, False, True, False, True])


class ParametersTest(unittest.TestCase):
    def test_the_manual_lists_every_parameter_with_its_default(self):
        text = (PACKAGE / "config" / "sam_masks.yaml").read_text()
        values, unknown = parameters.read(yaml.safe_load(text))
        defaults, _ = parameters.read({})
        self.assertEqual(unknown, [])
        self.assertEqual(values, defaults)
        self.assertEqual(set(dict(parameters.flatten(yaml.safe_load(text)))), set(parameters.PARAMETERS))
        allowed = [line.split("Allowed: ")[1] for line in text.splitlines() if "Allowed: " in line]
        told = []
        for parameter in parameters.PARAMETERS.values():
            problem = parameter.problem(object())
            told.append(problem.replace("one of ", "").replace(".0 ", " ").replace(".0", ""))
        self.assertEqual(allowed, told)

    def test_bad_values_are_named(self):
        for given, words in (({"threads": 0}, "threads is 0; allowed: a whole number from 1 to 256"),
                             ({"threads": 2.5}, "threads"), ({"threads": True}, "threads"),
                             ({"backend": "yolo"}, 'backend is \'yolo\'; allowed: one of "onnx", "torch", "graph"'),
                             ({"automatic": {"min_area": "many"}}, "automatic/min_area"),
                             ({"compressed": 1}, "compressed"), ({"fixed_frame": 3}, "fixed_frame"),
                             ({"min_interval": float("nan")}, "min_interval")):
            with self.assertRaises(parameters.ParameterError) as raised:
                parameters.read(given)
            self.assertIn(words, str(raised.exception))

    def test_unknown_names_are_told(self):
        self.assertEqual(parameters.read({"automatic": {"points": 3}, "threads": 1})[1], ["automatic/points"])

    def test_command_line(self):
        values = folder_tool.read_parameters(None, ["backend=graph", "graph/scale=100.5", "automatic/skip_covered=true"])
        self.assertEqual((values["backend"], values["graph/scale"], values["automatic/skip_covered"]), ("graph", 100.5, True))
        for setting in ("backend", "graph/size=3", "graph/scale=much"):
            with self.assertRaises(parameters.ParameterError):
                folder_tool.read_parameters(None, [setting])

    def test_a_missing_model_is_named(self):
        values, _ = parameters.read({"onnx": {"encoder": "/nowhere/e.onnx"}})
        with self.assertRaises(BackendError) as raised:
            make_segmenter(values, "/nowhere")
        self.assertIn("./bootstrap sam", str(raised.exception))


class FilesTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = pathlib.Path(self.folder.name)

    def tearDown(self):
        self.folder.cleanup()

    def make_masks(self, *words):
        return subprocess.run([sys.executable, str(PACKAGE / "scripts" / "make_masks"), "--home", str(self.root), *words],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
                              env=dict(os.environ, PYTHONPATH=str(PACKAGE / "python")))

    def test_masks_of_a_folder_of_images(self):
        image = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
        image[:, 50:] = 200
        for name in "ab":
            cv2.imwrite(str(self.root / (name + ".png")), image)
        run = self.make_masks(str(self.root), str(self.root / "masks"), "--set", "backend=graph", "--only", "b")
        self.assertEqual(run.returncode, 0, run.stdout)
        masks, height, width = mask_files.read_masks(self.root / "masks" / "b")
        self.assertEqual((height, width, coverage(masks, height, width)), (HEIGHT, WIDTH, 1.0))
        self.assertFalse((self.root / "masks" / "a").exists())
        name, count, covered, _ = (self.root / "masks" / "make_masks.csv").read_text().strip().split(",")
        self.assertEqual((name, int(count), float(covered)), ("b", len(masks), 1.0))
        self.assertIn("b: masks are there", self.make_masks(str(self.root), str(self.root / "masks"), "--set",
                                                            "backend=graph").stdout)

    def test_make_masks_says_what_is_wrong(self):
        for words, told in (((str(self.root), "out"), "no such image"), (("/nowhere", "out"), "/nowhere"),
                            ((str(self.root), "out", "--set", "threads=0"), "threads is 0")):
            run = self.make_masks(*words)
            self.assertEqual((run.returncode, told in run.stdout), (1, True), run.stdout)

    def test_masks_survive_their_files(self):
        masks = [rectangle(0, 0, 50, 50), rectangle(10, 10, 20, 20)]
        mask_files.write_masks(self.root / "a", masks + [rectangle(1, 1, 2, 2)], HEIGHT, WIDTH)
        mask_files.write_masks(self.root / "a", masks, HEIGHT, WIDTH)  # nothing of before is left
        found, height, width = mask_files.read_masks(self.root / "a")
        self.assertEqual(([mask.box for mask in found], height, width), ([mask.box for mask in masks], HEIGHT, WIDTH))
        self.assertEqual(mask_files.read_layers(self.root / "a", 4).shape, (HEIGHT, WIDTH, 2))
        self.assertEqual(mask_files.entries(self.root), [("a", self.root / "a")])

    def test_label_images(self):
        labels = np.zeros((HEIGHT, WIDTH), np.uint16)
        labels[:10, :10] = 700
        cv2.imwrite(str(self.root / "12.5.png"), labels)
        self.assertEqual(mask_files.entries(self.root)[0][0], "12.5")
        self.assertEqual([mask.area for mask in mask_files.read_masks(self.root / "12.5.png")[0]], [100])

    def test_bad_files_are_named(self):
        with self.assertRaisesRegex(mask_files.MaskFileError, "no such folder"):
            mask_files.entries(self.root / "nowhere")
        with self.assertRaisesRegex(mask_files.MaskFileError, "neither"):
            mask_files.entries(self.root)
        (self.root / "a").mkdir()
        with self.assertRaisesRegex(mask_files.MaskFileError, "no .png"):
            mask_files.read_masks(self.root / "a")
        (self.root / "a" / "0.png").write_text("no picture")
        with self.assertRaisesRegex(mask_files.MaskFileError, "0.png: is no image"):
            mask_files.read_masks(self.root / "a")
        cv2.imwrite(str(self.root / "a" / "0.png"), np.zeros((5, 5), np.uint8))
        cv2.imwrite(str(self.root / "a" / "1.png"), np.zeros((5, 6), np.uint8))
        with self.assertRaisesRegex(mask_files.MaskFileError, "1.png: is 6 x 5 px"):
            mask_files.read_masks(self.root / "a")


class Tensor(np.ndarray):
    """What the torch backend uses of a tensor."""

    def float(self):
        return self.astype(np.float32)

    def cpu(self):
        return self

    def numpy(self):
        return np.asarray(self)


class TorchTest(unittest.TestCase):
    """The glue to packages that are not installed here, with stand-ins of their interfaces."""

    def setUp(self):
        self.file = tempfile.NamedTemporaryFile()
        self.torch = types.ModuleType("torch")
        self.torch.set_num_threads = mock.Mock()
        self.torch.no_grad = contextlib.nullcontext
        self.torch.cuda = types.SimpleNamespace(is_available=lambda: False)
        self.torch.int = np.int32
        self.torch.as_tensor = lambda values, device: np.asarray(values).view(Tensor)
        self.torch.ones = lambda shape, dtype, device: np.ones(shape, dtype)

    def tearDown(self):
        self.file.close()

    def load(self, modules, model, **other):
        settings = dict(checkpoint=self.file.name, threads=3, device="cpu", input_size=0, **{})
        settings.update(other)
        with mock.patch.dict(sys.modules, modules):
            return load_torch_model(model=model, **settings)

    def test_what_is_missing_is_named(self):
        for model, package in (("vit_b", "segment_anything"), ("vit_t", "mobile_sam"), ("sam2_hiera_s.yaml", "sam2")):
            with self.assertRaisesRegex(BackendError, "needs the Python package torch.*install"):
                self.load({"torch": None}, model)
            with self.assertRaisesRegex(BackendError, "needs the Python package " + package):
                self.load({"torch": self.torch, package: None}, model)
        with self.assertRaisesRegex(BackendError, "there is no such file"):
            self.load({"torch": self.torch, "mobile_sam": types.ModuleType("mobile_sam")}, "vit_t", checkpoint="/nowhere")
        with self.assertRaisesRegex(BackendError, "no GPU"):
            self.load({"torch": self.torch, "mobile_sam": types.ModuleType("mobile_sam")}, "vit_t", device="cuda")

    def test_segment_anything(self):
        sam = mock.Mock()
        sam.to.return_value = sam
        sam.image_encoder.img_size = 1024
        sam.prompt_encoder.return_value = ("sparse", "dense")
        sam.mask_decoder.side_effect = lambda **given: (np.zeros((5, 3, 256, 256)).view(Tensor), np.ones((5, 3)).view(Tensor))
        package = types.ModuleType("segment_anything")
        package.sam_model_registry = {"vit_b": mock.Mock(return_value=sam)}
        model = self.load({"torch": self.torch, "segment_anything": package}, "vit_b")
        package.sam_model_registry["vit_b"].assert_called_once_with(checkpoint=self.file.name)
        self.torch.set_num_threads.assert_called_once_with(3)
        model.encode(np.zeros((376, 1241, 3), np.uint8))
        self.assertEqual(sam.image_encoder.call_args[0][0].shape, (1, 3, 1024, 1024))
        scores, logits = model.decode(np.float32([[1241.0 * k / 5, 100.0] for k in range(5)]))
        self.assertEqual((scores.shape, logits.shape), ((5, 3), (5, 3, 256, 256)))
        coordinates, labels = sam.prompt_encoder.call_args[1]["points"]
        self.assertEqual((coordinates.shape, labels.shape), ((5, 1, 2), (5, 1)))
        self.assertAlmostEqual(float(coordinates[1, 0, 0]), 1024 / 5, places=3)
        self.assertEqual(model.enlarge(logits[0, 0]).shape, (310, 1024))

    def test_a_foreign_checkpoint_is_named(self):
        package = types.ModuleType("segment_anything")
        package.sam_model_registry = {"vit_b": mock.Mock(side_effect=RuntimeError("Missing key"))}
        with self.assertRaisesRegex(BackendError, "torch/checkpoint.*Missing key"):
            self.load({"torch": self.torch, "segment_anything": package}, "vit_b")

    def test_sam2(self):
        predictor = mock.Mock()
        predictor.predict.side_effect = lambda point_coords, **given: (  # as it does for a batch of one: squeezed
            None, np.ones((len(point_coords), 3)).squeeze(), np.zeros((len(point_coords), 3, 256, 256)).squeeze(0)
            if len(point_coords) == 1 else np.zeros((len(point_coords), 3, 256, 256)))
        build = types.ModuleType("sam2.build_sam")
        build.build_sam2 = mock.Mock(return_value="model")
        predictors = types.ModuleType("sam2.sam2_image_predictor")
        predictors.SAM2ImagePredictor = mock.Mock(return_value=predictor)
        modules = {"torch": self.torch, "sam2": types.ModuleType("sam2"), "sam2.build_sam": build,
                   "sam2.sam2_image_predictor": predictors}
        model = self.load(modules, "configs/sam2.1/sam2.1_hiera_s.yaml")
        build.build_sam2.assert_called_once_with("configs/sam2.1/sam2.1_hiera_s.yaml", self.file.name, device="cpu")
        model.encode(np.zeros((60, 100, 3), np.uint8))
        for count in (1, 4):
            scores, logits = model.decode(np.zeros((count, 2)))
            self.assertEqual((scores.shape, logits.shape), ((count, 3), (count, 3, 256, 256)))
        self.assertEqual(predictor.predict.call_args[1]["point_coords"].shape, (4, 1, 2))
        self.assertEqual(model.enlarge(logits[0, 0].astype(np.float32)).shape, (60, 100))


if __name__ == "__main__":
    unittest.main(verbosity=2)
