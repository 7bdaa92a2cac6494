"""Measures MuJoCo C on a trotting Go2, one thread, and sets gaitfit's `bench physics` beside it.

MuJoCo steps in C (mujoco.rollout, one MjData, no Python in the loop). Same conditions as gaitfit's benchmark: PD trot,
pyramidal cone, 5 ms Euler steps, friction loss on, geoms against the ground only, the feet alone or every geom.
MuJoCo's solver settings are its defaults unless given. Its time is CPU time, so that other programs on the core do
not make it look slow; gaitfit states wall time, so a busy machine lowers the ratio. Both
programs run pinned to one core where the system can.

Usage: .venv/bin/python tools/bench_mujoco.py [--gaitfit target/release/gaitfit] [--json result.json ...]
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import time

import mujoco
import numpy as np
from mujoco import rollout

ROOT = pathlib.Path(__file__).parent.parent
# With softer gains the open-loop trot sags and tips over.
KP, KD = 40.0, 1.0
# Steps before a robot starts afresh: an open-loop trot drifts and falls in the end.
EPISODE_STEPS = 400


def trotter(path, geoms, frictionloss, iterations):
    """The compiled Go2: geoms meet the plane only, and its motors are PD position servos with their torque limits."""
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in spec.geoms:
        ground = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
        foot = geom.type == mujoco.mjtGeom.mjGEOM_SPHERE and geom.parent.name.endswith(("calf", "foot"))
        collides = (geom.contype or geom.conaffinity) and (foot or geoms == "all")
        geom.contype, geom.conaffinity = (1, 0) if ground else (0, int(collides))
    for actuator in spec.actuators:
        limits = actuator.forcerange if actuator.forcerange[1] > 0 else actuator.ctrlrange
        actuator.forcerange, actuator.forcelimited = limits.copy(), True
        actuator.ctrllimited = False
        actuator.gainprm[0] = KP
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm[:3] = 0, -KP, -KD
    model = spec.compile()
    model.dof_frictionloss[6:] = frictionloss
    model.opt.timestep, model.opt.impratio = 0.005, 1
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.iterations, model.opt.tolerance, model.opt.ls_iterations = iterations, 1e-8, 50
    return model


def trot(model, steps):
    """Position targets of a 2 Hz trot in place, (steps, 12): diagonal legs lift in turn, targets held for 20 ms."""
    names = [model.joint(model.actuator_trnid[a, 0]).name.removesuffix("_joint") for a in range(model.nu)]
    time_s = 0.02 * (np.arange(steps) // 4)
    out = np.empty((steps, model.nu))
    for a, name in enumerate(names):
        leg, kind = name.rsplit("_", 1)
        lift = np.maximum(0, np.sin(2 * np.pi * (2.0 * time_s + (0 if leg in ("FL", "RR") else 0.5))))
        rest = {"hip": 0.1 if leg[1] == "L" else -0.1, "thigh": 0.9, "calf": -1.6}[kind]
        out[:, a] = rest + {"hip": 0.0, "thigh": 0.25, "calf": -0.5}[kind] * lift
    return out


def measure(model, episodes, repeats):
    """Substeps a second of each repeat, the mean contact count and whether the robot stayed on its feet."""
    data = mujoco.MjData(model)
    control = trot(model, EPISODE_STEPS)
    data.qpos[2] = 0.32
    data.qpos[7:] = control[0]
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, initial, spec)
    initial = np.tile(initial, (episodes, 1))
    # Small differences between episodes: base velocity.
    initial[:, 1 + model.nq : 1 + model.nq + 3] = np.random.default_rng(0).normal(0, 0.1, (episodes, 3))
    state = np.empty((episodes, EPISODE_STEPS, initial.shape[1]))
    rates = []
    for _ in range(repeats + 1):
        begin = time.process_time()
        rollout.rollout(model, data, initial, control[None], state=state)
        rates.append(episodes * EPISODE_STEPS / (time.process_time() - begin))
    contacts = []
    for row in state.reshape(-1, state.shape[2])[::97]:
        mujoco.mj_setState(model, data, row, spec)
        mujoco.mj_forward(model, data)
        contacts.append(data.ncon)
    # The first rollout warms caches up. Column 3 is the base height: time, then qpos.
    return rates[1:], statistics.mean(contacts), state[..., 3].min() > 0.15


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=pathlib.Path, default=ROOT / "assets" / "go2.xml", help="the Go2 in MJCF")
    parser.add_argument("--geoms", choices=["feet", "all", "both"], default="both")
    parser.add_argument("--episodes", type=int, default=50, help=f"episodes of {EPISODE_STEPS} steps in one measurement")
    parser.add_argument("--repeats", type=int, default=7, help="measurements; the median counts")
    parser.add_argument("--frictionloss", type=float, default=0.2, help="N m, every joint")
    parser.add_argument("--iterations", type=int, default=100, help="MuJoCo's Newton iterations (its default: 100)")
    parser.add_argument("--core", type=int, help="CPU core to pin to (default: the first one allowed)")
    parser.add_argument("--gaitfit", type=pathlib.Path, help="gaitfit program to run")
    parser.add_argument("--presets", nargs="+", default=["fast", "accurate"], help="presets to run it with")
    parser.add_argument("--json", type=pathlib.Path, nargs="+", default=[], help="saved `gaitfit bench physics --json`")
    args = parser.parse_args()

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0)) if args.core is None else args.core})
    wanted = ["feet", "all"] if args.geoms == "both" else [args.geoms]
    reference = {}
    for geoms in wanted:
        model = trotter(args.model, geoms, args.frictionloss, args.iterations)
        rates, contacts, upright = measure(model, args.episodes, args.repeats)
        reference[geoms] = statistics.median(rates)
        print(f"mujoco {mujoco.__version__}  {geoms:4s}  {reference[geoms] / 1e6:.3f} M substeps/s "
              f"(median of {len(rates)}, {min(rates) / 1e6:.3f} to {max(rates) / 1e6:.3f}; "
              f"{contacts:.1f} contacts, {'upright' if upright else 'FELL: not the trot this should measure'})")

    results = [json.loads(path.read_text()) for path in args.json]
    if args.gaitfit:
        for geoms in wanted:
            for preset in args.presets:
                command = [str(args.gaitfit), "bench", "physics", "--preset", preset, "--geoms", geoms, "--threads", "1", "--json"]
                results.append(json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout))
    for result in results:
        rate, threads, geoms = result["substeps_per_second"], result["threads"], result["geoms"]
        if geoms not in reference:
            raise SystemExit(f"no MuJoCo measurement for --geoms {geoms}; run with --geoms both")
        note = "" if threads == 1 else f"  ({threads} threads against one)"
        print(f"gaitfit       {geoms:4s}  {rate / 1e6:.3f} M substeps/s, {result['preset']}, lanes {result['lanes']}: "
              f"{rate / reference[geoms]:.0f} times MuJoCo{note}")


if __name__ == "__main__":
    main()
