"""What the scripts share that write figures into the documents of doc/."""

import pathlib
import shutil
import subprocess
import sys

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
COLORS = ['#c1440e', '#1f5a94', '#2f8f57', '#8a5aa8']


class Missing(Exception):
    """A dataset or program is not there."""


# --- sections of a document ------------------------------------------------------------------------------------------

def markers(script):
    """The lines around a section that a script writes, with {} for its name."""
    return '<!-- {}: begin {{}} -->'.format(script), '<!-- {}: end {{}} -->'.format(script)


def replace(document, script, name, text, path):
    begin, end = (marker.format(name) for marker in markers(script))
    if document.count(begin) != 1 or document.count(end) != 1:
        sys.exit('{}: the lines "{}" and "{}" must be there once; put them where the section belongs'.format(
            path, begin, end))
    before, rest = document.split(begin)
    return before + begin + '\n' + text + '\n' + end + rest.split(end)[1]


def write_sections(script, sections, bench, out):
    """Asks each section for its text and puts it between its markers; a document that does not exist starts as a copy.
    Returns why some sections were left as they were."""
    if not out.exists():
        shutil.copy(str(PACKAGE / 'doc' / script.replace('.py', '.md')), str(out))
    missing = []
    for name, section in sections.items():
        print('--- section', name, flush=True)
        try:
            text = section(bench)
        except Missing as reason:
            missing.append('section {} is left as it was: {}'.format(name, reason))
            continue
        out.write_text(replace(out.read_text(), script, name, text, out))
    print('written:', out)
    return missing


# --- programs --------------------------------------------------------------------------------------------------------

def call(command, **options):
    command = [str(word) for word in command]
    print('$ ' + ' '.join("'{}'".format(word) if ' ' in word else word for word in command), flush=True)
    subprocess.run(command, check=True, **options)


def find_programs(given, program):
    """The folder of the package's programs."""
    package = PACKAGE / 'build' / 'devel' / 'lib' / 'lidar_camera_recalibration'
    places = [given] if given else [package, *PACKAGE.parents[1].glob('devel/lib/lidar_camera_recalibration')]
    for place in places:
        if (place / program).is_file():
            return place
    sys.exit('{} is not built; build the package first, or name the folder of the programs with --programs'.format(
        program))


def describe_commit():
    try:
        return subprocess.run(['git', '-C', str(PACKAGE), 'describe', '--always', '--dirty=+'], check=True,
                              stdout=subprocess.PIPE, universal_newlines=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return 'unknown'


# --- plots -----------------------------------------------------------------------------------------------------------

def pyplot():
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot as plt
    plt.rcParams.update({'font.size': 10, 'axes.spines.top': False, 'axes.spines.right': False, 'axes.grid': True,
                         'grid.color': '#dddddd', 'grid.linewidth': 0.6, 'axes.axisbelow': True,
                         'legend.frameon': False, 'lines.linewidth': 1.8})
    return plt


def save(figure, path):
    from PIL import Image  # comes with matplotlib
    figure.savefig(str(path), dpi=110, bbox_inches='tight')
    pyplot().close(figure)
    Image.open(str(path)).convert('RGB').quantize(96).save(str(path), optimize=True)  # a third of the size
    print('written:', path)
