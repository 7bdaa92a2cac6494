"""Walks of a real robot as a test: what logs say without a simulation, and a fit of one trial validated on another.

The archive holds a folder of walks named COMMAND_trialN.csv (and one of another simulator's walks, if there is one), and the
policy that walked. For each trial it prints the tables of `gaitfit inspect`; with --fit it fits trial 1 and validates on
trial 2. Standard library only.

Usage: python3 tools/real_walks.py ARCHIVE.tar.xz [--gaitfit target/release/gaitfit] [--robot assets/go2.xml] [--fit] [--set KEY=VALUE …]
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys
import tarfile
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent


def run(command, folder, accept=(0, 3)):
    """Runs the program in a folder; exit code 3 says that a check did not hold, which is a result."""
    print("$", *command, flush=True)
    done = subprocess.run(command, cwd=folder)
    if done.returncode not in accept:
        sys.exit(f"error: {command[0]} ended with exit code {done.returncode}")
    return done.returncode


def without_simulation(program, robot, folder):
    """The document that `inspect --json` prints of a folder."""
    command = [program, "inspect", str(folder), "--robot", robot, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"error: {' '.join(command)}: {done.stderr.strip()}")
    return json.loads(done.stdout).get("without_simulation")


def row(name, found):
    swings = found and found["swings"]
    if not swings:
        return f"| {name} | {found and found['why_not']} | | | |"
    number = lambda one, scale=1.0, digits=3: f"{scale * one['value']:.{digits}f} ± {scale * one['error']:.{digits}f}"
    listed = lambda key, digits: ", ".join(number(group[key], 1.0, digits) for group in swings["groups"])
    delay = number(swings["delay"], 1e3, 1)
    return f"| {name} | {listed('friction', 3)} | {listed('damping', 3)} | {listed('armature', 4)} | {delay} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archive", type=pathlib.Path, help="tar archive of walks")
    parser.add_argument("--gaitfit", default=str(ROOT / "target/release/gaitfit"), help="the program")
    parser.add_argument("--robot", default=str(ROOT / "assets/go2.xml"), help="robot file")
    parser.add_argument("--fit", action="store_true", help="fit trial 1 and validate on trial 2 too")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of the fit (repeatable)")
    parser.add_argument("--out", type=pathlib.Path, help="folder to unpack into and to fit in [a temporary one]")
    args = parser.parse_args()
    # The fit runs in another folder.
    args.robot = str(pathlib.Path(args.robot).resolve())
    args.gaitfit = str(pathlib.Path(args.gaitfit).resolve())
    if shutil.which(args.gaitfit) is None:
        sys.exit(f"error: {args.gaitfit} is not there; build it with `cargo build --release`, or give --gaitfit")
    with tempfile.TemporaryDirectory() as temporary:
        place = (args.out or pathlib.Path(temporary)).resolve()
        place.mkdir(parents=True, exist_ok=True)
        with tarfile.open(args.archive) as archive:
            archive.extractall(place, filter="data")
        groups = {}
        for path in sorted(place.rglob("*.csv")):
            if "by-trial" in path.relative_to(place).parts:
                continue
            trial = path.stem.rsplit("_", 1)[-1]
            if trial.startswith("trial") or trial == "sim":
                groups.setdefault(f"{path.parent.name} {trial}", []).append(path)
        if not groups:
            sys.exit(f"error: {args.archive} holds no walks named COMMAND_trialN.csv or COMMAND_sim.csv")
        rows, folders = [], {}
        for name, files in groups.items():
            folder = folders[name] = place / "by-trial" / name.replace(" ", "-")
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            for path in files:
                shutil.copy(path, folder)
            rows.append(row(f"{name}, {len(files)} walks", without_simulation(args.gaitfit, args.robot, folder)))
        print("| walks | friction, N·m | damping, N·m·s/rad | armature, kg·m² | delay, ms |\n| --- | --- | --- | --- | --- |")
        print("\n".join(rows), flush=True)
        if not args.fit:
            return
        real = sorted(name for name in groups if name.rsplit(" ", 1)[-1].startswith("trial"))
        policies = sorted(place.rglob("*.safetensors"))
        if len(real) < 2 or not policies:
            sys.exit("error: a fit needs two trials and the policy (.safetensors) in the archive")
        configuration = place / "adapt.toml"
        entries = {"name": "real-walks", "robot": args.robot, "policy": str(policies[0]), "logs": [str(folders[real[0]])]}
        configuration.write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in entries.items()))
        settings = [part for one in args.set for part in ("--set", one)]
        run([args.gaitfit, "adapt", str(configuration), *settings], place)
        theta = place / "runs" / "real-walks" / "theta.toml"
        run([args.gaitfit, "validate", str(theta), *map(str, sorted(folders[real[1]].glob("*.csv")))], place)


if __name__ == "__main__":
    main()
