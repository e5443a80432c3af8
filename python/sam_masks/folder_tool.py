"""make_masks: masks of a folder of images."""
import argparse
import pathlib
import sys
import time

import cv2
import yaml

from sam_masks import parameters
from sam_masks.backends import BackendError
from sam_masks.environment import add_option
from sam_masks.mask_files import write_masks
from sam_masks.masks import coverage
from sam_masks.segmenter import make_segmenter, step_back

TABLE = "make_masks.csv"  # in the folder of the masks: name, masks, share of the image, CPU time [s]
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


def parse_arguments(description):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("images", type=pathlib.Path, help="folder of images")
    parser.add_argument("out", type=pathlib.Path, help="folder for the masks, e.g. masks of a dataset")
    parser.add_argument("--config", type=pathlib.Path, help="parameters, as config/sam_masks.yaml")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="settings",
                        help="one parameter, e.g. backend=graph or automatic/points_per_side=16")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="images of these names, without ending")
    add_option(parser)
    return parser.parse_args()


def read_parameters(config, settings):
    """@return values of all parameters  @throw ParameterError"""
    given = (yaml.safe_load(config.read_text()) or {}) if config else {}
    for setting in settings:
        name, separator, value = setting.partition("=")
        if not separator:
            raise parameters.ParameterError("--set {}: write it as NAME=VALUE".format(setting))
        *groups, last = name.split("/")
        place = given
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = yaml.safe_load(value)
    values, unknown = parameters.read(given)
    if unknown:
        raise parameters.ParameterError("no such parameter: " + ", ".join(unknown))
    return values


def main(description, home):
    """@return exit status"""
    arguments = parse_arguments(description)
    try:
        values = read_parameters(arguments.config, arguments.settings)
        images = sorted(path for path in arguments.images.iterdir() if path.suffix.lower() in PICTURES)
        if arguments.only:
            images = [path for path in images if path.stem in arguments.only]
        if not images:
            raise OSError("{}: holds no such image".format(arguments.images))
        step_back(values["nice"])
        segmenter = make_segmenter(values, home)
        for path in images:
            make(segmenter, path, arguments.out / path.stem)
    except (parameters.ParameterError, BackendError, OSError) as problem:
        print("make_masks: {}".format(problem), file=sys.stderr)
        return 1
    return 0


def make(segmenter, path, folder):
    if folder.is_dir():
        print("{}: masks are there".format(path.stem))
        return
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise OSError("{}: is no image".format(path))
    start = time.process_time()
    masks = segmenter.segment(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    seconds = time.process_time() - start
    write_masks(folder, masks, *image.shape[:2])
    covered = coverage(masks, *image.shape[:2])
    with (folder.parent / TABLE).open("a") as table:
        table.write("{},{},{:.4f},{:.2f}\n".format(path.stem, len(masks), covered, seconds))
    print("{}: {} masks on {:.0f} % of the image, {:.1f} s CPU".format(path.stem, len(masks), 100 * covered, seconds),
          flush=True)
