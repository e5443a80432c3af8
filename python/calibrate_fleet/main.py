"""calibrate_fleet: one calibration a bag, and each vehicle's drift over time."""
import argparse
import math
import os
import pathlib
import shutil
import subprocess
import sys

from calibrate_fleet import tables
from calibrate_fleet.engine import EngineError, work_off, write_plan
from calibrate_fleet.plan import PlanError, find_runs
from calibrate_fleet.trend import day, read_runs, trends

PACKAGE = "lidar_camera_recalibration"
OK, BAD_INPUT, USAGE, DRIFTED = 0, 1, 2, 3

DESCRIPTION = """Calibrates every bag of a folder with calibrate_bag, as tasks of Snakemake, and shows how each vehicle's extrinsic
moved over time. Called again, it does only what is missing: new bags, changed ones, tasks that died. Writes into OUT: runs.csv
and vehicles.csv, trend.png, and for each bag runs/VEHICLE/BAG.yaml (the result) and logs/VEHICLE/BAG.log.

Exit status: 0 all done and no vehicle has drifted, 1 some bags could not be used, 2 wrong options, 3 a vehicle has drifted."""

EPILOG = """What follows -- goes to calibrate_bag: --config, --set, --initial, --image, --camera ... A bag's vehicle comes from its path,
its time from its own stamps. Elsewhere than on this machine's cores: --engine "--profile slurm", as Snakemake's profiles say."""


def parse(argv):
    """@return options, words for calibrate_bag"""
    words = argv[argv.index("--") + 1:] if "--" in argv else []
    own = argv[:argv.index("--")] if "--" in argv else argv
    parser = argparse.ArgumentParser(prog="calibrate_fleet", description=DESCRIPTION, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter,
                                     usage="calibrate_fleet BAGS OUT [options] [-- OPTIONS OF calibrate_bag]")
    parser.add_argument("bags", type=pathlib.Path, help="folder of the bags, with folders in it")
    parser.add_argument("out", type=pathlib.Path, help="folder for the results")
    parser.add_argument("--vehicle", default="{vehicle}/**", metavar="PATTERN",
                        help="where in a bag's path below BAGS its vehicle stands; * stands for a part of a name, ** for any "
                             "folders (default: {vehicle}/**, the first folder); e.g. '{vehicle}_*.bag'")
    parser.add_argument("--cores", type=int, default=os.cpu_count(), help="of this machine (default: all)")
    parser.add_argument("--engine", default="", metavar="OPTIONS", help="further options of Snakemake, in one word")
    parser.add_argument("--tolerance", type=float, nargs=2, default=(0.3, 5.0), metavar=("DEG", "CM"),
                        help="more change than this is drift (default: 0.3 5)")
    parser.add_argument("--reference-runs", type=int, default=3, metavar="N",
                        help="the first N accepted runs are what the last N are compared with (default: 3)")
    parser.add_argument("--retry-failed", action="store_true", help="try bags again that could not be used before")
    parser.add_argument("--calibrate-bag", metavar="PROGRAM", help=argparse.SUPPRESS)
    options = parser.parse_args(own)
    if options.cores < 1 or options.reference_runs < 1 or min(options.tolerance) <= 0:
        parser.error("--cores, --reference-runs and --tolerance must be positive")
    if any(word.split("=")[0] == "--out" for word in words):
        parser.error("calibrate_fleet itself names the result of each bag: leave --out away")
    return options, absolute(words)


def absolute(words):
    """Tasks run in a folder, and on machines, of their own: names of files that exist become absolute."""
    return [str(pathlib.Path(word).resolve()) if not word.startswith("-") and pathlib.Path(word).is_file() else word
            for word in words]


def program(given):
    if given:
        return pathlib.Path(given).resolve()
    beside = pathlib.Path(sys.argv[0]).resolve().parent / "calibrate_bag"
    if beside.is_file():
        return beside
    found = shutil.which("catkin_find") and subprocess.run(
        ["catkin_find", "--first-only", "--libexec", PACKAGE, "calibrate_bag"], stdout=subprocess.PIPE,
        universal_newlines=True).stdout.strip()
    if not found:
        raise EngineError("calibrate_bag is not there: build the package and source its setup.bash")
    return pathlib.Path(found)


def forget_failed(folder):
    for run in read_runs(folder):
        if run.status == "failed":
            (folder / (run.name + ".json")).unlink()


def draw(out, all_trends, tolerance):
    """The picture needs Matplotlib, the tables do not."""
    try:
        from calibrate_fleet import picture
        picture.draw(out / "trend.png", all_trends, tolerance)
    except ImportError as problem:
        print("no picture ({}): install python3-matplotlib".format(problem), file=sys.stderr)


def report(all_trends, others, runs, out):
    """@return whether every bag could be used, whether a vehicle has drifted"""
    for trend in all_trends:
        since = ", since " + day(trend.since) if not math.isnan(trend.since) else ""
        print("{}: {}{} ({} accepted, {} rejected, {} failed)".format(
            trend.vehicle, trend.verdict, since, trend.accepted, trend.rejected, trend.failed))
    recorded = {run.name for run in read_runs(out / "runs")}
    problems = [(run.bag, run.reason) for trend in all_trends for run in trend.runs if run.status == "failed"]
    problems += [(run["bag"], "its task did not finish, the next call tries again; see {}".format(
        out / "logs" / (run["name"] + ".log"))) for run in runs if run["name"] not in recorded]
    problems += [(bag, "its path does not fit --vehicle") for bag in others]
    if problems:
        print("\n{} bags could not be used:".format(len(problems)))
        for bag, reason in problems:
            print("  {}: {}".format(bag, reason))
    return not problems, any(trend.verdict == "drifted" for trend in all_trends)


def main(argv):
    """@return exit status"""
    options, words = parse(argv)
    try:
        runs, others = find_runs(options.bags, options.vehicle)
        out = options.out.resolve()
        plan = out / "plan.json"
        write_plan(plan, runs, program(options.calibrate_bag), words)
        if options.retry_failed:
            forget_failed(out / "runs")
        if not work_off(plan, options.cores, options.engine):
            print("calibrate_fleet: Snakemake did not finish all tasks, see {}; if it speaks of a lock that a killed call left, "
                  "call once with --engine=--unlock".format(out / "engine.log"), file=sys.stderr)
    except (PlanError, EngineError, OSError) as problem:
        print("calibrate_fleet: {}".format(problem), file=sys.stderr)
        return BAD_INPUT
    tolerance = (math.radians(options.tolerance[0]), options.tolerance[1] / 100)
    all_trends = trends(read_runs(out / "runs"), tolerance, options.reference_runs)
    tables.write_runs(out / "runs.csv", all_trends)
    tables.write_vehicles(out / "vehicles.csv", all_trends, tolerance)
    if all_trends:
        draw(out, all_trends, tolerance)
    usable, drifted = report(all_trends, others, runs, out)
    return BAD_INPUT if not usable else DRIFTED if drifted else OK
