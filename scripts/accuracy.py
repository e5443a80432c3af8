#!/usr/bin/env python3
"""Measures the paper's method on real frames and writes the table into doc/accuracy.md.

    scripts/accuracy.py                         # all nine cells, some minutes each
    scripts/accuracy.py --trials 5 --frames 1   # a part of it, for a look; other cells are left out of the table

Only the text between the markers is replaced; a new file gets a short frame around it.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
BEGIN = '<!-- accuracy.py: begin {name} -->'
END = '<!-- accuracy.py: end {name} -->'
STARTS = [(1.0, 0.05), (2.5, 0.1), (5.0, 0.2)]  # [deg], [m], uniform per axis

NEW_FILE = """# Accuracy

Every table of this page is written by `scripts/accuracy.py`.

## The paper's method on KITTI odometry 00

The paper (Calib-Anything, its table of accuracy) states for KITTI an L2 error of 10.7 cm and 0.174 deg, Huber
10.4 cm and 0.168 deg; the initial errors and the number of frames behind these figures are not stated.

{begin}
{end}
"""


def find_evaluate(given):
    places = [pathlib.Path(given)] if given else [
        PACKAGE / 'build' / 'devel' / 'lib' / 'lidar_camera_recalibration' / 'evaluate',
        *PACKAGE.parents[1].glob('devel/lib/lidar_camera_recalibration/evaluate')]
    for place in places:
        if place.is_file():
            return str(place)
    sys.exit('evaluate is not built; build the package first, or name the program with --evaluate')


def run_cell(arguments, evaluate, frames, start):
    rotation, translation = start
    with tempfile.TemporaryDirectory() as folder:
        result = pathlib.Path(folder) / 'cell.json'
        command = [evaluate, str(arguments.dataset), '--method', arguments.method, '--frames', str(frames),
                   '--trials', str(arguments.trials), '--seed', str(arguments.seed),
                   '--frame-set', arguments.frame_set,
                   '--start-rotation-deg', str(rotation), '--start-translation-m', str(translation),
                   '--json', str(result)]
        for assignment in arguments.set:
            command += ['--set', assignment]
        print(' '.join(command), flush=True)
        subprocess.run(command, check=True)
        return json.loads(result.read_text())


def row(cell):
    rotation, translation = cell['rotation_deg'], cell['translation_m']
    return '| {} | {} | {} |'.format(
        cell['frames'],
        '±{:g}°, ±{:g} cm'.format(cell['start_rotation_deg'], 100 * cell['start_translation_m']),
        ' | '.join([
            '{:.3f} / {:.1f}'.format(rotation['mean'], 100 * translation['mean']),
            '{:.3f} / {:.1f}'.format(rotation['median'], 100 * translation['median']),
            '{:.3f} / {:.1f}'.format(rotation['p90'], 100 * translation['p90']),
            '{:.3f} / {:.1f}'.format(rotation['huber'], 100 * translation['huber']),
            ', '.join('{:.2f}'.format(value) for value in rotation['axis_mean_absolute']),
            ', '.join('{:.1f}'.format(100 * value) for value in translation['axis_mean_absolute']),
            '{:.0f} %'.format(100 * cell['success_rate']),
            '{:.0f} %'.format(100 * cell['accepted_rate']),
            '{:.0f}'.format(cell['evaluations_per_run']),
            '{:.1f}'.format(cell['cpu_seconds_per_run'])]))


def table(cells, arguments):
    lines = [
        '| frames | start, per axis | mean (L2) | median | p90 | Huber | about x, y, z [deg] | along x, y, z [cm] '
        '| < 0.3° and < 5 cm | accepted | scored | CPU [s] |',
        '|---|---|---|---|---|---|---|---|---|---|---|---|']
    lines += [row(cell) for cell in cells]
    lines += [
        '',
        'Errors as rotation [deg] / translation [cm] against the published calibration of the dataset `{}`; norms'
        .format(arguments.dataset.name),
        'except for the columns per axis of the optical frame, which are mean absolute errors. Method `{}`, {} trials a'
        .format(arguments.method, arguments.trials),
        'row, seed {}, {} frames. A trial draws its start (uniform in the box) and its frames at random and prepares'
        .format(arguments.seed, arguments.frame_set),
        'the frames around that start; the search range is the box. L2 is the mean norm, Huber the M-estimate of location',
        'of the norms (limit 1.345 robust standard deviations), both in the unit of the error. Rejected results count',
        'with what the search found. *Scored*: extrinsics scored in a run. CPU: all of a run on one thread, preparation',
        'of the frames included.']
    if arguments.set:
        lines.append('Changed parameters: {}.'.format(', '.join('`{}`'.format(word) for word in arguments.set)))
    return '\n'.join(lines)


def write(path, name, text):
    begin, end = BEGIN.format(name=name), END.format(name=name)
    if path.exists():
        document = path.read_text()
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        document = NEW_FILE.format(begin=begin, end=end)
    if begin not in document or end not in document:
        sys.exit('{}: the lines "{}" and "{}" are missing; put them where the table belongs'.format(path, begin, end))
    before, rest = document.split(begin, 1)
    after = rest.split(end, 1)[1]
    path.write_text(before + begin + '\n' + text + '\n' + end + after)
    print('written:', path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--dataset', type=pathlib.Path, default=PACKAGE.parent / 'shared' / 'data' / 'kitti_00')
    parser.add_argument('--method', default='paper')
    parser.add_argument('--frames', type=int, nargs='+', default=[1, 5, 10])
    parser.add_argument('--trials', type=int, default=20)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--frame-set', choices=['all', 'even', 'odd'], default='all')
    parser.add_argument('--set', action='append', default=[], metavar='NAME=VALUE', help='parameter of the method')
    parser.add_argument('--evaluate', help='the program, if not in build/')
    parser.add_argument('--out', type=pathlib.Path, default=PACKAGE / 'doc' / 'accuracy.md')
    parser.add_argument('--name', help='of the table, in its markers (default: the method)')
    arguments = parser.parse_args()
    if not arguments.dataset.is_dir():
        sys.exit('{}: there is no such dataset; name one with --dataset'.format(arguments.dataset))

    evaluate = find_evaluate(arguments.evaluate)
    cells = []
    for frames in arguments.frames:
        for start in STARTS:
            cells.append(run_cell(arguments, evaluate, frames, start))
    write(arguments.out, arguments.name or arguments.method, table(cells, arguments))


if __name__ == '__main__':
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit('evaluate failed with status {}'.format(error.returncode))
