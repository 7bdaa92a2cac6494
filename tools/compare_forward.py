"""Holds `gaitfit forward` against MuJoCo C on random states of any robot both can read.

Makes the states (falls from random poses, some airborne, random controls), runs
`gaitfit forward MODEL STATES.npz OUT.npz --preset converged`, and prints for each quantity the largest difference and
the largest difference relative to the state's largest entry. Geoms meet the ground only on MuJoCo's side too, since
gaitfit has no self-collision. Balls on a height field may have more contacts in MuJoCo (docs/results/robot-files.md). With --lenient
MuJoCo's model loses what gaitfit drops: colliding meshes, height fields from files, free bodies beside the robot. Visual meshes are never read. Exit code 3 if a relative difference exceeds
the tolerance.

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

GROUND = {mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_HFIELD}
ROUND = {mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE}
QUANTITIES = ("M", "qfrc_bias", "qacc", "next_qpos", "next_qvel")


def load(path, lenient=False):
    """The file's model with ground contacts only and a solver that runs to convergence."""
    spec = mujoco.MjSpec.from_file(str(path))
    if path.suffix == ".urdf":
        complete_urdf(spec)
    if lenient:
        drop(spec)
    strip_pictures(spec)
    grounds = {geom.name for geom in grounds_of(spec)}
    for pair in list(spec.pairs):
        if not {pair.geomname1, pair.geomname2} & grounds:
            spec.delete(pair)
    ground_only(spec)
    model = spec.compile()
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.iterations, model.opt.tolerance = 200, 1e-15
    model.opt.ls_iterations, model.opt.ls_tolerance = 100, 1e-10
    return model


def grounds_of(spec):
    """Planes, boxes and height fields of bodies that nothing moves."""
    moving = set()
    for body in spec.worldbody.bodies:
        if body.find_all("joint"):
            moving |= {body.name, *(inner.name for inner in body.find_all("body"))}
    return [geom for geom in spec.geoms if geom.parent.name not in moving and geom.type in GROUND]


def ground_only(spec):
    """Leaves a geom the contacts with the ground that its bit masks allow, and no others."""
    grounds = grounds_of(spec)
    masks = [(ground.contype, ground.conaffinity) for ground in grounds]
    kinds = [ground.type for ground in grounds]
    if len(grounds) > 31:
        raise SystemExit("more than 31 things of the world may be touched; MuJoCo has 31 bits for them")
    for geom in spec.geoms:
        if not any(geom == ground for ground in grounds):
            touched = [bool(geom.contype & affinity or geom.conaffinity & bits)
                       and (kind == mujoco.mjtGeom.mjGEOM_PLANE or geom.type in ROUND)
                       for (bits, affinity), kind in zip(masks, kinds)]
            geom.contype, geom.conaffinity = 0, sum(touch << bit for bit, touch in enumerate(touched))
    for bit, ground in enumerate(grounds):
        ground.contype, ground.conaffinity = 1 << bit, 0


def strip_pictures(spec):
    """Removes what is only seen, since its files may be missing. Bodies must not get their mass from it."""
    massless = [body.name for body in spec.bodies if body != spec.worldbody and not body.explicitinertial]
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and not (geom.contype or geom.conaffinity):
            if geom.parent.name in massless:
                raise SystemExit(f"body {geom.parent.name} gets its mass from a mesh; give it an <inertial>")
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
    for geom in spec.geoms:
        geom.material = ""
    for material in list(spec.materials):
        spec.delete(material)
    for texture in list(spec.textures):
        spec.delete(texture)


def drop(spec):
    """Removes what gaitfit drops when it reads leniently."""
    solids = {mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER,
              mujoco.mjtGeom.mjGEOM_BOX}
    robot, *others = [body for body in spec.worldbody.bodies if body.find_all("joint")]
    gone = [joint for joint in robot.find_all("joint") if joint.type == mujoco.mjtJoint.mjJNT_BALL]
    names = {joint.name for joint in [*gone, *(joint for body in others for joint in body.find_all("joint"))]}
    unused = [*spec.equalities, *spec.sensors, *(actuator for actuator in spec.actuators if actuator.target in names)]
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            joint.frictionloss, joint.armature = 0, 0
            joint.damping, joint.stiffness = np.zeros_like(joint.damping), np.zeros_like(joint.stiffness)
    for one in [*unused, *(spec.keys if names else []), *gone, *others]:
        spec.delete(one)
    moving = {robot.name, *(body.name for body in robot.find_all("body"))}
    for geom in list(spec.geoms):
        collides = geom.type in (solids if geom.parent.name in moving else GROUND)
        if not collides:
            geom.contype = geom.conaffinity = 0
        if geom.type == mujoco.mjtGeom.mjGEOM_HFIELD and spec.hfield(geom.hfieldname).file:
            spec.delete(geom)
    for field in [field for field in spec.hfields if field.file]:
        spec.delete(field)


def complete_urdf(spec):
    """Adds what a URDF leaves to its reader: the base floats above a floor, and each joint has a motor of the effort it
    states. Inertias that cannot be are mended as gaitfit mends them: each moment becomes the mean."""
    # Fused links would share the softness of their contacts.
    spec.compiler.fusestatic = False
    spec.worldbody.bodies[0].add_freejoint()
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for body in spec.bodies:
        if body.explicitinertial and not np.isnan(body.fullinertia[0]):
            xx, yy, zz, xy, xz, yz = body.fullinertia
            low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            if low < 0 or low + middle < high:
                body.inertia = np.full(3, np.maximum([low, middle, high], 0).sum() / 3)
                body.fullinertia = np.full(6, np.nan)
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
                              ctrllimited=bool(joint.actfrcrange.any()), ctrlrange=joint.actfrcrange)


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


def comparable(model, states):
    """The states without those in which MuJoCo gives a geom several contacts with one height field, as it does at the edges
    of its triangles, or one that is as deep as its radius. The engine has one contact for each ball."""
    kept = []
    for index, qpos in enumerate(states["qpos"] if model.nhfield else ()):
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        on_field = [c for c in data.contact if model.geom_type[c.geom[0]] == mujoco.mjtGeom.mjGEOM_HFIELD]
        once = len({tuple(c.geom) for c in on_field}) == len(on_field)
        kept += [index] if once and all(c.dist > -model.geom_size[c.geom[1], 0] for c in on_field) else []
    return {name: values[kept] for name, values in states.items()} if model.nhfield else states


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


def run(path, states, gaitfit="gaitfit", preset="converged", lenient=False, keep=None, stderr=None):
    """gaitfit's quantities at the states."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = keep or pathlib.Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(folder / "states.npz", **states)
        command = [gaitfit, "forward", path, folder / "states.npz", folder / "out.npz", "--preset", preset]
        command += ["--lenient"] * lenient
        subprocess.run([str(word) for word in command], check=True, stderr=stderr)
        with np.load(folder / "out.npz") as found:
            return {name: found[name] for name in QUANTITIES}


def differences(found, expected):
    """Per quantity the largest difference, the largest relative to its state's largest entry, and that state."""
    out = {}
    for name in QUANTITIES:
        if found[name].shape != expected[name].shape:
            raise SystemExit(f"{name}: gaitfit's shape {found[name].shape}, MuJoCo's {expected[name].shape}")
        axes = tuple(range(1, expected[name].ndim))
        difference = np.abs(found[name] - expected[name]).max(axis=axes)
        # NaN is the worst difference of all.
        difference = np.where(np.isnan(difference), np.inf, difference)
        relative = difference / np.abs(expected[name]).max(axis=axes)
        worst = int(relative.argmax())
        out[name] = difference.max(), relative[worst], worst
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=pathlib.Path, help="robot in MJCF")
    parser.add_argument("--gaitfit", default="gaitfit", help="gaitfit program (default: the one in PATH)")
    parser.add_argument("--preset", default="converged", help="solver preset of gaitfit")
    parser.add_argument("--states", type=int, default=100, help="how many states to make")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tolerance", type=float, default=1e-6, help="largest relative difference that passes")
    parser.add_argument("--lenient", action="store_true", help="read leniently: drop what the engine does not honour")
    parser.add_argument("--keep", type=pathlib.Path, help="folder to leave states.npz and out.npz in")
    args = parser.parse_args()

    model = load(args.model, args.lenient)
    states = comparable(model, make_states(model, args.states, args.seed))
    expected, contacts, residual = reference(model, states)
    print(f"{args.model.name}: {len(contacts)} states, {contacts.mean():.1f} contacts on average (max {contacts.max()}), "
          f"MuJoCo's inverse residual {residual:.1e}")
    found = run(args.model, states, args.gaitfit, args.preset, args.lenient, args.keep)

    failed = False
    print(f"{'quantity':10s} {'max |diff|':>11s} {'relative':>10s}  worst state (contacts)")
    for name, (difference, relative, worst) in differences(found, expected).items():
        failed |= not relative <= args.tolerance
        print(f"{name:10s} {difference:11.2e} {relative:10.2e}  {worst} ({contacts[worst]})")
    if failed:
        print(f"above the tolerance of {args.tolerance:g}", file=sys.stderr)
        sys.exit(3)


if __name__ == "__main__":
    main()
