"""A robot that is not gaitfit's: a policy on an altered Go2 in official MuJoCo, recorded and measured like a real one.

`collect` writes logs of joint signals and commands, nothing of the base, in gaitfit's log format (one CSV a trajectory, gains in
log.toml). `evaluate` measures what `gaitfit evaluate` measures, the reward and the gait left out. What differs from the model
file stands in a TOML (examples/go2-ground/robot.toml); without --robot the robot is the file's, at a physics step of 1 ms.

Usage: .venv/bin/python tools/mujoco_robot.py collect --policy policy.onnx --robot robot.toml --out FOLDER [--trajectories 64]
       .venv/bin/python tools/mujoco_robot.py evaluate --policy policy.onnx --robot robot.toml [--trajectories 500] [--json]
"""

import argparse
import dataclasses
import difflib
import json
import math
import pathlib
import sys
import time
import tomllib

import mujoco
import numpy as np

from mujoco_effects import Effects
from mujoco_sim import (
    COMMAND, LOG_SHIFT, Group, Policy, Refused, World, check, estimate, groups, parallel, random_commands, share, show,
    stream, trials,
)

TIMESTEP = 0.001
# Drift trials: time of standing before and after a command, and of the command, s.
STAND, HOLD = 1.0, 4.0
KEYS = {"model": str, "timestep": float, "delay": float, "torque_noise": float, "strength": float, "friction": float,
        "frictionloss": dict, "armature": dict, "damping": dict, "spring": list, "payload": dict, "effects": dict}
PAYLOAD = {"mass": float, "x": float, "y": float, "z": float}
EFFECT_TABLES = ("backlash", "elasticity", "load_friction", "stiction")
EFFECT_LISTS = ("imu_tilt", "gyro_bias")
SPRING = {"joint": str, "stiffness": float, "angle": float}


def typed(table, kinds, where):
    """Refuses unknown keys and wrong types; whole numbers pass as numbers."""
    for key, value in table.items():
        if key not in kinds:
            near = difflib.get_close_matches(key, kinds, 1)
            meant = f"; did you mean `{near[0]}`?" if near else "."
            raise Refused(f"{where}: unknown key `{key}`{meant} Known keys: {', '.join(kinds)}")
        number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        if not (number if kinds[key] is float else isinstance(value, kinds[key])):
            expected = {float: "a number", str: "a text", dict: "a table", list: "a list of tables"}[kinds[key]]
            raise Refused(f"{where}: `{key}` must be {expected}")
    return table


def read_robot(policy, path, seed):
    """The world that a robot file describes."""
    if path is None:
        return World(policy, timestep=TIMESTEP, seed=seed)
    try:
        table = typed(tomllib.loads(path.read_text(encoding="utf-8")), KEYS, path)
    except (OSError, ValueError) as error:
        raise Refused(f"{path}: {error}") from None
    for name in ("frictionloss", "armature", "damping"):
        typed(table.get(name, {}), dict.fromkeys(table.get(name, {}), float), f"{path}: [{name}]")
        for pattern, value in table.get(name, {}).items():
            if value < 0:
                raise Refused(f"{path}: {name} of {pattern} is {value}; it cannot be negative")
    springs = []
    for spring in table.get("spring", []):
        if not isinstance(spring, dict) or set(typed(spring, SPRING, f"{path}: [[spring]]")) != set(SPRING):
            raise Refused(f"{path}: each [[spring]] needs {', '.join(SPRING)}")
        if spring["stiffness"] < 0:
            raise Refused(f"{path}: a spring's stiffness is {spring['stiffness']}; it cannot be negative")
        springs.append((spring["joint"], spring["stiffness"], spring["angle"]))
    rest = {key: value for key, value in table.items() if key not in ("model", "spring", "payload", "effects")}
    kinds = {field.name: (dict if field.name in EFFECT_TABLES else list if field.name in EFFECT_LISTS else float)
             for field in dataclasses.fields(Effects)}
    rest["effects"] = Effects(**typed(table.get("effects", {}), kinds, f"{path}: [effects]"))
    if why := rest["effects"].check():
        raise Refused(f"{path}: [effects]: {why}")
    if payload := typed(table.get("payload", {}), PAYLOAD, f"{path}: [payload]"):
        if not payload.get("mass", 0.0) > 0:
            raise Refused(f"{path}: [payload] needs a mass above 0, kg, and its place in the base's frame: x, y, z, m")
        rest["payload"] = tuple(payload.get(key, 0.0) for key in PAYLOAD)
    if not 0 <= table.get("friction", 0.0) <= 100:
        raise Refused(f"{path}: friction is {table['friction']}; it must lie between 0 and 100")
    model = {"model": path.parent / table["model"]} if "model" in table else {}
    return World(policy, springs=tuple(springs), seed=seed, **({"timestep": TIMESTEP} | model | rest))


IMU = ["base_quat_w", "base_quat_x", "base_quat_y", "base_quat_z", "wx", "wy", "wz"]
PLACE = [f"base_{what}_{axis}" for what in ("pos", "vel") for axis in "xyz"]
# What a log says of the base: columns and their values.
BASE = {
    "none": ([], lambda data, feelings: []),
    "imu": (IMU, lambda data, feelings: feelings.imu(data)),
    "all": (IMU + PLACE, lambda data, feelings: np.concatenate([feelings.imu(data), data.qpos[:3], data.qvel[:3]])),
}


def draw_command(task, rng):
    """A command as the task draws it, standing included."""
    low, high = np.array([task[axis] for axis in ("x", "y", "yaw")]).T
    command = rng.uniform(low, high)
    return np.zeros(3) if rng.uniform() < task["standing"] else command


def read_commands(path):
    """Command sequences by number: rows of time, s, and command, m/s, m/s, rad/s, which holds until the next row's time."""
    try:
        rows = np.genfromtxt(path, delimiter=",", names=True, comments="#", ndmin=1)
        table = np.stack([rows[name] for name in ("trajectory", "time", "vx_cmd", "vy_cmd", "wz_cmd")], axis=1)
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise Refused(f"{path}: no file of commands (trajectory, time, vx_cmd, vy_cmd, wz_cmd): {error}") from None
    if not np.isfinite(table).all():
        raise Refused(f"{path}: a value is no number")
    sequences = [table[table[:, 0] == number, 1:] for number in range(len(np.unique(table[:, 0])))]
    for number, sequence in enumerate(sequences):
        if not len(sequence) or sequence[0, 0] != 0 or (np.diff(sequence[:, 0]) <= 0).any():
            raise Refused(f"{path}: sequence {number} must begin at time 0, and times must rise")
    return sequences


def now(sequence, seconds):
    """The command of a sequence at a time; the last one holds to the end."""
    return sequence[np.searchsorted(sequence[:, 0], seconds + 1e-9, side="right") - 1, 1:]


def record(job):
    """Logs of some trajectories: {rows, fell}. A row holds position and velocity as the policy saw them, the command, and
    the target and action that followed."""
    world, numbers, seconds, shift, base, played = job
    group = Group(world, numbers)
    policy, robot = group.policy, group.robot
    steps, hold = round(seconds / policy.dt), max(1, round(policy.command["seconds"] / policy.dt))
    # The log begins some control periods after the robot does.
    begins = [round(stream(world.seed, LOG_SHIFT, number).uniform(*shift) / policy.dt) for number in numbers]
    draws = [stream(world.seed, COMMAND, number) for number in numbers]
    commands, logs = np.zeros((len(numbers), 3)), [[] for _ in numbers]
    for step in range(steps + max(begins)):
        if played is not None:
            commands = np.stack([now(played[number], step * policy.dt) for number in numbers])
        elif step % hold == 0:
            commands = np.stack([draw_command(policy.command, rng) for rng in draws])
        pairs = list(zip(group.feelings, group.data))
        seen = [np.concatenate([feelings.positions(data), feelings.velocities(data)]) for feelings, data in pairs]
        of_base = [BASE[base][1](data, feelings) for feelings, data in pairs]
        bases = [np.concatenate([values, group.place(index)]) for index, values in enumerate(of_base)]
        for index in group.step(commands):
            if begins[index] <= step < begins[index] + steps:
                sent = group.sent[0][index], group.actions[index], commands[index], bases[index]
                logs[index].append(np.concatenate([[len(logs[index]) * policy.dt], seen[index], *sent]))
    return [{"rows": rows, "fell": bool(fell)} for rows, fell in zip(logs, group.fallen)]


def write_sidecar(folder, policy, args):
    """Robot, rate and gains of all logs of the folder. JSON's texts and numbers are TOML's too."""
    gains = lambda values: ", ".join(map(repr, values.tolist()))
    notes = {"recorder": f"tools/mujoco_robot.py, MuJoCo {mujoco.__version__}", "policy": args.policy.name, "seed": args.seed}
    if args.robot is not None:
        notes["altered"] = args.robot.name
    text = f"robot = {json.dumps(policy.interface['robot'])}\nrate_hz = {1 / policy.dt!r}\n"
    text += f"# In the order of the q_ columns.\nkp = [{gains(policy.kp)}]\nkd = [{gains(policy.kd)}]\n\n[notes]\n"
    text += "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in notes.items())
    (folder / "log.toml").write_text(text, encoding="utf-8")


def collect(args, world):
    low, high = args.log_shift[0], args.log_shift[-1]
    if len(args.log_shift) > 2 or not 0 <= low <= high <= 10:
        raise Refused("--log-shift takes one or two times from 0 to 10 s, the shorter first")
    policy = Policy(args.policy)
    if round(args.seconds / policy.dt) < 1:
        raise Refused(f"--seconds {args.seconds} is shorter than a control period of {policy.dt} s")
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise Refused(f"cannot make the folder {args.out}: {error.strerror}") from None
    if any(args.out.glob("*.csv")):
        raise Refused(f"{args.out} already holds logs; give an empty folder")
    played = read_commands(args.commands) if args.commands else None
    args.trajectories = len(played) if played else args.trajectories
    jobs = [(world, numbers, args.seconds, (low, high), args.base, played) for numbers in groups(args.trajectories)]
    logs = parallel(record, jobs, args.processes, "logs")
    columns = [f"{prefix}_{joint}" for prefix in ("q", "dq", "qdes", "act") for joint in policy.joints]
    motion = ["motion_time", "motion_heading"] if policy.motion else []
    header = ",".join(["time", *columns, "vx_cmd", "vy_cmd", "wz_cmd", *BASE[args.base][0], *motion])
    digits, files = max(2, len(str(args.trajectories - 1))), []
    for number, log in enumerate(logs):
        if not log["rows"]:
            print(f"note: trajectory {number} fell before its log began; it has no file", file=sys.stderr)
            continue
        path = args.out / f"trajectory_{number:0{digits}}.csv"
        # Times need their digits however long the log is.
        formats = ["%.7g", *[f"%.{args.digits}g"] * (len(log["rows"][0]) - 1)]
        stated = "# fell = true\n" if log["fell"] else ""
        np.savetxt(path, log["rows"], fmt=formats, delimiter=",", header=stated + header, comments="")
        files.append(str(path))
    write_sidecar(args.out, policy, args)
    report = {"trajectories": len(files), "seconds": args.seconds, "falls": sum(log["fell"] for log in logs), "files": files}
    return report, f"{len(files)} logs of {args.seconds} s in {args.out}, {report['falls']} falls"


def drift_trial(job):
    """Errors of some robots after one command: {error (x, y, yaw) or None after a fall, path}."""
    world, numbers, command = job
    group = Group(world, numbers)
    begin, end = round(STAND / group.policy.dt), round((STAND + HOLD) / group.policy.dt)
    starts, paths = np.zeros((len(numbers), 3)), [[] for _ in numbers]
    for step in range(end + begin):
        if step == begin:
            # Robots settle while they first stand: errors count from where they then are.
            starts = np.stack([group.pose(index) for index in range(len(numbers))])
        now = command if begin <= step < end else (0.0, 0.0, 0.0)
        for index in group.step(np.tile(now, (len(numbers), 1))):
            if step >= begin and not group.fallen[index]:
                paths[index].append(relative(starts[index], group.pose(index)).tolist())
    results = []
    for path, fell in zip(paths, group.fallen):
        error = None if fell else (np.array(path[-1]) - HOLD * np.array(command)).tolist()
        results.append({"error": error and [*error[:2], wrap(error[2])], "path": path})
    return results


def wrap(angle):
    return angle - math.tau * round(angle / math.tau)


def relative(start, now):
    """`now` seen from `start`: x, y, heading."""
    sin, cos = math.sin(start[2]), math.cos(start[2])
    dx, dy = now[:2] - start[:2]
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx, wrap(now[2] - start[2])])


def drift_speeds(text, task):
    """Speeds of constant commands, both ways of each axis: `half` of the task's greatest, or three numbers."""
    if text == "half":
        return [np.array(task[axis]) / 2 for axis in ("x", "y", "yaw")]
    try:
        speeds = [float(word) for word in text.split(",")]
    except ValueError:
        speeds = []
    if len(speeds) != 3 or not all(0 <= speed <= 100 for speed in speeds):
        raise Refused(f"--drift-speeds is {text!r}; give `half` or three speeds such as 1,1,0.3925")
    return [(-speed, speed) for speed in speeds]


def drift(world, speeds, robots, processes):
    """Constant commands and standing: stand, command for four seconds, stand."""
    (back, ahead), (right, left), (clockwise, counter) = speeds
    commands = {
        "stand": (0.0, 0.0, 0.0),
        "+x": (ahead, 0.0, 0.0), "-x": (back, 0.0, 0.0),
        "+y": (0.0, left, 0.0), "-y": (0.0, right, 0.0),
        "+yaw": (0.0, 0.0, counter), "-yaw": (0.0, 0.0, clockwise),
    }  # fmt: skip
    jobs = [(world, numbers, tuple(map(float, command))) for command in commands.values() for numbers in groups(robots)]
    results = iter(parallel(drift_trial, jobs, processes, "robots under constant commands"))
    report = []
    for name, command in commands.items():
        mine = [next(results) for _ in range(robots)]
        errors = [result["error"] for result in mine if result["error"] is not None]
        axes = {axis: estimate([error[k] for error in errors]) for k, axis in enumerate(("x", "y", "yaw"))}
        fall_rate = share([result["error"] is None for result in mine])
        report.append({"name": name, "command": list(command), **axes, "fall_rate": fall_rate, "path": mine[0]["path"]})
    return report


def evaluate(args, world):
    if args.drift < 0:
        raise Refused("--drift must not be negative")
    policy = Policy(args.policy)
    commands = random_commands(policy.command, args.seed, args.trajectories)
    report = {"policy": str(args.policy), "seconds": args.seconds, "seed": args.seed}
    report |= trials(world, commands, args.seconds, 0.0, args.processes)
    speeds = drift_speeds(args.drift_speeds, policy.command)
    report["drift"] = drift(world, speeds, args.drift, args.processes) if args.drift else []
    text = show(report, f"{args.policy} in MuJoCo {mujoco.__version__}: {args.trajectories} × {args.seconds} s")
    if report["drift"]:
        text += "\ndrift: final error after standing, four seconds of the command, standing\n"
        text += "\n".join(drift_line(trial) for trial in report["drift"])
    return report, text


def drift_line(trial):
    line = f"{trial['name']:6}"
    for axis, unit in (("x", "m"), ("y", "m"), ("yaw", "rad")):
        mean = trial[axis]["mean"]
        value = "    fell" if mean is None else f"{mean:+8.3f} ± {trial[axis]['ci95']:.3f} {unit}"
        line += f"  {axis} {value}"
    return line + f"  falls {100 * trial['fall_rate']['mean']:.0f} %"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, run, count in (("collect", collect, 64), ("evaluate", evaluate, 500)):
        command = commands.add_parser(name)
        command.set_defaults(run=run)
        command.add_argument("--policy", type=pathlib.Path, required=True, help="ONNX file written by gaitfit")
        command.add_argument("--robot", type=pathlib.Path, help="TOML of what differs from the model file [nothing]")
        command.add_argument("--trajectories", type=int, default=count, help=f"[{count}]")
        command.add_argument("--seconds", type=float, default=4.0, help="length of each [4]")
        command.add_argument("--seed", type=int, default=0, help="of commands and noise [0]")
        command.add_argument("--processes", type=int, default=2, help="they change the time taken, not the results [2]")
        command.add_argument("--json", action="store_true", help="print one JSON document")
    commands.choices["collect"].add_argument("--out", type=pathlib.Path, required=True, help="folder for the logs")
    commands.choices["collect"].add_argument("--log-shift", type=float, nargs="+", default=[0.0], metavar="S",
        help="begin each log this long after the robot, drawn between two times [0]")  # fmt: skip
    commands.choices["collect"].add_argument("--base", choices=list(BASE), default="none",
        help="what the logs say of the base: nothing, what an IMU says, or all of its state [none]")  # fmt: skip
    commands.choices["collect"].add_argument("--commands", type=pathlib.Path, metavar="FILE",
        help="play these command sequences, one a trajectory: CSV with trajectory, time, vx_cmd, vy_cmd, wz_cmd")  # fmt: skip
    commands.choices["collect"].add_argument("--digits", type=int, default=7, choices=range(3, 18), metavar="N",
        help="significant digits of the numbers in the logs [7]")  # fmt: skip
    commands.choices["evaluate"].add_argument("--drift", type=int, default=16, help="robots a constant command, 0: none [16]")
    commands.choices["evaluate"].add_argument("--drift-speeds", default="half", metavar="X,Y,YAW",
        help="speeds of these, m/s, m/s, rad/s, or `half` of the policy's greatest commands [half]")  # fmt: skip
    args = parser.parse_args()
    if min(args.trajectories, args.processes) < 1 or not 0 < args.seconds <= 3600 or args.seed < 0:
        parser.error("--trajectories and --processes are at least 1, --seed at least 0, --seconds from 0 to 3600")
    world, begun = read_robot(args.policy, args.robot, args.seed), time.monotonic()
    check(world)
    report, text = args.run(args, world)
    altered = "nominal" if args.robot is None else args.robot.name
    report["simulator"], report["wall_seconds"] = f"MuJoCo {mujoco.__version__}, {altered}", time.monotonic() - begun
    print(json.dumps(report, indent=2) if args.json else f"{text}\n{report['wall_seconds']:.1f} s")


if __name__ == "__main__":
    try:
        main()
    except Refused as error:
        sys.exit(f"error: {error}")
