"""Holds `gaitfit forward` against MuJoCo C on random states of any robot both can read.

Makes the states (falls from random poses, some airborne, random controls), runs
`gaitfit forward MODEL STATES.npz OUT.npz --preset converged`, and prints for each quantity the largest difference and
the largest difference relative to the state's largest entry. Geoms meet planes only on MuJoCo's side too, since
gaitfit has no self-collision. Exit code 3 if a relative difference exceeds the tolerance.

Usage: .venv/bin/python tools/compare_forward.py assets/go2.xml --gaitfit target/release/gaitfit
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile

import mujoco
import numpy as np

from make_physics_fixtures import converge, random_ctrl, step

QUANTITIES = ("M", "qfrc_bias", "qacc", "next_qpos", "next_qvel")


def load(path):
    """The file's model with ground contacts only and a solver that runs to convergence."""
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in spec.geoms:
        collides = geom.contype or geom.conaffinity
        plane = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
        geom.contype, geom.conaffinity = (int(bool(collides)), 0) if plane else (0, int(bool(collides)))
    model = spec.compile()
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.iterations, model.opt.tolerance = 200, 1e-15
    model.opt.ls_iterations, model.opt.ls_tolerance = 100, 1e-10
    return model


def make_states(model, count, seed):
    """qpos, qvel, ctrl of `count` states on the way of falls from random poses; every fifth is before the fall."""
    rng = np.random.default_rng(seed)
    floating = model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    hinges = np.arange(1 if floating else 0, model.njnt)
    low, high = np.where(model.jnt_limited[hinges, None], model.jnt_range[hinges], [-2.0, 2.0]).T
    states = []
    for i in range(count):
        data = mujoco.MjData(model)
        joints = rng.uniform(low, high)
        if model.nkey and i % 2:
            mujoco.mj_resetDataKeyframe(model, data, 0)
            joints = data.qpos[-len(hinges):] + rng.normal(0, 0.2, len(hinges))
        data.qpos[-len(hinges):] = joints
        if floating:
            quat = rng.normal(size=4) * (0.1 if i % 2 else 1) + [1.0 if i % 2 else 0, 0, 0, 0]
            data.qpos[2] += 0.1
            data.qpos[3:7] = quat / np.linalg.norm(quat)
        if i % 5:
            data.ctrl[:] = random_ctrl(model, rng, 0.1)
            for _ in range(int(rng.uniform(0.1, 1.2) / model.opt.timestep)):
                mujoco.mj_step(model, data)
        data.qvel[:] += rng.normal(0, 0.5, model.nv)
        data.ctrl[:] = random_ctrl(model, rng, 0.8)
        states.append((data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
    return {name: np.array(column) for name, column in zip(("qpos", "qvel", "ctrl"), zip(*states))}


def reference(model, states):
    """The compared quantities from MuJoCo, the contact counts, and the largest inverse-dynamics residual."""
    out, contacts, worst = {name: [] for name in QUANTITIES}, [], 0.0
    for qpos, qvel, ctrl in zip(states["qpos"], states["qvel"], states["ctrl"]):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
        worst = max(worst, converge(model, data))
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        contacts.append(data.ncon)
        for name, value in (("M", mass), ("qfrc_bias", data.qfrc_bias), ("qacc", data.qacc)):
            out[name].append(value.copy())
        step(model, data)
        out["next_qpos"].append(data.qpos.copy())
        out["next_qvel"].append(data.qvel.copy())
    return {name: np.array(values) for name, values in out.items()}, np.array(contacts), worst


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=pathlib.Path, help="robot in MJCF")
    parser.add_argument("--gaitfit", default="gaitfit", help="gaitfit program (default: the one in PATH)")
    parser.add_argument("--preset", default="converged", help="solver preset of gaitfit")
    parser.add_argument("--states", type=int, default=100, help="how many states to make")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tolerance", type=float, default=1e-6, help="largest relative difference that passes")
    parser.add_argument("--keep", type=pathlib.Path, help="folder to leave states.npz and out.npz in")
    args = parser.parse_args()

    model = load(args.model)
    states = make_states(model, args.states, args.seed)
    expected, contacts, residual = reference(model, states)
    print(f"{args.model.name}: {args.states} states, {contacts.mean():.1f} contacts on average (max {contacts.max()}), "
          f"MuJoCo's inverse residual {residual:.1e}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.keep or pathlib.Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(folder / "states.npz", **states)
        command = [args.gaitfit, "forward", args.model, folder / "states.npz", folder / "out.npz", "--preset", args.preset]
        subprocess.run([str(word) for word in command], check=True)
        with np.load(folder / "out.npz") as found:
            found = {name: found[name] for name in QUANTITIES}

    failed = False
    print(f"{'quantity':10s} {'max |diff|':>11s} {'relative':>10s}  worst state (contacts)")
    for name in QUANTITIES:
        if found[name].shape != expected[name].shape:
            raise SystemExit(f"{name}: gaitfit's shape {found[name].shape}, MuJoCo's {expected[name].shape}")
        axes = tuple(range(1, expected[name].ndim))
        difference = np.abs(found[name] - expected[name]).max(axis=axes)
        # NaN is the worst difference of all.
        difference = np.where(np.isnan(difference), np.inf, difference)
        relative = difference / np.abs(expected[name]).max(axis=axes)
        worst = int(relative.argmax())
        failed |= not relative[worst] <= args.tolerance
        print(f"{name:10s} {difference.max():11.2e} {relative[worst]:10.2e}  {worst} ({contacts[worst]})")
    if failed:
        print(f"above the tolerance of {args.tolerance:g}", file=sys.stderr)
        sys.exit(3)


if __name__ == "__main__":
    main()
