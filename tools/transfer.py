"""How well fits find the numbers of a robot that is not the fit's own simulator, and how well their intervals hold.

For each row (how the robot is simulated, how it is fitted), truth (friction and armature of hips, thighs and calves) and seed
it records walking logs, in official MuJoCo or with `gaitfit collect`, fits them with `gaitfit fit`, and compares. Rows of
springs have one on a joint that the fit has to find; each of their seeds has another truth. Each fit is kept; the same
command goes on where it was stopped.

Usage: .venv/bin/python tools/transfer.py [--only 'ROW,…'] [--seeds 5] [--out runs/transfer] [--gaitfit PROGRAM]
"""

import argparse
import collections
import concurrent.futures
import fnmatch
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import threading

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
ROBOT = {"engine": "mujoco", "timestep": 0.001, "delay": 0.0, "noise": 0.0, "shift": (0.02, 0.1), "policy": "go2-robust", "spring": ""}
OWN = {"engine": "gaitfit", "timestep": 0.005, "preset": "fast"}
WALK = {"delay": 0.004, "shift": (0.5, 2.0)}
FIT = {"timestep": 0.0025, "preset": "fast", "cost": "matchr1", "delay": False, "odd": False}
# What differs from ROBOT and FIT.
ROWS = {
    "mujoco-5ms": ({}, {"timestep": 0.005}),
    "mujoco-2.5ms": ({}, {}),
    "mujoco-1ms": ({}, {"timestep": 0.001}),
    "walk-5ms": (WALK, {"timestep": 0.005, "delay": True}),
    "walk-2.5ms": (WALK, {"delay": True}),
    "walk-1ms": (WALK, {"timestep": 0.001, "delay": True}),
    "same-step": ({"timestep": 0.005}, {"timestep": 0.005}),
    "own-walk": ({**OWN, "shift": (0.5, 2.0)}, {"timestep": 0.005}),
    "own-converged": ({**OWN, "preset": "converged"}, {"timestep": 0.005}),
    "own-plain": ({**OWN, "policy": "go2-walk"}, {"timestep": 0.005}),
    "mujoco-plain": ({"policy": "go2-walk"}, {}),
    "noise-1": ({"noise": 1.0}, {}),
    "noise-2.5": ({"noise": 2.5}, {}),
    "noise-5": ({"noise": 5.0}, {}),
    "noise-2.5-matcho": ({"noise": 2.5}, {"cost": "matcho"}),
    "wass-5ms": ({}, {"timestep": 0.005, "cost": "wass"}),
    "spring-none": ({}, {"odd": True}),
    # As `gaitfit collect --spring` takes them: joint, N·m/rad, and the angle of rest, rad.
    **{f"spring-calf{rest}": ({"spring": f"RR_calf_joint=75@{rest}"}, {"odd": True}) for rest in (-1.5, -1.9, -2.3)},
    **{f"spring-thigh-{rest}": ({"spring": f"FL_thigh_joint=40@{rest}"}, {"odd": True}) for rest in (0.5, 0.9, 1.3)},
}
# One at a time of each robot's logs.
RECORDING = collections.defaultdict(threading.Lock)
# Rows of many minutes a fit on a processor: one seed there.
SLOW = ("noise-2.5-matcho", "wass-5ms")


def run(*words):
    found = subprocess.run([str(word) for word in words], cwd=ROOT, capture_output=True, text=True)
    # 3: a check or the convergence failed; the result is there.
    if found.returncode not in (0, 3):
        sys.exit(f"{' '.join(map(str, words))}\n{found.stderr}")
    return found.stdout


def logs(args, robot, truth, seed):
    """The folder with a robot's logs; they are recorded once."""
    name = "-".join(str(value) for value in [*robot.values(), truth, seed]).replace(" ", "")
    folder = args.out / "logs" / name
    with RECORDING[name]:
        return folder if folder.exists() else record(args, robot, truth, seed, folder)


def spring(robot):
    """A robot's spring: joint, stiffness, N·m/rad, angle of rest, rad; no joint if it has none."""
    joint, _, numbers = robot["spring"].partition("=")
    stiffness, _, angle = numbers.partition("@")
    return joint, float(stiffness or 0), float(angle or 0)


def record(args, robot, truth, seed, folder):
    work = pathlib.Path(tempfile.mkdtemp(dir=args.out))
    policy = ROOT / f"assets/{robot['policy']}.safetensors"
    numbers = [float(value) for value in TRUTHS[truth]]
    made = work / "logs"
    if robot["engine"] == "mujoco":
        onnx = work / "policy.onnx"
        run(args.gaitfit, "export", policy, "--onnx", onnx)
        table = lambda values: "".join(f'"*_{group}_joint" = {value!r}\n' for group, value in zip(GROUPS, values))
        joint, stiffness, angle = spring(robot)
        spring_table = f'[[spring]]\njoint = "{joint}"\nstiffness = {stiffness}\nangle = {angle}\n' if joint else ""
        (work / "robot.toml").write_text(
            f"timestep = {robot['timestep']}\ndelay = {robot['delay']}\ntorque_noise = {robot['noise']}\n"
            f"[frictionloss]\n{table(numbers[:3])}[armature]\n{table(numbers[3:])}{spring_table}"
        )
        run(sys.executable, "tools/mujoco_robot.py", "collect", "--policy", onnx, "--robot", work / "robot.toml", "--out",
            made, "--trajectories", args.logs, "--log-shift", *robot["shift"], "--base", "imu", "--seed", seed, "--processes", args.threads)  # fmt: skip
    else:
        text = 'format = 2\nrobot = "go2"\ncost_name = "truth"\ncost = 0.0\n'
        for kind, values, unit in (("frictionloss", numbers[:3], "N·m"), ("armature", numbers[3:], "kg·m²")):
            for group, value in zip(GROUPS, values):
                joints = json.dumps([f"{leg}_{group}_joint" for leg in ("FL", "FR", "RL", "RR")])
                text += f'[[parameter]]\nname = "{kind}_{group}"\nkind = "{kind}"\njoints = {joints}\n'
                text += f'value = {value}\nunit = "{unit}"\nlower = 0.0\nupper = 0.5\nat_bound = false\n'
        (work / "truth.toml").write_text(text)
        run(args.gaitfit, "collect", policy, "--theta", work / "truth.toml", "--preset", robot["preset"], "--out", made,
            "--trajectories", args.logs, "--log-shift", *robot["shift"], "--privileged", "--seed", seed, "--threads", args.threads,
            *(["--spring", robot["spring"]] if robot["spring"] else []))  # fmt: skip
    folder.parent.mkdir(exist_ok=True)
    made.rename(folder)
    shutil.rmtree(work)
    return folder


def fit(args, row, truth, seed):
    robot, how = ({**base, **own} for base, own in zip((ROBOT, FIT), ROWS[row]))
    numbers = TRUTHS[truth]
    config = {
        "base": "free", "policy": str(ROOT / f"assets/{robot['policy']}.safetensors"),
        "logs": [str(logs(args, robot, truth, seed))], "costs": [how["cost"]],
    }  # fmt: skip
    if how["cost"] == "wass":
        args_of_search = f"population = {args.population}\ngenerations = {args.generations}\n"
        args_of_search += f"replicates = {args.replicates}\n"
    else:
        args_of_search = ""
    with tempfile.TemporaryDirectory(dir=args.out) as work:
        config["runs"] = work
        if how["odd"]:
            config["odd_joints"] = True
        text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in config.items())
        text += '[[parameter]]\nkind = "frictionloss"\n[[parameter]]\nkind = "armature"\n'
        if how["delay"]:
            text += '[[parameter]]\nkind = "delay"\nper = "all"\nupper = 0.04\n'
        text += f"[simulation]\ntimestep = {how['timestep']}\npreset = \"{how['preset']}\"\n"
        if how["cost"] in ("matchr1", "wass"):
            text += f"robot_timestep = {robot['timestep']}\n"
        text += f"[optimizer]\nseeds = 1\nseed = {seed}\n{args_of_search}"
        path = pathlib.Path(work) / "fit.toml"
        path.write_text(text)
        more = ["--threads", args.threads, *(["--device", args.device] if args.device != "cpu" else [])]
        result = json.loads(run(args.gaitfit, "adapt", path, "--name", "fit", "--json", *more))
    found = {one["name"]: one for one in result["parameters"]}
    names = [f"{kind}_{group}" for kind in ("frictionloss", "armature") for group in GROUPS]
    pick = lambda name: [found[name][key] for key in ("value", "interval", "identified")]
    return {
        "row": row, "truth": truth, "seed": seed, "numbers": dict(zip(names, map(float, numbers))),
        "found": {n: pick(n) for n in names}, "names": list(found), "uncertainty": result["fits"][0].get("uncertainty"),
        "correction": result["fits"][0].get("correction"), "regression": result["fits"][0].get("regression"),
        "delay": found["delay"]["value"] if how["delay"] else None, "cost": result["cost"],
        "odd": result["odd_joints"]["odd"] if how["odd"] else None, "springs": result.get("springs", []),
        "converged": result["converged"], "seconds": result["wall_seconds"],
    }  # fmt: skip


def errors(one):
    return np.array([100 * (one["found"][name][0] / true - 1) for name, true in one["numbers"].items()])


def inside(one):
    return [low <= one["numbers"][name] <= high for name, (_, (low, high), _) in one["found"].items()]


def table(results):
    head = ["row", "fits", "mean error, %", "worst fit, %", "friction, %", "armature, %", "inside 95 %", "s a fit"]
    lines = ["| " + " | ".join([*head, "not converged"]) + " |", "| --- |" + " --- |" * len(head)]
    for row in ROWS:
        mine = [one for one in results if one["row"] == row]
        if mine:
            off = np.abs([errors(one) for one in mine])
            of = lambda values: f"{np.mean(values):.2f}"
            cells = [
                row, str(len(mine)), of(off), f"{off.mean(1).max():.2f}", of(off[:, :3]), of(off[:, 3:]),
                f"{100 * np.mean([inside(one) for one in mine]):.0f} %", f"{np.median([one['seconds'] for one in mine]):.0f}",
                str(sum(not one["converged"] for one in mine)),
            ]  # fmt: skip
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def spring_table(results):
    """What fits said of springs; the largest error of those that named the joint and no other."""
    head = ["row", "fits", "the right joints and no other", "stiffness, %", "angle of rest, rad", "inside 95 %"]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " --- |" * (len(head) - 1)]
    for row, (robot, how) in ROWS.items():
        mine = [one for one in results if one["row"] == row and how.get("odd")]
        if mine:
            joint, stiffness, angle = spring({**ROBOT, **robot})
            right = [one for one in mine if one["odd"] == ([joint] if joint else [])]
            found = [one["springs"][0] for one in right if one["springs"]]
            cells = [row, str(len(mine)), f"{len(right)} of {len(mine)}", "–", "–", "–"]
            if found:
                cells[3] = f"{max(abs(100 * (one['stiffness'] / stiffness - 1)) for one in found):.2f}"
                cells[4] = f"{max(abs(one['rest'] - angle) for one in found):.4f}"
                within = lambda one, key, true: one[f"{key}_interval"][0] <= true <= one[f"{key}_interval"][1]
                held = [within(one, key, true) for one in found for key, true in (("stiffness", stiffness), ("rest", angle))]
                cells[5] = f"{sum(held)} of {len(held)}"
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) if len(lines) > 2 else ""


def kept(args, row, truth, seed):
    """A fit as it was kept, or made and kept now."""
    path = args.out / f"{row}-{truth}-{seed}.json"
    if not path.exists():
        path.write_text(json.dumps(fit(args, row, truth, seed), indent=1))
    one = json.loads(path.read_text())
    print(f"{row} {truth} {seed}: {np.abs(errors(one)).mean():.2f} %  {np.round(errors(one), 1)}", file=sys.stderr)
    return one


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="*", help="patterns over rows, with commas [all]: " + ", ".join(ROWS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--logs", type=int, default=32, help="logs of 4 s [32]")
    parser.add_argument("--population", type=int, default=12, help="of wass [12]")
    parser.add_argument("--generations", type=int, default=100, help="of wass [100]")
    parser.add_argument("--replicates", type=int, default=4, help="of wass [4]; 0: as the search finds them")
    parser.add_argument("--threads", type=int, default=2, help="of a fit [2]")
    parser.add_argument("--device", default="cpu", help="of a fit, as of `gaitfit fit` [cpu]")
    parser.add_argument("--at-once", type=int, default=1, help="fits that run beside each other [1]")
    parser.add_argument("--first", type=int, default=1, help="first seed [1]")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "runs/transfer")
    parser.add_argument("--json", type=pathlib.Path, help="a file for all fits together")
    parser.add_argument("--gaitfit", type=pathlib.Path, default=ROOT / "target/release/gaitfit")
    args = parser.parse_args()
    args.out, args.gaitfit = args.out.resolve(), args.gaitfit.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    patterns = args.only.split(",")
    rows = [row for row in ROWS if any(fnmatch.fnmatch(row, pattern) for pattern in patterns)]
    jobs = [
        (row, truth, seed)
        for seed in range(args.first, args.seeds + 1)
        for row in rows
        for number, truth in enumerate(TRUTHS, start=1)
        if (seed == 1 or row not in SLOW or args.device != "cpu") and (not row.startswith("spring") or (seed - number) % len(TRUTHS) == 0)
    ]
    with concurrent.futures.ThreadPoolExecutor(args.at_once) as pool:
        results = list(pool.map(lambda job: kept(args, *job), jobs))
    if args.json:
        args.json.write_text(json.dumps(results))
    print(table(results))
    print(spring_table(results))


if __name__ == "__main__":
    main()
