"""How well fits find the numbers of a robot that is not gaitfit's simulator: official MuJoCo.

For each row (how the robot is simulated, how it is fitted), truth (friction and armature of hips, thighs and calves) and seed
it records walking logs in MuJoCo, fits them with `gaitfit adapt`, and compares. Each fit is kept; the same command goes on
where it was stopped.

Usage: .venv/bin/python tools/transfer.py [--only 'ROW,…'] [--seeds 5] [--out runs/transfer] [--gaitfit PROGRAM]
"""

import argparse
import fnmatch
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
GROUPS = ("hip", "thigh", "calf")
DRAWN = np.random.default_rng(20)
# friction loss, N·m, then armature, kg·m², of hips, thighs and calves.
TRUTHS = {
    "A": [0.2, 0.15, 0.1, 0.1, 0.05, 0.075],
    "B": [0.05, 0.3, 0.22, 0.02, 0.08, 0.03],
    **{f"drawn{k}": [*DRAWN.uniform(0.05, 0.35, 3), *DRAWN.uniform(0.015, 0.1, 3)] for k in (1, 2, 3)},
}
ROBOT = {"timestep": 0.001, "delay": 0.0, "noise": 0.0, "shift": (0.02, 0.1), "policy": "go2-robust"}
FIT = {"timestep": 0.0025, "preset": "fast", "cost": "matchr1", "delay": False}
# What differs from ROBOT and FIT.
ROWS = {
    "mujoco-5ms": ({}, {"timestep": 0.005}),
    "mujoco-2.5ms": ({}, {}),
    "mujoco-1ms": ({}, {"timestep": 0.001}),
    "walk-5ms": ({"delay": 0.004, "shift": (0.5, 2.0)}, {"timestep": 0.005, "delay": True}),
    "walk-2.5ms": ({"delay": 0.004, "shift": (0.5, 2.0)}, {"delay": True}),
    "walk-1ms": ({"delay": 0.004, "shift": (0.5, 2.0)}, {"timestep": 0.001, "delay": True}),
    "same-step": ({"timestep": 0.005}, {"timestep": 0.005}),
    "plain-walk": ({"policy": "go2-walk"}, {}),
    "noise-1": ({"noise": 1.0}, {}),
    "noise-2.5": ({"noise": 2.5}, {}),
    "noise-5": ({"noise": 5.0}, {}),
    "wass-5ms": ({}, {"timestep": 0.005, "cost": "wass"}),
}


def run(*words):
    found = subprocess.run([str(word) for word in words], cwd=ROOT, capture_output=True, text=True)
    # 3: a check or the convergence failed; the result is there.
    if found.returncode not in (0, 3):
        sys.exit(f"{' '.join(map(str, words))}\n{found.stderr}")
    return found.stdout


def fit(args, row, truth, seed, work):
    robot, how = ({**base, **own} for base, own in zip((ROBOT, FIT), ROWS[row]))
    numbers = TRUTHS[truth]
    policy = ROOT / f"assets/{robot['policy']}.safetensors"
    onnx = work / "policy.onnx"
    run(args.gaitfit, "export", policy, "--onnx", onnx)
    table = lambda values: "".join(f'"*_{group}_joint" = {value!r}\n' for group, value in zip(GROUPS, map(float, values)))
    (work / "robot.toml").write_text(
        f"timestep = {robot['timestep']}\ndelay = {robot['delay']}\ntorque_noise = {robot['noise']}\n"
        f"[frictionloss]\n{table(numbers[:3])}[armature]\n{table(numbers[3:])}"
    )
    run(sys.executable, "tools/mujoco_robot.py", "collect", "--policy", onnx, "--robot", work / "robot.toml", "--out",
        work / "logs", "--trajectories", args.logs, "--log-shift", *robot["shift"], "--base", "imu", "--seed", seed)  # fmt: skip
    config = {
        "base": "free", "policy": str(policy), "logs": [str(work / "logs")], "costs": [how["cost"]], "runs": str(work),
    }  # fmt: skip
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in config.items())
    text += '[[parameter]]\nkind = "frictionloss"\n[[parameter]]\nkind = "armature"\n'
    if how["delay"]:
        text += '[[parameter]]\nkind = "delay"\nper = "all"\nupper = 0.04\n'
    text += f"[simulation]\ntimestep = {how['timestep']}\npreset = \"{how['preset']}\"\n"
    if how["cost"] != "wass":
        text += f"robot_timestep = {robot['timestep']}\n"
    text += f"[optimizer]\nseeds = 1\nseed = {seed}\npopulation = {args.population}\ngenerations = {args.generations}\n"
    (work / "fit.toml").write_text(text)
    result = json.loads(run(args.gaitfit, "adapt", work / "fit.toml", "--name", "fit", "--json"))
    found = {one["name"]: one for one in result["parameters"]}
    names = [f"{kind}_{group}" for kind in ("frictionloss", "armature") for group in GROUPS]
    pick = lambda name: [found[name][key] for key in ("value", "interval", "identified")]
    return {
        "row": row, "truth": truth, "seed": seed, "numbers": dict(zip(names, numbers)), "found": {n: pick(n) for n in names},
        "delay": found["delay"]["value"] if how["delay"] else None, "cost": result["cost"],
        "converged": result["converged"], "seconds": result["wall_seconds"],
    }  # fmt: skip


def errors(one):
    return np.array([100 * (one["found"][name][0] / true - 1) for name, true in one["numbers"].items()])


def table(results):
    lines = ["| row | fits | mean error, % | worst fit, % | friction, % | armature, % | s a fit | not converged |", "| --- |" + " --- |" * 7]
    for row in ROWS:
        mine = [one for one in results if one["row"] == row]
        if mine:
            all_errors = np.abs([errors(one) for one in mine])
            of = lambda values: f"{np.mean(values):.2f}"
            lines.append(
                f"| {row} | {len(mine)} | {of(all_errors)} | {all_errors.mean(1).max():.2f} | {of(all_errors[:, :3])} | "
                f"{of(all_errors[:, 3:])} | {np.median([one['seconds'] for one in mine]):.0f} | "
                f"{sum(not one['converged'] for one in mine)} |"
            )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="*", help="patterns over rows, with commas [all]: " + ", ".join(ROWS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--logs", type=int, default=32, help="logs of 4 s [32]")
    parser.add_argument("--population", type=int, default=12)
    parser.add_argument("--generations", type=int, default=80)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "runs/transfer")
    parser.add_argument("--gaitfit", type=pathlib.Path, default=ROOT / "target/release/gaitfit")
    args = parser.parse_args()
    args.out, args.gaitfit = args.out.resolve(), args.gaitfit.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    patterns = args.only.split(",")
    rows = [row for row in ROWS if any(fnmatch.fnmatch(row, pattern) for pattern in patterns)]
    results = []
    for seed in range(1, args.seeds + 1):
        for row in rows:
            for truth in TRUTHS:
                kept = args.out / f"{row}-{truth}-{seed}.json"
                if not kept.exists():
                    work = pathlib.Path(tempfile.mkdtemp(dir=args.out))
                    try:
                        kept.write_text(json.dumps(fit(args, row, truth, seed, work), indent=1))
                    finally:
                        shutil.rmtree(work)
                one = json.loads(kept.read_text())
                print(f"{row} {truth} {seed}: {np.abs(errors(one)).mean():.2f} %  {np.round(errors(one), 1)}", file=sys.stderr)
                results.append(one)
    print(table(results))


if __name__ == "__main__":
    main()
