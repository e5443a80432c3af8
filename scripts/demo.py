#!/usr/bin/env python3
"""The demonstration: a simulated drive with a wrong extrinsic, recalibrated live by the nodelet.

Makes the bag, starts demo.launch on it, calls ~recalibrate as a user would, and compares the outcome with the
simulation's truth. Writes summary.json, result.yaml and overlay.png into the output folder.
"""
import argparse
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import time

import numpy
import yaml

NODE = "/recalibration"
PACKAGE = "lidar_camera_recalibration"
FRAMES = 24
FRAMES_USED = 10
PERTURBATION = ("3", "0.1")  # rotation [deg], translation [m]


def say(text, end="\n"):
    print(text, end=end, file=sys.stderr, flush=True)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default="demo", help="folder for bag and results (default: ./demo)")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated street and of the extrinsic's error")
    parser.add_argument("--rviz", action="store_true", help="show it in rviz and stay until Ctrl-C")
    return parser.parse_args()


def program(name):
    """@return path of a program of the package"""
    beside = os.path.join(os.path.dirname(os.path.realpath(sys.argv[0])), name)
    if os.path.exists(beside):
        return beside
    return subprocess.check_output(["catkin_find", "--first-only", "--libexec", PACKAGE, name], text=True).strip()


def simulate(folder, seed):
    """@return paths of bag and truth; kept from the last run unless the simulator is newer."""
    bag = os.path.join(folder, "drive_%d.bag" % seed)
    truth = os.path.splitext(bag)[0] + ".truth.yaml"
    simulator = program("simulate_drive")
    if os.path.exists(truth) and os.path.getmtime(truth) > os.path.getmtime(simulator):
        say("using the simulated drive of the last run: " + bag)
        return bag, truth
    say("simulating a drive of %d frames, extrinsic off by %s deg and %s m" % ((FRAMES,) + PERTURBATION))
    subprocess.check_call([simulator, bag, "--seed", str(seed), "--frames", str(FRAMES), "--perturb"]
                          + list(PERTURBATION))
    return bag, truth


def free_port():
    with socket.socket() as s:
        s.bind(("localhost", 0))
        return s.getsockname()[1]


class Launch:
    """roslaunch of a launch file of the package with a master of its own; its output goes to a file."""

    def __init__(self, folder, file, **args):
        self.log = os.path.join(folder, "roslaunch.log")
        port = free_port()
        os.environ["ROS_MASTER_URI"] = "http://localhost:%d" % port
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(
                ["roslaunch", "-p", str(port), PACKAGE, file] + ["%s:=%s" % pair for pair in args.items()],
                stdout=log, stderr=subprocess.STDOUT, start_new_session=True)

    def stop(self):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)


def matrix_of(transform):
    t, q = transform.translation, transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t.x],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t.y],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t.z],
        [0, 0, 0, 1]])


def error(matrix, truth):
    """@return rotation [deg], translation [m]"""
    cosine = (numpy.trace(matrix[:3, :3] @ truth[:3, :3].T) - 1) / 2
    return math.degrees(math.acos(min(1.0, max(-1.0, cosine)))), float(numpy.linalg.norm(matrix[:3, 3] - truth[:3, 3]))


def recalibrate(folder, launch, timeout=300.0):
    """@param timeout [s]  @return the CalibrationResult and the path of the overlay picture or None"""
    import cv2
    import rospy
    from cv_bridge import CvBridge
    from lidar_camera_recalibration.msg import RecalibrationState
    from lidar_camera_recalibration.srv import Recalibrate, SaveCalibration
    from sensor_msgs.msg import Image

    deadline = time.time() + 60
    while not port_open(os.environ["ROS_MASTER_URI"]):
        if launch.process.poll() is not None or time.time() > deadline:
            raise RuntimeError("roslaunch did not come up; see " + launch.log)
        time.sleep(0.1)
    rospy.init_node("demo", anonymous=True, disable_signals=True)
    overlays = {}

    def keep_overlay(message):
        overlays["last"] = message

    rospy.Subscriber(NODE + "/overlay", Image, keep_overlay, queue_size=1)
    states = rospy.Subscriber(NODE + "/state", RecalibrationState, Progress().show, queue_size=10)
    rospy.wait_for_service(NODE + "/recalibrate", timeout=60)
    say("calling %s/recalibrate" % NODE)
    response = rospy.ServiceProxy(NODE + "/recalibrate", Recalibrate)(
        min_frames=FRAMES_USED, wait=True, timeout=timeout)
    states.unregister()
    if sys.stderr.isatty():
        say("")  # ends the line of the progress
    if not response.success:
        raise RuntimeError("recalibrate failed: " + response.message)
    saved = rospy.ServiceProxy(NODE + "/save", SaveCalibration)(
        path=os.path.abspath(os.path.join(folder, "result.yaml")), format="yaml")
    if not saved.success:
        raise RuntimeError("save failed: " + saved.message)
    time.sleep(1.0)  # the comparison is drawn after the answer
    picture = None
    if "last" in overlays:
        picture = os.path.join(folder, "overlay.png")
        cv2.imwrite(picture, CvBridge().imgmsg_to_cv2(overlays["last"], "bgr8"))
    return response.result, picture


class Progress:
    """Shows the node's state on one line of a terminal; in a log, a line per frame and per ten percent."""

    def __init__(self):
        self.terminal = sys.stderr.isatty()
        self.last = None

    def show(self, state):
        searching = state.state == state.SEARCHING
        step = state.text if self.terminal else (state.state, int(10 * state.progress) if searching else state.frames)
        if step == self.last:
            return
        self.last = step
        if self.terminal:
            say("\r\033[K  " + state.text[:shutil.get_terminal_size().columns - 3], end="")
        else:
            say("  " + state.text)


def port_open(uri):
    host, port = uri.split("//")[1].split(":")
    with socket.socket() as s:
        return s.connect_ex((host, int(port))) == 0


def report(folder, result, picture, truth_file):
    with open(truth_file) as file:
        truth = numpy.array(yaml.safe_load(file)["T_camera_lidar"], dtype=float).reshape(4, 4)
    before = error(matrix_of(result.start.transform), truth)
    after = error(matrix_of(result.transform.transform), truth)
    summary = {
        "rotation_error_before_deg": before[0],
        "rotation_error_after_deg": after[0],
        "translation_error_before_m": before[1],
        "translation_error_after_m": after[1],
        "accepted": bool(result.accepted),
        "seconds": result.duration,
        "score_before": result.score_before,
        "score_after": result.score_after,
        "frames": result.frames,
    }
    with open(os.path.join(folder, "summary.json"), "w") as file:
        json.dump(summary, file, indent=2)
        file.write("\n")
    print("""
                    before      after
rotation error   %7.2f deg %7.2f deg
translation      %7.3f m   %7.3f m
score            %7.4f     %7.4f

%s
%d frames, %d extrinsics scored, %.1f s

overlay before/after   %s
result file            %s
summary                %s""" % (
        before[0], after[0], before[1], after[1], result.score_before, result.score_after, result.reason,
        result.frames, result.evaluations, result.duration, picture or "none was published",
        os.path.join(folder, "result.yaml"), os.path.join(folder, "summary.json")))
    return result.accepted and after[0] < before[0] / 3


def stay(launch):
    say("rviz stays open, the drive is played again and again; Ctrl-C ends the demo")
    try:
        launch.process.wait()
    except KeyboardInterrupt:
        say("ending the demo")


def follow(folder, launch, truth, timeout=300.0, then=None):
    """Recalibrates in what was launched and tells how well.

    @param timeout [s]; then: called with the launch after the report  @return exit status
    """
    try:
        result, picture = recalibrate(folder, launch, timeout)
        good = report(folder, result, picture, truth)
        if then:
            then(launch)
    except RuntimeError as failure:
        say("%s\nthe last lines of %s:" % (failure, launch.log))
        with open(launch.log) as log:
            say("".join(log.readlines()[-15:]))
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        launch.stop()
    return 0 if good else 1


def take_signals():
    for number in (signal.SIGINT, signal.SIGTERM):  # also where the caller has them ignored, as shells do for `&`
        signal.signal(number, signal.default_int_handler)


def main():
    args = arguments()
    take_signals()
    os.makedirs(args.out, exist_ok=True)
    bag, truth = simulate(args.out, args.seed)
    say("starting roslaunch %s demo.launch (its output: %s)" % (PACKAGE, os.path.join(args.out, "roslaunch.log")))
    launch = Launch(args.out, "demo.launch", bag=os.path.abspath(bag), rviz=args.rviz, loop=args.rviz)
    return follow(args.out, launch, truth, then=stay if args.rviz else None)


if __name__ == "__main__":
    sys.exit(main())
