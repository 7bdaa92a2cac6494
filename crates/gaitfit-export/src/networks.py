"""The fit's networks of joints in NumPy, from networks.npz; the files .onnx beside it hold the same.

    networks = load()
    torque = networks["resid_act_FL_hip"]([q, dq, q_before, dq_before, q_two_before, dq_two_before])

Angles (rad) are as encoders report them, velocities in rad/s: now, a sample ago, two samples ago. A sample is the policy's
period for action_delta, whose output is added to position targets (rad), and the physics step of the fit for resid_act,
whose output is added to torques (N·m). theta.json names kind and joint of each network.
"""

import pathlib

import numpy as np


def load(path=pathlib.Path(__file__).with_name("networks.npz")):
    """The networks by name: functions of (..., 6) numbers that give (...)."""
    parts = {}
    with np.load(path) as saved:
        for key in saved.files:
            name, part = key.rsplit("/", 1)
            parts.setdefault(name, {})[part] = saved[key]
    return {name: function(own) for name, own in parts.items()}


def function(saved):
    def network(motion):
        x = np.asarray(motion, dtype=float) * saved["factor"] + saved["offset"]
        x = np.tanh(x @ saved["w0"] + saved["b0"])
        x = np.tanh(x @ saved["w1"] + saved["b1"])
        return (x @ saved["w2"] + saved["b2"])[..., 0]

    return network
