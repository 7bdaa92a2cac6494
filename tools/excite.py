"""Do chosen commands make fits more precise than random ones? Measured on a robot in official MuJoCo with torque noise.

A pool of command sequences walks in gaitfit's engine on a robot of guessed numbers. `gaitfit sensitivity` says how much each
log adds to what three others tell. Sets of sequences that leave the smallest expected spread are chosen one by one and then
exchanged while that helps (Fedorov 1972, Theory of Optimal Experiments): the criterion is the geometric mean of the standard
deviations, of friction alone or of friction and armature. Then robots with other numbers walk in MuJoCo, as long, under the
chosen commands and under random ones, and `gaitfit adapt` fits their logs. Each fit is kept; the same command goes on where it
was stopped.

Usage: .venv/bin/python tools/excite.py [--seeds 5] [--logs 8] [--noise 2.5] [--out runs/excite] [--gaitfit PROGRAM]
"""

import argparse
import csv
import itertools
import json
import pathlib
import shutil
import subprocess
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
POLICY = ROOT / "assets/go2-robust.safetensors"
GROUPS = ("hip", "thigh", "calf")
NAMES = [f"{kind}_{group}" for kind in ("frictionloss", "armature") for group in GROUPS]
FRICTION, ALL = [0, 1, 2], list(range(6))
# Friction loss, N·m, then armature, kg·m²: what is guessed when commands are chosen, and the robots.
GUESS = [0.1, 0.1, 0.1, 0.05, 0.05, 0.05]
TRUTHS = {"A": [0.2, 0.15, 0.1, 0.1, 0.05, 0.075], "B": [0.05, 0.3, 0.22, 0.02, 0.08, 0.03]}
# Ranges of the three commands, seconds until the next, and how many sequences.
FULL = [[-1.0, 1.0]] * 3
KINDS = {"usual": (FULL, 4.0, 48), "quick": (FULL, 1.0, 24), "quicker": (FULL, 0.5, 16)}
KINDS |= {
    "end" + "".join(f"{value:+d}" for value in ends): ([[float(value)] * 2 for value in ends], 4.0, 1)
    for ends in itertools.product((-1, 0, 1), repeat=3)
}
COMMAND = ("vx_cmd", "vy_cmd", "wz_cmd")
BASIS = 3


def run(*words):
    found = subprocess.run([str(word) for word in words], cwd=ROOT, capture_output=True, text=True)
    # 3: a check or the convergence failed; the result is there.
    if found.returncode not in (0, 3):
        sys.exit(f"{' '.join(map(str, words))}\n{found.stderr}")
    return found.stdout


def write_theta(path, values):
    text = 'format = 2\nrobot = "go2"\ncost_name = "guess"\ncost = 0.0\n'
    for name, value in zip(NAMES, values):
        kind, group = name.split("_")
        joints = json.dumps([f"{leg}_{group}_joint" for leg in ("FL", "FR", "RL", "RR")])
        unit = "N·m" if kind == "frictionloss" else "kg·m²"
        text += f'[[parameter]]\nname = "{name}"\nkind = "{kind}"\njoints = {joints}\nvalue = {value}\nunit = "{unit}"\n'
        text += "lower = 0.0\nupper = 0.5\nat_bound = false\n"
    path.write_text(text, encoding="utf-8")


def write_config(path, args, logs, more=""):
    config = {"base": "free", "policy": str(POLICY), "logs": [str(log) for log in logs], "costs": ["matchr1"], "runs": str(args.out)}
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in config.items())
    path.write_text(f'{text}[simulation]\ntimestep = {args.timestep}\npreset = "fast"\n{more}', encoding="utf-8")


def information(args, logs):
    """1 / variance to expect of each number from `logs`, up to a factor."""
    write_config(args.out / "look.toml", args, logs)
    found = run(args.gaitfit, "sensitivity", args.out / "look.toml", "--theta", args.out / "guess.toml", "--json", "--threads", args.threads)
    return np.array([one["deviation"] or np.inf for one in json.loads(found)["parameters"]]) ** -2.0


def sequence(log):
    """Time and command wherever the command changes."""
    found = []
    for row in csv.DictReader(line for line in log.open(encoding="utf-8") if not line.startswith("#")):
        command = [float(row[name]) for name in COMMAND]
        if not found or found[-1][1:] != command:
            found.append([float(row["time"]), *command])
    return found


def draw_pool(args):
    """Candidate sequences with what each adds, those of robots that fell left out."""
    kept = args.out / "pool.json"
    if kept.exists():
        return json.loads(kept.read_text())
    write_theta(args.out / "guess.toml", GUESS)
    logs = []
    for kind, ((x, y, yaw), seconds, count) in KINDS.items():
        folder, task = args.out / "pool" / kind, args.out / "task.toml"
        shutil.rmtree(folder, ignore_errors=True)
        task.write_text(f'base = "velocity"\n[command]\nx = {x}\ny = {y}\nyaw = {yaw}\nseconds = {seconds}\nstanding = 0.0\n')
        run(args.gaitfit, "collect", POLICY, "--theta", args.out / "guess.toml", "--task", task, "--out", folder, "--trajectories", count,
            "--seconds", args.seconds, "--privileged", "--torque-noise", args.noise, "--threads", args.threads, "--seed", 7)  # fmt: skip
        logs += [(kind, log) for log in sorted(folder.glob("*.csv")) if "# fell = true" not in log.read_text(encoding="utf-8")]
    basis, rest = [log for _, log in logs[:BASIS]], logs[BASIS:]
    known, pool = information(args, basis), []
    for number, (kind, log) in enumerate(rest):
        added = np.maximum(information(args, [*basis, log]) - known, 1e-9)
        pool.append({"kind": kind, "commands": sequence(log), "adds": added.tolist()})
        print(f"\rpool: {number + 1} of {len(rest)}", end="", file=sys.stderr)
    kept.write_text(json.dumps(pool))
    return pool


def spread(adds, which):
    """Geometric mean of the standard deviations of the numbers `which`, up to a factor."""
    return float(np.exp(-0.5 * np.log(np.sum(adds, axis=0)[which]).mean()))


def choose(adds, count, which):
    """Numbers of the sequences with the smallest expected spread; a sequence may be taken several times."""
    chosen = []
    for _ in range(count):
        chosen.append(min(range(len(adds)), key=lambda one: spread(adds[[*chosen, one]], which)))
    while True:
        swaps = itertools.product(range(count), range(len(adds)))
        least, place, one = min((spread(adds[[*chosen[:at], one, *chosen[at + 1 :]]], which), at, one) for at, one in swaps)
        if least > spread(adds[chosen], which) * (1 - 1e-6):
            return chosen
        chosen[place] = one


def record(args, how, truth, seed):
    """Logs of a robot in MuJoCo."""
    folder = args.out / "logs" / f"{how}-{truth}-{seed}"
    shutil.rmtree(folder, ignore_errors=True)
    onnx, robot = args.out / "policy.onnx", args.out / "robot.toml"
    run(args.gaitfit, "export", POLICY, "--onnx", onnx)
    table = lambda values: "".join(f'"*_{group}_joint" = {value!r}\n' for group, value in zip(GROUPS, values))
    numbers = TRUTHS[truth]
    robot.write_text(
        f"timestep = 0.001\ntorque_noise = {args.noise}\n[frictionloss]\n{table(numbers[:3])}[armature]\n{table(numbers[3:])}"
    )
    played = [] if how == "random" else ["--commands", args.out / f"{how}.csv"]
    run(sys.executable, "tools/mujoco_robot.py", "collect", "--policy", onnx, "--robot", robot, "--out", folder, "--trajectories", args.logs,
        "--seconds", args.seconds, "--log-shift", 0.02, 0.1, "--base", "imu", "--seed", seed, "--processes", args.threads, *played)  # fmt: skip
    return folder


def fit(args, how, truth, seed):
    """Value and interval of each number, as they were kept or found now."""
    kept = args.out / f"fit-{how}-{truth}-{seed}.json"
    if not kept.exists():
        more = f"robot_timestep = 0.001\n[optimizer]\nseeds = 1\nseed = {seed}\nreplicates = {args.replicates}\n"
        write_config(args.out / "fit.toml", args, [record(args, how, truth, seed)], more)
        name = f"{how}-{truth}-{seed}"
        found = run(args.gaitfit, "adapt", args.out / "fit.toml", "--name", name, "--json", "--threads", args.threads)
        values = {one["name"]: [one["value"], *one["interval"]] for one in json.loads(found)["parameters"]}
        kept.write_text(json.dumps(values))
        shutil.rmtree(args.out / "logs" / name)
    values = json.loads(kept.read_text())
    found = np.array([values[name] for name in NAMES])
    print(f"{how} {truth} {seed}: off by {np.round(found[:, 0] - TRUTHS[truth], 4)}", file=sys.stderr)
    return found


def table(args, expected):
    """Per design: what was expected, and over seeds the spread, the intervals' width and the error, root mean squares over robots."""
    head = ["commands", "expected spread", "spread of friction", "of armature", "interval of friction", "of armature", "error of friction, N·m"]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " --- |" * (len(head) - 1)]
    first = None
    for how, predicted in expected.items():
        all_fits = np.array([[fit(args, how, truth, seed) for seed in range(1, args.seeds + 1)] for truth in TRUTHS])
        values = all_fits[..., 0]
        root = lambda of: np.sqrt(np.mean(of**2, axis=(0, 1)))
        deviation = root(values.std(axis=1, ddof=1)[:, None])
        width = root(all_fits[..., 2] - all_fits[..., 1])
        off = root(values - np.array(list(TRUTHS.values()))[:, None])
        mean = lambda of: np.exp(np.log(of).mean())
        now = [mean(deviation[:3]), mean(deviation[3:]), mean(width[:3]), mean(width[3:])]
        first = first or now
        cells = [how, f"{predicted[0]:.2f}, {predicted[1]:.2f}", *(f"{a:.2e} ({a / b:.2f})" for a, b in zip(now, first)), f"{mean(off[:3]):.4f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--logs", type=int, default=8, help="logs of a fit [8]")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each log [4]")
    parser.add_argument("--noise", type=float, default=2.5, help="torque noise, N·m [2.5]")
    parser.add_argument("--timestep", type=float, default=0.005, help="of the fit, s [0.005]")
    parser.add_argument("--replicates", type=int, default=0, help="sets of simulated logs that correct a fit [0]")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "runs/excite")
    parser.add_argument("--gaitfit", type=pathlib.Path, default=ROOT / "target/release/gaitfit")
    args = parser.parse_args()
    args.out, args.gaitfit = args.out.resolve(), args.gaitfit.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    pool = draw_pool(args)
    adds = np.array([one["adds"] for one in pool])
    usual = [at for at, one in enumerate(pool) if one["kind"] == "usual"]
    draws = np.random.default_rng(1)
    some = [adds[draws.choice(usual, args.logs)] for _ in range(500)]
    random = [np.mean([spread(one, which) for one in some]) for which in (FRICTION, ALL)]
    expected = {"random": [1.0, 1.0]}
    for how, which in (("friction", FRICTION), ("all", ALL)):
        chosen = choose(adds, args.logs, which)
        expected[how] = [spread(adds[chosen], of) / whole for of, whole in zip((FRICTION, ALL), random)]
        print(f"{how}: {', '.join(pool[one]['kind'] for one in chosen)}", file=sys.stderr)
        rows = [[number, *row] for number, one in enumerate(chosen) for row in pool[one]["commands"]]
        lines = [",".join(["trajectory", "time", *COMMAND]), *(",".join(map(str, row)) for row in rows)]
        (args.out / f"{how}.csv").write_text("\n".join(lines) + "\n")
    print(table(args, expected))


if __name__ == "__main__":
    main()
