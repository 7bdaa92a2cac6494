"""Do chosen commands make fits more precise than random ones? Measured on robots in official MuJoCo with torque noise.

`gaitfit excite --policy` chooses commands on a robot of guessed numbers, anew for each seed. Then robots with other numbers walk
in MuJoCo, as long, under the chosen commands and under random ones, and `gaitfit fit` fits their logs. In the cases below the
fit has dry friction and armature; viscous damping too; or the robot has logs of a straight walk already, which the choice takes
into account. What is made is kept; the same command goes on where it was stopped.

Usage: .venv/bin/python tools/excite.py [--seeds 5] [--logs 8] [--noise 2.5] [--only CASE …] [--out runs/excite] [--gaitfit PROGRAM]
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
POLICY = ROOT / "assets/go2-robust.safetensors"
GROUPS = ("hip", "thigh", "calf")
UNITS = {"frictionloss": "N·m", "armature": "kg·m²", "damping": "N·m·s/rad"}
# By kind, of hips, thighs and calves: what is guessed when commands are chosen, and the robots. Dampers only where they are fitted.
GUESS = {"frictionloss": [0.1, 0.1, 0.1], "armature": [0.05, 0.05, 0.05], "damping": [0.1, 0.1, 0.1]}
TRUTHS = {
    "A": {"frictionloss": [0.2, 0.15, 0.1], "armature": [0.1, 0.05, 0.075], "damping": [0.1, 0.2, 0.15]},
    "B": {"frictionloss": [0.05, 0.3, 0.22], "armature": [0.02, 0.08, 0.03], "damping": [0.25, 0.05, 0.1]},
}
# Kinds that are fitted; command of a walk that is recorded before, in half of the logs; ways to choose: options of `excite`.
DRY = ["frictionloss", "armature"]
FRICTION = ["--parameters", "frictionloss_*"]
CASES = {
    "dry": (DRY, None, {"friction": FRICTION, "all": []}),
    "damped": ([*DRY, "damping"], None, {"friction": FRICTION, "friction, reach 2": [*FRICTION, "--reach", 2]}),
    "straight": ([*DRY, "damping"], [0.5, 0.0, 0.0], {"friction": FRICTION, "friction, reach 2": [*FRICTION, "--reach", 2]}),
}  # fmt: skip


def run(*words):
    found = subprocess.run([str(word) for word in words], cwd=ROOT, capture_output=True, text=True)
    # 3: a check or the convergence failed; the result is there.
    if found.returncode not in (0, 3):
        sys.exit(f"{' '.join(map(str, words))}\n{found.stderr}")
    return found.stdout


def names(kinds):
    return [f"{kind}_{group}" for kind in kinds for group in GROUPS]


def write_theta(path, values):
    text = 'format = 2\nrobot = "go2"\ncost_name = "guess"\ncost = 0.0\n'
    for kind, of in values.items():
        for group, value in zip(GROUPS, of):
            joints = json.dumps([f"{leg}_{group}_joint" for leg in ("FL", "FR", "RL", "RR")])
            text += f'[[parameter]]\nname = "{kind}_{group}"\nkind = "{kind}"\njoints = {joints}\nvalue = {value}\n'
            text += f'unit = "{UNITS[kind]}"\nlower = 0.0\nupper = 0.5\nat_bound = false\n'
    path.write_text(text, encoding="utf-8")


def write_config(path, args, kinds, logs, more=""):
    config = {"base": "free", "policy": str(POLICY), "logs": [str(log) for log in logs], "costs": ["matchr1"], "runs": str(args.out)}
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in config.items())
    text += f'[simulation]\ntimestep = {args.timestep}\npreset = "fast"\n{more}'
    text += "".join(f'[[parameter]]\nkind = "{kind}"\njoints = ["*"]\nper = "group"\n' for kind in kinds)
    path.write_text(text, encoding="utf-8")


def record(args, folder, kinds, truth, count, seed, commands=None):
    """Logs of a robot in MuJoCo."""
    if folder.exists():
        return folder
    robot = args.out / "robot.toml"
    text = f"timestep = 0.001\ntorque_noise = {args.noise}\n"
    for kind in kinds:
        text += f"[{kind}]\n" + "".join(f'"*_{group}_joint" = {value!r}\n' for group, value in zip(GROUPS, TRUTHS[truth][kind]))
    robot.write_text(text)
    played = ["--commands", commands] if commands else []
    new = folder.with_suffix(".new")
    shutil.rmtree(new, ignore_errors=True)
    run(sys.executable, "tools/mujoco_robot.py", "collect", "--policy", args.out / "policy.onnx", "--robot", robot, "--out", new,
        "--trajectories", count, "--seconds", args.seconds, "--log-shift", 0.02, 0.1, "--base", "imu", "--seed", seed,
        "--processes", args.threads, *played)  # fmt: skip
    return new.rename(folder)


def choose(args, path, kinds, logs, count, seed, options):
    """Writes chosen commands, and gives the expected deviations of friction, chosen over random."""
    kept = path.with_suffix(".json")
    if not kept.exists():
        write_theta(args.out / "guess.toml", {kind: GUESS[kind] for kind in kinds})
        write_config(args.out / "choose.toml", args, kinds, logs)
        found = run(args.gaitfit, "excite", args.out / "choose.toml", "--policy", POLICY, "--theta", args.out / "guess.toml",
            "--out", path, "--trajectories", count, "--seconds", args.seconds, "--pool", args.pool, "--torque-noise", args.noise,
            "--seed", seed, "--threads", args.threads, "--json", *options)  # fmt: skip
        kept.write_text(found)
    found = {one["name"]: one["chosen"] / one["random"] for one in json.loads(kept.read_text())["parameters"]}
    return np.array([found[name] for name in names(kinds)])


def one(args, case, how, truth, seed):
    """Values and intervals of a fit, `numbers × 3`, and the expected deviations over those with random commands."""
    kinds, before, ways = CASES[case]
    name = f"{case}-{how}-{truth}-{seed}".replace(", ", "-").replace(" ", "")
    kept, logs = args.out / f"fit-{name}.json", []
    count = args.logs
    if before:
        count -= args.logs // 2
        walk = args.out / "before.csv"
        rows = [f"{number},0.0,{','.join(map(str, before))}\n" for number in range(args.logs - count)]
        walk.write_text("trajectory,time,vx_cmd,vy_cmd,wz_cmd\n" + "".join(rows))
        folder = args.out / "logs" / f"{case}-before-{truth}-{seed}"
        logs = [record(args, folder, kinds, truth, len(rows), 1000 + seed, walk)]
    commands, expected = None, np.ones(len(names(kinds)))
    if how in ways:
        # Where nothing was recorded the choice does not know the robot.
        commands = args.out / (f"{name}.csv" if before else f"{name}.csv".replace(f"-{truth}-", "-"))
        expected = choose(args, commands, kinds, logs, count, seed, ways[how])
    if not kept.exists():
        logs = [*logs, record(args, args.out / "logs" / name, kinds, truth, count, seed, commands)]
        more = f"robot_timestep = 0.001\n[optimizer]\nseeds = 1\nseed = {seed}\nreplicates = {args.replicates}\n"
        write_config(args.out / "fit.toml", args, kinds, logs, more)
        shutil.rmtree(args.out / name, ignore_errors=True)
        found = run(args.gaitfit, "adapt", args.out / "fit.toml", "--name", name, "--json", "--threads", args.threads)
        kept.write_text(json.dumps({one["name"]: [one["value"], *one["interval"]] for one in json.loads(found)["parameters"]}))
    values = json.loads(kept.read_text())
    found = np.array([values[name] for name in names(kinds)])
    print(f"{name}: off by {np.round(found[:, 0] - truths(kinds, truth), 4)}", file=sys.stderr)
    return found, expected


def truths(kinds, truth):
    return np.concatenate([TRUTHS[truth][kind] for kind in kinds])


def table(args, case):
    """Per kind of number: over seeds the spread, the intervals' width and the error, root mean squares over robots and geometric
    means over groups, with those of random commands as 1."""
    kinds, _, ways = CASES[case]
    head = ["commands", "number", "expected spread", "spread over seeds", "error", "interval", "inside"]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " --- |" * (len(head) - 1)]
    first = None
    for how in ["random", *ways]:
        all_found = [[one(args, case, how, truth, seed) for seed in range(1, args.seeds + 1)] for truth in TRUTHS]
        fits = np.array([[found for found, _ in row] for row in all_found])
        expected = np.array([[expected for _, expected in row] for row in all_found])
        true = np.array([truths(kinds, truth) for truth in TRUTHS])[:, None]
        mean = lambda of: np.exp(np.log(of).reshape(len(kinds), len(GROUPS)).mean(axis=1))
        root = lambda of: mean(np.sqrt(np.mean(of**2, axis=(0, 1))))
        now = np.stack([
            root(fits[..., 0].std(axis=1, ddof=1)[:, None]), root(fits[..., 0] - true), root(fits[..., 2] - fits[..., 1]),
        ])  # fmt: skip
        first = now if first is None else first
        inside = ((fits[..., 1] <= true) & (true <= fits[..., 2])).mean(axis=(0, 1)).reshape(len(kinds), -1).mean(axis=1)
        for at, kind in enumerate(kinds):
            cells = [f"{value:.2e} ({value / of:.2f})" for value, of in zip(now[:, at], first[:, at])]
            guess = f"{np.exp(np.log(mean_of(expected)).reshape(len(kinds), -1).mean(axis=1))[at]:.2f}"
            lines.append("| " + " | ".join([how, f"{kind}, {UNITS[kind]}", guess, *cells, f"{100 * inside[at]:.0f} %"]) + " |")
    return "\n".join(lines)


def mean_of(expected):
    """Geometric means over robots and seeds."""
    return np.exp(np.log(expected).mean(axis=(0, 1)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--logs", type=int, default=8, help="logs of a fit [8]")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each log [4]")
    parser.add_argument("--noise", type=float, default=2.5, help="torque noise, N·m [2.5]")
    parser.add_argument("--pool", type=int, default=128, help="sequences to choose from [128]")
    parser.add_argument("--timestep", type=float, default=0.005, help="of the fit, s [0.005]")
    parser.add_argument("--replicates", type=int, default=4, help="sets of simulated logs that correct a fit [4]")
    parser.add_argument("--only", nargs="+", choices=list(CASES), default=list(CASES), help="cases [all]")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "runs/excite")
    parser.add_argument("--gaitfit", type=pathlib.Path, default=ROOT / "target/release/gaitfit")
    args = parser.parse_args()
    args.out, args.gaitfit = args.out.resolve(), args.gaitfit.resolve()
    (args.out / "logs").mkdir(parents=True, exist_ok=True)
    run(args.gaitfit, "export", POLICY, "--onnx", args.out / "policy.onnx")
    for case in args.only:
        print(f"{case}\n\n{table(args, case)}\n", flush=True)


if __name__ == "__main__":
    main()
