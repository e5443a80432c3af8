#!/usr/bin/env python3
"""The whole chain on real frames: image -> sam_masks -> nodelet -> tf. Run it with

    ./bootstrap shell python3 scripts/sam_chain.py ../shared/data/kitti_00

It plays a dataset's images and clouds without its masks, from a wrong extrinsic and so slowly that sam_masks keeps up,
calls ~recalibrate, and compares the outcome with the dataset's reference.
"""
import argparse
import os
import pathlib
import subprocess
import sys

import demo


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=pathlib.Path, help="folder in CalibAnything's layout")
    parser.add_argument("--out", default="sam_chain", help="folder for bag and results (default: ./sam_chain)")
    parser.add_argument("--backend", default="onnx", choices=["onnx", "torch", "graph"])
    parser.add_argument("--seconds", type=float, default=60.0,
                        help="real time from frame to frame [s] (default: %(default)s); frames that come too fast for "
                             "sam_masks are passed over")
    parser.add_argument("--perturb", nargs=2, default=["3", "0.1"], metavar=("DEG", "M"),
                        help="how wrong the extrinsic is at the start (default: 3 deg, 0.1 m)")
    parser.add_argument("--seed", default="1", help="of the wrong extrinsic's directions")
    return parser.parse_args()


def bag_without_masks(folder, dataset, perturb, seed):
    """@return paths of bag and truth"""
    bare = pathlib.Path(folder) / "dataset"
    bare.mkdir(exist_ok=True)
    for part in dataset.resolve().iterdir():
        link = bare / part.name
        if link.is_symlink():
            link.unlink()
        if part.name != "masks":
            link.symlink_to(part)
    bag = os.path.abspath(os.path.join(folder, "drive.bag"))
    subprocess.check_call([demo.program("dataset_to_bag"), str(bare), "--out", bag, "--rate", "1",
                           "--perturb", *perturb, "--seed", seed])
    return bag, bag.replace(".bag", ".truth.yaml")


def main():
    args = arguments()
    demo.take_signals()
    os.makedirs(args.out, exist_ok=True)
    bag, truth = bag_without_masks(args.out, args.dataset, args.perturb, args.seed)
    launch = demo.Launch(args.out, "replay_sam.launch", bag=bag, backend=args.backend, rate=1.0 / args.seconds)
    return demo.follow(args.out, launch, truth, timeout=100 * args.seconds)


if __name__ == "__main__":
    sys.exit(main())
