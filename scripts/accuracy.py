#!/usr/bin/env python3
"""Measures what the package reaches and writes the figures, tables and plots of doc/accuracy.md.

    ./bootstrap accuracy                       # builds what is needed, then all sections; about 40 minutes of CPU, trials in parallel
    scripts/accuracy.py --only beams halves    # these sections, the others stay as they are
    scripts/accuracy.py --trials 2 --work /tmp/a --out /tmp/a/accuracy.md   # for a look

The document's prose is written by hand; only what stands between the markers is replaced. Raw results stay in
build/accuracy/, as CSV with a line for each trial, and are not measured again until --fresh.
"""

import argparse
import collections
import csv
import json
import pathlib
import shutil
import subprocess
import sys

from document import (COLORS, Missing, PACKAGE, call, describe_commit, find_programs, markers, pyplot, save,
                      write_sections)

BEGIN, END = markers('accuracy.py')

# --- what is measured: change it here --------------------------------------------------------------------------------

PAPER = 'paper'
METHOD = 'consistency_edges'
LABELS = {PAPER: 'paper', METHOD: 'edges and regions'}  # in plots

# Variants of METHOD without one of its parts, as evaluate takes them.
ABLATION = [
    METHOD,
    'no_azimuth_gaps:edges/weight_azimuth_gap=0',
    'no_ring_gaps:edges/weight_ring_gap=0',
    'no_reflectivity_steps:edges/weight_reflectivity_step=0',
    'no_region:edges/weight_region=0',
    'azimuth_gaps_only:edges/weight_ring_gap=0,edges/weight_reflectivity_step=0,edges/weight_region=0',
    'no_hidden_culling:frame/cull_hidden=false',
    'paper_search:search=paper',
]

# The terms of Score that have something to show, by method: column of the slices, label.
TERMS = {
    PAPER: [('total', 'total'), ('reflectivity', 'reflectivity $F_R$'), ('normal', 'normal $F_N$'),
            ('segment', 'segment $F_S$')],
    METHOD: [('total', 'total'), ('edges', 'edges'), ('region', 'region')],
}

STARTS = ['E1', 'E2', 'E3']
BASIN = [3, 6, 9, 12]  # [deg]
BEAMS = [64, 32, 16]
SIMULATION = ['--frames', '25', '--rate', '0.05', '--seed', '11']  # 25 frames along 3.8 km of street
# Drives with clouds as fired: 15 m/s, bends of up to 20 deg/s.
MOTION = ['--raw', '--frames', '20', '--rate', '1', '--speed', '15', '--winding', '1.6', '--perturb', '2', '0.1']
MOTION_SEEDS = [11, 12, 13]
MOTION_DELAYS = [0, 0.05]  # of the cloud after its image [s]
AXES = {'rx': 'pitch (about x)', 'ry': 'yaw (about y)', 'rz': 'roll (about z)',
        'tx': 'sideways (along x)', 'ty': 'vertical (along y)', 'tz': 'forward (along z)'}

START_TEXT = {'E1': '±1°, ±5 cm', 'E2': '±2.5°, ±10 cm', 'E3': '±5°, ±20 cm'}

# Masks by sam_masks: label, name, parameters, methods that are measured with them.
MASKS = [
    ('onnx (MobileSAM)', 'onnx', {'backend': 'onnx', 'threads': 1}, [METHOD, PAPER]),
    ('graph', 'graph', {'backend': 'graph', 'threads': 1}, [METHOD, PAPER]),
    ('onnx, no attend_padding', 'onnx_crop', {'backend': 'onnx', 'threads': 1, 'onnx/attend_padding': 'false'}, [METHOD]),
    ('onnx, skip_covered', 'onnx_skip', {'backend': 'onnx', 'threads': 1, 'automatic/skip_covered': 'true'}, [METHOD]),
]


# --- running ---------------------------------------------------------------------------------------------------------

class Bench:
    """Runs evaluate, once for each question."""

    def __init__(self, arguments):
        self.arguments = arguments
        self.programs = find_programs(arguments.programs, 'evaluate')
        self.work = arguments.work
        self.work.mkdir(parents=True, exist_ok=True)
        self.images = arguments.out.parent / 'images'
        self.images.mkdir(parents=True, exist_ok=True)
        self.commit = describe_commit()
        self.asked = set()

    def real(self, name):
        folder = self.arguments.data / name
        if not folder.is_dir():
            raise Missing('{}: there is no such dataset; name the folder of the datasets with --data'.format(folder))
        return folder

    def simulated(self, beams):
        name = 'simulation_{}'.format(beams)
        folder, record = self.work / name, self.work / (name + '.command')
        command = ['--beams', str(beams), *SIMULATION]
        fresh = self.arguments.fresh and name not in self.asked
        if fresh or not record.exists() or record.read_text().split() != command:
            program = self.programs / 'simulate_drive'
            if not program.exists():
                raise Missing('simulate_drive is not built: it needs Embree (libembree-dev)')
            forget(record)
            shutil.rmtree(str(folder), ignore_errors=True)
            call([program, '--dataset', folder, *command])
            record.write_text(' '.join(command) + '\n')
        self.asked.add(name)
        return folder

    def masked(self, name, settings):
        """kitti_00 with masks made anew for the frames at odd positions."""
        source, folder = self.real('kitti_00'), self.work / ('kitti_00_' + name)
        if settings['backend'] == 'onnx' and not (self.arguments.sam / 'decoder.onnx').is_file():
            raise Missing("{}: there is no model; call './bootstrap sam'".format(self.arguments.sam))
        words = ['{}={}'.format(key, value) for key, value in settings.items()]
        record, masks = self.work / (folder.name + '.command'), folder / 'masks'
        fresh = self.arguments.fresh and folder.name not in self.asked
        if fresh or not record.exists() or record.read_text().split() != words:
            forget(record)
            shutil.rmtree(str(folder), ignore_errors=True)
            masks.mkdir(parents=True)
            for part in source.iterdir():
                if part.name != 'masks':
                    (folder / part.name).symlink_to(part.resolve())
            names = sorted(path.stem for path in (source / 'images').iterdir())[1::2]
            call([self.programs / 'make_masks', folder / 'images', masks, '--home', self.arguments.sam, '--set', 'nice=0',
                  *[word for setting in words for word in ('--set', setting)], '--only', *names])
            record.write_text(' '.join(words) + '\n')
        self.asked.add(folder.name)
        return folder

    def run(self, name, dataset, methods, trials, frames=None, starts=('E2',), extra=()):
        """Figures of the cells, {(method, frames, start): cell}; `name` is that of the files that keep them."""
        trials = self.arguments.trials or trials
        result, table = self.work / (name + '.json'), self.work / (name + '.csv')
        command = [self.programs / 'evaluate', dataset, '--trials', trials, '--csv', table, *extra]
        for method in methods:
            command += ['--method', method]
        if frames:
            command += ['--frames', ','.join(str(count) for count in frames)]
        command += ['--start', ','.join(starts)]
        command = [str(word) for word in command]
        kept = read_json(result)
        fresh = self.arguments.fresh and name not in self.asked
        if fresh or kept.get('command') != command[1:]:
            unfinished = self.work / (name + '.unfinished')
            forget(result)  # an interrupted run must not pass for the one before
            call(command + ['--json', unfinished])
            kept = dict(json.loads(unfinished.read_text()), command=command[1:], commit=self.commit)
            result.write_text(json.dumps(kept, indent=1) + '\n')
            unfinished.unlink()
        self.asked.add(name)
        return Cells(kept, table)

    def calibrated(self, seed, delay, fixed_frame):
        """What calibrate_bag says about a drive with clouds as fired."""
        name = 'motion_{}_{}'.format(seed, delay)
        bag, result = self.work / (name + '.bag'), self.work / '{}-{}.json'.format(name, fixed_frame or 'as_fired')
        drive = [*MOTION, '--seed', str(seed), '--cloud-delay', str(delay)]
        command = ['--set', 'fixed_frame=' + fixed_frame, '--set', 'frames/max_turn_rate_deg=360']
        kept = read_json(result)
        fresh = self.arguments.fresh and result not in self.asked
        if fresh or kept.get('command') != drive + command:
            program = self.programs / 'simulate_drive'
            if not program.exists():
                raise Missing('simulate_drive is not built: it needs Embree (libembree-dev)')
            forget(result)
            if bag not in self.asked:
                call([program, bag, *drive])
            unfinished = self.work / (name + '.unfinished')
            try:
                call([self.programs / 'calibrate_bag', bag, '--reference', bag.with_suffix('.truth.yaml'), '--json',
                      unfinished, *command])
            except subprocess.CalledProcessError as error:
                if error.returncode != 3:  # a rejected result, which counts as well
                    raise
            kept = dict(json.loads(unfinished.read_text()), command=drive + command, commit=self.commit)
            result.write_text(json.dumps(kept, indent=1) + '\n')
            unfinished.unlink()
            self.asked.add(bag)
        self.asked.add(result)
        return kept

    def table(self, name, dataset, option, extra):
        """Rows of the table that `evaluate` writes for an option such as --slices; kept as long as the call is the same."""
        table, record = self.work / (name + '.csv'), self.work / (name + '.json')
        command = [str(word) for word in [self.programs / 'evaluate', dataset, option, table, *extra]]
        fresh = self.arguments.fresh and name not in self.asked
        if fresh or read_json(record).get('command') != command[1:]:
            forget(record)
            call(command)
            record.write_text(json.dumps({'command': command[1:], 'commit': self.commit}) + '\n')
        self.asked.add(name)
        with table.open() as stream:
            return list(csv.DictReader(stream))

    def slices(self, name, dataset, extra=()):
        return self.table(name, dataset, '--slices', ['--method', PAPER, '--method', METHOD, *extra])

    def monitor(self, name, dataset, windows, frames, extra=()):
        """Verdicts of the drift monitor on windows: rows of numbers, but `offset`."""
        rows = self.table(name, dataset, '--monitor', [
            '--method', METHOD, '--frames', ','.join(str(count) for count in frames), '--trials',
            self.arguments.trials or windows, *extra])
        return [{key: value if key == 'offset' else float(value) for key, value in row.items()} for row in rows]


class Cells:
    """The figures of a call of evaluate, and its trials where a figure is not enough."""

    def __init__(self, record, table):
        self.record, self.table = record, table
        self.cells = {(cell['method'], cell['frames'], cell['start']): cell for cell in record['cells']}

    def __getitem__(self, key):
        method, frames, start = key
        return self.cells[(name_of(method), str(frames), start)]

    def trials(self):
        with self.table.open() as stream:
            return list(csv.DictReader(stream))


def name_of(method):
    return method.split(':')[0]


def read_json(path):
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return {}


def forget(path):
    if path.exists():
        path.unlink()


# --- tables ----------------------------------------------------------------------------------------------------------

HEAD = ('| method | frames | start, per axis | mean (L2) | median | p90 | Huber | about x, y, z [deg] '
        '| along x, y, z [cm] | < 0.3° and < 5 cm | accepted | scored | CPU [s] |\n' + 13 * '|---' + '|')


def pair(cell, figure):
    return '{:.3f} / {:.1f}'.format(cell['rotation_deg'][figure], 100 * cell['translation_m'][figure])


def axes(cell, figure):
    return [', '.join('{:.2f}'.format(value) for value in cell['rotation_deg'][figure]),
            ', '.join('{:.1f}'.format(100 * value) for value in cell['translation_m'][figure])]


def row(cell, label=None):
    return '| ' + ' | '.join(
        [label or cell['method'], cell['frames'], START_TEXT.get(cell['start'], cell['start'])]
        + [pair(cell, figure) for figure in ('mean', 'median', 'p90', 'huber')]
        + axes(cell, 'axis_mean_absolute')
        + ['{:.0f} %'.format(100 * cell['success_rate']), '{:.0f} %'.format(100 * cell['accepted_rate']),
           '{:.0f}'.format(cell['evaluations_per_run']), '{:.1f}'.format(cell['cpu_seconds_per_run'])]) + ' |'


def note(*results):
    """How the rows above came about."""
    commits = sorted({result.record['commit'] for result in results})
    trials = collections.OrderedDict()
    for result in results:
        for cell in result.record['cells']:
            trials.setdefault(result.record['trials'], []).append(cell['method'])
    words = ['{} trials a row ({})'.format(count, ', '.join(sorted(set(methods))))
             for count, methods in trials.items()]
    return '\n*{}; seed {}; measured at {}.*'.format('; '.join(words), results[0].record['seed'], ', '.join(commits))


def table(cells, *results, head=HEAD):
    return '\n'.join([head] + [row(*cell) if isinstance(cell, tuple) else row(cell) for cell in cells]
                     + [note(*results)])


# --- the runs that more than one section uses ------------------------------------------------------------------------

ODD = ('--frame-set', 'odd')


def kitti_method(bench, start):
    return bench.run('kitti_00_odd-{}-{}'.format(METHOD, start), bench.real('kitti_00'), [METHOD], 20,
                     frames=[1, 3, 5, 10], starts=[start], extra=ODD)


def kitti_paper(bench, start):
    return bench.run('kitti_00_odd-{}-{}'.format(PAPER, start), bench.real('kitti_00'), [PAPER], 3,
                     frames=[1, 3, 5, 10], starts=[start], extra=ODD)


def kitti_twenty(bench):
    return bench.run('kitti_00_all-{}'.format(METHOD), bench.real('kitti_00'), [METHOD], 6, frames=[20], starts=STARTS)


def kitti_rings(bench, every):
    return bench.run('kitti_00_odd_ring{}-{}'.format(every, METHOD), bench.real('kitti_00'), [METHOD], 20,
                     frames=[5, 10], starts=['E2'], extra=ODD + ('--every-ring', every))


def simulation(bench, beams):
    return bench.run('simulation_{}-{}'.format(beams, METHOD), bench.simulated(beams), [METHOD], 10,
                     frames=[1, 3, 5, 10, 20] if beams == 64 else [5, 10], starts=['E3'])


def halves(bench, dataset, name):
    return bench.run('halves_{}-{}'.format(name, METHOD), dataset, [METHOD], 10, starts=['E1'],
                     extra=('--halves', 12))


def other_sensor(bench, name):
    return bench.run('{}-{}'.format(name, METHOD), bench.real(name), [METHOD], 20, frames=['all'], starts=['E1'])


# --- sections --------------------------------------------------------------------------------------------------------

def methods_section(bench):
    results, cells = [], []
    for start in STARTS:
        for method, run in ((PAPER, kitti_paper), (METHOD, kitti_method)):
            results.append(run(bench, start))
            cells += [results[-1][method, frames, start] for frames in (1, 3, 5, 10)]
    results.append(kitti_twenty(bench))
    cells += [(results[-1][METHOD, 20, start], METHOD + ', all frames') for start in STARTS]
    order = {start: i for i, start in enumerate(STARTS)}
    plain = [cell if isinstance(cell, tuple) else (cell, cell['method']) for cell in cells]
    plain.sort(key=lambda item: (item[1] != PAPER, order[item[0]['start']], int(item[0]['frames'])))
    return table(plain, *results)


def beams_section(bench):
    results = [simulation(bench, beams) for beams in BEAMS]
    cells = [(cell, '{}, {} beams'.format(METHOD, beams)) for beams, result in zip(BEAMS, results)
             for cell in result.cells.values()]
    return table(cells, *results)


def rings_section(bench):
    results = [kitti_method(bench, 'E2'), kitti_rings(bench, 2), kitti_rings(bench, 4)]
    cells = [(result[METHOD, frames, 'E2'], '{}, {} rings'.format(METHOD, rings))
             for rings, result in zip((64, 32, 16), results) for frames in (5, 10)]
    return table(cells, *results)


def halves_section(bench):
    results = [halves(bench, bench.real('kitti_00'), 'kitti_00'), halves(bench, bench.simulated(64), 'simulation_64')]
    head = ('| data | frames | median | p90 | mean | about x, y, z [deg] | along x, y, z [cm] |\n' + 7 * '|---' + '|')
    lines = [head]
    for name, result in zip(('kitti_00', 'simulated drive, 64 beams'), results):
        cell = result[METHOD, 12, 'E1']
        lines.append('| ' + ' | '.join([name, '2 x 12'] + [pair(cell, figure) for figure in ('median', 'p90', 'mean')]
                                       + axes(cell, 'axis_mean_absolute')) + ' |')
    return '\n'.join(lines + [note(*results)])


def ablation(bench):
    return bench.run('ablation-{}'.format(METHOD), bench.real('kitti_00'), ABLATION, 8, frames=[5], starts=['E2'],
                     extra=ODD)


def ablation_section(bench):
    result = ablation(bench)
    return table([result[method, 5, 'E2'] for method in ABLATION], result)


def offset_section(bench):
    """Signed means: what all trials have in common is no scatter."""
    odd, drive, few = kitti_method(bench, 'E1'), simulation(bench, 64), simulation(bench, 16)
    even = bench.run('kitti_00_even-{}'.format(METHOD), bench.real('kitti_00'), [METHOD], 8, frames=[10], starts=['E1'],
                     extra=('--frame-set', 'even'))
    parts = ablation(bench)
    other_day = other_sensor(bench, 'kitti_0926')
    rows = [('kitti_00, odd frames', odd[METHOD, 10, 'E1']), ('kitti_00, even frames', even[METHOD, 10, 'E1']),
            ('kitti_00, odd frames', parts[METHOD, 5, 'E2'])]
    rows += [('kitti_00, odd frames, ' + name_of(variant), parts[variant, 5, 'E2'])
             for variant in ABLATION[1:4] + ABLATION[5:6]]
    rows += [('kitti_0926', other_day[METHOD, 'all', 'E1']),
             ('simulated drive, 64 beams', drive[METHOD, 10, 'E3']), ('simulated drive, 16 beams', few[METHOD, 10, 'E3'])]
    lines = ['| data | frames | about x, y, z [deg] | along x, y, z [cm] |', 4 * '|---' + '|']
    lines += ['| {} | {} | {} | {} |'.format(
        label, cell['frames'], ', '.join('{:+.3f}'.format(value) for value in cell['rotation_deg']['axis_mean']),
        ', '.join('{:+.1f}'.format(100 * value) for value in cell['translation_m']['axis_mean'])) for label, cell in rows]
    return '\n'.join(lines + [note(odd, even, parts, other_day, drive, few)])


def covariance_section(bench):
    runs = [('simulated drive, 64 beams, against the truth', simulation(bench, 64), (5, 10, 20), 'E3'),
            ('simulated drive, 16 beams, against the truth', simulation(bench, 16), (5, 10), 'E3'),
            ('kitti_00, against the reference', kitti_method(bench, 'E2'), (5, 10), 'E2'),
            ('kitti_00, one half against the other', halves(bench, bench.real('kitti_00'), 'kitti_00'), (12,), 'E1')]
    lines = ['| data | frames | about x, y, z | along x, y, z |', 4 * '|---' + '|']
    for label, result, counts, start in runs:
        for frames in counts:
            ratios = ['{:.1f}'.format(ratio) for ratio in result[METHOD, frames, start]['normalised_error_rms']]
            lines.append('| {} | {} | {} | {} |'.format(label, frames, ', '.join(ratios[:3]), ', '.join(ratios[3:])))
    return '\n'.join(lines + [note(*[run[1] for run in runs])])


def basin_section(bench):
    counts, turns = [1, 5], ('rx', 'ry', 'rz')
    results = collections.OrderedDict((axis, bench.run(
        'basin-{}-{}'.format(METHOD, axis), bench.real('kitti_00'), [METHOD], 4, frames=counts,
        starts=['{}={}'.format(axis, degrees) for degrees in BASIN], extra=ODD)) for axis in turns)
    rates = {frames: {axis: [100 * results[axis][METHOD, frames, '{}={}'.format(axis, degrees)]['success_rate']
                             for degrees in BASIN] for axis in turns} for frames in counts}
    plot_basin(rates, bench.images / 'basin.png')
    lines = ['![Success against the start](images/basin.png)', '',
             '| frames | start off by | ' + ' | '.join('{}°'.format(degrees) for degrees in BASIN) + ' |',
             (len(BASIN) + 2) * '|---' + '|']
    for frames in counts:
        for axis in turns:
            lines.append('| {} | {} | '.format(frames, AXES[axis])
                         + ' | '.join('{:.0f} %'.format(rate) for rate in rates[frames][axis]) + ' |')
    return '\n'.join(lines + [note(*results.values())])


def frames_section(bench):
    curves = [
        ('kitti_00, ' + LABELS[PAPER], [kitti_paper(bench, 'E3')[PAPER, n, 'E3'] for n in (1, 3, 5, 10)]),
        ('kitti_00, ' + LABELS[METHOD], [kitti_method(bench, 'E3')[METHOD, n, 'E3'] for n in (1, 3, 5, 10)]
         + [kitti_twenty(bench)[METHOD, 20, 'E3']]),
        ('simulated drive, ' + LABELS[METHOD], [simulation(bench, 64)[METHOD, n, 'E3'] for n in (1, 3, 5, 10, 20)]),
    ]
    plot_frames(curves, bench.images / 'error_against_frames.png')
    return '![Error against frames](images/error_against_frames.png)'


def slices_section(bench):
    pictures = []
    for name, dataset, extra in (('kitti_00', bench.real('kitti_00'), ODD), ('simulation', bench.simulated(64), ())):
        rows = bench.slices('slices_' + name, dataset, extra)
        plot_slices(rows, bench.images / 'slices_{}.png'.format(name))
        pictures.append('![Score slices on {0}](images/slices_{0}.png)'.format(name))
    return '\n\n'.join(pictures)


def others_section(bench):
    lines = ['| data | frames | rotation at the start [deg] | after | translation at the start [cm] | after | accepted '
             '| accepted and worse: in the image | in rotation | in translation |', 10 * '|---' + '|']
    results, reasons = [], []
    for name in ('kitti_0926', 'pandar64_a'):
        results.append(other_sensor(bench, name))
        cell, trials = results[-1][METHOD, 'all', 'E1'], results[-1].trials()
        lines.append('| {} | {} | {:.3f} | {:.3f} | {:.1f} | {:.1f} | {:.0f} % | {} | {} | {} |'.format(
            name, len(trials[0]['frame_names'].split()), cell['rotation_deg']['start_mean'],
            cell['rotation_deg']['mean'], 100 * cell['translation_m']['start_mean'],
            100 * cell['translation_m']['mean'], 100 * cell['accepted_rate'],
            *['{} of {}'.format(count_worse(trials, figure), len(trials))
              for figure in ('shift_px', 'rotation_deg', 'translation_m')]))
        refused = collections.Counter(kind_of(trial['reason']) for trial in trials if trial['accepted'] == '0')
        reasons += ['- {}, {} of {}: {}'.format(name, count, len(trials), reason)
                    for reason, count in refused.most_common()]
    return '\n'.join(lines + ['', 'Refused:' if reasons else 'Nothing was refused.'] + [''] * bool(reasons) + reasons
                     + [note(*results)])


ALARM = 0.2  # of drift_probability; kDoubtful in drift_monitor.cpp
WINDOWS = 200
ROC = ('kitti_00, odd frames', 'kitti_0926', 'simulated drive, 64 beams', 'simulated drive, 16 beams')
CALIBRATION = ('kitti_00, odd frames', 'kitti_0926', 'simulated drive, 64 beams')  # not fitted to


def share(rows, frames, offset, size=0.0, threshold=ALARM):
    """Of the windows with an alarm; `size` in deg or m."""
    alarms = [row['probability'] >= threshold for row in rows if row['frames'] == frames and row['offset'] == offset
              and abs(row['rotation_deg'] + row['translation_m'] - size) < 1e-6]
    return sum(alarms) / len(alarms) if alarms else None


def smallest_rotation(rows, frames, detected=0.95):
    """From which on at least so many windows have an alarm."""
    angles = sorted({round(row['rotation_deg'], 6) for row in rows if row['offset'] == 'rotation'}, reverse=True)
    smallest = None
    for angle in angles:
        found = share(rows, frames, 'rotation', angle)
        if found is None or found < detected:
            break
        smallest = angle
    return smallest


def monitor_section(bench):
    frames = [1, 3, 10, 20]
    data = [('kitti_00, odd frames', 'kitti_00_odd', bench.real('kitti_00'), ODD),
            ('kitti_00, all frames', 'kitti_00', bench.real('kitti_00'), ()),
            ('kitti_0926', 'kitti_0926', bench.real('kitti_0926'), ()),
            ('pandar64_a', 'pandar64_a', bench.real('pandar64_a'), ())]
    data += [('simulated drive, {} beams'.format(beams), 'simulation_{}'.format(beams), bench.simulated(beams), ())
             for beams in BEAMS]
    results = [(label, bench.monitor('monitor-' + name, dataset, WINDOWS, frames, extra))
               for label, name, dataset, extra in data]
    plot_monitor(results, bench.images / 'drift_roc.png')
    lines = ['| data | frames | false alarms | highest probability without drift | 0.3° | 0.5° | 1° | 5 cm sideways '
             '| 10 cm sideways | bars |', 10 * '|---' + '|']
    percent = '{:.1f} %'.format
    for label, rows in results:
        for count in sorted({row['frames'] for row in rows}):
            alarms = share(rows, count, 'none')
            highest = max(row['probability'] for row in rows if row['offset'] == 'none' and row['frames'] == count)
            found = [share(rows, count, offset, size) for offset, size in (
                ('rotation', 0.3), ('rotation', 0.5), ('rotation', 1.0), ('sideways', 0.05), ('sideways', 0.1))]
            met = alarms <= 0.01 and found[1] >= 0.98 and found[4] >= 0.98
            verdict = ('met' if met else '**not met**') if count >= 10 or label == 'pandar64_a' else ''
            lines.append('| ' + ' | '.join([label, '{:.0f}'.format(count), percent(100 * alarms),
                                            '{:.2f}'.format(highest)] + [percent(100 * value) for value in found]
                                           + [verdict]) + ' |')
    lines += ['', '| data | smallest rotation that 95 % of the windows detect | frames |', 3 * '|---' + '|']
    for label, rows in results:
        count = max(row['frames'] for row in rows)
        angle = smallest_rotation(rows, count)
        lines.append('| {} | {} | {:.0f} |'.format(label, 'none' if angle is None else '{:g}°'.format(angle), count))
    lines += ['', '| probability given | windows | of them off by more than the tolerance |', 3 * '|---' + '|']
    fair = [row for label, rows in results if label in CALIBRATION for row in rows if row['offset'] == 'random'
            and row['frames'] >= 3]
    for low in (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9):
        high = min([edge for edge in (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0) if edge > low])
        rows = [row for row in fair if low <= row['probability'] < high]
        off = sum(row['rotation_deg'] > 0.3 or row['translation_m'] > 0.05 for row in rows)
        lines.append('| {:g} to {:g} | {} | {} |'.format(low, high, len(rows), percent(100 * off / len(rows)) if rows else ''))
    lines.append('\n*{} windows of each offset; rotations both ways about x, y, z and about 12 random axes; alarm from a probability of {} on.*'.format(
        bench.arguments.trials or WINDOWS, ALARM))
    return '\n'.join(lines)


def count_worse(trials, figure):
    return sum(trial['accepted'] == '1' and float(trial[figure]) > float(trial['start_' + figure]) for trial in trials)


def kind_of(reason):
    """A reason without its numbers, to count them."""
    words = [word for word in reason.replace('rejected: ', '').split() if not any(c.isdigit() for c in word)]
    return ' '.join(words)


def motion_section(bench):
    lines = ['| cloud after the image | clouds | rotation [deg], each drive | translation [cm], each drive '
             '| mean | score | accepted |', 7 * '|---' + '|']
    commits = set()
    for delay in MOTION_DELAYS:
        for label, frame in (('taken as they are', ''), ('deskewed and moved to the image (`fixed_frame`)', 'odom')):
            results = [bench.calibrated(seed, delay, frame) for seed in MOTION_SEEDS]
            commits |= {result['commit'] for result in results}
            turns = [result['rotation_error_after_deg'] for result in results]
            shifts = [100 * result['translation_error_after_m'] for result in results]
            lines.append('| {:.0f} ms | {} | {} | {} | {:.3f}° / {:.1f} cm | {:.3f} | {} of {} |'.format(
                1000 * delay, label, ', '.join('{:.3f}'.format(turn) for turn in turns),
                ', '.join('{:.1f}'.format(shift) for shift in shifts), sum(turns) / len(turns),
                sum(shifts) / len(shifts), sum(result['score_after'] for result in results) / len(results),
                sum(result['accepted'] for result in results), len(results)))
    return '\n'.join(lines + ['\n*Drives with seeds {}; measured at {}.*'.format(
        ', '.join(str(seed) for seed in MOTION_SEEDS), ', '.join(sorted(commits)))])


def masks_section(bench):
    """The same trials with the delivered masks and with those of each backend."""
    sys.path.insert(0, str(PACKAGE / 'python'))
    from sam_masks.mask_files import read_masks
    from sam_masks.masks import agreement
    made, rows, results = [], [], [kitti_method(bench, 'E2'), kitti_paper(bench, 'E2')]
    rows += [(results[0][METHOD, 5, 'E2'], '{}, delivered'.format(METHOD)),
             (results[1][PAPER, 5, 'E2'], '{}, delivered'.format(PAPER))]
    delivered = bench.real('kitti_00') / 'masks'
    for label, name, settings, methods in MASKS:
        dataset = bench.masked(name, settings)
        for method in methods:
            trials = 3 if method == PAPER else 20  # as for the delivered masks
            results.append(bench.run('masks_{}-{}'.format(name, method), dataset, [method], trials, frames=[5],
                                     starts=['E2'], extra=ODD))
            rows.append((results[-1][method, 5, 'E2'], '{}, {}'.format(method, label)))
        with (dataset / 'masks' / 'make_masks.csv').open() as table_file:
            images = list(csv.reader(table_file))
        found, known = [], []
        for image in images:
            theirs, ours = (read_masks(folder / image[0])[0] for folder in (delivered, dataset / 'masks'))
            found.append(agreement(theirs, ours))
            known.append(agreement(ours, theirs))
        count, covered, seconds = (sum(float(image[i]) for image in images) / len(images) for i in (1, 2, 3))
        made.append('| {} | {:.0f} | {:.0f} % | {:.2f} | {:.2f} | {:.1f} |'.format(
            label, count, 100 * covered, sum(found) / len(found), sum(known) / len(known), seconds))
    lines = ['| masks by | masks an image | of the image covered | delivered masks found | masks known to the delivered '
             '| CPU an image [s] |', 6 * '|---' + '|'] + made + ['']
    rows.sort(key=lambda row: row[0]['method'] == PAPER)  # stable: the order of the backends
    return '\n'.join(lines) + '\n' + table(rows, *results)


# Label, dataset, options of evaluate, numbers of frames, starts, trials of each; whether the inputs are fit for use.
NEAR = ('--range-rotation-deg', 1, '--range-translation-m', 0.05)
NEAR_STARTS = ['0 0', '0.1 0.01', '0.3 0.02']
GATE = [
    ('kitti_00', ODD, [5, 10], STARTS, 6, True),
    ('kitti_00, start right or nearly', ODD + NEAR, [5, 10], NEAR_STARTS, 8, True),
    ('kitti_0926', (), [5, 'all'], ['E1'], 8, True),
    ('pandar64_a, 2 frames', (), ['all'], ['E1'], 10, True),
    ('simulation_64', (), [5, 10, 20], ['E1', 'E3'], 4, True),
    ('simulation_64, start right or nearly', NEAR, [5, 10], NEAR_STARTS, 4, True),
    ('simulation_16', (), [5, 10], ['E2'], 8, True),
    ('simulation_16, start right or nearly', NEAR, [5, 10], NEAR_STARTS, 4, True),
    ('kitti_00, 1 frame', ODD, [1], ['E1', 'E2'], 10, False),
    ('simulation_64, 1 frame', (), [1], ['E2'], 20, False),
    ('kitti_00, the 6 largest masks only', ODD + ('--masks', 'largest'), [1, 5], ['E2'], 8, False),
    ('kitti_00, garbage for masks', ODD + ('--masks', 'garbage'), [5, 10], ['E2'], 8, False),
    ('kitti_00, masks of another image', ODD + ('--masks', 'another'), [5, 10], ['E2'], 8, False),
    ('kitti_00, start 15° off, range 5°', ODD + ('--range-rotation-deg', 5), [5], ['rx=15', 'ry=15', 'rz=15'], 6, False),
]


class GateCount:
    """What became of some results: how many there are, and how many of them were refused."""

    def __init__(self):
        self.runs = self.accepted = self.worse = self.good = self.good_refused = self.near = self.near_refused = 0

    def add(self, trial):
        def within(prefix):
            return float(trial[prefix + 'rotation_deg']) < 0.3 and float(trial[prefix + 'translation_m']) < 0.05
        accepted = trial['accepted'] == '1'
        self.runs += 1
        self.accepted += accepted
        self.worse += accepted and float(trial['shift_px']) > float(trial['start_shift_px'])
        if within('start_'):
            self.near += 1
            self.near_refused += not accepted
        elif within(''):
            self.good += 1
            self.good_refused += not accepted

    def __iadd__(self, other):
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)
        return self

    def row(self, label):
        share = ' ({:.0f} %)'.format(100 * self.good_refused / self.good) if self.good else ''
        return '| {} | {} | {} | {} | {} of {}{} | {} of {} |'.format(
            label, self.runs, self.accepted, '**{}**'.format(self.worse) if self.worse else 0, self.good_refused, self.good,
            share, self.near_refused, self.near)


def gate_section(bench):
    """Each trial counts as accepted or not, better or worse than its start, within the tolerance or not."""
    lines = ['| data | runs | accepted | accepted and worse than the start | good, but refused '
             '| refused, start within the tolerance already |', 6 * '|---' + '|']
    sums, reasons, results = {True: GateCount(), False: GateCount()}, collections.Counter(), []
    for number, (label, extra, frames, starts, trials, usable) in enumerate(GATE):
        name = label.split(',')[0]
        dataset = bench.simulated(int(name.split('_')[1])) if name.startswith('simulation') else bench.real(name)
        results.append(bench.run('gate-{}'.format(number), dataset, [METHOD], trials, frames=frames, starts=starts,
                                 extra=('--seed', 3) + tuple(extra)))
        count = GateCount()
        for trial in results[-1].trials():
            count.add(trial)
            if trial['accepted'] == '0':
                reasons[kind_of(trial['reason'].split(';')[0].split('(')[0])] += 1
        lines.append(count.row('{}, {} frames'.format(label, ', '.join(str(n) for n in frames))
                               if 'frame' not in label else label))
        sums[usable] += count
    lines.append(sums[True].row('**fit for use**'))
    lines.append(sums[False].row('**hopeless or nearly**'))
    sums[True] += sums[False]
    lines.append(sums[True].row('**all**'))
    lines.append('')
    lines += ['- {} times: {}'.format(count, reason) for reason, count in reasons.most_common()]
    return '\n'.join(lines + [note(*results)])


# --- the bars --------------------------------------------------------------------------------------------------------

class Bar:
    """One row: what was asked for and what was measured. Limits: figure -> limit; success is at least, others at most."""

    def __init__(self, data, frames, start, cell, **limits):
        self.data, self.frames, self.start, self.cell, self.limits = data, frames, start, cell, limits

    FIGURES = collections.OrderedDict([
        ('rotation', ('rotation', '{:.3f}°', lambda cell: cell['rotation_deg']['median'])),
        ('rotation_p90', ('p90', '{:.3f}°', lambda cell: cell['rotation_deg']['p90'])),
        ('translation', ('translation', '{:.1f} cm', lambda cell: 100 * cell['translation_m']['median'])),
        ('success', ('success', '{:.0f} %', lambda cell: 100 * cell['success_rate'])),
    ])

    def row(self):
        wanted, measured, missed = [], [], []
        for figure, (label, pattern, value_of) in self.FIGURES.items():
            if figure not in self.limits:
                continue
            limit, value = self.limits[figure], value_of(self.cell)
            prefix = 'p90 ' if figure == 'rotation_p90' else ''
            wanted.append('{}{} {}'.format(prefix, '≥' if figure == 'success' else '≤', pattern.format(limit)))
            measured.append(prefix + pattern.format(value))
            if not (value >= limit if figure == 'success' else value <= limit):
                missed.append(label)
        verdict = '**not met: {}**'.format(', '.join(missed)) if missed else 'met'
        return '| {} | {} | {} | {} | {} | {} |'.format(self.data, self.frames, self.start, ', '.join(wanted),
                                                       ', '.join(measured), verdict)


def bars_section(bench):
    results = [simulation(bench, 64), kitti_method(bench, 'E2'), kitti_method(bench, 'E3'), kitti_method(bench, 'E1'),
               kitti_rings(bench, 2), kitti_rings(bench, 4), halves(bench, bench.real('kitti_00'), 'kitti_00')]
    drive, e2, e3, e1, half, quarter, agreement = results
    bars = [
        Bar('simulated drive, 64 beams', 10, 'E3', drive[METHOD, 10, 'E3'], rotation=0.03, translation=0.7,
            success=100),
        Bar('kitti_00', 10, 'E2', e2[METHOD, 10, 'E2'], rotation=0.06, rotation_p90=0.10, translation=4.0,
            success=100),
        Bar('kitti_00', 5, 'E3', e3[METHOD, 5, 'E3'], rotation=0.08, translation=4.2, success=90),
        Bar('kitti_00', 1, 'E1', e1[METHOD, 1, 'E1'], rotation=0.17, translation=4.2, success=65),
        Bar('kitti_00, every 2nd ring', 5, 'E2', half[METHOD, 5, 'E2'], rotation=0.15, translation=4.2, success=75),
        Bar('kitti_00, every 4th ring', 5, 'E2', quarter[METHOD, 5, 'E2'], rotation=0.35, translation=5.0,
            success=40),
        Bar('kitti_00, disjoint sets of 12 frames', '2 x 12', 'E1', agreement[METHOD, 12, 'E1'], rotation=0.05,
            translation=1.2),
    ]
    lines = ['| data | frames | start | asked for: medians, success | measured | |', 6 * '|---' + '|'] + [bar.row() for bar in bars]
    for name in ('kitti_0926', 'pandar64_a'):
        results.append(other_sensor(bench, name))
        trials = results[-1].trials()
        worse = count_worse(trials, 'shift_px')
        refused = sum(trial['accepted'] == '0' for trial in trials)
        lines.append('| {} | all | E1 | never worse than the start, or refused | {} of {} worse, {} refused | {} |'.format(
            name, worse, len(trials), refused, 'met' if worse == 0 else '**not met**'))
    return '\n'.join(lines + [note(*results)])


# --- plots -----------------------------------------------------------------------------------------------------------

def plot_basin(rates, path):
    plt = pyplot()
    figure, panels = plt.subplots(1, len(rates), figsize=(9.5, 3.6), sharey=True)
    for panel, (frames, axes_rates) in zip(panels, rates.items()):
        for i, ((axis, values), color) in enumerate(zip(axes_rates.items(), COLORS)):
            panel.bar([place + 0.26 * (i - 1) for place in range(len(BASIN))], values, width=0.24, color=color,
                      label=AXES[axis])
        panel.set(title='1 frame' if frames == 1 else '{} frames'.format(frames), ylim=(0, 100),
                  xlabel='error of the start about the axis [deg]', xticks=range(len(BASIN)), xticklabels=BASIN)
        panel.grid(False, axis='x')
    panels[0].set_ylabel('trials below 0.3° and 5 cm [%]')
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncol=len(labels))
    figure.tight_layout(rect=(0, 0.08, 1, 1))
    save(figure, path)


def plot_frames(curves, path):
    plt = pyplot()
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 3.8))
    parts = (('rotation_deg', 1.0, 'rotation error [deg]'), ('translation_m', 100.0, 'translation error [cm]'))
    for panel, (part, scale, label) in zip(panels, parts):
        for (name, cells), color in zip(curves, COLORS):
            frames = [int(cell['frames']) for cell in cells]
            median, p90 = ([scale * cell[part][figure_name] for cell in cells] for figure_name in ('median', 'p90'))
            panel.plot(frames, median, marker='o', color=color, label=name)
            panel.fill_between(frames, median, p90, color=color, alpha=0.15, linewidth=0)
        panel.set(xscale='log', yscale='log', xlabel='frames', ylabel=label)
        for axis, places in ((panel.xaxis, FixedLocator([1, 3, 5, 10, 20])), (panel.yaxis, LogLocator(subs=(1, 2, 5)))):
            axis.set_major_locator(places)
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter(FuncFormatter(lambda value, _: '{:g}'.format(value)))
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncol=len(labels))
    figure.suptitle('Start E3 (±5°, ±20 cm on each axis). Line: median; shaded: up to the 90th percentile', fontsize=10)
    figure.tight_layout(rect=(0, 0.07, 1, 1))
    save(figure, path)


def plot_monitor(results, path):
    """Detection against false alarms, from every possible threshold, for one frame and for windows."""
    plt = pyplot()
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.0), sharey=True)
    for panel, (offset, size, title) in zip(panels, (('rotation', 0.5, 'rotation of 0.5°'),
                                                     ('sideways', 0.1, '10 cm sideways'))):
        chosen = [result for result in results if result[0] in ROC]
        for color, (label, rows) in zip(COLORS, chosen):
            rows = [row for row in rows if row['offset'] == 'none'
                    or row['offset'] == offset and abs(row['rotation_deg'] + row['translation_m'] - size) < 1e-6]
            for frames, style in ((1, ':'), (3, '--'), (10, '-')):
                thresholds = sorted({row['probability'] for row in rows if row['frames'] == frames
                                     and row['offset'] == 'none'} | {0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0})
                points = [(share(rows, frames, 'none', 0.0, t), share(rows, frames, offset, size, t)) for t in thresholds]
                points = [(100 * x, 100 * y) for x, y in points if x is not None and y is not None]
                panel.plot([x for x, _ in points], [y for _, y in points], style, color=color, drawstyle='steps-post',
                           label='{}, {} frame{}'.format(label, frames, '' if frames == 1 else 's'))
                if frames == 10:
                    panel.plot(100 * share(rows, 10, 'none'), 100 * share(rows, 10, offset, size), 'o', color=color)
        panel.set(xlabel='false alarms [%]', title=title, xlim=(-1, 40), ylim=(50, 101))
    panels[0].set_ylabel('detected [%]')
    panels[1].legend(fontsize=7, loc='lower right')
    figure.tight_layout()
    save(figure, path)


def plot_slices(rows, path):
    """Each curve is stretched to 0..1 of its own slice: their levels differ, and the place of the top is the point."""
    plt = pyplot()
    figure, panels = plt.subplots(2, 3, figsize=(10.5, 5.6), sharey=True)
    for panel, axis in zip(panels.flat, AXES):
        scale, unit = (1.0, 'deg') if axis.startswith('r') else (100.0, 'cm')
        curves = [(method, column, label) for method, terms in TERMS.items() for column, label in terms]
        own = {METHOD: COLORS[1], PAPER: COLORS[0]}
        extra_colors = iter(['#2f8f57', '#8a5aa8', '#d8a100', '#5f6a72', '#00979d', '#b0567a'])
        for method, column, label in curves:
            color = own[method] if column == 'total' else next(extra_colors)
            points = [(scale * float(row['offset']), float(row[column])) for row in rows
                      if row['method'] == method and row['axis'] == axis]
            values = [value for _, value in points]
            low, high = min(values), max(values)
            if high <= low:
                continue
            panel.plot([offset for offset, _ in points], [(value - low) / (high - low) for value in values],
                       color=color, linewidth=2.0 if column == 'total' else 1.2,
                       linestyle='-' if column == 'total' else '--', label='{}: {}'.format(LABELS[method], label))
        panel.axvline(0.0, color='#888888', linewidth=0.8)
        panel.set(xlabel='{} [{}]'.format(AXES[axis], unit), ylim=(-0.03, 1.05))
    for panel in panels[:, 0]:
        panel.set_ylabel('score, stretched to 0..1')
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncol=min(len(labels), 5), fontsize=9)
    figure.tight_layout(rect=(0, 0.07 if len(labels) <= 5 else 0.11, 1, 1))
    save(figure, path)


# --- the document ----------------------------------------------------------------------------------------------------

SECTIONS = collections.OrderedDict([
    ('bars', bars_section), ('methods', methods_section), ('frames', frames_section), ('beams', beams_section),
    ('rings', rings_section), ('halves', halves_section), ('ablation', ablation_section),
    ('offset', offset_section), ('covariance', covariance_section), ('basin', basin_section),
    ('slices', slices_section), ('masks', masks_section), ('motion', motion_section), ('monitor', monitor_section),
    ('others', others_section), ('gate', gate_section)])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', nargs='+', choices=list(SECTIONS), metavar='SECTION',
                        help='these sections: ' + ', '.join(SECTIONS))
    parser.add_argument('--trials', type=int, help='of every row, instead of what each section has')
    parser.add_argument('--fresh', action='store_true', help='measure again what is there')
    parser.add_argument('--data', type=pathlib.Path, default=PACKAGE.parent / 'shared' / 'data',
                        help='folder of kitti_00, kitti_0926 and pandar64_a (default: %(default)s)')
    parser.add_argument('--work', type=pathlib.Path, default=PACKAGE / 'build' / 'accuracy',
                        help='folder for raw results and simulated drives (default: %(default)s)')
    parser.add_argument('--sam', type=pathlib.Path, default=PACKAGE / 'build' / 'sam',
                        help="what './bootstrap sam' made, for section masks (default: %(default)s)")
    parser.add_argument('--programs', type=pathlib.Path, help='folder of evaluate and simulate_drive')
    parser.add_argument('--out', type=pathlib.Path, default=PACKAGE / 'doc' / 'accuracy.md',
                        help='the document; one that does not exist starts as a copy (default: %(default)s)')
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    sections = collections.OrderedDict((name, section) for name, section in SECTIONS.items()
                                       if name in (arguments.only or SECTIONS))
    missing = write_sections('accuracy.py', sections, Bench(arguments), arguments.out)
    if missing:
        sys.exit('\n'.join(missing))


if __name__ == '__main__':
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit('{} failed with status {}'.format(pathlib.Path(error.cmd[0]).name, error.returncode))
    except ImportError as error:
        sys.exit('{}: install python3-matplotlib, or call ./bootstrap accuracy'.format(error))
