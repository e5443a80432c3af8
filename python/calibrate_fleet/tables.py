"""runs.csv, a line for each bag, and vehicles.csv, a line for each vehicle with its verdict."""
import csv
import math

from calibrate_fleet.trend import AXES, day, difference, sigma_along, size

# Column of an axis: name with its unit, factor to it.
COLUMNS = [("{}_deg".format(axis), math.degrees(1)) if axis[0] == "r" else ("{}_cm".format(axis), 100.0) for axis in AXES]


def figure(value, factor=1.0):
    return "" if value is None or math.isnan(value) else "{:.4f}".format(value * factor)


def axis_figures(values):
    if values is None:
        return [""] * len(COLUMNS)
    return [figure(value, factor) for value, (_, factor) in zip(values, COLUMNS)]


def write(path, head, lines):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(lines)


def write_runs(path, all_trends):
    """Change of each run since the vehicle's first ones, and its sigma."""
    head = (["vehicle", "time", "stamp", "status", "frames"] + ["change_" + name for name, _ in COLUMNS] +
            ["sigma_" + name for name, _ in COLUMNS] + ["reason", "result", "bag"])
    lines = []
    for trend in all_trends:
        for run in trend.runs:
            change = difference(run.T, trend.reference) if run.T is not None and trend.reference is not None else None
            lines.append([run.vehicle, day(run.stamp), figure(run.stamp), run.status, run.frames] + axis_figures(change) +
                         axis_figures(run.sigma) + [run.reason, run.result, run.bag])
    write(path, head, lines)


def write_vehicles(path, all_trends, tolerance):
    head = (["vehicle", "verdict", "since", "change_deg", "sigma_deg", "tolerance_deg", "change_cm", "sigma_cm",
             "tolerance_cm", "accepted", "rejected", "failed"] + ["change_" + name for name, _ in COLUMNS] +
            ["sigma_" + name for name, _ in COLUMNS])
    lines = []
    for trend in all_trends:
        known = trend.change is not None
        angle, distance = size(trend.change) if known else (math.nan, math.nan)
        angle_sigma, distance_sigma = sigma_along(trend.change, trend.sigma) if known else (math.nan, math.nan)
        degrees = math.degrees(1)
        lines.append([trend.vehicle, trend.verdict, day(trend.since), figure(angle, degrees), figure(angle_sigma, degrees),
                      figure(tolerance[0], degrees), figure(distance, 100), figure(distance_sigma, 100),
                      figure(tolerance[1], 100), trend.accepted, trend.rejected, trend.failed] +
                     axis_figures(trend.change) + axis_figures(trend.sigma))
    write(path, head, lines)
