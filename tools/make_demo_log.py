"""Makes the example logs in examples/go2-demo: a Go2 in the air whose joint parameters are known.

The base is clamped, contacts are off, physics is MuJoCo at 4 kHz with the PD evaluated at every step, as on motor boards, from
targets that arrive DELAY late; joints are logged at 200 Hz with encoder noise. fit.csv and validate.csv have
different commands and different gains; truth.toml has the parameters. Seeded: the same packages give the same bytes.

Usage: .venv/bin/python tools/make_demo_log.py [--model assets/go2.xml] [--out FOLDER]
"""

import argparse
import math
import pathlib

import mujoco
import numpy as np

ROOT = pathlib.Path(__file__).parent.parent
KINDS = ("hip", "thigh", "calf")
JOINTS = [f"{leg}_{kind}" for leg in ("FL", "FR", "RL", "RR") for kind in KINDS]
PHYSICS_DT, LOG_EVERY = 0.00025, 20
SETTLE = 2.0

# The altered robot: by joint kind, SI units. The delay is on the position target.
TRUTH = {
    "frictionloss": {"hip": 0.21, "thigh": 0.17, "calf": 0.62},
    "armature": {"hip": 0.015, "thigh": 0.019, "calf": 0.047},
    "damping": {"hip": 0.19, "thigh": 0.22, "calf": 0.31},
}
DELAY = 0.007
POSITION_NOISE, VELOCITY_NOISE = 3e-4, 0.01
EFFORT = {"hip": 23.7, "thigh": 23.7, "calf": 45.43}
# Centre of the commanded motion and amplitudes of its triangle and its chirp, rad.
CENTRE = {"hip": 0.0, "thigh": 0.95, "calf": -1.75}
TRIANGLE = {"hip": 0.40, "thigh": 0.55, "calf": 0.40}
CHIRP = {"hip": 0.15, "thigh": 0.20, "calf": 0.20}

LOGS = {
    "fit": dict(seed=1, seconds=9.0, kp={"hip": 20, "thigh": 20, "calf": 40}, kd={"hip": 1, "thigh": 1, "calf": 2}),
    "validate": dict(
        seed=2, seconds=8.0, kp={"hip": 30, "thigh": 30, "calf": 50}, kd={"hip": 0.8, "thigh": 0.8, "calf": 1.5}
    ),
}


def kind(joint):
    return joint.rsplit("_", 1)[1]


def robot(path):
    """The model with its base welded to the world, contacts off, and the true joint parameters."""
    spec = mujoco.MjSpec.from_file(str(path))
    for joint in list(spec.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
    for key in list(spec.keys):
        spec.delete(key)
    model = spec.compile()
    names = [model.joint(j).name.removesuffix("_joint") for j in range(model.njnt)]
    if names != JOINTS:
        raise SystemExit(f"{path}: joints are {names}, expected {JOINTS}")
    for parameter, by_kind in TRUTH.items():
        getattr(model, f"dof_{parameter}")[:] = [by_kind[kind(joint)] for joint in JOINTS]
    model.opt.timestep = PHYSICS_DT
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = 50, 50, 1e-12
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    # The inverse weights behind the softness of friction loss depend on armature.
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def command(rng, seconds):
    """Position targets at the log rate, (samples, joints): a slow triangle plus a chirp on each joint."""
    samples = round(seconds / (PHYSICS_DT * LOG_EVERY))
    targets = np.empty((samples, len(JOINTS)))
    for j, joint in enumerate(JOINTS):
        period, phase = rng.uniform(1.6, 3.2), rng.uniform()
        top, offset = rng.uniform(3.0, 5.0), rng.uniform(0, 2 * math.pi)
        for i in range(samples):
            t = i * PHYSICS_DT * LOG_EVERY
            sawtooth = (t / period + phase) % 1
            triangle = 4 * abs(sawtooth - 0.5) - 1
            # Frequency rises linearly from 0.3 Hz to `top` over the log.
            chirp = math.sin(offset + 2 * math.pi * (0.3 * t + 0.5 * (top - 0.3) * t * t / seconds))
            targets[i, j] = CENTRE[kind(joint)] + TRIANGLE[kind(joint)] * triangle + CHIRP[kind(joint)] * chirp
    # What is logged is what is sent.
    return np.round(targets, 5)


def simulate(model, targets, kp, kd):
    """True positions and velocities at each sample. The robot has settled on the first target before sample 0."""
    kp, kd, effort = (np.array([by[kind(joint)] for joint in JOINTS], dtype=float) for by in (kp, kd, EFFORT))
    data = mujoco.MjData(model)
    data.qpos[:] = targets[0]
    late = round(DELAY / PHYSICS_DT)
    positions, velocities = [], []
    for tick in range(-round(SETTLE / PHYSICS_DT), len(targets) * LOG_EVERY):
        if tick >= 0 and tick % LOG_EVERY == 0:
            positions.append(data.qpos.copy())
            velocities.append(data.qvel.copy())
        target = targets[max(tick - late, 0) // LOG_EVERY]
        data.qfrc_applied[:] = np.clip(kp * (target - data.qpos) - kd * data.qvel, -effort, effort)
        mujoco.mj_step(model, data)
    return np.array(positions), np.array(velocities)


def write_log(path, model, seed, seconds, kp, kd):
    rng = np.random.default_rng(seed)
    targets = command(rng, seconds)
    positions, velocities = simulate(model, targets, kp, kd)
    low, high = model.jnt_range.T
    room = min((positions - low).min(), (high - positions).min())
    if room < 0.05:
        raise SystemExit(f"{path.name}: a joint comes within {room:.3f} rad of its limit; the example must stay clear")
    rms = np.sqrt(np.mean((positions - targets) ** 2))
    positions = positions + rng.normal(0, POSITION_NOISE, positions.shape)
    velocities = velocities + rng.normal(0, VELOCITY_NOISE, velocities.shape)

    def gains(by_kind):
        return "{ " + ", ".join(f'"*_{k}" = {v}' for k, v in by_kind.items()) + " }"

    columns = ["time"] + [f"{signal}_{joint}" for signal in ("q", "dq", "qdes") for joint in JOINTS]
    with path.open("w", newline="\n") as file:
        file.write("# A simulated Go2, base clamped, legs in the air. Made by tools/make_demo_log.py; truth in truth.toml\n")
        file.write(f'# robot = "go2"\n# rate_hz = 200\n# kp = {gains(kp)}\n# kd = {gains(kd)}\n')
        file.write(",".join(columns) + "\n")
        for i, (q, dq, target) in enumerate(zip(positions, velocities, targets)):
            fields = [f"{i * PHYSICS_DT * LOG_EVERY:.3f}"]
            fields += [f"{v:.5f}" for v in q] + [f"{v:.4f}" for v in dq] + [f"{v:.5f}" for v in target]
            file.write(",".join(fields) + "\n")
    print(f"{path.name}: {len(targets)} rows, {path.stat().st_size / 1e3:.0f} kB, "
          f"RMS target minus position {rms:.4f} rad, nearest limit {room:.2f} rad")


def write_truth(path):
    lines = ["# The parameters behind fit.csv and validate.csv, by joint kind. Made by tools/make_demo_log.py.",
             f"delay = {DELAY}  # s, on the position target, which is held between samples",
             f"position_noise = {POSITION_NOISE}  # rad, standard deviation of q_*",
             f"velocity_noise = {VELOCITY_NOISE}  # rad/s, standard deviation of dq_*",
             "encoder_bias = 0.0  # rad", "torque_scale = 1.0"]
    units = {"frictionloss": "N·m", "armature": "kg·m²", "damping": "N·m·s/rad"}
    for parameter, by_kind in TRUTH.items():
        lines += ["", f"[{parameter}]  # {units[parameter]}"]
        lines += [f'"*_{k}" = {value}' for k, value in by_kind.items()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=pathlib.Path, help="a Go2 in MJCF (default: assets/go2.xml)")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "examples" / "go2-demo")
    args = parser.parse_args()
    model = robot(args.model or ROOT / "assets" / "go2.xml")
    args.out.mkdir(parents=True, exist_ok=True)
    for name, settings in LOGS.items():
        write_log(args.out / f"{name}.csv", model, **settings)
    write_truth(args.out / "truth.toml")


if __name__ == "__main__":
    main()
