"""Trains the tasks that `tools/init_table.py --out FOLDER` wrote, and prints which robots walk, in our simulator and in MuJoCo.

Each NAME.toml of the folder is trained on its own within a budget of time, its policy evaluated over 500 trajectories of
random commands, exported to ONNX and walked in official MuJoCo if that package is installed.
A robot walks if at most 2 % of the
trajectories end in a fall and its velocity error is less than half of that of a robot that stands still. Results go to
FOLDER/walks.csv line by line, so that a run that was cut off resumes.

Usage, on a machine with a GPU: python3 tools/train_robots.py tried --gaitfit ./gaitfit --seconds 180 [--only NAME ...]
"""

import argparse
import csv
import json
import pathlib
import signal
import subprocess
import sys
import time

COLUMNS = ["robot", "trained_s", "iterations", "error", "yaw_error", "falls", "walks", "mujoco_error", "mujoco_falls", "mujoco", "note"]
HERE = pathlib.Path(__file__).parent


def run(command, seconds, **more):
    """Exit code (None after the time limit), standard output, standard error."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more) as process:
        try:
            out, errors = process.communicate(timeout=seconds)
            return process.returncode, out, errors
        except subprocess.TimeoutExpired:
            # As Ctrl-C: the training writes a checkpoint, and ends.
            process.send_signal(signal.SIGINT)
            out, errors = process.communicate()
            return None, out, errors


def evaluate(args, policy, row):
    code, out, errors = run(
        [args.gaitfit, "evaluate", policy, "--json", "--trajectories", "500", "--drift", "0", "--device", args.device], 300
    )
    if not out.strip().startswith("{"):
        row["note"] = f"evaluate: {errors.strip()[-160:]}"
        return
    found = json.loads(out)
    row["error"] = found["linear_velocity_error"]["mean"]
    row["yaw_error"] = found["angular_velocity_error"]["mean"]
    row["falls"] = found["fall_rate"]["mean"]
    row["walks"] = code == 0 and "Walks" in found.get("verdict", "")
    row["note"] = "" if row["walks"] else found.get("verdict", "")[:160]


def in_mujoco(args, robot, policy, row):
    onnx = policy.with_suffix(".onnx")
    code, _, errors = run([args.gaitfit, "export", str(policy), "--onnx", str(onnx)], 120)
    if code != 0:
        row["mujoco"] = f"export: {errors.strip()[-100:]}"
        return
    command = [sys.executable, str(HERE / "walk_mujoco.py"), str(onnx), "--model", str(robot), "--trajectories", "100", "--json"]
    code, out, errors = run([*command, "--processes", str(args.processes)], 600)
    if not out.strip().startswith("{"):
        row["mujoco"] = f"not walked: {(errors.strip().splitlines() or ['no output'])[-1][:120]}"
        return
    found = json.loads(out)
    row["mujoco_error"] = found["linear_velocity_error"]["mean"]
    row["mujoco_falls"] = found["fall_rate"]["mean"]
    still = row["error"] if row["error"] is not None else float("inf")
    near = row["mujoco_error"] is not None and row["mujoco_error"] <= 1.5 * still
    row["mujoco"] = "walks" if row["walks"] and near and (row["mujoco_falls"] or 0.0) <= 0.02 else "no"


def one(args, configuration):
    """Trains, evaluates and walks one robot."""
    name = configuration.stem
    row = dict.fromkeys(COLUMNS)
    row["robot"] = name
    begin = time.monotonic()
    command = [args.gaitfit, "train", configuration.name, "--json", "--name", name, "--device", args.device]
    for setting in args.set:
        command += ["--set", setting]
    runs = configuration.parent / "runs"
    code, out, errors = run(command, args.seconds, cwd=configuration.parent)
    row["trained_s"] = round(time.monotonic() - begin, 1)
    results = json.loads(out) if out.strip().startswith("{") else None
    if results:
        row["iterations"] = results["seeds"][0]["iterations"]
    policies = sorted((runs).glob(f"{name}*/seed-1/policy.safetensors"), key=lambda path: path.stat().st_mtime)
    if not policies:
        why = "not done in the time" if code is None else errors.strip()[-200:]
        row["note"] = f"train: {why}"
        return row
    policy = policies[-1]
    evaluate(args, str(policy), row)
    mended = configuration.with_suffix(".xml")
    named = next((line for line in configuration.read_text().splitlines() if line.startswith("robot = ")), "")
    robot = mended if mended.exists() else configuration.parent / json.loads(named.partition(" = ")[2] or '""')
    in_mujoco(args, robot, policy, row)
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--gaitfit", default="target/release/gaitfit")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--seconds", type=float, default=180.0, help="budget of one training")
    parser.add_argument("--set", action="append", default=[], help="a setting of all trainings, e.g. train.iterations=300")
    parser.add_argument("--only", nargs="+", help="names of robots")
    parser.add_argument("--processes", type=int, default=8, help="of MuJoCo")
    args = parser.parse_args()
    args.gaitfit = str(pathlib.Path(args.gaitfit).resolve())
    table = args.folder / "walks.csv"
    done = set()
    if table.exists():
        with table.open() as file:
            done = {row["robot"] for row in csv.DictReader(file)}
    for configuration in sorted(args.folder.glob("*.toml")):
        if configuration.stem in done or (args.only and configuration.stem not in args.only):
            continue
        row = one(args, configuration.resolve())
        with table.open("a", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow(row)
        print(json.dumps(row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
