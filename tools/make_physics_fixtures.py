"""Writes the physics fixtures: states and short rollouts of twelve robots, computed with MuJoCo in float64.

Reads the MJCF files beside the fixtures (crates/gaitfit-physics/tests/fixtures/*.xml) and writes one .npz per robot
and option variant; README.md in that folder describes every array. The same MuJoCo version gives the same numbers.
Prints, per file, the contact and row counts and the largest inverse-dynamics residual: how converged the numbers are.

Usage: .venv/bin/python tools/make_physics_fixtures.py [--only go2] [--out FOLDER]
"""

import argparse
import dataclasses
import itertools
import pathlib
import zlib

import mujoco
import numpy as np

FOLDER = pathlib.Path(__file__).parent.parent / "crates" / "gaitfit-physics" / "tests" / "fixtures"
PYRAMIDAL, ELLIPTIC = mujoco.mjtCone.mjCONE_PYRAMIDAL, mujoco.mjtCone.mjCONE_ELLIPTIC
EULER, IMPLICITFAST = mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
STATES = 30
# The kind of state i is KINDS[i % 6].
KINDS = ("standing", "tilted", "limits", "airborne", "fallen", "pressed")
ROLLOUT_STEPS = 200


@dataclasses.dataclass(frozen=True)
class Variant:
    """What is changed in the file's model before it is evaluated."""

    name: str
    cone: int = PYRAMIDAL
    impratio: float = 1.0
    integrator: int = EULER
    frictionloss: bool = True
    tilt: tuple = (1.0, 0.0, 0.0, 0.0)
    eulerdamp: bool = True


# A slope of about 14 degrees, not along a world axis.
SLOPE = (0.9927, 0.1, -0.067, 0.0)
VARIANTS = {
    "biped": [
        Variant("pyr_imp1_fl"),
        Variant("pyr_imp10_nofl", impratio=10, frictionloss=False),
        Variant("ell_imp1_nofl", ELLIPTIC, frictionloss=False),
        Variant("ell_imp10_fl", ELLIPTIC, 10),
        Variant("pyr_imp1_fl_noeulerdamp", eulerdamp=False),
    ],
    "humanoid": [
        Variant("pyr_imp1_fl"),
        Variant("ell_imp1_fl", ELLIPTIC),
        Variant("ell_imp5_fl_slope", ELLIPTIC, 5, tilt=SLOPE),
        Variant("pyr_imp1_nofl_slope", frictionloss=False, tilt=SLOPE),
        Variant("pyr_imp1_fl_implicitfast", integrator=IMPLICITFAST),
    ],
    "arm": [
        Variant("pyr_imp1_fl"),
        Variant("ell_imp1_nofl", ELLIPTIC, frictionloss=False),
        Variant("pyr_imp1_fl_implicitfast", integrator=IMPLICITFAST),
    ],
    "tripod": [
        Variant("pyr_imp1_fl_implicitfast", integrator=IMPLICITFAST),
        Variant("ell_imp1_nofl", ELLIPTIC, frictionloss=False),
    ],
    "drag": [
        Variant("pyr_imp1_fl"),
        Variant("ell_imp1_fl_implicitfast", ELLIPTIC, integrator=IMPLICITFAST),
        Variant("pyr_imp1_nofl_noeulerdamp", frictionloss=False, eulerdamp=False),
    ],
    "rover": [Variant("pyr_imp1_fl"), Variant("ell_imp10_fl_implicitfast", ELLIPTIC, 10, integrator=IMPLICITFAST)],
    "telescope": [Variant("pyr_imp1_fl"), Variant("ell_imp10_fl_implicitfast", ELLIPTIC, 10, integrator=IMPLICITFAST), Variant("ell_imp1_nofl", ELLIPTIC, frictionloss=False)],
    "crab": [Variant("pyr_imp1_fl"), Variant("ell_imp10_nofl", ELLIPTIC, 10, frictionloss=False)],
    "hand": [Variant("pyr_imp1_fl"), Variant("ell_imp10_fl_implicitfast", ELLIPTIC, 10, integrator=IMPLICITFAST), Variant("pyr_imp1_nofl_noeulerdamp", frictionloss=False, eulerdamp=False)],
    "gears": [Variant("pyr_imp1_fl"), Variant("ell_imp10_fl_implicitfast", ELLIPTIC, 10, integrator=IMPLICITFAST), Variant("pyr_imp1_nofl_noeulerdamp", frictionloss=False, eulerdamp=False)],
    "twins": [Variant("pyr_imp1_nofl_implicitfast", integrator=IMPLICITFAST, frictionloss=False), Variant("ell_imp1_fl", ELLIPTIC)],
    "terrain": [Variant("pyr_imp1_fl"), Variant("ell_imp10_nofl", ELLIPTIC, 10, frictionloss=False)],
    "go2": [
        Variant("pyr_imp1_fl"),
        Variant("pyr_imp100_nofl", impratio=100, frictionloss=False),
        Variant("ell_imp1_nofl", ELLIPTIC, frictionloss=False),
        Variant("ell_imp100_fl", ELLIPTIC, 100),
    ],
}
# Robots whose own parts touch each other.
OWN = ("crab", "gears", "hand", "twins")
# The variant of each robot whose fall is recorded, and the steps recorded.
ROLLOUTS = {"twins": "ell_imp1_fl", "hand": "pyr_imp1_fl", "gears": "pyr_imp1_fl", "biped": "pyr_imp1_fl", "humanoid": "ell_imp1_fl", "arm": "pyr_imp1_fl_implicitfast", "rover": "pyr_imp1_fl", "telescope": "pyr_imp1_fl", "go2": "pyr_imp1_fl"}


def load(robot, variant):
    """The robot's model with the variant's options; constants that follow from the reference pose are recomputed."""
    spec = mujoco.MjSpec.from_file(str(FOLDER / f"{robot}.xml"))
    # Before compilation: MuJoCo compiles the pose of static geoms into its collision tree.
    if spec.worldbody.geoms[0].type == mujoco.mjtGeom.mjGEOM_PLANE:
        spec.worldbody.geoms[0].quat = np.array(variant.tilt) / np.linalg.norm(variant.tilt)
    model = spec.compile()
    opt = model.opt
    opt.cone, opt.impratio, opt.integrator = variant.cone, variant.impratio, variant.integrator
    opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    opt.iterations, opt.tolerance = 200, 1e-15
    opt.ls_iterations, opt.ls_tolerance = 100, 1e-10
    if not variant.eulerdamp:
        opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    if not variant.frictionloss:
        model.dof_frictionloss[:] = 0
    return model


def converge(model, data):
    """Evaluates the state and restarts the solver from its own result until the residual stops falling.

    Returns the residual: max |M qacc + bias - passive - constraint - actuator| with the constraint forces that
    qacc implies (N, N m).
    """
    best, best_qacc = np.inf, None
    for _ in range(4):
        mujoco.mj_forward(model, data)
        qacc = data.qacc.copy()
        mujoco.mj_inverse(model, data)
        residual = np.abs(data.qfrc_inverse - data.qfrc_actuator).max()
        if residual < best:
            best, best_qacc = residual, qacc
        data.qacc_warmstart[:] = best_qacc
    mujoco.mj_forward(model, data)
    return best


def step(model, data):
    """One step whose solver is warm-started from the converged acceleration."""
    residual = converge(model, data)
    mujoco.mj_step(model, data)
    return residual


def clearance(model, data):
    """Distance of the robot's lowest point from the plane, m."""
    normal = data.geom_xmat[0].reshape(3, 3)[:, 2]
    gaps = []
    for geom in range(1, model.ngeom):
        size, along = model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3).T @ normal
        support = {
            mujoco.mjtGeom.mjGEOM_SPHERE: size[0],
            mujoco.mjtGeom.mjGEOM_CAPSULE: size[0] + size[1] * abs(along[2]),
            mujoco.mjtGeom.mjGEOM_CYLINDER: size[0] * np.hypot(along[0], along[1]) + size[1] * abs(along[2]),
            mujoco.mjtGeom.mjGEOM_BOX: size @ np.abs(along),
        }[mujoco.mjtGeom(model.geom_type[geom])]
        if model.geom_bodyid[geom] and model.body_weldid[model.geom_bodyid[geom]]:
            gaps.append(normal @ (data.geom_xpos[geom] - data.geom_xpos[0]) - support)
    return min(gaps)


def place(model, data, gap):
    """Moves a floating robot vertically until its lowest point is `gap` above the plane, m."""
    mujoco.mj_kinematics(model, data)
    normal = data.geom_xmat[0].reshape(3, 3)[:, 2]
    data.qpos[2] += (gap - clearance(model, data)) / normal[2]
    mujoco.mj_kinematics(model, data)


def random_joints(model, kind, home, rng):
    """Joint positions of one state: near home, anywhere inside the limits, or with three joints beyond them."""
    numbers = np.arange(model.njnt - len(home), model.njnt)
    # Slides are drawn from 0.1 m where hinges are drawn from 1 rad.
    reach = np.where(model.jnt_type[numbers] == mujoco.mjtJoint.mjJNT_SLIDE, 0.1, 1.0)
    low, high = np.where(model.jnt_limited[numbers, None], model.jnt_range[numbers], reach[:, None] * [-2.0, 2.0]).T
    if kind in ("standing", "fallen", "pressed"):
        return home + reach * rng.normal(0, 0.08 if kind == "standing" else 0.3, len(home))
    joints = rng.uniform(low + 0.05 * (high - low), high - 0.05 * (high - low))
    if kind == "limits":
        beyond = rng.choice(np.flatnonzero(model.jnt_limited[numbers]), 3, replace=False)
        side = rng.integers(0, 2, 3)
        joints[beyond] = np.where(side, high[beyond], low[beyond]) + (2 * side - 1) * reach[beyond] * rng.uniform(0.005, 0.12, 3)
    return joints


def random_ctrl(model, rng, scale):
    low, high = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, [-1.0, 1.0]).T
    # Past the range by a little, so that clamping matters.
    return scale * rng.uniform(1.2 * low, 1.2 * high)


def random_state(model, kind, rng):
    """One state of the given kind in a fresh MjData. Kinds are listed in the fixtures' README."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    floating = model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    hinges = data.qpos[7:] if floating else data.qpos
    home = hinges.copy()
    hinges[:] = random_joints(model, kind, home, rng)
    if floating:
        tilt = np.array([1, *rng.normal(0, 0.04, 3)]) if kind == "standing" else rng.normal(size=4)
        data.qpos[:2] = rng.uniform(-1, 1, 2)
        data.qpos[3:7] = tilt / np.linalg.norm(tilt)
        place(model, data, {"standing": -0.002, "airborne": 0.3}.get(kind, -rng.uniform(0.001, 0.015)))
    else:
        # A fixed robot cannot be moved to the ground: draw until it touches (or, airborne, does not).
        mujoco.mj_kinematics(model, data)
        while (kind == "airborne") != (clearance(model, data) > 0) or clearance(model, data) < -0.015:
            hinges[:] = random_joints(model, "tilted" if kind in ("standing", "fallen", "pressed") else kind, home, rng)
            mujoco.mj_kinematics(model, data)
    if kind in ("fallen", "pressed"):
        data.ctrl[:] = random_ctrl(model, rng, 0.05)
        for _ in range(int(rng.uniform(0.15, 1.5) / model.opt.timestep)):
            mujoco.mj_step(model, data)
    if kind == "pressed" and floating:
        data.qpos[2] -= rng.uniform(0.005, 0.02)
    data.ctrl[:] = random_ctrl(model, rng, 1.0)
    data.qvel[:] += rng.normal(0, {"tilted": 1.0, "limits": 1.0, "airborne": 3.0}.get(kind, 0.3), model.nv)
    data.time = 0
    return data


def terrain_state(model, kind, rng):
    """One state on ground that is not flat, on which the engine and MuJoCo mean the same contacts; and how many were drawn.

    MuJoCo gives a ball one contact with each prism of a height field that it meets; the engine gives one in all. On a box
    the engine takes a rod for its two ends; MuJoCo may find a point between them.
    """
    for drawn in itertools.count(1):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qpos[7:] = random_joints(model, "tilted", data.qpos[7:].copy(), rng)
        tilt = rng.normal(size=4) if kind in ("fallen", "tilted") else np.array([1, *rng.normal(0, 0.2, 3)])
        data.qpos[:2] = rng.uniform([-1.2, -0.6], [2.3, 0.6])
        data.qpos[3:7] = tilt / np.linalg.norm(tilt)
        data.qpos[2] = 1.5
        mujoco.mj_forward(model, data)
        while not data.ncon and data.qpos[2] > -1:
            data.qpos[2] -= 0.004
            mujoco.mj_forward(model, data)
        data.qpos[2] += 0.3 if kind == "airborne" else -rng.uniform(0, 0.05)
        data.qvel[:] = rng.normal(0, 0.5, model.nv)
        data.ctrl[:] = random_ctrl(model, rng, 1.0)
        mujoco.mj_forward(model, data)
        if (kind == "airborne" or data.ncon) and same_contacts(model, data):
            return data, drawn


def same_contacts(model, data):
    """Whether every ball has one contact with a height field at most, and every rod's contacts with a box are its ends'."""
    found = {}
    for contact in data.contact:
        found.setdefault(tuple(contact.geom), []).append(contact.dist)
    for (first, second), distances in found.items():
        if model.geom_type[first] == mujoco.mjtGeom.mjGEOM_HFIELD:
            # Where the centre is below the surface, MuJoCo's depth is only as exact as its collision tolerance.
            if len(distances) > 1 or distances[0] < -model.geom_size[second, 0]:
                return False
            # The engine's fields have no walls at their borders.
            local = data.geom_xmat[first].reshape(3, 3).T @ (data.geom_xpos[second] - data.geom_xpos[first])
            if (np.abs(local[:2]) > model.hfield_size[model.geom_dataid[first], :2]).any():
                return False
        elif model.geom_type[first] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            ends = end_distances(model, data, first, second)
            if len(ends) != len(distances) or not np.allclose(np.sort(distances), ends, rtol=0, atol=1e-12):
                return False
    for rod in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE):
        for box in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX):
            if (rod, box) not in found and len(end_distances(model, data, rod, box)):
                return False
    return True


def end_distances(model, data, rod, box):
    """Distances of a rod's ends from a box, of those that meet it."""
    radius, half = model.geom_size[rod, :2]
    out = []
    for sign in (-1, 1):
        end = data.geom_xpos[rod] + sign * half * data.geom_xmat[rod].reshape(3, 3)[:, 2]
        local = data.geom_xmat[box].reshape(3, 3).T @ (end - data.geom_xpos[box])
        outside = np.linalg.norm(local - np.clip(local, -model.geom_size[box], model.geom_size[box]))
        inside = (model.geom_size[box] - np.abs(local)).min()
        distance = (outside if outside > 0 else -inside) - radius
        out += [distance] if distance < 0 else []
    return np.sort(out)


def evaluate(model, data, own):
    """Everything stored of one state, as a dict of arrays; also the worst residual on the way.

    `own`: also which contacts are between own parts.
    """
    row = {"qpos": data.qpos.copy(), "qvel": data.qvel.copy(), "ctrl": data.ctrl.copy()}
    data.qacc_warmstart[:] = 0
    residual = converge(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    row["M"] = mass
    for name in ("qfrc_bias", "qfrc_passive", "qfrc_actuator", "qacc_smooth", "qacc", "qfrc_constraint"):
        row[name] = getattr(data, name).copy()
    row["inv_residual"], row["ncon"], row["nefc"] = residual, data.ncon, data.nefc
    contacts = list(data.contact)
    # Geoms of bodies without any joint come before the robot's.
    robots = model.body_rootid[model.jnt_bodyid]
    static = int((~np.isin(model.body_rootid[model.geom_bodyid], robots)).sum())
    row["contact_geom"] = np.array([max(c.geom) - static for c in contacts], dtype=np.int32)
    if own:
        row["contact_own"] = np.array([min(c.geom) >= static for c in contacts], dtype=np.int32)
    row["contact_dim"] = np.array([c.dim for c in contacts], dtype=np.int32)
    for name in ("dist", "pos", "frame", "friction", "solref", "solimp", "includemargin"):
        row[f"contact_{name}"] = np.array([getattr(c, name) for c in contacts], dtype=float)
    row["efc_J"] = data.efc_J.reshape(-1, model.nv).copy()
    for name in ("aref", "D", "R", "pos", "margin", "force"):
        row[f"efc_{name}"] = getattr(data, f"efc_{name}").copy()
    for name in ("type", "id"):
        row[f"efc_{name}"] = getattr(data, f"efc_{name}").astype(np.int32)
    for count in range(1, 6):
        residual = max(residual, step(model, data))
        if count in (1, 5):
            prefix = "next" if count == 1 else "next5"
            row[f"{prefix}_qpos"], row[f"{prefix}_qvel"] = data.qpos.copy(), data.qvel.copy()
    return row, residual


def stack(rows, name, width):
    """States' arrays of one name in one array; ragged first axes are padded with NaN (floats) or -1 (integers)."""
    values = [np.asarray(row[name]) for row in rows]
    if not name.startswith(("contact_", "efc_")):
        return np.array(values)
    tail = next((v.shape[1:] for v in values if len(v)), ())
    whole = values[0].dtype.kind == "i"
    out = np.full((len(rows), width, *tail), -1 if whole else np.nan, dtype=np.int32 if whole else float)
    for i, value in enumerate(values):
        out[i, : len(value)] = value.reshape(len(value), *tail)
    return out


def constants(model, variant):
    """What a reader needs to set the same variant, and the model constants."""
    return {
        "timestep": model.opt.timestep,
        "cone": np.int32(model.opt.cone),
        "impratio": model.opt.impratio,
        "integrator": np.int32(variant.integrator == IMPLICITFAST),
        "eulerdamp": np.int32(variant.eulerdamp),
        "frictionloss": model.dof_frictionloss,
        "plane_pos": model.geom_pos[0],
        "plane_quat": model.geom_quat[0],
        "body_invweight0": model.body_invweight0,
        "dof_invweight0": model.dof_invweight0,
    }


def write_states(robot, variant, out):
    model = load(robot, variant)
    rng = np.random.default_rng(zlib.crc32(f"{robot}_{variant.name}".encode()))
    rows, worst, drawn = [], 0.0, 0
    for i in range(STATES):
        kind = i % len(KINDS)
        if robot == "terrain":
            data, tries = terrain_state(model, KINDS[kind], rng)
            drawn += tries
        else:
            data = random_state(model, KINDS[kind], rng)
        if i == len(KINDS) + 4:
            data.qvel[:] = 0
        row, residual = evaluate(model, data, robot in OWN)
        row["kind"] = np.int32(kind)
        rows.append(row)
        worst = max(worst, residual)
    ncon, nefc = max(r["ncon"] for r in rows), max(r["nefc"] for r in rows)
    arrays = constants(model, variant)
    for name in rows[0]:
        arrays[name] = stack(rows, name, ncon if name.startswith("contact_") else nefc)
    path = out / f"states_{robot}_{variant.name}.npz"
    np.savez_compressed(path, **arrays)
    report(path, f"{STATES} states, contacts {sum(r['ncon'] for r in rows)} (max {ncon}), rows max {nefc}"
           + f", {drawn} drawn" * (drawn > 0), worst)


def write_rollout(robot, variant, out):
    """A fall from just above the ground with constant controls."""
    model = load(robot, variant)
    rng = np.random.default_rng(zlib.crc32(f"rollout_{robot}".encode()))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] += random_ctrl(model, rng, 0.05)
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        # The rover is to roll.
        tilt = np.array([1, *rng.normal(0, 0.02 if robot == "rover" else 0.15, 3)])
        data.qpos[3:7] = tilt / np.linalg.norm(tilt)
        place(model, data, 0.01)
    data.qvel[:] = rng.normal(0, 0.2, model.nv)
    qpos, qvel, ncon, worst = [data.qpos.copy()], [data.qvel.copy()], [], 0.0
    for _ in range(ROLLOUT_STEPS):
        worst = max(worst, step(model, data))
        qpos.append(data.qpos.copy())
        qvel.append(data.qvel.copy())
        ncon.append(data.ncon)
    path = out / f"rollout_{robot}_{variant.name}.npz"
    np.savez_compressed(
        path, **constants(model, variant), qpos=qpos, qvel=qvel, ctrl=data.ctrl, ncon=np.array(ncon, dtype=np.int32)
    )
    report(path, f"{ROLLOUT_STEPS} steps, contacts at the end {ncon[-1]}", worst)


def report(path, what, worst):
    print(f"{path.name:48s} {path.stat().st_size / 1e3:6.0f} kB  {what}, inverse residual {worst:.1e}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=sorted(VARIANTS), help="one robot")
    parser.add_argument("--out", type=pathlib.Path, default=FOLDER, help="folder to write to (default: the fixtures)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for robot, variants in VARIANTS.items():
        if args.only in (None, robot):
            for variant in variants:
                write_states(robot, variant, args.out)
                if variant.name == ROLLOUTS.get(robot):
                    write_rollout(robot, variant, args.out)


if __name__ == "__main__":
    main()
