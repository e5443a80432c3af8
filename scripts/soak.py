#!/usr/bin/env python3
"""The nodelet under the load of a vehicle, for as long as wanted: `./bootstrap soak --duration 3600`.

Starts a master of its own, measures how long the node takes from its launch to its first ~state, and runs
test/soak.cpp, which prints a table and ends with status 1 on a violation. Options go to that program: --help.
"""
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

PACKAGE = "lidar_camera_recalibration"


def program(name):
    folder = os.environ.get("CMAKE_PREFIX_PATH", "").split(":")[0]
    path = os.path.join(folder, "lib", PACKAGE, name)
    if not os.path.exists(path):
        sys.exit(path + " is not there: build the target `tests`, or call ./bootstrap soak")
    return path


def free_port():
    with socket.socket() as s:
        s.bind(("localhost", 0))
        return s.getsockname()[1]


def start_master(log_folder):
    port = free_port()
    os.environ.update(ROS_MASTER_URI="http://localhost:%d" % port, ROS_HOSTNAME="localhost", ROS_LOG_DIR=log_folder,
                      MALLOC_MMAP_THRESHOLD_="131072", MALLOC_ARENA_MAX="2")  # as recalibrate.launch sets them
    master = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL)
    deadline = time.time() + 30
    while time.time() < deadline and master.poll() is None:
        with socket.socket() as s:
            if s.connect_ex(("localhost", port)) == 0:
                return master
        time.sleep(0.05)
    sys.exit("rosmaster did not come up")


def startup_time():
    """@return seconds from the launch of the node to its first ~state"""
    import rospy
    rospy.init_node("soak_startup", disable_signals=True, disable_rosout=True)
    ready = threading.Event()
    subscriber = rospy.Subscriber("/startup/state", rospy.AnyMsg, lambda state: ready.set())
    start = time.time()
    node = subprocess.Popen([program("recalibration_node"), "__name:=startup"], stdout=subprocess.DEVNULL)
    came = ready.wait(60)
    seconds = time.time() - start
    subscriber.unregister()
    node.send_signal(signal.SIGINT)
    status = node.wait(30)
    if not came or status != 0:
        sys.exit("the node did not start or did not end well (status %d)" % status)
    return seconds


def main():
    log_folder = tempfile.mkdtemp(prefix="soak_")
    master = start_master(log_folder)
    try:
        if "--help" not in sys.argv:
            print("%-46s %.2f s" % ("node launched to first ~state", startup_time()), flush=True)
        return subprocess.call([program("soak")] + sys.argv[1:])
    finally:
        master.terminate()
        master.wait()
        shutil.rmtree(log_folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
