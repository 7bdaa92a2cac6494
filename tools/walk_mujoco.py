"""Walks an exported ONNX policy in official MuJoCo and reports falls and tracking errors.

The robot starts in the policy's default pose, just above the ground, under a random command that it keeps. Errors are means
over a trajectory (until a fall) of |v_xy - command_xy|, m/s, and |yaw rate - command|, rad/s, measured as `gaitfit evaluate`
measures them; reported as mean and 95 % confidence interval over trajectories. Falls follow the rule of the policy's task.

Usage: .venv/bin/python tools/walk_mujoco.py policy.onnx [--timestep 0.001] [--trajectories 200] [--json]
"""

import argparse
import json
import pathlib
import sys

import mujoco
import numpy as np

from mujoco_sim import GO2, Policy, Refused, World, check, load, random_commands, show, trials


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=pathlib.Path, help="ONNX file written by gaitfit")
    parser.add_argument("--model", type=pathlib.Path, default=GO2)
    parser.add_argument("--timestep", type=float, help="physics step, s [the model file's, at most 0.005]")
    parser.add_argument("--trajectories", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--skip", type=float, default=0.0, help="seconds at the start that do not count [0]")
    parser.add_argument("--command", type=float, nargs=3, metavar=("X", "Y", "YAW"),
                        help="half ranges, m/s, m/s, rad/s [the task's ranges]")
    parser.add_argument("--fixed", action="store_true", help="the command is exactly --command instead of random")
    parser.add_argument("--height", type=float, help="base height at the start, m [so that the feet just touch]")
    parser.add_argument("--clearance", type=float, default=0.002, help="gap below the feet at the start, m [0.002]")
    parser.add_argument("--joint-noise", type=float, default=0.0, help="half range of the starting joint angles, rad [0]")
    parser.add_argument("--fall-geoms", nargs="*", help="their contact with the ground is a fall [the task's]")
    parser.add_argument("--tilt", type=float, help="degrees from which a robot has fallen [the task's]")
    parser.add_argument("--lowest", type=float, help="base height below which it has, m [the task's]")
    parser.add_argument("--friction", type=float, help="sliding friction of every geom [the file's]")
    parser.add_argument("--armature", type=float, help="rotor inertia of every joint, kg·m² [the file's]")
    parser.add_argument("--ground-only", action="store_true", help="no contacts between parts of the robot")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    if args.fixed and args.command is None:
        parser.error("--fixed needs --command")
    if args.timestep is None:
        args.timestep = min(load(args.model).option.timestep, 0.005)
    if min(args.trajectories, args.processes) < 1 or args.seconds <= 0:
        parser.error("--trajectories, --processes and --seconds must be positive")

    fall = {"contacts": args.fall_geoms, "tilt": args.tilt, "height": args.lowest}
    same = ("policy", "model", "timestep", "friction", "ground_only", "height", "clearance", "joint_noise", "seed")
    world = World(
        **{name: getattr(args, name) for name in same},
        fall={key: value for key, value in fall.items() if value is not None},
        armature={} if args.armature is None else {"*": args.armature},
    )
    check(world)
    ranges = Policy(args.policy).command
    if args.command is not None:
        ranges = {axis: [-half, half] for axis, half in zip(("x", "y", "yaw"), args.command)}
    commands = random_commands(ranges, args.seed, args.trajectories)
    if args.fixed:
        commands = np.tile(args.command, (args.trajectories, 1))
    report = {"seconds": args.seconds, "timestep": args.timestep, "mujoco": mujoco.__version__}
    report |= trials(world, commands, args.seconds, args.skip, args.processes)
    title = f"{args.policy} in MuJoCo {mujoco.__version__}, {args.timestep} s: {args.trajectories} × {args.seconds} s"
    print(json.dumps(report, indent=2) if args.json else show(report, title))


if __name__ == "__main__":
    try:
        main()
    except Refused as error:
        sys.exit(f"error: {error}")
