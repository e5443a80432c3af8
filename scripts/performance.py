#!/usr/bin/env python3
"""Measures what the package costs and writes the figures, tables and plots of doc/performance.md.

    ./bootstrap benchmark                               # builds what is needed, then all sections; about 8 minutes
    scripts/performance.py --only preparation           # these sections, the others stay as they are
    scripts/performance.py --repetitions 1 --out /tmp/performance.md     # for a look

The document's prose is written by hand; only what stands between the markers is replaced. Everything is measured anew by
benchmark/ (build/performance/ keeps the raw results), but the simulated drive is kept until --fresh.

Machines are noisy: every figure is CPU time and the fastest of some repetitions, since noise only ever adds; beside it
stand a floor from the same run and, by valgrind, numbers that do not depend on the load.
"""

import argparse
import collections
import functools
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys

from document import COLORS, Missing, PACKAGE, call, describe_commit, find_programs, pyplot, save, write_sections

# --- what is measured: change it here --------------------------------------------------------------------------------

PROGRAM = 'performance_benchmark'
DRIVE = ['--frames', '50', '--rate', '0.05', '--seed', '11']
DRIVE_FRAMES = [1, 5, 10, 50]
KITTI_FRAMES = [1, 5, 10]
# First-level caches of which bytes moved are counted, the same on every machine.
CACHE = ['--I1=32768,8,64', '--D1=32768,8,64']
LINE = 64  # of the cache [byte]

FLOOR, FLOOR_LABEL = 'projection', 'projection_and_label'
EVALUATIONS = collections.OrderedDict([
    (FLOOR, '*floor: bare projection*'),
    (FLOOR_LABEL, '*floor: projection and one label each*'),
    ('paper', '`paper`'),
    ('consistency_edges', '`consistency_edges`, edges and regions'),
    ('edge_score', '`consistency_edges`, edges alone'),
    ('least_squares_step', '`consistency_edges`, a least-squares step'),
])
CURVES = ['paper', 'consistency_edges', 'edge_score', FLOOR_LABEL, FLOOR]

# Stages of makeFrame. What no function measures alone is a difference: (stage, without).
STAGES = collections.OrderedDict([
    ('crop', ('crop, with the rings', None)),
    ('normals', ('normals', None)),
    ('planes', ('planes', ('segments', 'clusters'))),
    ('clusters', ('clusters', None)),
    ('reflectivity', ('reflectivity', None)),
    ('visibility', ('visibility', None)),
    ('edges', ('LiDAR edges', None)),
    ('undistort', ('image and masks without distortion', None)),
    ('label_sets', ('label sets', None)),
    ('mask_borders', ('mask borders', None)),
    ('boundary_field', ('boundary field', None)),
])
PLACES = collections.OrderedDict([('kitti_00', 'kitti_00'), ('large', 'simulated')])
RECALIBRATIONS = [('kitti_00', 10), ('drive', 10), ('drive', 50)]
STARTS = ['2.5deg_10cm', '5.0deg_20cm']
START_TEXT = {'2.5deg_10cm': '2.5°, 10 cm', '5.0deg_20cm': '5°, 20 cm'}
SCORE_TOLERANCE = 1e-3  # between textbook and package; test_textbook holds the package to it


# --- running ---------------------------------------------------------------------------------------------------------

class Case:
    """A measurement: the fastest repetition [s], and the figures that the program tells with it."""

    def __init__(self, cpu, wall, counters):
        self.cpu, self.wall, self.counters = cpu, wall, counters

    def __getitem__(self, counter):
        return self.counters[counter]

    def per_candidate(self):
        return self.cpu / self['candidates']

    def per_point(self, points='points'):
        """[ns]"""
        return 1e9 * self.per_candidate() / self[points]


UNITS = {'ns': 1e-9, 'us': 1e-6, 'ms': 1e-3, 's': 1.0}
# What Google Benchmark tells beside the counters of a case.
OWN_KEYS = {'name', 'run_name', 'run_type', 'repetitions', 'repetition_index', 'threads', 'iterations', 'real_time',
            'cpu_time', 'time_unit', 'family_index', 'per_family_instance_index'}


def case_name(name):
    """Without what Google Benchmark appends."""
    return re.split(r'/(?:min_time|iterations|repeats|process_time|real_time)\b', name)[0]


def read_cases(text):
    cases = collections.OrderedDict()
    for entry in json.loads(text)['benchmarks']:
        if entry.get('run_type') == 'aggregate':
            continue
        name = case_name(entry['name'])
        if entry.get('error_occurred'):
            sys.exit('{}: {}'.format(name, entry.get('error_message')))
        unit = UNITS[entry['time_unit']]
        case = Case(unit * entry['cpu_time'], unit * entry['real_time'],
                    {key: value for key, value in entry.items() if key not in OWN_KEYS})
        best = cases.get(name)
        if best:
            case.cpu, case.wall = min(case.cpu, best.cpu), min(case.wall, best.wall)
        cases[name] = case
    return cases


Count = collections.namedtuple('Count', 'instructions moved')  # moved: bytes into the first-level cache


def read_counts(dumps):
    """The dumps of callgrind, one a measurement."""
    counts = {}
    for dump in dumps:
        name = re.search(r'^desc: Trigger: Client Request: (.*)$', dump, re.MULTILINE)
        if not name:
            continue  # that of the end of the program
        events = re.search(r'^events: (.*)$', dump, re.MULTILINE).group(1).split()
        totals = dict(zip(events, map(int, re.search(r'^totals: (.*)$', dump, re.MULTILINE).group(1).split())))
        counts[name.group(1)] = Count(totals['Ir'], LINE * (totals['D1mr'] + totals['D1mw']))
    return counts


class Bench:
    """Runs the benchmark program, once for each question."""

    def __init__(self, arguments):
        self.arguments = arguments
        self.programs = find_programs(arguments.programs, PROGRAM)
        self.program = self.programs / PROGRAM
        self.work = arguments.work
        self.work.mkdir(parents=True, exist_ok=True)
        self.images = arguments.out.parent / 'images'
        self.images.mkdir(parents=True, exist_ok=True)
        self.kept = {}

    def build(self):
        return json.loads(subprocess.check_output([str(self.program), '--build'], universal_newlines=True))

    def inputs(self):
        kitti = self.arguments.data / 'kitti_00'
        if not kitti.is_dir():
            raise Missing('{}: there is no such dataset; name the folder of the datasets with --data'.format(kitti))
        return ['--kitti={}'.format(kitti), '--drive={}'.format(self.drive())]

    def drive(self):
        folder, record = self.work / 'drive', self.work / 'drive.command'
        fresh = self.arguments.fresh and 'drive' not in self.kept
        if fresh or not record.exists() or record.read_text().split() != DRIVE:
            program = self.programs / 'simulate_drive'
            if not program.exists():
                raise Missing('simulate_drive is not built: it needs Embree (libembree-dev)')
            if record.exists():
                record.unlink()
            shutil.rmtree(str(folder), ignore_errors=True)
            call([program, '--dataset', folder, *DRIVE])
            record.write_text(' '.join(DRIVE) + '\n')
        self.kept['drive'] = True
        return folder

    def cases(self, name, pattern, repetitions):
        """@param pattern  of the names of the measurements"""
        if name not in self.kept:
            result = self.work / (name + '.json')
            call([self.program, *self.inputs(), '--min-time={}'.format(self.arguments.min_time),
                  '--repetitions={}'.format(self.arguments.repetitions or repetitions),
                  '--benchmark_filter=' + pattern, '--benchmark_out={}'.format(result),
                  '--benchmark_out_format=json'], stdout=subprocess.DEVNULL)
            self.kept[name] = read_cases(result.read_text())
        return self.kept[name]

    def counts(self):
        """Of what is measured on the first frame of kitti_00."""
        if 'counts' not in self.kept:
            folder = self.work / 'callgrind'
            shutil.rmtree(str(folder), ignore_errors=True)
            folder.mkdir()
            pattern = '^(evaluation/.*/kitti_00/frames:1/|preparation/kitti_00/|side_by_side/score)'
            call(['valgrind', '--tool=callgrind', '--instr-atstart=no', '--cache-sim=yes', *CACHE, '-q',
                  '--callgrind-out-file={}'.format(folder / 'out'), self.program, *self.inputs(),
                  '--count-instructions', '--benchmark_filter=' + pattern], stdout=subprocess.DEVNULL)
            self.kept['counts'] = read_counts([dump.read_text() for dump in sorted(folder.iterdir())])
        return self.kept['counts']


def evaluation(bench):
    return bench.cases('evaluation', '^evaluation/', 3)


def preparation(bench):
    return bench.cases('preparation', '^preparation/', 3)


def recalibration(bench):
    return bench.cases('recalibration', '^recalibration/', 3)


def side_by_side(bench):
    return bench.cases('side_by_side', '^side_by_side/', 3)


def memory(bench):
    """Each in a process of its own."""
    cases = collections.OrderedDict()
    for place in ('kitti_00/frames:10', 'drive/frames:50', 'large/frames:1'):
        cases.update(bench.cases('memory_' + re.sub(r'\W', '_', place), '^memory/{}'.format(place), 1))
    return cases


# --- tables ----------------------------------------------------------------------------------------------------------

def table(head, rows):
    return '\n'.join(['| ' + ' | '.join(head) + ' |', len(head) * '|---' + '|']
                     + ['| ' + ' | '.join(row) + ' |' for row in rows])


@functools.lru_cache()
def commit():
    return describe_commit()  # when the run begins; somebody may commit during it


def note(*words):
    return '\n*{}*'.format('; '.join([*words, 'measured at {}.'.format(commit())]))


def number(value):
    """Three digits."""
    if value == 0:
        return '0'
    rounded = float('{:.3g}'.format(value))
    return '{:.{}f}'.format(rounded, min(4, max(0, 2 - math.floor(math.log10(abs(rounded))))))


def thousands(value):
    return '{} k'.format(number(value / 1e3))


def place_of(frames, source='kitti_00', threads=1):
    return '{}/frames:{}/threads:{}'.format(source, frames, threads)


def machine_section(bench):
    lines = pathlib.Path('/proc/cpuinfo').read_text().splitlines()
    model = next((line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')), 'unknown')
    speed = next((line.split(':', 1)[1].strip() for line in lines if line.startswith('cpu MHz')), None)
    release = dict(line.split('=', 1) for line in pathlib.Path('/etc/os-release').read_text().splitlines() if '=' in line)
    build = bench.build()
    rows = [['processor', model + (', {:.0f} MHz'.format(float(speed)) if speed else '')],
            ['cores', str(os.cpu_count())],
            ['system', release.get('PRETTY_NAME', 'unknown').strip('"')],
            ['compiler', build['compiler']],
            ['flags', '`{}`'.format(build['flags'].strip())],
            ['load when measured', '{:.1f} (1 would be this measurement alone)'.format(os.getloadavg()[0])]]
    return table(['', ''], rows) + '\n' + note('callgrind simulates a first-level cache of 32 kB')


# --- candidate evaluation --------------------------------------------------------------------------------------------

def evaluation_section(bench):
    cases, counts = evaluation(bench), bench.counts()
    floor = cases['evaluation/{}/{}'.format(FLOOR, place_of(10))]
    rows = []
    for name, label in EVALUATIONS.items():
        case, count = cases['evaluation/{}/{}'.format(name, place_of(10))], counts['evaluation/{}/{}'.format(name, place_of(1))]
        one = cases['evaluation/{}/{}'.format(name, place_of(1))]
        visits = one['points'] * one['candidates']
        rows.append([label, number(1e6 * case.per_candidate()), number(case.per_point()),
                     number(case.per_point('cloud_points')), number(case.cpu / floor.cpu),
                     number(count.instructions / visits), number(count.moved / visits)])
    head = ['kitti_00, 10 frames, 1 thread', 'µs per candidate', 'ns per point in view', 'ns per point of the clouds',
            '× floor', 'instructions per point in view', 'bytes moved per point in view']
    return table(head, rows) + '\n' + note(
        '{} points in view, {} of the clouds, {} edges'.format(*(thousands(floor[key]) for key in ('points', 'cloud_points', 'edges'))),
        'instructions and bytes counted on the first frame')


def curve(cases, name, places):
    return [cases['evaluation/{}/{}'.format(name, place)] for place in places]


def sources(cases, prefix):
    """In the order in which they were measured."""
    pattern = re.compile(r'evaluation/{}/({}[^/]*)/frames:1/threads:1$'.format(FLOOR, prefix))
    return [match.group(1) for match in map(pattern.match, cases) if match]


def scaling_section(bench):
    cases = evaluation(bench)
    densities = [place_of(1, source) for source in sources(cases, 'density_')]
    masks = [place_of(1, source) for source in sources(cases, 'masks_')]
    groups = [
        ('simulated, 1 frame', densities, lambda case: '{} points'.format(thousands(case['points']))),
        ('simulated, 1 frame', masks, lambda case: '{:.0f} masks'.format(case['masks_per_frame'])),
        ('simulated drive', [place_of(frames, 'drive') for frames in DRIVE_FRAMES], None),
        ('kitti_00', [place_of(frames) for frames in KITTI_FRAMES], None),
    ]
    rows = []
    for data, places, label in groups:
        for place in places:
            row_cases = [cases['evaluation/{}/{}'.format(name, place)] for name in CURVES]
            count = place.split('/')[1].replace('frames:', '')
            text = label(row_cases[0]) if label else count + (' frame' if count == '1' else ' frames')
            rows.append(['{}: {}'.format(data, text), thousands(row_cases[0]['points']), thousands(row_cases[0]['edges'])]
                        + ['{} / {}'.format(number(1e6 * case.per_candidate()), number(case.per_point()))
                           for case in row_cases])
    threads = []
    for objective in ('paper', 'consistency_edges'):
        one, two = (cases['evaluation/{}/{}'.format(objective, place_of(10, threads=count))] for count in (1, 2))
        threads.append('- 2 threads instead of 1, kitti_00, 10 frames, `{}`: {} of the wall time, {} of the CPU time'.format(
            objective, number(two.wall / one.wall), number(two.cpu / one.cpu)))
    plot_scaling(cases, densities, masks, bench.images / 'performance_scaling.png')
    head = ['µs per candidate / ns per point in view', 'points in view', 'edges'] + [
        EVALUATIONS[name].replace('`consistency_edges`, ', '') if name == 'edge_score' else EVALUATIONS[name]
        for name in CURVES]
    return '![Cost of a candidate](images/performance_scaling.png)\n\n' + table(head, rows) + '\n\n' + '\n'.join(
        threads) + '\n' + note('1 thread where nothing else is said')


def use_log_axes(panel):
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
    panel.set(xscale='log', yscale='log')
    for axis, steps in ((panel.xaxis, (1, 2, 5)), (panel.yaxis, (1,))):
        axis.set_major_locator(LogLocator(subs=steps))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(
            lambda value, _: '{:g} k'.format(value / 1e3) if value >= 1e3 else '{:g}'.format(value)))


def plot_scaling(cases, densities, masks, path):
    plt = pyplot()
    figure, panels = plt.subplots(2, 2, figsize=(10, 7.2))
    colors = dict(zip(CURVES, [COLORS[0], COLORS[1], COLORS[2], '#8a8a8a', '#333333']))
    parts = [(panels[0, 0], densities, 'points', 'points in view of 1 frame'),
             (panels[0, 1], masks, 'masks_per_frame', 'masks of 1 frame'),
             (panels[1, 0], [place_of(frames, 'drive') for frames in DRIVE_FRAMES], None, 'frames of the simulated drive')]
    for panel, places, counter, label in parts:
        for name in CURVES:
            row = curve(cases, name, places)
            x = [case[counter] for case in row] if counter else DRIVE_FRAMES
            panel.plot(x, [1e6 * case.per_candidate() for case in row], marker='o', color=colors[name],
                       linestyle='--' if name in (FLOOR, FLOOR_LABEL) else '-',
                       label=EVALUATIONS[name].replace('`', '').replace('*', ''))
        panel.set(xlabel=label, ylabel='µs per candidate')
        use_log_axes(panel)
    panel = panels[1, 1]
    for i, name in enumerate(('paper', 'consistency_edges')):
        row = [cases['evaluation/{}/{}'.format(name, place_of(10, threads=threads))] for threads in (1, 2)]
        for k, (kind, hatch) in enumerate((('wall', None), ('cpu', '//'))):
            panel.bar([2.6 * i + threads + 0.36 * (k - 0.5) for threads in (0, 1)],
                      [1e6 * getattr(case, kind) / case['candidates'] for case in row], width=0.34,
                      color=colors[name], alpha=1.0 if k == 0 else 0.45, hatch=hatch,
                      label='{}, {} time'.format(name, kind))
    panel.set(xticks=[0, 1, 2.6, 3.6], xticklabels=['1', '2', '1', '2'], xlabel='threads, 10 frames of kitti_00',
              ylabel='µs per candidate')
    panel.grid(False, axis='x')
    panel.legend(fontsize=8)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncol=3, fontsize=9)
    figure.tight_layout(rect=(0, 0.07, 1, 1))
    save(figure, path)


# --- frame preparation -----------------------------------------------------------------------------------------------

def stage_values(values, place):
    """[(stage, value)] of whatever `values` tells of the measurement of a name."""
    result = collections.OrderedDict()
    for stage, (_, difference) in STAGES.items():
        if difference:
            result[stage] = values('preparation/{}/{}'.format(place, difference[0])) - values(
                'preparation/{}/{}'.format(place, difference[1]))
        else:
            result[stage] = values('preparation/{}/{}'.format(place, stage))
    return result


def preparation_section(bench):
    cases, counts = preparation(bench), bench.counts()
    whole = {place: cases['preparation/{}/makeFrame'.format(place)] for place in PLACES}
    floor = {place: cases['preparation/{}/projection'.format(place)] for place in PLACES}
    milliseconds = {place: stage_values(lambda name: 1e3 * cases[name].cpu, place) for place in PLACES}
    instructions = stage_values(lambda name: counts[name].instructions, 'kitti_00')
    moved = stage_values(lambda name: counts[name].moved, 'kitti_00')
    rows = []

    def add(label, of_place, instruction_count, byte_count):
        rows.append([label] + [text for place in PLACES for text in
                               (number(of_place[place]), number(of_place[place] / (1e3 * floor[place].cpu)))]
                    + [number(instruction_count / 1e6), number(byte_count / 1e6) if byte_count > 0 else '-'])

    total = counts['preparation/kitti_00/makeFrame']
    for stage, (label, _) in STAGES.items():
        add(label, {place: milliseconds[place][stage] for place in PLACES}, instructions[stage], moved[stage])
    add('rest: copies, normals and flags into place',
        {place: 1e3 * whole[place].cpu - sum(milliseconds[place].values()) for place in PLACES},
        total.instructions - sum(instructions.values()), total.moved - sum(moved.values()))
    add('**whole frame**', {place: 1e3 * whole[place].cpu for place in PLACES}, total.instructions, total.moved)
    count = counts['preparation/kitti_00/projection']
    add('*floor: bare projection of the cloud*', {place: 1e3 * floor[place].cpu for place in PLACES},
        count.instructions, count.moved)
    plot_preparation(cases, milliseconds, whole, bench.images / 'performance_preparation.png')
    head = ['stage']
    for place, label in PLACES.items():
        case = whole[place]
        head += ['{}, {:.0f}x{:.0f}, {} points: CPU [ms]'.format(label, case['width'], case['height'], thousands(case['cloud'])),
                 '× floor']
    head += ['kitti_00: M instructions', 'MB moved']
    return '![Cost of a frame](images/performance_preparation.png)\n\n' + table(head, rows) + '\n' + note(
        'one thread', 'points after crop: ' + ', '.join(
            thousands(cases['preparation/{}/normals'.format(place)]['cropped']) for place in PLACES))


def plot_preparation(cases, milliseconds, whole, path):
    plt = pyplot()
    figure, panels = plt.subplots(1, 2, figsize=(10.5, 4.2), gridspec_kw={'width_ratios': [1.25, 1]})
    panel = panels[0]
    palette = ['#c1440e', '#1f5a94', '#2f8f57', '#8a5aa8', '#d8a100', '#00979d', '#b0567a', '#5f6a72', '#7a9e3b',
               '#4f7cc4', '#a0693c', '#333333']
    left = {place: 0.0 for place in PLACES}
    for (stage, (label, _)), color in zip(STAGES.items(), palette):
        values = [max(0.0, milliseconds[place][stage]) for place in PLACES]
        panel.barh(range(len(PLACES)), values, left=[left[place] for place in PLACES], color=color, label=label, height=0.6)
        for place, value in zip(PLACES, values):
            left[place] += value
    panel.set(yticks=range(len(PLACES)), xlabel='CPU [ms]', yticklabels=[
        '{}\n{:.0f}x{:.0f}\n{} points'.format(label, whole[place]['width'], whole[place]['height'],
                                             thousands(whole[place]['cloud'])) for place, label in PLACES.items()])
    panel.grid(False, axis='y')
    panel.legend(fontsize=7.5, ncol=3, loc='upper center', bbox_to_anchor=(0.45, -0.18))
    pattern = re.compile(r'preparation/density_[^/]*/makeFrame$')
    row = sorted((case for name, case in cases.items() if pattern.match(name)), key=lambda case: case['cloud'])
    panels[1].plot([case['cloud'] for case in row], [1e3 * case.cpu for case in row], marker='o', color=COLORS[1])
    panels[1].set(xlabel='points of the simulated cloud, 1241x376', ylabel='CPU of makeFrame [ms]')
    use_log_axes(panels[1])
    figure.tight_layout()
    save(figure, path)


# --- recalibrations and memory ---------------------------------------------------------------------------------------

def recalibration_section(bench):
    cases, evaluations = recalibration(bench), evaluation(bench)
    rows = []
    for source, frames in RECALIBRATIONS:
        floor = evaluations['evaluation/{}/{}'.format(FLOOR, place_of(frames, source))].per_candidate()
        for start in STARTS:
            for threads in (1, 2):
                case = cases['recalibration/{}/frames:{}/start:{}/threads:{}'.format(source, frames, start, threads)]
                rows.append([source, str(frames), START_TEXT[start], str(threads), '{:.2f}'.format(case.cpu),
                             '{:.2f}'.format(case.wall), '{:.0f}'.format(case['evaluations']),
                             '{:.2f}'.format(floor * case['evaluations']),
                             '{:.3f}° / {:.1f} cm'.format(case['rotation_deg'], 100 * case['translation_m'])])
    return table(['data', 'frames', 'start off by', 'threads', 'CPU [s]', 'wall [s]', 'extrinsics scored',
                  'floor: as many bare projections [s]', 'error of the result'], rows) + '\n' + note('fastest of 3')


def memory_section(bench):
    cases = memory(bench)
    rows = []
    for name, case in cases.items():
        source, frames = name.split('/')[1:3]
        rows.append([source, frames.replace('frames:', '')] + ['{:.1f}'.format(case[key] / 1e6) for key in (
            'memory_use_per_frame', 'resident_per_frame', 'evaluator_paper', 'evaluator_consistency_edges',
            'process_without_frames', 'process_with_frames', 'peak_of_calibration')])
    return table(['[MB]', 'frames', 'a frame, as it counts itself', 'a frame, as the system counts it',
                  'evaluator `paper`', 'evaluator `consistency_edges`', 'process without its frames', 'with them',
                  'peak of a recalibration'], rows) + '\n' + note('resident memory, libraries included')


# --- side by side ----------------------------------------------------------------------------------------------------

def side_by_side_section(bench):
    cases, counts = side_by_side(bench), bench.counts()
    place = 'kitti_00/frames:1'
    textbook, package = ({part: cases['side_by_side/{}_{}/{}'.format(part, who, place)] for part in ('score', 'search')}
                         for who in ('textbook', 'paper'))
    counted = [counts['side_by_side/score_{}/{}'.format(who, place)].instructions for who in ('textbook', 'paper')]
    difference = abs(textbook['score']['score'] - package['score']['score'])
    if difference > SCORE_TOLERANCE:
        sys.exit('textbook and package score the same extrinsic {:.5f} and {:.5f}, which is more than {} apart'.format(
            textbook['score']['score'], package['score']['score'], SCORE_TOLERANCE))
    rows = [['one score, CPU [ms]'] + [number(1e3 * side['score'].cpu) for side in (textbook, package)]
            + [number(textbook['score'].cpu / package['score'].cpu)],
            ['one score, M instructions'] + [number(count / 1e6) for count in counted] + [number(counted[0] / counted[1])],
            ['search, CPU [s]'] + [number(side['search'].cpu) for side in (textbook, package)]
            + [number(textbook['search'].cpu / package['search'].cpu)],
            ['extrinsics scored'] + ['{:.0f}'.format(side['search']['candidates']) for side in (textbook, package)] + [''],
            ['error of the result'] + ['{:.2f}° / {:.1f} cm'.format(side['search']['rotation_deg'],
                                                                   100 * side['search']['translation_m'])
                                       for side in (textbook, package)] + [''],
            ['score at the reference'] + ['{:.5f}'.format(side['score']['score']) for side in (textbook, package)]
            + ['apart by {:.1e}, allowed {:.0e}'.format(difference, SCORE_TOLERANCE)]]
    print('paper-mode search: the textbook takes {} times the CPU time of the package'.format(rows[2][3]))
    return table(['kitti_00, 1 frame, 1 thread', 'textbook', 'this package', 'ratio'], rows) + '\n' + note(
        'both in one run')


# --- the bars --------------------------------------------------------------------------------------------------------

def bars_section(bench):
    evaluations, frames, runs, held = evaluation(bench), preparation(bench), recalibration(bench), memory(bench)
    rows = []

    def bar(what, limit, value, unit, cpu=None):
        rows.append([what, '≤ {} {}'.format(number(limit), unit),
                     '{} {}'.format(number(value), unit) + (' (CPU {} {})'.format(number(cpu), unit) if cpu else ''),
                     'met' if value <= limit else '**not met**'])

    def run(source, count, start):
        return runs['recalibration/{}/frames:{}/start:{}/threads:2'.format(source, count, start)]

    bar('`paper`, 10 frames of kitti_00, one core: per point in view and candidate', 12,
        evaluations['evaluation/paper/' + place_of(10)].per_point(), 'ns')
    for name in ('consistency_edges', 'edge_score'):
        for points, label in (('points', 'in view'), ('cloud_points', 'of the clouds')):
            bar('{}, the same: per point {} and candidate'.format(EVALUATIONS[name], label), 1,
                evaluations['evaluation/{}/{}'.format(name, place_of(10))].per_point(points), 'ns')
    for place, limit in (('kitti_00', 100), ('large', 250)):
        case = frames['preparation/{}/makeFrame'.format(place)]
        bar('a frame of {} points, {:.0f}x{:.0f}, one core: CPU'.format(thousands(case['cloud']), case['width'], case['height']),
            limit, 1e3 * case.cpu, 'ms')
    for start, limit in zip(STARTS, (1, 3)):
        case = run('kitti_00', 10, start)
        bar('recalibration on 10 frames, start off by {}, 2 threads: wall'.format(START_TEXT[start]), limit, case.wall, 's',
            case.cpu)
    ratios = []
    for start, limit in zip(STARTS, (5, 15)):
        many, few = run('drive', 50, start), run('drive', 10, start)
        bar('the same on 50 frames of the drive, start off by {}: wall'.format(START_TEXT[start]), limit, many.wall, 's', many.cpu)
        ratios.append('{} times the CPU time of 10, start off by {}'.format(number(many.cpu / few.cpu), START_TEXT[start]))
    bar('memory of a frame: kitti_00', 30, held['memory/kitti_00/frames:10']['resident_per_frame'] / 1e6, 'MB')
    bar('memory of a frame: 1920x1200', 30, held['memory/large/frames:1']['resident_per_frame'] / 1e6, 'MB')
    return table(['what', 'asked for', 'measured', ''], rows) + '\n\n50 frames of the drive take {}.\n'.format(
        ' and '.join(ratios)) + note()


# --- the document ----------------------------------------------------------------------------------------------------

SECTIONS = collections.OrderedDict([
    ('machine', machine_section), ('evaluation', evaluation_section), ('scaling', scaling_section),
    ('preparation', preparation_section), ('recalibration', recalibration_section), ('memory', memory_section),
    ('side_by_side', side_by_side_section), ('bars', bars_section)])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', nargs='+', choices=list(SECTIONS), metavar='SECTION',
                        help='these sections: ' + ', '.join(SECTIONS))
    parser.add_argument('--repetitions', type=int, help='of every measurement, instead of what each section has')
    parser.add_argument('--min-time', type=float, default=0.05, help='of each repetition [s] (default: %(default)s)')
    parser.add_argument('--fresh', action='store_true', help='simulate the drive again')
    parser.add_argument('--data', type=pathlib.Path, default=PACKAGE.parent / 'shared' / 'data',
                        help='folder of kitti_00 (default: %(default)s)')
    parser.add_argument('--work', type=pathlib.Path, default=PACKAGE / 'build' / 'performance',
                        help='folder for raw results and the simulated drive (default: %(default)s)')
    parser.add_argument('--programs', type=pathlib.Path, help='folder of performance_benchmark and simulate_drive')
    parser.add_argument('--out', type=pathlib.Path, default=PACKAGE / 'doc' / 'performance.md',
                        help='the document; one that does not exist starts as a copy (default: %(default)s)')
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    sections = collections.OrderedDict((name, section) for name, section in SECTIONS.items()
                                       if name in (arguments.only or SECTIONS))
    commit()
    missing = write_sections('performance.py', sections, Bench(arguments), arguments.out)
    if missing:
        sys.exit('\n'.join(missing))


if __name__ == '__main__':
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit('{} failed with status {}'.format(pathlib.Path(error.cmd[0]).name, error.returncode))
    except FileNotFoundError as error:
        sys.exit('{}: install valgrind, or call ./bootstrap benchmark'.format(error))
    except ImportError as error:
        sys.exit('{}: install python3-matplotlib, or call ./bootstrap benchmark'.format(error))
