"""Walks an exported ONNX policy in official MuJoCo and reports falls and tracking errors.

Everything about the policy (joints, pose, gains, observation) is read from the ONNX file's `gaitfit` metadata, the network
runs in onnxruntime, and nothing of gaitfit takes part. The robot starts in the policy's default pose, just above the
ground, under a random command that it keeps. At every physics step torque = kp (target - q) - kd dq, clipped at the
motors' limits; the policy acts every control period.

A fall: one of --fall-geoms touches the ground, the base tilts by more than --tilt, or sinks below --lowest. Errors are means
over a trajectory (until a fall) of |v_xy - command_xy|, m/s, in the base's heading frame, and |yaw rate - command|, rad/s,
about the body's z axis, once a control period; reported as mean and 95 % confidence interval over trajectories.

Usage: .venv/bin/python tools/walk_mujoco.py policy.onnx [--timestep 0.001] [--trajectories 200] [--json]
"""

import argparse
import json
import math
import multiprocessing
import pathlib

import mujoco
import numpy as np
import onnxruntime

ROOT = pathlib.Path(__file__).parent.parent
DIVERGED = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC]


def bare(name):
    return name.removesuffix("_joint")


class Robot:
    """A MuJoCo model, and where the policy's joints lie in it."""

    def __init__(self, args, interface):
        spec = mujoco.MjSpec.from_file(str(args.model))
        if spec.modelname != interface["robot"]:
            raise SystemExit(f"the policy is for robot {interface['robot']}, {args.model} is {spec.modelname}")
        if args.ground_only:
            # Geoms that touch nothing in the file stay so.
            for geom in spec.geoms:
                ground = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
                geom.contype, geom.conaffinity = (1, 0) if ground else (0, int(bool(geom.contype or geom.conaffinity)))
        self.model = model = spec.compile()
        model.opt.timestep = args.timestep
        if args.friction is not None:
            model.geom_friction[:, 0] = args.friction
        joints = {bare(model.joint(j).name): j for j in range(model.njnt)}
        missing = [name for name in interface["joints"] if bare(name) not in joints]
        if missing:
            raise SystemExit(f"{args.model} has no joint {missing[0]}")
        ids = [joints[bare(name)] for name in interface["joints"]]
        self.position, self.velocity = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
        motors = {int(model.actuator_trnid[a, 0]): a for a in range(model.nu)}
        self.motors = np.array([motors[j] for j in ids])
        self.torque_limit = model.actuator_ctrlrange[self.motors]
        self.floor = next(g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE)
        self.fall_geoms = {model.geom(name).id for name in args.fall_geoms}
        self.solid = [g for g in range(model.ngeom) if g != self.floor and model.geom_conaffinity[g]]

    def start(self, interface, height, clearance, rng, joint_noise):
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.model.qpos0
        data.qpos[:7] = 0, 0, 1, 1, 0, 0, 0
        pose = np.array(interface["default_pose"])
        data.qpos[self.position] = pose + rng.uniform(-joint_noise, joint_noise, len(pose))
        mujoco.mj_kinematics(self.model, data)
        gaps = [mujoco.mj_geomDistance(self.model, data, self.floor, g, 5.0, None) for g in self.solid]
        data.qpos[2] = height if height is not None else 1 - min(gaps) + clearance
        mujoco.mj_forward(self.model, data)
        return data

    def fallen(self, data, args):
        upright = data.xmat[1].reshape(3, 3)[2, 2]
        if data.qpos[2] < args.lowest or upright < math.cos(math.radians(args.tilt)):
            return True
        for geoms, distance in zip(data.contact.geom, data.contact.dist):
            if self.floor in geoms and distance <= 0 and self.fall_geoms.intersection(geoms.tolist()):
                return True
        return False


def observe(robot, interface, data, command, last_action, time):
    """One row: the interface's terms, scaled."""
    rotation = data.xmat[1].reshape(3, 3)
    phase = 2 * math.pi * time * (interface.get("gait_frequency") or 0.0)
    quantities = {
        "base_angular_velocity": lambda: data.qvel[3:6],
        "projected_gravity": lambda: -rotation[2],
        "command": lambda: command,
        "joint_position": lambda: data.qpos[robot.position] - interface["default_pose"],
        "joint_velocity": lambda: data.qvel[robot.velocity],
        "last_action": lambda: last_action,
        "base_linear_velocity": lambda: rotation.T @ data.qvel[:3],
        "gait_phase": lambda: (math.sin(phase), math.cos(phase)),
    }
    parts = [np.asarray(quantities[term["quantity"]]()) * np.array(term.get("scale") or [1.0]) for term in interface["observation"]]
    return np.concatenate(parts).astype(np.float32)


def walk(job):
    """Trajectories of given commands, in lock step so that the network runs once a period. One result a trajectory."""
    args, commands, numbers = job
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(args.policy), options, providers=["CPUExecutionProvider"])
    interface = json.loads(session.get_modelmeta().custom_metadata_map["gaitfit"])["interface"]
    given, gives = session.get_inputs()[0].name, session.get_outputs()[0].name
    robot = Robot(args, interface)
    pose, scale = np.array(interface["default_pose"]), np.array(interface["action_scale"])
    kp, kd, clip = np.array(interface["kp"]), np.array(interface["kd"]), interface.get("action_clip") or math.inf
    dt = interface["control_dt"]
    substeps = round(dt / args.timestep)
    if abs(substeps * args.timestep - dt) > 1e-9:
        raise SystemExit(f"the control period {dt} s is no multiple of the timestep {args.timestep} s")
    generators = [np.random.default_rng([args.seed, 1, number]) for number in numbers]
    robots = [robot.start(interface, args.height, args.clearance, rng, args.joint_noise) for rng in generators]
    actions = np.zeros((len(commands), len(pose)))
    errors, rates, falls = [[] for _ in robots], [[] for _ in robots], np.zeros(len(robots), bool)
    for step in range(round(args.seconds / dt)):
        time = step * dt
        rows = [observe(robot, interface, *each, time) for each in zip(robots, commands, actions)]
        chosen = session.run([gives], {given: np.stack(rows)})[0].astype(float)
        for index, data in enumerate(robots):
            if falls[index]:
                continue
            target = pose + scale * np.clip(chosen[index], -clip, clip)
            for _ in range(substeps):
                torque = kp * (target - data.qpos[robot.position]) - kd * data.qvel[robot.velocity]
                data.ctrl[robot.motors] = np.clip(torque, robot.torque_limit[:, 0], robot.torque_limit[:, 1])
                mujoco.mj_step(robot.model, data)
            mujoco.mj_fwdPosition(robot.model, data)
            diverged = any(data.warning[kind].number for kind in DIVERGED)
            falls[index] = diverged or robot.fallen(data, args)
            # MuJoCo resets a simulation that diverges: its velocities mean nothing then.
            if time + dt > args.skip and not diverged:
                forward = data.xmat[1].reshape(3, 3)[:2, 0]
                forward = forward / np.linalg.norm(forward)
                velocity = np.array([forward @ data.qvel[:2], forward[0] * data.qvel[1] - forward[1] * data.qvel[0]])
                command = commands[index]
                errors[index].append((np.linalg.norm(velocity - command[:2]), abs(data.qvel[5] - command[2])))
                rates[index].append(np.abs(chosen[index] - actions[index]).mean())
        actions = chosen
    mean = lambda values: np.mean(values, axis=0).tolist() if values else None
    return [(bool(fall), mean(error), mean(rate)) for fall, error, rate in zip(falls, errors, rates)]


def estimate(values):
    values = np.asarray(values, float)
    spread = 1.96 * values.std(ddof=1) / math.sqrt(len(values)) if len(values) > 1 else None
    return {"mean": float(values.mean()), "ci95": spread and float(spread)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=pathlib.Path, help="ONNX file written by gaitfit")
    parser.add_argument("--model", type=pathlib.Path, default=ROOT / "assets/go2.xml")
    parser.add_argument("--timestep", type=float, default=0.005, help="physics step, s [0.005]")
    parser.add_argument("--trajectories", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--skip", type=float, default=0.0, help="seconds at the start that do not count [0]")
    parser.add_argument("--command", type=float, nargs=3, default=[1, 1, 1], metavar=("X", "Y", "YAW"),
                        help="half ranges, m/s, m/s, rad/s [1 1 1]")
    parser.add_argument("--fixed", action="store_true", help="the command is exactly --command instead of random")
    parser.add_argument("--height", type=float, help="base height at the start, m [so that the feet just touch]")
    parser.add_argument("--clearance", type=float, default=0.002, help="gap below the feet at the start, m [0.002]")
    parser.add_argument("--joint-noise", type=float, default=0.0, help="half range of the starting joint angles, rad [0]")
    parser.add_argument("--fall-geoms", nargs="*", default=["trunk", "head", "chin"])
    parser.add_argument("--tilt", type=float, default=60.0, help="degrees [60]")
    parser.add_argument("--lowest", type=float, default=0.15, help="base height, m [0.15]")
    parser.add_argument("--friction", type=float, help="sliding friction of every geom [the file's]")
    parser.add_argument("--ground-only", action="store_true", help="no contacts between parts of the robot")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()

    half = np.array(args.command)
    draws = np.random.default_rng([args.seed, 0]).uniform(-half, half, (args.trajectories, 3))
    commands = np.tile(half, (args.trajectories, 1)) if args.fixed else draws
    # Small groups keep the processes evenly busy; what a trajectory gives does not depend on its group.
    groups = np.array_split(np.arange(args.trajectories), min(args.trajectories, 4 * args.processes))
    jobs = [(args, commands[group], group.tolist()) for group in groups]
    with multiprocessing.get_context("spawn").Pool(args.processes) as pool:
        results = [result for group in pool.map(walk, jobs, chunksize=1) for result in group]
    falls, errors, rates = zip(*results)
    errors = np.array([error for error in errors if error is not None])
    if not len(errors):
        raise SystemExit("no trajectory lasted beyond --skip")
    report = {
        "trajectories": args.trajectories,
        "seconds": args.seconds,
        "timestep": args.timestep,
        "mujoco": mujoco.__version__,
        "linear_velocity_error": estimate(errors[:, 0]),
        "angular_velocity_error": estimate(errors[:, 1]),
        "fall_rate": estimate(falls),
        "action_rate": estimate([rate for rate in rates if rate is not None]),
    }
    if args.json:
        print(json.dumps(report, indent=2))
        return
    print(f"{args.policy} in MuJoCo {mujoco.__version__}, {args.timestep} s: {args.trajectories} × {args.seconds} s")
    for name, unit in (
        ("linear_velocity_error", "m/s"),
        ("angular_velocity_error", "rad/s"),
        ("fall_rate", ""),
        ("action_rate", "mean |change| a control period"),
    ):
        print(f"{name:24} {report[name]['mean']:.4f} ± {report[name]['ci95'] or 0.0:.4f} {unit}")


if __name__ == "__main__":
    main()
