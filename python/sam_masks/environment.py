"""What './bootstrap sam' makes, a Python environment and a model, in one folder: venv/, encoder.onnx, decoder.onnx."""
import argparse
import os
import pathlib
import sys


def add_option(parser):
    parser.add_argument("--home", default=os.environ.get("SAM_MASKS_HOME", ""), metavar="FOLDER",
                        help="what './bootstrap sam' made (default: $SAM_MASKS_HOME, or build/sam of the package)")


def enter(argv):
    """Goes on in the environment's Python where there is one; it sees the system's packages, ROS among them, as well.

    @param argv of the program, which may name the folder  @return the folder
    """
    parser = argparse.ArgumentParser(add_help=False)
    add_option(parser)
    given = parser.parse_known_args(argv[1:])[0].home
    home = pathlib.Path(given) if given else pathlib.Path(__file__).resolve().parents[2] / "build" / "sam"
    python = home / "venv" / "bin" / "python3"
    if python.is_file() and pathlib.Path(sys.prefix).resolve() != (home / "venv").resolve():
        os.execv(str(python), [str(python)] + argv)
    return home
