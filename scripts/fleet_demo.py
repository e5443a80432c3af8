#!/usr/bin/env python3
"""The demonstration of calibrate_fleet: simulates bags of some vehicles, one of which drifts, and runs it on them.

    ./bootstrap fleet --demo                                     # 30 bags of 3 vehicles
    scripts/fleet_demo.py --bags 4 --vehicles 2 --programs DIR   # a small one

Every vehicle has an extrinsic of its own. That of the last one turns and slides after its first weeks. In one bag of the second
vehicle tf is off by more than the search reaches, so that its result is rejected; one bag of the first is cut short. The truth
is written beside the bags, and the change that calibrate_fleet found is compared with it at the end.
"""
import argparse
import csv
import math
import os
import pathlib
import shutil
import subprocess
import sys

import numpy
import yaml

from calibrate_fleet import trend

DAY = 86400.0
START = 1700000000.0  # of the first bag [s]
APART = 7 * DAY  # from bag to bag of a vehicle
DRIFT_DEG = (0.0, 0.6, 0.15)  # rx ry rz, at the end
DRIFT_M = (0.04, 0.0, 0.0)
NOMINAL = [[0.0, -1.0, 0.0, 0.02], [0.0, 0.0, -1.0, -0.28], [1.0, 0.0, 0.0, -0.45], [0.0, 0.0, 0.0, 1.0]]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=pathlib.Path, required=True, help="folder of simulate_drive and calibrate_fleet")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("fleet_demo"), help="folder for bags and results")
    parser.add_argument("--bags", type=int, default=30)
    parser.add_argument("--vehicles", type=int, default=3)
    parser.add_argument("--frames", type=int, default=6, help="of each bag")
    parser.add_argument("--beams", type=int, default=32)
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    parser.add_argument("--picture", type=pathlib.Path, help="copy the picture to this file")
    return parser.parse_args()


def moved(T, degrees, metres):
    """@return T with a rotation and a translation on the side of the camera"""
    result = numpy.array(T, float)
    result[:3, :3] = trend.turn(numpy.radians(degrees)) @ result[:3, :3]
    result[:3, 3] += metres
    return result


def truth_of(vehicle, vehicles, share):
    """@param share  of the time of all bags, 0..1"""
    random = numpy.random.RandomState(vehicle)
    T = moved(NOMINAL, random.normal(0, 0.7, 3), random.normal(0, 0.015, 3))
    if vehicle + 1 < vehicles:
        return T
    drift = min(1.0, max(0.0, (share - 0.3) / 0.6))  # nothing, then a steady slide, then at rest
    return moved(T, drift * numpy.array(DRIFT_DEG), drift * numpy.array(DRIFT_M))


def simulate(options, bags):
    """@return paths of the bags that came to be"""
    each = options.bags // options.vehicles
    for vehicle in range(options.vehicles):
        for number in range(each):
            bag = bags / "truck_{}".format(vehicle + 1) / "drive_{:02d}.bag".format(number + 1)
            if bag.exists():
                continue
            bag.parent.mkdir(parents=True, exist_ok=True)
            truth = truth_of(vehicle, options.vehicles, number / max(1, each - 1))
            given = bag.with_suffix(".given.yaml")
            given.write_text(yaml.safe_dump({"T_camera_lidar": truth.tolist(), "camera_frame": "camera_optical_frame",
                                             "lidar_frame": "lidar"}))
            print("simulating {}".format(bag.relative_to(bags)), file=sys.stderr, flush=True)
            seed = 100 * vehicle + number + 1
            lost = vehicle == 1 and number == each // 2 and each > 3
            command = [options.programs / "simulate_drive", bag, "--truth", given, "--seed", seed, "--start",
                       START + number * APART + vehicle * DAY, "--frames", options.frames, "--rate", 0.1, "--beams",
                       options.beams, "--width", 800, "--height", 256, "--perturb"] + ([12, 0.4] if lost else [1, 0.05])
            subprocess.check_call([str(word) for word in command], stderr=subprocess.DEVNULL)


def spoil(bags, options):
    """One bag cut short, as a full disk leaves it."""
    short = bags / "truck_1" / "drive_{:02d}.bag".format(max(2, options.bags // options.vehicles - 2))
    with short.open("r+b") as file:
        if os.path.getsize(str(short)) > 200000:
            file.truncate(200000)


def compare(options, out):
    """Prints what was found of each vehicle's change against the truth, between its first three bags and its last three."""
    with (out / "vehicles.csv").open() as file:
        found = {line["vehicle"]: line for line in csv.DictReader(file)}
    each = options.bags // options.vehicles
    for vehicle in range(options.vehicles):
        name = "truck_{}".format(vehicle + 1)
        if not found.get(name, {}).get("change_deg"):
            continue
        truths = [truth_of(vehicle, options.vehicles, number / max(1, each - 1)) for number in range(each)]
        count = min(3, each // 2)
        turned = [angle_between(truths[-1 - i], truths[0]) for i in range(count)]
        print("{}: {} deg found, {:.3f} deg true".format(name, found[name]["change_deg"], sum(turned) / count))


def angle_between(T, reference):
    return math.degrees(math.acos(min(1.0, (numpy.trace(T[:3, :3] @ reference[:3, :3].T) - 1) / 2)))


def main():
    options = arguments()
    bags, out = options.work / "bags", options.work / "results"
    simulate(options, bags)
    spoil(bags, options)
    status = subprocess.call([str(options.programs / "calibrate_fleet"), str(bags), str(out), "--cores", str(options.cores)])
    print("\ncalibrate_fleet ended with status {}; look at {} and {}".format(status, out / "trend.png", out / "vehicles.csv"))
    if (out / "vehicles.csv").exists():
        compare(options, out)
    if options.picture and (out / "trend.png").exists():
        shutil.copy(str(out / "trend.png"), str(options.picture))
    return 0 if status in (0, 1, 3) else status


if __name__ == "__main__":
    sys.exit(main())
