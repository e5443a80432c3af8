"""For catkin only: where the Python modules of the package are."""
from distutils.core import setup

from catkin_pkg.python_setup import generate_distutils_setup

setup(**generate_distutils_setup(packages=["calibrate_fleet", "sam_masks", "sam_masks.backends"],
                                package_dir={"": "python"}, package_data={"calibrate_fleet": ["Snakefile"]}))
