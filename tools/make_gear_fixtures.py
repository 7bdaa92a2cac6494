"""Writes crates/gaitfit-physics/tests/fixtures/gears.npz: a clamped Go2 in MuJoCo with a further joint between each motor
and its link, whose targets swing. Tests hold the step's gears against it.

Each case (see `main`) has two arrays, `samples x joints`, every 20 ms: the motors' angles, and the links' angles minus the
motors' (rad). Needs the packages of tools/requirements.txt.
"""

import math
from pathlib import Path

import mujoco
import numpy as np

FIXTURES = Path(__file__).resolve().parent.parent / "crates/gaitfit-physics/tests/fixtures"
STEP, SAMPLE, SECONDS = 5e-5, 0.02, 1.0
KP, KD = 40.0, 1.0
MOTOR = {"armature": 0.02, "damping": 0.1}
RETARDATION = 2e-3  # s, damping of a gear over its stiffness
REST = np.array([0.0, 0.9, -1.8] * 4)


def robot(play, compliance, friction):
    spec = mujoco.MjSpec.from_file(str(FIXTURES / "go2.xml"))
    for joint in list(spec.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
            continue
        for name, value in {**MOTOR, "frictionloss": friction}.items():
            setattr(joint, name, [value, 0, 0] if name == "damping" else value)
        joint.limited = False
        between = {"type": joint.type, "axis": joint.axis, "pos": joint.pos, "armature": 1e-5}
        if compliance:
            stiffness = 1 / compliance
            between |= {"stiffness": [stiffness, 0, 0], "damping": [RETARDATION * stiffness, 0, 0]}
        else:
            between |= {"limited": True, "range": [-play / 2, play / 2], "solref_limit": [4 * STEP, 1.0], "damping": [1e-3, 0, 0]}
        joint.parent.add_joint(name=f"{joint.name}_gear", **between)
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    return spec.compile()


def swing(play, compliance, friction):
    model = robot(play, compliance, friction)
    data = mujoco.MjData(model)
    motors = np.arange(0, 24, 2)
    data.qpos[motors] = REST
    angles, offsets = [], []
    for sample in range(round(SECONDS / SAMPLE)):
        angles.append(data.qpos[motors].copy())
        offsets.append(data.qpos[motors + 1].copy())
        time = sample * SAMPLE
        target = REST + 0.25 * np.sin(7 * time + np.arange(12)) + 0.1 * math.sin(23 * time)
        for _ in range(round(SAMPLE / STEP)):
            data.qfrc_applied[motors] = KP * (target - data.qpos[motors]) - KD * data.qvel[motors]
            mujoco.mj_step(model, data)
    return np.array(angles), np.array(offsets)


def main():
    cases = {"play": (0.03, 0.0, 0.2), "twist": (0.0, 0.004, 0.2), "smooth": (0.0, 0.004, 0.0)}
    arrays = {}
    for name, case in cases.items():
        arrays[f"{name}_motor"], arrays[f"{name}_offset"] = swing(*case)
    np.savez_compressed(FIXTURES / "gears.npz", **arrays)


main()
