"""What a policy that follows a reference motion observes of it, for `mujoco_sim.py`. Written from docs/policies-motion.md, apart
from the Rust code, so that each checks the other."""

import math

import numpy as np


def product(a, b):
    (w, x, y, z), (p, q, r, s) = a, b
    return np.array([w * p - x * q - y * r - z * s, w * q + x * p + y * s - z * r,
                     w * r - x * s + y * p + z * q, w * s + x * r - y * q + z * p])  # fmt: skip


def about(axis, angle):
    axis = np.array(axis, float) / np.linalg.norm(axis)
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])


def heading(q):
    w, x, y, z = q
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def matrix(q):
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


class Motion:
    """The motion in a policy's interface."""

    def __init__(self, interface):
        own, width = interface["reference"], len(interface["joints"])
        self.rate = own["rate_hz"]
        self.position, self.velocity = (np.array(own[key], float).reshape(-1, width) for key in ("position", "velocity"))
        self.orientation = np.array(own.get("orientation", []), float).reshape(-1, 4)
        self.anchor = [(interface["joints"].index(one["joint"]), one["axis"]) for one in own.get("anchor", [])]
        self.last = len(self.position) - 1

    def _mixed(self, table, time):
        place = min(max(time * self.rate, 0.0), float(self.last))
        low = min(int(place + 1e-4), self.last)
        share = max(place - low, 0.0) if place - low > 1e-4 else 0.0
        a, b = table[low], table[min(low + 1, self.last)]
        return a + share * ((b if table is not self.orientation or a @ b >= 0 else -b) - a)

    def joints(self, time):
        """Angles, rad."""
        return self._mixed(self.position, time)

    def speeds(self, time):
        """Velocities, rad/s; 0 outside the motion."""
        moves = -1e-4 <= time * self.rate <= self.last + 1e-4
        return self._mixed(self.velocity, time) if moves else np.zeros(self.velocity.shape[1])

    def phase(self, time):
        return np.array([min(max(time * self.rate / self.last, 0.0), 1.0)])

    def _anchor(self, base, joints):
        for joint, axis in self.anchor:
            base = product(base, about(axis, joints[joint]))
        return base

    def turned(self, base, joints):
        """Angle by which the motion is turned so that at its beginning it faces as the robot does, rad."""
        return heading(self._anchor(base, joints)) - heading(self.orientation[0]) if len(self.orientation) else 0.0

    def difference(self, time, turned, base, joints):
        """Rotation from the robot's anchor to the motion's, first two columns, row by row."""
        own = self._mixed(self.orientation, time)
        wanted = product(about([0, 0, 1], turned), own / np.linalg.norm(own))
        back = self._anchor(base, joints) * np.array([1, -1, -1, -1])
        return matrix(product(back, wanted))[:, :2].ravel()
