"""What tools/check_mjlab.py and tools/check_unitree_rl_lab.py have in common: the steps of a trainer's own program, their comparison
with gaitfit's reading of the same policy, and their file, which tests read."""

import json

import numpy as np

import gaitfit


class Steps:
    """Control steps of a policy in its own program, one robot.

    `readings` are what the robot's sensors and its user give, a list for each quantity of gaitfit; joints are in the order of
    `joints`. `begins` has the numbers of the steps at which an episode begins; the first is always one.
    """

    def __init__(self, joints):
        self.joints, self.readings, self.begins = list(joints), {}, [0]
        self.observations, self.actions, self.targets = [], [], []

    def add(self, readings, observation, action, targets):
        for name, value in readings.items():
            self.readings.setdefault(name, []).append(np.asarray(value, np.float32).ravel())
        for rows, value in ((self.observations, observation), (self.actions, action), (self.targets, targets)):
            rows.append(np.asarray(value, np.float32).ravel())

    def describe(self):
        rows = np.array(self.actions)
        return f"{len(rows)} steps, {len(self.begins)} episodes, actions of {rows.min():.2f} to {rows.max():.2f}"

    def save(self, path, program, count):
        """The first `count` steps, without the observations. Single precision survives nine digits."""
        digits = lambda rows: [[float(f"{x:.9g}") for x in row] for row in rows[:count]]
        table = {
            "program": program,
            "joints": self.joints,
            "begins": [step for step in self.begins if step < count],
            "readings": {name: digits(rows) for name, rows in self.readings.items()},
            "actions": digits(self.actions),
            "targets": digits(self.targets),
        }
        path.write_text(json.dumps(table, separators=(",", ":")).replace('],"', '],\n"') + "\n")

    def log(self, path, control_dt):
        """A log that `gaitfit inspect` reads, with the columns of docs/logs.md."""
        names = {
            "base_angular_velocity": ["wx", "wy", "wz"],
            "base_quaternion": [f"base_quat_{axis}" for axis in "wxyz"],
            "command": ["vx_cmd", "vy_cmd", "wz_cmd"],
            "joint_position": [f"q_{joint}" for joint in self.joints],
            "joint_velocity": [f"dq_{joint}" for joint in self.joints],
        }
        columns = ["time"] + [name for quantity in names for name in names[quantity]]
        columns += [f"act_{joint}" for joint in self.joints]
        count = len(self.actions)
        # A policy that follows a motion has no command.
        readings = {"command": np.zeros((count, 3))} | self.readings
        table = [np.arange(count)[:, None] * control_dt]
        table += [np.array(readings[quantity]) for quantity in names] + [np.array(self.actions)]
        np.savetxt(path, np.hstack(table), "%.9g", ",", header=",".join(columns), comments="")


def compare(file, steps):
    """Largest differences between the program's numbers and what gaitfit makes of the same readings, and the policy: observations and
    actions where the last action is the program's, actions where it is gaitfit's own ("actions in a row"), and targets."""
    policy = gaitfit.load_policy(file)
    interface = policy.interface
    order = [steps.joints.index(joint) for joint in interface.joints]
    of_joints = ("joint_position", "joint_velocity")
    found = dict.fromkeys(("observations", "actions", "actions in a row", "targets"), 0.0)
    beside, alone = gaitfit.Observer(interface), gaitfit.Observer(interface)
    for step, (wanted, target) in enumerate(zip(steps.actions, steps.targets)):
        if step in steps.begins:
            beside.reset(), alone.reset()
            last = own = np.zeros(len(interface.joints), np.float32)
        rows = {name: values[step] for name, values in steps.readings.items() if name in beside.quantities}
        rows |= {name: rows[name][order] for name in of_joints if name in rows}
        given = lambda action: rows | ({"last_action": action} if "last_action" in beside.quantities else {})
        seen = beside(**given(last))
        own = policy(alone(**given(own)))
        last = wanted[order]
        for name, value, other in (
            ("observations", seen, steps.observations[step]),
            ("actions", policy(seen), last),
            ("actions in a row", own, last),
            ("targets", interface.targets(last), target[order]),
        ):
            found[name] = max(found[name], float(np.abs(value - other).max()))
    return found, policy
