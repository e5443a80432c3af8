#!/usr/bin/env python3
"""scripts/performance.py with a stand-in for the benchmark program, and the real one with a tiny filter: what is parsed,
what is written where, and how bars are judged. Nothing timed is asserted.

    test_performance.py [FOLDER_OF_PROGRAMS]     # without, the real program is left out
"""

import json
import pathlib
import shutil
import stat
import subprocess
import sys
import tempfile
import unittest

SCRIPTS = pathlib.Path(__file__).resolve().parent.parent / 'scripts'
SCRIPT = SCRIPTS / 'performance.py'
sys.path.insert(0, str(SCRIPTS))
import document  # noqa: E402
import performance  # noqa: E402

PROGRAMS = None  # set by main()

# Measures whatever figures.json says, {name: [cpu ms of each repetition, {counter: value}]}, and counts its calls.
STAND_IN = """#!/usr/bin/env python3
import json, pathlib, re, sys
here = pathlib.Path(__file__).resolve().parent
with (here / 'calls').open('a') as log:
    log.write(' '.join(sys.argv[1:]) + '\\n')
if '--build' in sys.argv:
    print(json.dumps({'compiler': 'GNU 9', 'flags': ' -O3'}))
    sys.exit()
options = dict(word.split('=', 1) for word in sys.argv[1:] if '=' in word)
figures = json.loads((here / 'figures.json').read_text())
entries = []
for name, (times, counters) in figures.items():
    if not re.search(options['--benchmark_filter'], name):
        continue
    full = name + '/min_time:0.100/repeats:2/process_time/real_time'
    for time in times:
        entries.append(dict(counters, name=full, run_type='iteration', cpu_time=time, real_time=2 * time, time_unit='ms',
                            iterations=3))
    entries.append({'name': full + '_mean', 'run_type': 'aggregate', 'cpu_time': 1e9, 'real_time': 1e9, 'time_unit': 'ms'})
pathlib.Path(options['--benchmark_out']).write_text(json.dumps({'benchmarks': entries}))
"""

# valgrind's place is taken by a program that writes the dumps of callgrind for the same measurements.
VALGRIND = """#!/usr/bin/env python3
import json, pathlib, re, sys
options = dict(word.split('=', 1) for word in sys.argv[1:] if '=' in word)
program = pathlib.Path(next(word for word in sys.argv[1:] if word.endswith('performance_benchmark')))
figures = json.loads((program.parent / 'figures.json').read_text())
out = options['--callgrind-out-file']
names = [name for name in figures if re.search(options['--benchmark_filter'], name)]
for i, name in enumerate(names):
    pathlib.Path('{}.{}'.format(out, i + 1)).write_text(
        'version: 1\\ndesc: Trigger: Client Request: {}\\nevents: Ir Dr Dw I1mr D1mr D1mw ILmr DLmr DLmw\\n'
        'summary: 1 1 1 1 1 1 1 1 1\\ntotals: {} 7 7 7 30 20 7 7 7\\n'.format(name, 1000000 * (i + 1)))
pathlib.Path(out).write_text('desc: Trigger: Program termination\\nevents: Ir\\ntotals: 5\\n')
"""


def stand_in_figures():
    figures = {}

    def sizes(points, masks=90):
        return {'candidates': 20, 'points': points, 'cloud_points': 6 * points, 'edges': 5000, 'masks_per_frame': masks}

    places = [('kitti_00', frames, threads) for frames in (10, 1, 5) for threads in (1, 2)]
    places += [('drive', frames, 1) for frames in (1, 5, 10, 50)]
    places += [(name, 1, 1) for name in ('density_16_0.2000', 'density_64_0.1728', 'masks_35', 'masks_350')]
    for source, frames, threads in places:
        for i, name in enumerate(performance.EVALUATIONS):
            figures['evaluation/{}/{}/frames:{}/threads:{}'.format(name, source, frames, threads)] = [
                [9.0, 4.0 * frames * (i + 1)] if i else [4.0 * frames], sizes(20000 * frames)]
    for source in ('kitti_00', 'large', 'density_16_0.2000', 'density_64_0.1728'):
        figures['preparation/{}/makeFrame'.format(source)] = [[300.0, 120.0], {
            'cloud': 120000, 'width': 1920 if source == 'large' else 1241, 'height': 1200 if source == 'large' else 376}]
        for stage in [*performance.STAGES, 'segments', 'projection']:
            if stage != 'planes':
                figures['preparation/{}/{}'.format(source, stage)] = [
                    [8.0] if stage == 'segments' else [5.0], {'cloud': 120000, 'cropped': 30000}]
    for source, frames in performance.RECALIBRATIONS:
        for start in performance.STARTS:
            for threads in (1, 2):
                figures['recalibration/{}/frames:{}/start:{}/threads:{}'.format(source, frames, start, threads)] = [
                    [400.0 * frames / 10], {'evaluations': 3000, 'rotation_deg': 0.02, 'translation_m': 0.01}]
        figures['memory/{}/frames:{}'.format(source, frames)] = [[0.0], {
            'memory_use_per_frame': 7e6, 'resident_per_frame': 8e6, 'evaluator_paper': 5e6,
            'evaluator_consistency_edges': 2e6, 'process_without_frames': 1e8, 'process_with_frames': 2e8, 'peak_of_calibration': 2.1e8}]
    figures['memory/large/frames:1'] = [[0.0], dict(figures['memory/kitti_00/frames:10'][1], resident_per_frame=4e7)]
    for who, time in (('textbook', 50.0), ('paper', 0.5)):
        figures['side_by_side/score_{}/kitti_00/frames:1'.format(who)] = [[time], {'score': 0.7}]
        figures['side_by_side/search_{}/kitti_00/frames:1'.format(who)] = [
            [200 * time], {'candidates': 200, 'rotation_deg': 0.2, 'translation_m': 0.1}]
    return figures


class PerformanceTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = pathlib.Path(self.folder.name)
        self.programs = self.root / 'programs'
        self.programs.mkdir()
        for name, text in (('performance_benchmark', STAND_IN), ('valgrind', VALGRIND),
                           ('simulate_drive', '#!/bin/sh\nmkdir "$2"\n')):
            program = self.programs / name
            program.write_text(text)
            program.chmod(program.stat().st_mode | stat.S_IXUSR)
        (self.root / 'data' / 'kitti_00').mkdir(parents=True)
        self.figures = stand_in_figures()

    def tearDown(self):
        self.folder.cleanup()

    def call(self, *words):
        (self.programs / 'figures.json').write_text(json.dumps(self.figures))
        return subprocess.run(
            [sys.executable, str(SCRIPT), '--programs', str(self.programs), '--data', str(self.root / 'data'), '--work',
             str(self.root / 'work'), '--out', str(self.root / 'performance.md'), *words],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
            env={'PATH': '{}:/usr/bin:/bin'.format(self.programs)})

    def section(self, name):
        begin, end = (marker.format(name) for marker in document.markers('performance.py'))
        return (self.root / 'performance.md').read_text().split(begin)[1].split(end)[0]

    def row(self, name, words):
        rows = [line for line in self.section(name).splitlines() if words in line]
        self.assertEqual(len(rows), 1, rows)
        return [cell.strip() for cell in rows[0].split('|')[1:-1]]

    def test_the_fastest_repetition_counts(self):
        run = self.call('--only', 'evaluation')
        self.assertEqual(run.returncode, 0, run.stdout)
        # 9 ms is the faster repetition, of 20 candidates on 200 k points in view.
        row = self.row('evaluation', '| `paper` |')
        self.assertEqual(row[1:5], ['450', '2.25', '0.375', '0.225'])

    def test_counts_are_per_visit(self):
        self.call('--only', 'evaluation')
        row = self.row('evaluation', 'bare projection*')
        # First measurement of the filter on one frame: 1 M instructions, 50 lines, 20 candidates on 20 k points.
        self.assertEqual(row[5:], ['2.50', '0.0080'])

    def test_stages_add_up(self):
        run = self.call('--only', 'preparation')
        self.assertEqual(run.returncode, 0, run.stdout)
        self.assertEqual(self.row('preparation', '| planes |')[1:3], ['3.00', '0.600'])
        self.assertEqual(self.row('preparation', '| **whole frame** |')[1], '120')
        stages = len(performance.STAGES)
        self.assertEqual(self.row('preparation', '| rest: ')[1], performance.number(120 - 5.0 * (stages - 1) - 3.0))

    def test_bars_are_judged(self):
        run = self.call('--only', 'bars')
        self.assertEqual(run.returncode, 0, run.stdout)
        self.assertEqual(self.row('bars', '`paper`, 10 frames')[1:], ['≤ 12.0 ns', '2.25 ns', 'met'])
        self.assertEqual(self.row('bars', 'memory of a frame: 1920x1200')[-1], '**not met**')
        self.assertEqual(self.row('bars', 'memory of a frame: kitti_00')[2:], ['8.00 MB', 'met'])
        self.assertEqual(self.row('bars', 'recalibration on 10 frames, start off by 2.5')[2:], ['0.800 s (CPU 0.400 s)', 'met'])
        self.assertEqual(self.row('bars', 'the same on 50 frames of the drive, start off by 5')[1:],
                         ['≤ 15.0 s', '4.00 s (CPU 2.00 s)', 'met'])
        self.assertIn('50 frames of the drive take 5.00 times the CPU time of 10, start off by 2.5', self.section('bars'))
        self.assertEqual(self.row('bars', 'a frame of 120 k points, 1241x376')[2:], ['120 ms', '**not met**'])

    def test_the_textbook_must_score_alike(self):
        run = self.call('--only', 'side_by_side')
        self.assertEqual(run.returncode, 0, run.stdout)
        self.assertIn('takes 100 times the CPU time', run.stdout)
        self.figures['side_by_side/score_paper/kitti_00/frames:1'][1]['score'] = 0.7011
        run = self.call('--only', 'side_by_side')
        self.assertNotEqual(run.returncode, 0)
        self.assertIn('0.70000 and 0.70110', run.stdout)

    def test_without_data_sections_stay(self):
        shutil.rmtree(str(self.root / 'data' / 'kitti_00'))
        run = self.call('--only', 'machine', 'memory')
        self.assertEqual(run.returncode, 1)
        self.assertIn('section memory is left as it was', run.stdout)
        self.assertIn('GNU 9', self.section('machine'))

    def test_the_drive_is_simulated_once(self):
        self.call('--only', 'memory')
        (self.root / 'work' / 'drive' / 'kept').touch()
        self.call('--only', 'memory')
        self.assertTrue((self.root / 'work' / 'drive' / 'kept').exists())
        self.call('--only', 'memory', '--fresh')
        self.assertFalse((self.root / 'work' / 'drive' / 'kept').exists())

    def test_every_section_is_written(self):
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            self.skipTest('python3-matplotlib is not installed')
        run = self.call()
        self.assertEqual(run.returncode, 0, run.stdout)
        for name in performance.SECTIONS:
            self.assertIn('|', self.section(name), name)
        for name in ('scaling', 'preparation'):
            picture = (self.root / 'images' / 'performance_{}.png'.format(name)).read_bytes()
            self.assertTrue(picture.startswith(b'\x89PNG'))
            self.assertGreater(len(picture), 5000)

    def test_numbers_have_three_digits(self):
        self.assertEqual([performance.number(value) for value in (0, 0.0123456, 0.99999, 9.996, 12.34, 123.4, 12345, -1.234)],
                         ['0', '0.0123', '1.00', '10.0', '12.3', '123', '12300', '-1.23'])


class ProgramTest(unittest.TestCase):
    """The real program, on a simulated frame. Sections ask it for names: all must be there."""

    def setUp(self):
        if PROGRAMS is None:
            self.skipTest('performance_benchmark is not built: it needs libbenchmark-dev and libembree-dev')
        self.program = PROGRAMS / 'performance_benchmark'

    def test_it_measures(self):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / 'out.json'
            subprocess.run([str(self.program), '--kitti=none', '--min-time=0.001', '--repetitions=2',
                            '--benchmark_filter=^evaluation/.*/density_16', '--benchmark_out={}'.format(out),
                            '--benchmark_out_format=json'], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            cases = performance.read_cases(out.read_text())
        place = 'density_16_0.2000/frames:1/threads:1'
        self.assertEqual(list(cases), ['evaluation/{}/{}'.format(name, place) for name in performance.EVALUATIONS])
        for case in cases.values():
            self.assertGreater(case.cpu, 0.0)
            self.assertGreater(case['points'], 1000)
            self.assertGreater(case['cloud_points'], case['points'])
        self.assertGreater(cases['evaluation/paper/' + place]['score'], 0.3)

    def test_it_knows_what_sections_ask_for(self):
        listed = subprocess.run([str(self.program), '--kitti=none', '--benchmark_list_tests'], check=True,
                                stdout=subprocess.PIPE, universal_newlines=True).stdout.split()
        names = {performance.case_name(name) for name in listed}
        wanted = {'preparation/large/makeFrame', 'preparation/large/projection', 'memory/large/frames:1'}
        for stage, (_, difference) in performance.STAGES.items():
            wanted |= {'preparation/large/' + name for name in difference or (stage,)}
        self.assertLessEqual(wanted, names)

    def test_it_tells_what_it_was_built_with(self):
        build = json.loads(subprocess.check_output([str(self.program), '--build'], universal_newlines=True))
        self.assertEqual(sorted(build), ['compiler', 'flags'])

    def test_wrong_options_are_refused(self):
        run = subprocess.run([str(self.program), '--no-such-option'], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                             universal_newlines=True)
        self.assertEqual(run.returncode, 2)
        self.assertIn('--kitti=FOLDER', run.stderr)


if __name__ == '__main__':
    if len(sys.argv) > 1 and not sys.argv[1].startswith('-'):
        PROGRAMS = pathlib.Path(sys.argv.pop(1))
    unittest.main(verbosity=2)
