"""Masks in files, as datasets keep them: NAME/ with one binary PNG a mask, or NAME.png with ids."""
import pathlib
import shutil

import cv2
import numpy as np

from sam_masks.masks import Mask, pack_layers, unpack_layers


class MaskFileError(Exception):
    """The message names the file."""


def entries(folder):
    """@return name and path of the masks of each image in a folder, by name."""
    folder = pathlib.Path(folder)
    if not folder.is_dir():
        raise MaskFileError("{}: there is no such folder".format(folder))
    found = sorted((path.stem if path.suffix == ".png" else path.name, path) for path in folder.iterdir()
                   if path.is_dir() or path.suffix == ".png")
    if not found:
        raise MaskFileError("{}: holds neither folders of masks nor label images (.png)".format(folder))
    return found


def read_masks(path):
    """@return the masks of one image, largest first, and its height and width."""
    path = pathlib.Path(path)
    files = sorted(path.glob("*.png")) if path.is_dir() else [path]
    images = [_read(file) for file in files]
    if not images:
        raise MaskFileError("{}: holds no .png".format(path))
    height, width = images[0].shape[:2]
    for file, image in zip(files, images):
        if image.shape[:2] != (height, width):
            raise MaskFileError("{}: is {} x {} px, the first mask {} x {}".format(
                file, image.shape[1], image.shape[0], width, height))
    if not path.is_dir():
        return unpack_layers(images[0]), height, width
    masks = (Mask.of_image(image.reshape(height, width, -1).any(axis=2)) for image in images)
    return sorted((mask for mask in masks if mask), key=lambda mask: -mask.area), height, width


def read_layers(path, max_layers):
    """@return ids of one image, height x width x layers."""
    masks, height, width = read_masks(path)
    return pack_layers(masks, height, width, max_layers)[0]


def write_masks(folder, masks, height, width):
    """Writes one binary PNG a mask, largest first; what was in the folder goes."""
    folder = pathlib.Path(folder)
    unfinished = folder.with_name(folder.name + ".unfinished")
    shutil.rmtree(str(unfinished), ignore_errors=True)
    unfinished.mkdir(parents=True)
    for i, mask in enumerate(masks):
        cv2.imwrite(str(unfinished / "{:03d}.png".format(i)), mask.in_image(height, width).astype(np.uint8) * 255)
    shutil.rmtree(str(folder), ignore_errors=True)
    unfinished.rename(folder)


def _read(file):
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise MaskFileError("{}: is no image".format(file))
    return image
