"""The trend picture: a row for each vehicle, rotation on the left, translation on the right."""
import datetime
import math

import numpy

from calibrate_fleet.trend import difference, sigma_along, size

MOST = 12  # vehicles in one picture
COLORS = {"drifted": "#c1440e", "unclear": "#b8860b", "steady": "#2f8f57", "too few": "#777777"}
AXIS_COLORS = ("#c1440e", "#1f5a94", "#2f8f57")
# Part of a change, its names, unit, factor to the unit.
PARTS = [(slice(0, 3), ("rx, pitch", "ry, yaw", "rz, roll"), "rotation [deg]", math.degrees(1)),
         (slice(3, 6), ("tx, sideways", "ty, down", "tz, forward"), "translation [cm]", 100.0)]


def chosen(all_trends):
    """@return those that ask for a look first, when there are too many, in the order of their names"""
    urgency = {verdict: place for place, verdict in enumerate(COLORS)}
    first = sorted(all_trends, key=lambda trend: (urgency[trend.verdict], trend.vehicle))[:MOST]
    return sorted(first, key=lambda trend: trend.vehicle)


def draw(path, all_trends, tolerance):
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    shown = chosen(all_trends)
    figure, rows = pyplot.subplots(len(shown), 2, figsize=(10, 0.7 + 2.1 * len(shown)), sharex=True, sharey="col",
                                   squeeze=False)
    for axes, trend in zip(rows, shown):
        for plot, part, limit in zip(axes, PARTS, tolerance):
            draw_part(plot, trend, part, limit)
        axes[0].set_title("{}: {}".format(trend.vehicle, headline(trend)), loc="left", fontsize=10, fontweight="bold",
                          color=COLORS[trend.verdict])
    for plot, (_, _, label, factor), limit in zip(rows[0], PARTS, tolerance):
        plot.legend(loc="upper right", ncol=5, fontsize=7, framealpha=0.9, borderaxespad=0.2)
        low, high = plot.get_ylim()
        room = max(abs(low), abs(high), 1.6 * limit * factor)
        plot.set_ylim(-room, room)
    rows[-1][0].xaxis.set_major_locator(matplotlib.dates.AutoDateLocator(minticks=3, maxticks=7))
    rows[-1][0].xaxis.set_major_formatter(matplotlib.dates.ConciseDateFormatter(rows[-1][0].xaxis.get_major_locator()))
    left_out = len(all_trends) - len(shown)
    figure.suptitle("Extrinsic of each vehicle since its first bags, accepted runs with their sigma; band: tolerance; "
                    "x: rejected" + ("; {} more vehicles in vehicles.csv".format(left_out) if left_out else ""), fontsize=9)
    figure.tight_layout(rect=(0, 0, 1, 0.99))
    figure.savefig(str(path), dpi=80)
    pyplot.close(figure)


def headline(trend):
    if trend.change is None:
        return "too few accepted runs ({})".format(trend.accepted)
    (angle, distance), (angle_sigma, distance_sigma) = size(trend.change), sigma_along(trend.change, trend.sigma)
    return "{}, {:.2f}° ± {:.2f}° and {:.1f} ± {:.1f} cm".format(
        trend.verdict, math.degrees(angle), math.degrees(angle_sigma), 100 * distance, 100 * distance_sigma)


def time_of(run):
    return datetime.datetime.utcfromtimestamp(run.stamp)


def draw_part(plot, trend, part, limit):
    rows, names, label, factor = part
    plot.axhspan(-limit * factor, limit * factor, color="#2f8f57", alpha=0.12, linewidth=0)
    plot.axhline(0, color="#999999", linewidth=0.6)
    if trend.reference is not None:
        accepted = [run for run in trend.runs if run.status == "accepted"]
        changes = numpy.array([difference(run.T, trend.reference)[rows] * factor for run in accepted])
        sigmas = numpy.array([(run.sigma[rows] if run.sigma is not None else numpy.zeros(3)) * factor for run in accepted])
        times = [time_of(run) for run in accepted]
        for axis, (name, color) in enumerate(zip(names, AXIS_COLORS)):
            plot.errorbar(times, changes[:, axis], yerr=sigmas[:, axis], color=color, marker="o", markersize=3.5,
                          linewidth=1.0, capsize=2, label=name)
    rejected = [time_of(run) for run in trend.runs if run.status == "rejected"]
    # At the foot of the plot: where a refused result lies means nothing.
    plot.plot(rejected, [0.06] * len(rejected), "x", color="black", markersize=6, markeredgewidth=1.6,
              transform=plot.get_xaxis_transform(), label="rejected" if rejected else None)
    plot.set_ylabel(label, fontsize=8)
    plot.tick_params(labelsize=8)
    plot.grid(axis="x", linewidth=0.3)
