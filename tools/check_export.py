"""Moves an exported robot in official MuJoCo beside gaitfit's own simulation of it, base clamped, and prints the difference.

FOLDER holds what `gaitfit export` wrote, original.xml, and given.json: joints, position targets at 200 Hz, the first
angles, and the encoder positions that gaitfit simulated. With "drive" the original robot is driven by load_theta.py and
drive.py, else robot.xml by its own actuators. Exits with 1 if the joints are more than a tolerance apart (RMS).

Usage: .venv/bin/python tools/check_export.py FOLDER [--tolerance RAD]
"""

import argparse
import ast
import json
import pathlib
import sys

import mujoco
import numpy as np

PERIOD, SUBSTEPS = 0.005, 20


def clamped(path):
    """The model without its floating base and without contacts."""
    spec = mujoco.MjSpec.from_file(str(path))
    for joint in [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]:
        spec.delete(joint)
    for key in list(spec.keys):
        spec.delete(key)
    spec.option.timestep = PERIOD / SUBSTEPS
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return spec


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--tolerance", type=float, default=1e-3)
    args = parser.parse_args()
    for path in args.folder.glob("*.py"):
        ast.parse(path.read_text(encoding="utf-8"), str(path))
    given = json.loads((args.folder / "given.json").read_text())
    names, bias = given["joints"], np.array(given["bias"])
    target = np.array(given["target"]).reshape(-1, len(names))
    wanted = np.array(given["position"]).reshape(-1, len(names))
    sys.path.insert(0, str(args.folder))
    import drive
    import load_theta

    theta = load_theta.load()
    spec = clamped(args.folder / ("original.xml" if given["drive"] else "robot.xml"))
    if given["drive"]:
        for actuator in list(spec.actuators):
            spec.delete(actuator)
        load_theta.gears(spec, theta)
    model = spec.compile()
    controller = drive.Drive(theta, given["kp"], given["kd"], model.opt.timestep)
    if given["drive"]:
        load_theta.apply(model, theta)
        assert controller.joints == names
    data = mujoco.MjData(model)
    place = np.array([model.joint(name).qposadr[0] for name in names])
    speed = np.array([model.joint(name).dofadr[0] for name in names])
    data.qpos[place] = np.array(given["q0"]) - bias
    motor = {model.actuator(i).trnid[0]: i for i in range(model.nu)}
    motors = [motor.get(model.joint(name).id) for name in names]
    found = [data.qpos[place] + bias]
    for row in target[:-1]:
        if given["drive"]:
            controller.send(row, data.qpos[place], data.qvel[speed])
        else:
            data.ctrl[motors] = row
        for _ in range(SUBSTEPS):
            if given["drive"]:
                torque = controller.torque(data.qpos[place], data.qvel[speed])
                data.qfrc_applied[speed] = torque
                load_theta.stribeck(model, data, theta, torque)
            mujoco.mj_step(model, data)
        found.append(data.qpos[place] + bias)
    error = np.array(found) - wanted
    # MuJoCo's stops are soft, so joints with play or compliance count a fifth.
    geared = [given["drive"] and bool(joint["play"] or joint["compliance"]) for joint in map(theta["joints"].get, names)]
    error[:, geared] /= 5
    rms, moved = np.sqrt(np.mean(error**2)), np.sqrt(np.mean((wanted - wanted.mean(axis=0)) ** 2))
    print(f"joints {rms:.2e} rad RMS apart, at most {np.abs(error).max():.2e}; they move by {moved:.3f} rad RMS")
    sys.exit(not (rms <= args.tolerance and moved > 0.02))


if __name__ == "__main__":
    main()
