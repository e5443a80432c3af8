#!/usr/bin/env python3
"""scripts/accuracy.py with a stand-in for evaluate: what is written where, what is kept, and how bars are judged."""

import importlib.util
import json
import pathlib
import stat
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).resolve().parent.parent / 'scripts' / 'accuracy.py'

# Writes the figures that its folder's figures.json holds for every cell that it is asked for, and counts its calls.
STAND_IN = """#!/usr/bin/env python3
import json, pathlib, sys
here = pathlib.Path(__file__).resolve().parent
with (here / 'calls').open('a') as log:
    log.write(' '.join(sys.argv[1:]) + '\\n')
options = {}
for word, value in zip(sys.argv[2::2], sys.argv[3::2]):
    options.setdefault(word, []).append(value)
figures = json.loads((here / 'figures.json').read_text())
frames = options.get('--halves') or options['--frames']
cells = [dict(figures, method=method.split(':')[0], frames=count, start=start)
         for method in options['--method'] for count in frames[0].split(',') for start in options['--start'][0].split(',')]
pathlib.Path(options['--json'][0]).write_text(json.dumps({'cells': cells, 'trials': 4, 'seed': 1}))
pathlib.Path(options['--csv'][0]).write_text(
    'accepted,reason,frame_names,shift_px,start_shift_px,rotation_deg,start_rotation_deg,translation_m,'
    'start_translation_m\\n'
    '1,"accepted: well",a b,2,1,1,2,0.1,0.2\\n'
    '0,"rejected: the score rises by only 0.1",a b,2,1,1,2,0.1,0.2\\n')
"""


def errors(median):
    return {'mean': median, 'median': median, 'p90': 2 * median, 'huber': median, 'start_mean': 1.0,
            'axis_mean_absolute': [0.1, 0.2, 0.3], 'axis_mean': [0.1, 0.2, 0.3]}


def load_script():
    sys.path.insert(0, str(SCRIPT.parent))  # for what the scripts share
    spec = importlib.util.spec_from_file_location('accuracy', str(SCRIPT))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class AccuracyTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = pathlib.Path(self.folder.name)
        self.programs = self.root / 'programs'
        self.programs.mkdir()
        for name, text in (('evaluate', STAND_IN), ('simulate_drive', '#!/bin/sh\nmkdir "$2"\n')):
            program = self.programs / name
            program.write_text(text)
            program.chmod(program.stat().st_mode | stat.S_IXUSR)
        self.figures(rotation=0.02, translation=0.005)
        for name in ('kitti_00', 'kitti_0926', 'pandar64_a'):
            (self.root / 'data' / name).mkdir(parents=True)

    def tearDown(self):
        self.folder.cleanup()

    def figures(self, rotation, translation):
        figures = {'rotation_deg': errors(rotation), 'translation_m': errors(translation), 'success_rate': 1.0,
                   'accepted_rate': 0.5, 'evaluations_per_run': 1000, 'cpu_seconds_per_run': 2.0}
        (self.programs / 'figures.json').write_text(json.dumps(figures))

    def call(self, *words):
        return subprocess.run(
            [sys.executable, str(SCRIPT), '--programs', str(self.programs), '--data', str(self.root / 'data'), '--work',
             str(self.root / 'work'), '--out', str(self.root / 'accuracy.md'), *words],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)

    def calls(self):
        log = self.programs / 'calls'
        return log.read_text().splitlines() if log.exists() else []

    def section(self, name):
        text = (self.root / 'accuracy.md').read_text()
        return text.split('<!-- accuracy.py: begin {} -->'.format(name))[1].split(
            '<!-- accuracy.py: end {} -->'.format(name))[0]

    def row(self, name, words):
        rows = [line for line in self.section(name).splitlines() if words in line]
        self.assertEqual(len(rows), 1, rows)
        return rows[0]

    def test_sections_are_written_between_their_markers(self):
        run = self.call('--only', 'rings')
        self.assertEqual(run.returncode, 0, run.stdout)
        self.assertEqual(self.section('rings').count('0.020 / 0.5'), 6 * 3)  # mean, median and Huber of six rows
        self.assertIn('4 trials a row', self.section('rings'))
        written, template = self.section('rings'), (SCRIPT.parent.parent / 'doc' / 'accuracy.md').read_text()
        before, rest = template.split('<!-- accuracy.py: begin rings -->')
        after = rest.split('<!-- accuracy.py: end rings -->')[1]
        self.assertEqual((self.root / 'accuracy.md').read_text(),
                         before + '<!-- accuracy.py: begin rings -->' + written + '<!-- accuracy.py: end rings -->' + after)

    def test_what_was_measured_is_kept(self):
        self.call('--only', 'rings')
        first = len(self.calls())
        self.assertEqual(first, 3)
        self.call('--only', 'rings')
        self.assertEqual(len(self.calls()), first)
        self.call('--only', 'rings', '--trials', '7')
        self.assertEqual(len(self.calls()), 2 * first)
        self.assertIn('--trials 7', self.calls()[-1])
        self.call('--only', 'rings', '--trials', '7', '--fresh')
        self.assertEqual(len(self.calls()), 3 * first)

    def test_bars_are_judged(self):
        self.assertEqual(self.call('--only', 'bars').returncode, 0)
        self.assertTrue(self.row('bars', 'simulated drive').endswith('| met |'))
        self.assertIn('1 of 2 worse, 1 refused | **not met**', self.row('bars', 'kitti_0926'))
        self.figures(rotation=0.055, translation=0.011)
        self.call('--only', 'bars', '--fresh')
        self.assertIn('**not met: rotation, translation**', self.row('bars', 'simulated drive'))
        self.assertIn('**not met: p90**', self.row('bars', '| kitti_00 | 10 | E2'))
        self.assertIn('**not met: rotation**', self.row('bars', 'disjoint'))
        self.assertTrue(self.row('bars', '| kitti_00 | 5 | E3').endswith('| met |'))

    def test_refusals_are_told(self):
        self.assertEqual(self.call('--only', 'others').returncode, 0)
        self.assertIn('- kitti_0926, 1 of 2: the score rises by only', self.section('others'))

    def test_drives_are_simulated_once(self):
        self.assertEqual(self.call('--only', 'beams').returncode, 0)
        drive = self.root / 'work' / 'simulation_32'
        self.assertTrue(drive.is_dir())
        (drive / 'kept').touch()
        self.assertEqual(self.call('--only', 'beams').returncode, 0)
        self.assertTrue((drive / 'kept').exists())
        self.assertEqual(self.call('--only', 'beams', '--fresh').returncode, 0)
        self.assertTrue(drive.is_dir())
        self.assertFalse((drive / 'kept').exists())
        (self.programs / 'simulate_drive').unlink()
        run = self.call('--only', 'beams', '--fresh')
        self.assertEqual(run.returncode, 1)
        self.assertIn('simulate_drive is not built', run.stdout)

    def test_without_data_a_section_stays(self):
        (self.root / 'data' / 'kitti_0926').rmdir()
        run = self.call('--only', 'others', 'rings')
        self.assertEqual(run.returncode, 1)
        self.assertIn('section others is left as it was', run.stdout)
        self.assertIn('kitti_0926', run.stdout)
        self.assertIn('0.020 / 0.5', self.section('rings'))

    def test_masks_need_a_model(self):
        run = self.call('--only', 'masks', '--sam', str(self.root / 'nowhere'))
        self.assertEqual(run.returncode, 1)
        self.assertIn("call './bootstrap sam'", run.stdout)

    def test_masks_are_made_once_and_compared(self):
        try:
            import cv2
            import numpy
        except ImportError:
            self.skipTest('python3-opencv is not installed')
        data = self.root / 'data' / 'kitti_00'
        for name in 'abcd':
            (data / 'masks' / name).mkdir(parents=True)
            mask = numpy.zeros((10, 20), numpy.uint8)
            mask[:, :10] = 255
            cv2.imwrite(str(data / 'masks' / name / '000.png'), mask)
        (data / 'images').mkdir()
        for name in 'abcd':
            (data / 'images' / (name + '.png')).touch()
        (self.root / 'decoder.onnx').touch()
        program = self.programs / 'make_masks'  # half of the delivered mask, for what it is asked
        program.write_text("""#!/usr/bin/env python3
import pathlib, shutil, sys
import cv2, numpy
out = pathlib.Path(sys.argv[2])
mask = numpy.zeros((10, 20), numpy.uint8)
mask[:, :5] = 255
for name in sys.argv[sys.argv.index('--only') + 1:]:
    (out / name).mkdir()
    cv2.imwrite(str(out / name / '000.png'), mask)
    with (out / 'make_masks.csv').open('a') as table:
        table.write(name + ',1,0.25,2.5\\n')
""".replace('#!/usr/bin/env python3', '#!' + sys.executable))
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        run = self.call('--only', 'masks', '--sam', str(self.root))
        self.assertEqual(run.returncode, 0, run.stdout)
        self.assertIn('| graph | 1 | 25 % | 0.50 | 0.50 | 2.5 |', self.section('masks'))
        self.assertIn('| paper, graph | 5 |', self.section('masks'))
        made = self.root / 'work' / 'kitti_00_graph'
        self.assertEqual(sorted(path.name for path in (made / 'masks').iterdir()), ['b', 'd', 'make_masks.csv'])
        self.assertTrue((made / 'images' / 'a.png').exists())
        program.unlink()
        self.assertEqual(self.call('--only', 'masks', '--sam', str(self.root)).returncode, 0)

    def test_failures_are_told(self):
        (self.programs / 'figures.json').unlink()
        run = self.call('--only', 'rings')
        self.assertEqual(run.returncode, 1)
        self.assertIn('evaluate failed with status 1', run.stdout)

    def test_plots(self):
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            self.skipTest('python3-matplotlib is not installed')
        run = self.call('--only', 'basin', 'frames')
        self.assertEqual(run.returncode, 0, run.stdout)
        for name in ('basin', 'error_against_frames'):
            picture = (self.root / 'images' / (name + '.png')).read_bytes()
            self.assertTrue(picture.startswith(b'\x89PNG'))
            self.assertGreater(len(picture), 5000)

    def test_every_section_has_its_place(self):
        script = load_script()
        text = (SCRIPT.parent.parent / 'doc' / 'accuracy.md').read_text()
        for name in script.SECTIONS:
            self.assertEqual(text.count(script.BEGIN.format(name)), 1, name)
            self.assertEqual(text.count(script.END.format(name)), 1, name)


if __name__ == '__main__':
    unittest.main(verbosity=2)
