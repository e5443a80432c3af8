"""Which image is taken next: always the newest, and only if it shows something new."""
import threading

import numpy as np


class Newest:
    """Holds one thing, the last that was put. A slow taker never sees a queue of old ones."""

    def __init__(self):
        self.condition = threading.Condition()
        self.thing = None
        self.replaced = 0  # put, but never taken

    def put(self, thing):
        with self.condition:
            self.replaced += self.thing is not None
            self.thing = thing
            self.condition.notify()

    def take(self, timeout):
        """@return the newest thing, or None after so many seconds without one"""
        with self.condition:
            self.condition.wait_for(lambda: self.thing is not None, timeout)
            thing, self.thing = self.thing, None
            return thing


class Gate:
    """Lets an image pass when enough time and way lie behind the last one that passed."""

    def __init__(self, min_interval, min_distance):
        """min_interval [s], counted in stamps; min_distance [m]. 0 switches either off."""
        self.min_interval, self.min_distance = min_interval, min_distance
        self.stamp = self.place = None

    def passes(self, stamp, place=None):
        """@param stamp [s]; place: x, y, z in a fixed frame [m], only needed with min_distance"""
        if self.stamp is not None and stamp >= self.stamp:  # else time went back: a bag is played again
            if stamp - self.stamp < self.min_interval:
                return False
            if self.min_distance > 0.0 and np.linalg.norm(np.subtract(place, self.place)) < self.min_distance:
                return False
        self.stamp, self.place = stamp, place
        return True
