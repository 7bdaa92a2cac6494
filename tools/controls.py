"""What a loop is worth on robots that are not the fit's own simulator: `gaitfit loop` on robots in official MuJoCo, whose policy
is measured beside policies trained without logs and beside one trained with the robot's own numbers.

A robot is a file of examples/go2-ground or experiments/robots; every seed records other logs, trains anew and measures with other
commands. Each loop is kept; the same command goes on where it was stopped. Robots that are no Go2 get a task by `gaitfit init`,
and a π₀ trained by `gaitfit train` as it comes.

Usage: .venv/bin/python tools/controls.py [--robots demo,payload,late] [--seeds 5] [--out runs/controls] [--device cuda]
"""

import argparse
import collections
import concurrent.futures
import fnmatch
import json
import pathlib
import subprocess
import sys
import threading
import tomllib

import mujoco
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
UNITREE = {group: f"*_{group}_joint" for group in ("hip", "thigh", "calf")}
SPOT = {"hip": "*_hx", "thigh": "*_hy", "calf": "*_kn"}
# A robot, the policy of assets/ that walks on it or none, its joint groups, the friction loss, N·m, and armature, kg·m², that
# fits may find, and those that randomised trainings add to the file's.
ROBOTS = {
    "demo": ("examples/go2-ground/robot.toml", "go2-walk", UNITREE, (0.5, 0.2), (0.4, 0.06)),
    "payload": ("experiments/robots/payload.toml", "go2-walk", UNITREE, (0.5, 0.2), (0.4, 0.06)),
    "late": ("experiments/robots/late.toml", "go2-walk", UNITREE, (0.5, 0.2), (0.4, 0.06)),
    "biped": ("experiments/robots/biped.toml", "go2-biped", UNITREE, (0.5, 0.2), (0.4, 0.06)),
    "go1": ("experiments/robots/go1.toml", None, UNITREE, (3.0, 0.2), (0.4, 0.06)),
    "spot": ("experiments/robots/spot.toml", None, SPOT, (4.0, 0.5), (1.6, 0.15)),
}
# One training at a time of each robot's first policy.
TRAINING = collections.defaultdict(threading.Lock)
STEP = 0.005  # s, of trainings
BEFORE, AFTER = "π₀", "π₁"
# Columns of the table.
POLICIES = {
    BEFORE: "π₀", "fine-tuned, nominal": "nominal", "fine-tuned, randomised": "randomised", AFTER: "fitted",
    "fine-tuned, draws of the fit": "fitted, draws", "fine-tuned, known numbers": "known numbers",
}  # fmt: skip


def model_of(name):
    """The path of a robot's model file, and what its own file says."""
    path = ROOT / ROBOTS[name][0]
    robot = tomllib.loads(path.read_text(encoding="utf-8"))
    return (path.parent / robot["model"]).resolve(), robot


def truth(name):
    """The robot's numbers as a theta.toml: what of them a simulator with rigid links and PD motors has."""
    path, robot = model_of(name)
    spec = mujoco.MjSpec.from_file(str(path))
    hinges = [joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    groups = {group: fnmatch.filter(hinges, pattern) for group, pattern in ROBOTS[name][2].items()}
    text = f'format = 2\nrobot = "{spec.modelname}"\ncost_name = "truth"\ncost = 0.0\n'

    def add(name, kind, value, unit, joints=()):
        nonlocal text
        text += f'[[parameter]]\nname = "{name}"\nkind = "{kind}"\njoints = {json.dumps(list(joints))}\n'
        text += f'value = {float(value)!r}\nunit = "{unit}"\n'

    for kind, unit in (("frictionloss", "N·m"), ("armature", "kg·m²")):
        for group, pattern in ROBOTS[name][2].items():
            add(f"{kind}_{group}", kind, robot.get(kind, {}).get(pattern, 0.0), unit, groups[group])
    every = sum(groups.values(), [])
    add("delay", "delay", robot.get("delay", 0.0), "s", every)
    add("torque_scale", "torque_scale", robot.get("strength", 1.0), "-", every)
    for spring in robot.get("spring", []):
        stiffness = spring["stiffness"]
        add(f"stiffness_{spring['joint']}", "stiffness", stiffness, "N·m/rad", [spring["joint"]])
        torque = stiffness * spring["angle"]
        add(f"spring_torque_{spring['joint']}", "spring_torque", torque, "N·m", [spring["joint"]])
    load = robot.get("payload", {})
    add("payload_mass", "payload_mass", load.get("mass", 0.0), "kg")
    for axis in "xyz":
        add(f"payload_{axis}", f"payload_{axis}", load.get(axis, 0.0), "m")
    ratio = robot["friction"] / spec.geom("FL_foot").friction[0] if "friction" in robot else 1.0
    add("floor_friction", "floor_friction", ratio, "-")
    return text


def first_policy(args, name):
    """The policy that walks on the robot: one of assets/, or one trained on the robot's file as it is."""
    if ROBOTS[name][1] is not None:
        return ROOT / f"assets/{ROBOTS[name][1]}.safetensors"
    with TRAINING[name]:
        task, run = args.out / f"{name}-walk.toml", f"{name}-walk"
        if not task.exists():
            program(args, "init", model_of(name)[0], "--out", task)
        if not (args.out / run / "report.html").exists():
            more = ["--resume"] if (args.out / run).exists() else []
            words = ["--name", run, "--device", args.device, "--set", f"runs={args.out}", "--threads", args.threads]
            program(args, "train", task, *words, *more)
    return args.out / run / "seed-1/policy.safetensors"


def program(args, *words):
    done = subprocess.run([str(word) for word in (args.gaitfit, *words)], cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, words))}\n{done.stderr[-3000:]}")


def config(args, name, seed):
    file, policy, groups, bounds, drawn = ROBOTS[name]
    path = ROOT / file
    model, robot = model_of(name)
    numbers = args.out / f"{name}-truth.toml"
    numbers.write_text(truth(name), encoding="utf-8")
    # Independent torques at every step of 1 ms act like smaller ones held for 5 ms.
    noise = robot.get("torque_noise", 0.0) * (robot.get("timestep", 0.001) / STEP) ** 0.5
    words = lambda verb, *more: json.dumps(
        [sys.executable, "tools/mujoco_robot.py", verb, "--policy", "{onnx}", "--robot", str(path), "--trajectories",
         "{trajectories}", "--seconds", "{seconds}", "--seed", "{seed}", "--processes", str(args.threads), *more]
    )  # fmt: skip
    patterns = "".join(f'{group} = ["{pattern}"]\n' for group, pattern in groups.items())
    widths = "tracking_width = 0.25\nyaw_tracking_width = 0.25\n" if policy == "go2-walk" else ""
    return f"""
policy = {json.dumps(str(first_policy(args, name)))}
robot = {json.dumps("" if policy else str(model))}
runs = {json.dumps(str(args.out))}
[target]
kind = "command"
seed = {seed}
trajectories = {args.logs}
collect = {words("collect", "--out", "{folder}", "--log-shift", "0.02", "0.1", "--base", "imu")}
evaluate = {words("evaluate", "--json", "--drift", "{drift}", "--drift-speeds", "{drift_speeds}")}
[adapt]
costs = ["matchr1"]
odd_joints = true
[adapt.groups]
{patterns}[[adapt.parameter]]
kind = "frictionloss"
upper = {bounds[0]}
[[adapt.parameter]]
kind = "armature"
upper = {bounds[1]}
[[adapt.parameter]]
kind = "delay"
per = "all"
upper = 0.04
[[adapt.parameter]]
kind = "torque_scale"
per = "all"
[[adapt.number]]
kind = "payload_mass"
[[adapt.number]]
kind = "payload_x"
[[adapt.number]]
kind = "payload_y"
[[adapt.number]]
kind = "payload_z"
[[adapt.number]]
kind = "floor_friction"
[adapt.simulation]
timestep = {args.timestep}
robot_timestep = 0.001
preset = "fast"
[adapt.optimizer]
seeds = 1
[finetune]
seeds = [{seed}]
[finetune.train]
iterations = {args.iterations}
[finetune.task]
{widths}[controls]
nominal = true
randomised = true
frictionloss = [0.0, {drawn[0]}]
armature = [0.0, {drawn[1]}]
draws = true
truth = {{ theta = {json.dumps(str(numbers))}, torque_noise = {noise} }}
[evaluate]
trajectories = {args.trajectories}
drift = {args.drift}
drift_speeds = [0.5, 0.5, 0.3925]
seed = {seed}
"""


def loop(args, name, seed):
    """The result of one loop: made, continued, or read."""
    run, kept = f"{name}-{seed}", args.out / f"{name}-{seed}.json"
    if not kept.exists():
        path = args.out / f"{run}.toml"
        path.write_text(config(args, name, seed), encoding="utf-8")
        words = [args.gaitfit, "loop", path, "--name", run, "--json", "--device", args.device, "--threads", args.threads]
        if (args.out / run).exists():
            words.append("--resume")
        done = subprocess.run([str(word) for word in words], cwd=ROOT, capture_output=True, text=True)
        (args.out / f"{run}.log").write_text(done.stderr, encoding="utf-8")
        # 3: a check failed; the result is there.
        if done.returncode not in (0, 3):
            print(f"{run}: {done.stderr[-3000:]}", file=sys.stderr)
            return None
        kept.write_text(done.stdout, encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


def errors(result):
    """Linear and angular error and share of falls of each policy on the robot: {policy: (m/s, rad/s, share)}."""
    keys = ("linear_velocity_error", "angular_velocity_error", "fall_rate")
    return {
        one["policy"]: [one[key]["mean"] for key in keys] for one in result["evaluations"] if one["on"] == "target"
    }


def table(results):
    """Means over the seeds, and the sum of both errors beside that of the best policy without logs and of the known robot."""
    head = ["robot", "seeds", *POLICIES.values(), "fitted / best without logs", "fitted / known numbers"]
    lines = ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|"]
    for name in ROBOTS:
        mine = [errors(result) for key, result in results.items() if key[0] == name]
        if not mine:
            continue
        found = {policy: np.array([one[policy] for one in mine]) for policy in POLICIES if all(policy in one for one in mine)}
        cell = lambda rows: f"{rows[:, 0].mean():.3f} m/s, {rows[:, 1].mean():.3f} rad/s, {100 * rows[:, 2].mean():.1f} %"
        total = {policy: rows[:, :2].sum(1) for policy, rows in found.items()}
        best = np.minimum(total["fine-tuned, nominal"], total["fine-tuned, randomised"])

        def ratio(other):
            each = total[AFTER] / other
            return f"{each.mean():.2f} ({each.min():.2f} to {each.max():.2f})"

        cells = [name, str(len(mine)), *(cell(found[policy]) if policy in found else "" for policy in POLICIES)]
        lines.append("| " + " | ".join([*cells, ratio(best), ratio(total["fine-tuned, known numbers"])]) + " |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", default="demo,payload,late,biped", help="[demo,payload,late,biped] of " + ", ".join(ROBOTS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--logs", type=int, default=64, help="logs of 4 s [64]")
    parser.add_argument("--iterations", type=int, default=160, help="of a training [160]")
    parser.add_argument("--trajectories", type=int, default=500, help="of an evaluation [500]")
    parser.add_argument("--drift", type=int, default=0, help="robots of each constant-command trial [0]")
    parser.add_argument("--timestep", type=float, default=0.005, help="of the fit, s [0.005]")
    parser.add_argument("--device", default="cpu", help="what trains, as of `gaitfit loop` [cpu]")
    parser.add_argument("--threads", type=int, default=2, help="of a loop [2]")
    parser.add_argument("--at-once", type=int, default=1, help="loops that run beside each other [1]")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "runs/controls")
    parser.add_argument("--gaitfit", type=pathlib.Path, default=ROOT / "target/release/gaitfit")
    args = parser.parse_args()
    args.out, args.gaitfit = args.out.resolve(), args.gaitfit.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    jobs = [(name, seed) for seed in range(1, args.seeds + 1) for name in args.robots.split(",")]
    with concurrent.futures.ThreadPoolExecutor(args.at_once) as pool:
        found = dict(zip(jobs, pool.map(lambda job: loop(args, *job), jobs)))
    print(table({job: result for job, result in found.items() if result is not None}))
    if None in found.values():
        sys.exit("some loops failed; the same command tries them again")


if __name__ == "__main__":
    main()
