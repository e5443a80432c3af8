"""One bag: runs calibrate_bag and writes down what came of it. Called by the engine, on whatever machine it chose.

A bag that cannot be used is a result, too, and is not tried again. Only when calibrate_bag itself dies (killed, out of memory,
no such program) nothing is written, and the next run tries anew.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys

import yaml

ACCEPTED, BAD_INPUT, REJECTED = 0, 1, 3  # exit statuses of calibrate_bag


def camera_names(words):
    """@return names in the --camera options of calibrate_bag; [""] if there is none"""
    given = [words[i + 1] for i, word in enumerate(words[:-1]) if word == "--camera"]
    given += [word.split("=", 1)[1] for word in words if word.startswith("--camera=")]
    return [value.split("=", 1)[0] for value in given] or [""]


def file_of(camera, path):
    """As calibrate_bag names the files of several cameras."""
    return path.with_name("{}_{}{}".format(path.stem, camera, path.suffix)) if camera else path


def outcome(camera, result, log):
    """@return what the record says of one camera"""
    if not result.is_file():
        return {"status": "failed", "reason": complaint(log, camera)}
    values = yaml.safe_load(result.read_text())
    kept = {key: values.get(key) for key in ("T_camera_lidar", "covariance", "stamp", "frames", "score_before",
                                             "score_after", "reason", "camera_frame", "lidar_frame")}
    kept["status"] = "accepted" if values.get("accepted") else "rejected"
    kept["result"] = result.name
    return kept


def complaint(log, camera=""):
    """@return the last line that says something, of this camera if there are several"""
    lines = [line.strip() for line in log.read_text(errors="replace").splitlines()]
    lines = [line for line in lines if line and not line.startswith(("reading", "searching"))]
    own = [line for line in lines if camera and line.startswith("camera {}: ".format(camera))]
    return (own or lines or ["calibrate_bag said nothing"])[-1]


def calibrate(run, program, words, record, log):
    """@return whether there is a record now"""
    result = record.with_suffix(".yaml")
    cameras = camera_names(words)
    for path in [record] + [file_of(camera, result) for camera in cameras]:
        if path.exists():
            path.unlink()
    record.parent.mkdir(parents=True, exist_ok=True)
    log.parent.mkdir(parents=True, exist_ok=True)
    # Few threads a bag, many bags at once: what comes later, of the user, wins.
    command = [program, run["bag"], "--set", "threads=1"] + words + ["--out", str(result)]
    with log.open("w") as output:
        status = subprocess.call(command, stdout=output, stderr=subprocess.STDOUT)
    if status not in (ACCEPTED, BAD_INPUT, REJECTED):
        print("{}: calibrate_bag ended with status {}: {}".format(run["bag"], status, complaint(log)), file=sys.stderr)
        return False
    content = dict(run, cameras={camera: outcome(camera, file_of(camera, result), log) for camera in cameras})
    unfinished = record.with_suffix(".part")
    unfinished.write_text(json.dumps(content, indent=1) + "\n")
    os.replace(str(unfinished), str(record))
    return True


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plan", type=pathlib.Path, required=True)
    parser.add_argument("--name", required=True, help="of the run in the plan")
    parser.add_argument("--record", type=pathlib.Path, required=True)
    parser.add_argument("--log", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    plan = json.loads(arguments.plan.read_text())
    run = next(run for run in plan["runs"] if run["name"] == arguments.name)
    done = calibrate(run, plan["program"], plan["calibrate"], arguments.record, arguments.log)
    return 0 if done else 1


if __name__ == "__main__":
    sys.exit(main())
