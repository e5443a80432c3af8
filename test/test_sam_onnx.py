#!/usr/bin/env python3
"""The ONNX backend for real: MobileSAM on a KITTI frame. Skipped where './bootstrap sam' was not called."""

import os
import pathlib
import sys
import unittest

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(PACKAGE / "python"))

from sam_masks.environment import enter  # noqa: E402

HOME = enter(sys.argv)

import cv2  # noqa: E402  only now the environment's packages can be found
import numpy as np  # noqa: E402

from sam_masks.automatic import AutomaticMasks, AutomaticSettings  # noqa: E402
from sam_masks.backends import BackendError  # noqa: E402
from sam_masks.backends.onnx import OnnxModel  # noqa: E402
from sam_masks.mask_files import read_masks  # noqa: E402
from sam_masks.masks import agreement, coverage  # noqa: E402

ENCODER, DECODER = HOME / "encoder.onnx", HOME / "decoder.onnx"
KITTI = pathlib.Path(os.environ.get("SHARED_DATA", str(PACKAGE.parent / "shared" / "data"))) / "kitti_00"
FRAME = "000000"


def setUpModule():
    if not (ENCODER.is_file() and DECODER.is_file()):
        raise unittest.SkipTest("SKIPPED, MobileSAM is not in {}: call './bootstrap sam'".format(HOME))


def frame():
    image = cv2.imread(str(KITTI / "images" / (FRAME + ".png")))
    if image is None:
        raise unittest.SkipTest("SKIPPED, there is no {}".format(KITTI))
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


class RealMasksTest(unittest.TestCase):
    def test_its_masks_are_those_that_the_data_came_with(self):
        image = frame()
        height, width = image.shape[:2]
        delivered = read_masks(KITTI / "masks" / FRAME)[0]
        model = OnnxModel(ENCODER, DECODER, threads=2)
        masks = AutomaticMasks(model, AutomaticSettings(points_per_side=16)).segment(image)
        found, known = agreement(delivered, masks), agreement(masks, delivered)
        covered, wanted = coverage(masks, height, width), coverage(delivered, height, width)
        print("16 x 16 prompts: {} masks (delivered, 32 x 32: {}), coverage {:.3f} ({:.3f}), delivered masks found {:.3f}, "
              "masks known {:.3f}".format(len(masks), len(delivered), covered, wanted, found, known))
        self.assertGreater(len(masks), 0.4 * len(delivered))
        self.assertLess(len(masks), len(delivered))
        self.assertGreater(covered, wanted - 0.05)
        self.assertGreater(found, 0.75)
        self.assertGreater(known, 0.85)


class DecoderTest(unittest.TestCase):
    def test_what_is_spared_alters_no_mask(self):
        import onnxruntime
        image = frame()
        model = OnnxModel(ENCODER, DECODER, threads=2)
        model.encode(image)
        points = np.float32([[300.0, 200.0], [620.0, 300.0], [1200.0, 20.0]])
        scores, logits = model.decode(points)
        self.assertEqual(logits.shape, (3, 3, 4 * model.frame.patches[0], 256))
        plain = onnxruntime.InferenceSession(str(DECODER), providers=["CPUExecutionProvider"])
        for n, point in enumerate(model.frame.points(points)):
            _, best, mask = plain.run(None, {  # the export's own choice among its proposals
                "image_embeddings": model.embedding, "point_coords": np.float32([[point, (0, 0)]]),
                "point_labels": np.float32([[1, -1]]), "mask_input": np.zeros((1, 1, 256, 256), np.float32),
                "has_mask_input": np.zeros(1, np.float32), "orig_im_size": np.float32(image.shape[:2])})
            chosen = int(np.argmax(scores[n]))
            self.assertAlmostEqual(float(best[0, 0]), float(scores[n, chosen]), places=4)
            np.testing.assert_allclose(mask[0, 0, :logits.shape[2]], logits[n, chosen], atol=1e-3)

    def test_without_the_padding_masks_are_close(self):
        image = frame()
        points = np.float32([[300.0, 200.0], [620.0, 300.0], [900.0, 150.0], [1200.0, 20.0]])
        answers = []
        for attend in (True, False):
            model = OnnxModel(ENCODER, DECODER, threads=2, attend_padding=attend)
            model.encode(image)
            answers.append(model.decode(points))
        self.assertEqual(answers[0][1].shape, answers[1][1].shape)
        best = np.argmax(answers[0][0], axis=1)
        for n, k in enumerate(best):
            one, other = answers[0][1][n, k] > 0, answers[1][1][n, k] > 0
            self.assertGreater(np.count_nonzero(one & other) / np.count_nonzero(one | other), 0.7)

    def test_a_smaller_input_gives_smaller_logits(self):
        image = frame()
        model = OnnxModel(ENCODER, DECODER, threads=2, input_size=512)
        model.encode(image)
        self.assertEqual(model.decode(np.float32([[300.0, 200.0]]))[1].shape, (1, 3, 40, 128))
        with self.assertRaisesRegex(BackendError, "input_size 2000"):
            OnnxModel(ENCODER, DECODER, input_size=2000)

    def test_other_models_are_refused_by_name(self):
        for encoder, decoder, words in ((ENCODER, ENCODER, "encoder.onnx: this is not SAM's decoder"),
                                        (DECODER, DECODER, "decoder.onnx: the encoder takes"),
                                        (ENCODER, pathlib.Path(__file__), "test_sam_onnx.py"),
                                        (pathlib.Path(__file__), DECODER, "ONNX Runtime refuses it")):
            with self.assertRaisesRegex(BackendError, words):
                OnnxModel(encoder, decoder)
        with self.assertRaisesRegex(BackendError, "device 'cuda'"):
            OnnxModel(ENCODER, DECODER, device="cuda")


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=2)
