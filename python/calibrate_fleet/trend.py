"""How the extrinsic of each vehicle moved since its first bags, against its sigma and a tolerance."""
import collections
import datetime
import json
import math

import numpy

AXES = ("rx", "ry", "rz", "tx", "ty", "tz")  # of the camera's optical frame; rotations [rad], translations [m]
SIGNIFICANT = 3.0  # sigmas
# Covariances come from draws of the same frames and do not see what these share, so no change is known better than this.
FLOOR = numpy.array([math.radians(0.02)] * 3 + [0.005] * 3)

Run = collections.namedtuple("Run", "name vehicle bag status reason stamp T sigma frames result")
# change, sigma: of the newest runs against the first ones; verdict in a word; since: stamp from which on the change stays
Trend = collections.namedtuple("Trend", "vehicle runs reference change sigma verdict since accepted rejected failed")


def read_runs(folder):
    """@return all runs that have a record, also those whose bag is gone by now, one for each camera"""
    runs = []
    for path in sorted(folder.rglob("*.json")):
        record = json.loads(path.read_text())
        for camera, values in record["cameras"].items():
            runs.append(make_run(record, camera, values, path.parent))
    return sorted(runs, key=lambda run: (run.vehicle, run.stamp, run.name))


def make_run(record, camera, values, folder):
    vehicle = record["vehicle"] + ("/" + camera if camera else "")
    failed = values["status"] == "failed"
    covariance = values.get("covariance")
    return Run(record["name"], vehicle, record["bag"], values["status"], values["reason"],
               math.nan if failed else float(values["stamp"]),
               None if failed else numpy.array(values["T_camera_lidar"], float),
               numpy.sqrt(numpy.diag(numpy.array(covariance, float))) if covariance else None,
               0 if failed else int(values["frames"]), "" if failed else str(folder / values["result"]))


def rotation_vector(R):
    """@return axis times angle [rad]"""
    axis = numpy.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = numpy.linalg.norm(axis) / 2, (numpy.trace(R) - 1) / 2
    angle = math.atan2(sine, cosine)
    if sine > 1e-9:
        return axis / (2 * sine) * angle
    if cosine > 0:
        return axis / 2
    # Half a turn: the axis is the column of R + 1 that is not zero.
    column = max((R + numpy.eye(3)).T, key=numpy.linalg.norm)
    return column / numpy.linalg.norm(column) * math.pi


def difference(T, reference):
    """@return rx ry rz tx ty tz of a result against a reference, as the package counts errors: rotation of T against the
    reference, and difference of the translations, in the axes of the optical frame"""
    return numpy.concatenate([rotation_vector(T[:3, :3] @ reference[:3, :3].T), T[:3, 3] - reference[:3, 3]])


def middle(changes, sigmas):
    """@return mean of some runs, and its sigma per axis: from their covariances or from how they scatter, what is more"""
    count = len(changes)
    variance = sum(sigma ** 2 for sigma in sigmas) / count
    if count > 1:
        variance = numpy.maximum(variance, numpy.var(changes, axis=0, ddof=1))
    return numpy.mean(changes, axis=0), numpy.sqrt(variance / count + FLOOR ** 2)


def size(change):
    """@return angle [rad] and distance [m]"""
    return numpy.linalg.norm(change[:3]), numpy.linalg.norm(change[3:])


def sigma_along(change, sigma):
    """@return sigma of the angle and of the distance"""
    result = []
    for part in (slice(0, 3), slice(3, 6)):
        length = numpy.linalg.norm(change[part])
        direction = change[part] / length if length > 0 else numpy.full(3, 3 ** -0.5)
        result.append(numpy.linalg.norm(direction * sigma[part]))
    return result


def judge(change, sigma, tolerance):
    """@param tolerance  angle [rad], distance [m]  @return verdict"""
    sizes, sigmas = size(change), sigma_along(change, sigma)
    beyond = [length > limit for length, limit in zip(sizes, tolerance)]
    certain = [length > limit and length > SIGNIFICANT * spread for length, limit, spread in zip(sizes, tolerance, sigmas)]
    if any(certain):
        return "drifted"
    return "unclear" if any(beyond) else "steady"


def trend_of(vehicle, runs, tolerance, count):
    """@param count  so many of the first runs are the reference, so many of the last ones are compared with it"""
    by_status = {status: [run for run in runs if run.status == status] for status in ("accepted", "rejected", "failed")}
    accepted = by_status["accepted"]
    numbers = [len(by_status[status]) for status in ("accepted", "rejected", "failed")]
    if len(accepted) < 2:
        reference = accepted[0].T if accepted else None
        return Trend(vehicle, runs, reference, None, None, "too few", math.nan, *numbers)
    count = min(count, len(accepted) // 2)
    reference = reference_of(accepted[:count])
    changes = [difference(run.T, reference) for run in accepted]
    sigmas = [numpy.zeros(6) if run.sigma is None else run.sigma for run in accepted]
    first, first_sigma = middle(changes[:count], sigmas[:count])
    last, last_sigma = middle(changes[-count:], sigmas[-count:])
    change, sigma = last - first, numpy.hypot(first_sigma, last_sigma)
    verdict = judge(change, sigma, tolerance)
    return Trend(vehicle, runs, reference, change, sigma, verdict,
                 since(accepted, changes, tolerance) if verdict == "drifted" else math.nan, *numbers)


def reference_of(runs):
    """@return mean extrinsic of some runs"""
    T = runs[0].T.copy()
    mean = numpy.mean([difference(run.T, runs[0].T) for run in runs], axis=0)
    T[:3, :3] = turn(mean[:3]) @ T[:3, :3]
    T[:3, 3] += mean[3:]
    return T


def turn(vector):
    """@return rotation matrix of a rotation vector"""
    angle = numpy.linalg.norm(vector)
    if angle == 0:
        return numpy.eye(3)
    x, y, z = vector / angle
    K = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return numpy.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def since(accepted, changes, tolerance):
    """@return stamp of the first run from which on all are out of tolerance"""
    stamp = math.nan
    for run, change in reversed(list(zip(accepted, changes))):
        if not any(length > limit for length, limit in zip(size(change), tolerance)):
            break
        stamp = run.stamp
    return stamp


def trends(runs, tolerance, count):
    """@return one Trend for each vehicle, or vehicle/camera, in the order of their names"""
    by_vehicle = collections.defaultdict(list)
    for run in runs:
        by_vehicle[run.vehicle].append(run)
    return [trend_of(vehicle, by_vehicle[vehicle], tolerance, count) for vehicle in sorted(by_vehicle)]


def day(stamp):
    return "" if math.isnan(stamp) else datetime.datetime.utcfromtimestamp(stamp).strftime("%Y-%m-%dT%H:%M:%SZ")
