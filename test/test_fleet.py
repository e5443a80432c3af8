#!/usr/bin/env python3
"""calibrate_fleet: whose bag is whose, what a task writes down, what counts as drift; and the whole on simulated bags.

    test_fleet.py                     # without an engine
    test_fleet.py --programs FOLDER   # the whole, where Snakemake is; says so where not
"""
import csv
import json
import math
import os
import pathlib
import shutil
import stat
import subprocess
import sys
import tempfile
import unittest

import numpy
import yaml

PACKAGE = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(PACKAGE / "python"))
sys.path.insert(0, str(PACKAGE / "scripts"))

from calibrate_fleet import engine, plan, tables, task, trend  # noqa: E402
from fleet_demo import moved, NOMINAL  # noqa: E402

def lines_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


TOLERANCE = (math.radians(0.3), 0.05)


class Folder(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="test_fleet_"))
        self.addCleanup(shutil.rmtree, str(self.folder))

    def touch(self, *names):
        for name in names:
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("")


class Plan(Folder):
    def vehicles(self, pattern):
        runs, others = plan.find_runs(self.folder, pattern)
        return [(run["name"], run["vehicle"]) for run in runs], [bag.name for bag in others]

    def test_first_folder(self):
        self.touch("a/x.bag", "a/2024/y.bag", "b/x.bag", "loose.bag", "a/notes.txt")
        self.assertEqual(self.vehicles("{vehicle}/**"),
                         ([("a/2024_y", "a"), ("a/x", "a"), ("b/x", "b")], ["loose.bag"]))

    def test_names(self):
        self.touch("bus-7_2024-01-01.bag", "bus-7_2024-01-02.bag", "deep/bus-8_1.bag", "other.bag")
        self.assertEqual(self.vehicles("**/{vehicle}_*.bag"),
                         ([("bus-7/2024-01-01", "bus-7"), ("bus-7/2024-01-02", "bus-7"), ("bus-8/deep_bus-8_1", "bus-8")],
                          ["other.bag"]))

    def test_refusals(self):
        with self.assertRaisesRegex(plan.PlanError, "no bag"):
            plan.find_runs(self.folder, "{vehicle}/**")
        self.touch("loose.bag")
        with self.assertRaisesRegex(plan.PlanError, "loose.bag"):
            plan.find_runs(self.folder, "{vehicle}/**")
        with self.assertRaisesRegex(plan.PlanError, "once"):
            plan.find_runs(self.folder, "*.bag")
        self.touch("a/b c.bag", "a/b_c.bag")
        with self.assertRaisesRegex(plan.PlanError, "same name"):
            plan.find_runs(self.folder, "{vehicle}/**")


class Task(Folder):
    """With a stand-in for calibrate_bag that ends with the status in the bag's name."""

    def calibrate(self, status, words=(), says="what is wrong", result=True):
        program = self.folder / "calibrate_bag"
        program.write_text("""#!/usr/bin/env python3
import sys, yaml
out = sys.argv[sys.argv.index("--out") + 1]
print("reading: 10 %")
print({says!r}, file=sys.stderr)
if {result}:
    for name in {names}:
        with open(out.replace(".yaml", name + ".yaml"), "w") as file:
            yaml.safe_dump({{"T_camera_lidar": {T}, "accepted": {status} == 0, "stamp": 12.5, "frames": 6, "reason": "why"}}, file)
sys.exit({status})
""".format(says=says, result=result, status=status, T=NOMINAL,
           names=["_" + name for name in task.camera_names(list(words)) if name] or [""]))
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        record = self.folder / "runs" / "a" / "x.json"
        done = task.calibrate({"name": "a/x", "vehicle": "a", "bag": "x.bag"}, str(program), list(words), record,
                              self.folder / "logs" / "a" / "x.log")
        self.assertEqual(done, record.exists())
        return json.loads(record.read_text())["cameras"] if done else None

    def test_statuses(self):
        self.assertEqual(self.calibrate(0)[""]["status"], "accepted")
        self.assertEqual(self.calibrate(3)[""]["status"], "rejected")
        failed = self.calibrate(1, result=False)[""]
        self.assertEqual((failed["status"], failed["reason"]), ("failed", "what is wrong"))
        self.assertIsNone(self.calibrate(137, result=False), "killed: no record, so the next run tries again")
        self.assertIsNone(self.calibrate(2, result=False), "wrong options are nobody's bag's fault")

    def test_an_old_result_is_not_taken_for_a_new_one(self):
        self.calibrate(0)
        self.assertEqual(self.calibrate(1, result=False)[""]["status"], "failed")

    def test_cameras(self):
        words = ["--camera", "front=/a", "--camera=rear=/b"]
        cameras = self.calibrate(0, words)
        self.assertEqual({name: values["status"] for name, values in cameras.items()},
                         {"front": "accepted", "rear": "accepted"})
        failed = self.calibrate(1, words, "camera rear: no topic fits", False)
        self.assertEqual(failed["rear"]["reason"], "camera rear: no topic fits")


def run_at(day, T, status="accepted", sigma=(0.0005, 0.0005, 0.0005, 0.01, 0.01, 0.01)):
    failed = status == "failed"
    return trend.Run("a/{}".format(day), "a", "{}.bag".format(day), status, "why", math.nan if failed else 86400.0 * day,
                     None if failed else T, None if failed or sigma is None else numpy.array(sigma), 6, "")


def trend_of(degrees, noise_deg=0.0, metres=(), **more):
    """Of a yaw angle for each day."""
    random = numpy.random.RandomState(1)
    runs = [run_at(day, moved(NOMINAL, numpy.array([0, yaw, 0]) + noise_deg * random.normal(size=3),
                              metres[day] if metres else (0, 0, 0)), **more) for day, yaw in enumerate(degrees)]
    return trend.trends(runs, TOLERANCE, 3)[0]


class Trend(unittest.TestCase):
    def test_steady(self):
        steady = trend_of([0] * 10, 0.05)
        self.assertEqual(steady.verdict, "steady")
        self.assertLess(math.degrees(trend.size(steady.change)[0]), 0.15)

    def test_drift_and_since_when(self):
        drifted = trend_of([0, 0, 0, 0.2, 0.4, 0.5, 0.6, 0.6, 0.6])
        self.assertEqual(drifted.verdict, "drifted")
        self.assertAlmostEqual(math.degrees(drifted.change[1]), 0.6, places=6)
        self.assertEqual(drifted.since, 4 * 86400)
        self.assertEqual(trend_of([0] * 8, metres=[(0, 0, 0)] * 4 + [(0, 0.08, 0)] * 4).verdict, "drifted")

    def test_a_large_change_that_is_uncertain_is_no_verdict(self):
        self.assertEqual(trend_of([0, 0, 0, 0, 0, 1.2]).verdict, "unclear", "one odd run")
        self.assertEqual(trend_of([0, 0.4] * 5, sigma=(0.02,) * 3 + (0.01,) * 3).verdict, "steady")
        self.assertEqual(trend_of([0] * 3 + [0.4] * 3, sigma=(0.02,) * 3 + (0.01,) * 3).verdict, "unclear")

    def test_without_covariances_the_scatter_counts(self):
        self.assertEqual(trend_of([0] * 3 + [0.6] * 3, sigma=None).verdict, "drifted")
        self.assertEqual(trend_of([0, 0.5, -0.5, 0.9, 0.1, 0.6], sigma=None).verdict, "unclear")

    def test_too_few(self):
        self.assertEqual(trend_of([0]).verdict, "too few")
        self.assertEqual(trend_of([0, 0.6]).verdict, "drifted", "one against one, with covariances")

    def test_refused_runs_do_not_count(self):
        runs = [run_at(day, numpy.array(NOMINAL)) for day in range(6)]
        runs += [run_at(9, moved(NOMINAL, (5, 0, 0), (0, 0, 0)), "rejected"), run_at(8, None, "failed")]
        only = trend.trends(runs, TOLERANCE, 3)[0]
        self.assertEqual((only.verdict, only.accepted, only.rejected, only.failed), ("steady", 6, 1, 1))

    def test_rotation_vector(self):
        for degrees in ([0.01, 0, 0], [10, -20, 30], [0, 179.9, 0], [0, 0, 0]):
            T = moved(numpy.eye(4), degrees, (0, 0, 0))
            self.assertTrue(numpy.allclose(numpy.degrees(trend.rotation_vector(T[:3, :3])), degrees, atol=1e-6), degrees)
        half = numpy.diag([-1.0, 1.0, -1.0])
        self.assertAlmostEqual(abs(trend.rotation_vector(half)[1]), math.pi)


class Tables(Folder):
    def test_lines_and_units(self):
        drifted = trend_of([0, 0, 0, 0.6, 0.6, 0.6])
        runs = drifted.runs + [run_at(7, None, "failed")]
        all_trends = [drifted._replace(runs=runs)]
        tables.write_vehicles(self.folder / "v.csv", all_trends, TOLERANCE)
        tables.write_runs(self.folder / "r.csv", all_trends)
        vehicle, = lines_of(self.folder / "v.csv")
        self.assertEqual((vehicle["verdict"], vehicle["since"]), ("drifted", "1970-01-04T00:00:00Z"))
        self.assertEqual((vehicle["change_deg"], vehicle["tolerance_cm"]), ("0.6000", "5.0000"))
        self.assertEqual(vehicle["change_ry_deg"], "0.6000")
        lines = lines_of(self.folder / "r.csv")
        self.assertEqual(len(lines), 7)
        self.assertEqual(lines[5]["sigma_tx_cm"], "1.0000")
        self.assertEqual((lines[6]["status"], lines[6]["time"], lines[6]["change_rx_deg"]), ("failed", "", ""))


class Whole(Folder):
    """Two vehicles with two bags each, one of which is cut short, through the engine, with the real programs."""
    programs = None

    def fleet(self, *words):
        done = subprocess.run([str(self.programs / "calibrate_fleet"), str(self.folder / "bags"),
                               str(self.folder / "results"), "--cores", "2"] + list(words),
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        return done.returncode, done.stdout

    def records(self):
        return {path.relative_to(self.folder / "results" / "runs").as_posix(): path.stat().st_mtime_ns
                for path in (self.folder / "results" / "runs").rglob("*.json")}

    def test_restart_does_only_what_is_missing(self):
        demo = subprocess.run([sys.executable, str(PACKAGE / "scripts" / "fleet_demo.py"), "--programs", str(self.programs),
                               "--work", str(self.folder), "--bags", "4", "--vehicles", "2", "--frames", "5",
                               "--cores", "2"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        self.assertEqual(demo.returncode, 0, demo.stdout)
        self.assertIn("truck_2: drifted", demo.stdout)
        self.assertIn("1 bags could not be used", demo.stdout)
        self.assertIn("cut short", demo.stdout)
        results = self.folder / "results"
        first = self.records()
        self.assertEqual(sorted(first), ["truck_1/drive_01.json", "truck_1/drive_02.json", "truck_2/drive_01.json",
                                         "truck_2/drive_02.json"])
        lines = {line["bag"].split("/")[-2] + "/" + line["bag"].split("/")[-1]: line
                 for line in lines_of(results / "runs.csv")}
        self.assertEqual(lines["truck_1/drive_02.bag"]["status"], "failed")
        self.assertEqual(lines["truck_2/drive_02.bag"]["status"], "accepted")
        truth = yaml.safe_load((self.folder / "bags" / "truck_2" / "drive_02.truth.yaml").read_text())
        result = yaml.safe_load(pathlib.Path(lines["truck_2/drive_02.bag"]["result"]).read_text())
        error = trend.difference(numpy.array(result["T_camera_lidar"]), numpy.array(truth["T_camera_lidar"]))
        self.assertLess(math.degrees(trend.size(error)[0]), 0.15)
        self.assertGreater((results / "trend.png").stat().st_size, 5000)

        status, _ = self.fleet()
        self.assertEqual(status, 1, "one bag cannot be used")
        self.assertEqual(self.records(), first, "nothing to do")

        (results / "runs" / "truck_2" / "drive_01.json").unlink()
        self.fleet()
        again = self.records()
        self.assertEqual({name for name in first if first[name] != again[name]}, {"truck_2/drive_01.json"})

        os.remove(str(self.folder / "bags" / "truck_1" / "drive_02.bag"))
        status, output = self.fleet()
        self.assertIn("truck_1/drive_02", "".join(self.records()), "what was found stays when a bag is archived")
        self.assertEqual(status, 1)

        # Other words for calibrate_bag make other results.
        status, output = self.fleet("--", "--set", "frames/min=10")
        self.assertEqual(status, 1, output)
        self.assertEqual(output.count("only 5 of 10 frames"), 3, output)


if __name__ == "__main__":
    if "--programs" in sys.argv:
        Whole.programs = pathlib.Path(sys.argv[sys.argv.index("--programs") + 1])
        try:
            engine.find_snakemake()
        except engine.EngineError as problem:
            print("SKIPPED, {}".format(problem))
            sys.exit(0)
        unittest.main(argv=[sys.argv[0], "Whole"], verbosity=2)
    unittest.main(argv=[sys.argv[0], "Plan", "Task", "Trend", "Tables"], verbosity=2)
