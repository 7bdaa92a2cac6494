"""Writes walk fixtures: stretches of a policy's walk in official MuJoCo with elliptic friction cones.

Each file holds the states and joint torques of consecutive physics steps, a few robots in one file, each under a random
command. They are what the solver presets are held against: contacts that begin, stick, slip and end as in a gait.
Solved to convergence in float64; numbers depend on the MuJoCo version alone.

Usage: .venv/bin/python tools/make_walk_fixtures.py policy.onnx [--out FOLDER]
"""

import argparse
import pathlib

import mujoco
import numpy as np

from make_physics_fixtures import FOLDER
from mujoco_sim import GO2, Group, World, random_commands

ROBOTS, SKIPPED, STEPS = 4, 60, 80  # robots, control periods before the stretch, physics steps in it
IMPRATIOS = (1, 100)


def record(policy, impratio):
    """States (ROBOTS, STEPS + 1, ·) and torques (ROBOTS, STEPS, ·) of one cone."""
    world = World(policy=policy, model=GO2, ground_only=True)
    group = Group(world, range(ROBOTS))
    model = group.robot.model
    model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, impratio
    model.opt.iterations, model.opt.tolerance = 200, 1e-15
    model.opt.ls_iterations, model.opt.ls_tolerance = 100, 1e-10
    commands = random_commands(group.policy.command, 1, ROBOTS)
    for _ in range(SKIPPED):
        group.step(commands)
    qpos, qvel, torque = ([[] for _ in range(ROBOTS)] for _ in range(3))
    for _ in range(STEPS // group.robot.substeps):
        targets = group.policy.targets(group.policy.act(group.observe(commands)))
        group.actions = group.policy.act(group.observe(commands))
        for i, data in enumerate(group.data):
            data.ctrl[group.robot.motors] = targets[i]
            for _ in range(group.robot.substeps):
                qpos[i].append(data.qpos.copy())
                qvel[i].append(data.qvel.copy())
                mujoco.mj_step(model, data)
                torque[i].append(data.actuator_force[:].copy())
    for i, data in enumerate(group.data):
        qpos[i].append(data.qpos.copy())
        qvel[i].append(data.qvel.copy())
    return {"qpos": np.array(qpos), "qvel": np.array(qvel), "torque": np.array(torque)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=pathlib.Path, help="assets/go2-walk.safetensors as ONNX (gaitfit export)")
    parser.add_argument("--out", type=pathlib.Path, default=FOLDER)
    args = parser.parse_args()
    for impratio in IMPRATIOS:
        arrays = record(args.policy, impratio)
        path = args.out / f"walk_go2_ell_imp{impratio}.npz"
        np.savez_compressed(path, impratio=float(impratio), **arrays)
        speed = np.linalg.norm(arrays["qvel"][:, :, :2], axis=2).mean()
        print(f"{path.name}: {ROBOTS} robots, {STEPS} steps, {speed:.2f} m/s on average, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
