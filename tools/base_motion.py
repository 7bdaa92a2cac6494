"""Compares how a robot's base moved with how it moves in a simulator: numbers that no fit has seen.

Each log has one constant command. The policy walks in each simulator under the same commands. The script prints mean speed,
roll, pitch and height of the base after the first second, for logs and simulators. Heights are relative to their mean over
all commands, because the place of the marker on the base is not known. Logs with the same command are trials, in the order in
which they are named. The last line of each table is the mean distance from the first trial. Speeds and heights of the logs are
columns of motion capture. Standard library only.

Usage: python3 tools/base_motion.py POLICY LOG.csv … [--theta NAME=theta.toml …] [--robot FILE] [--gaitfit target/release/gaitfit]
"""

import argparse
import csv
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
COMMANDS = ("vx_cmd", "vy_cmd", "wz_cmd")
QUANTITIES = {"forwards, m/s": 2, "sideways, m/s": 2, "roll, rad": 3, "pitch, rad": 3, "height, m": 3}
# This part of the sorted samples is left out at each end: motion capture has outliers.
TRIMMED = 0.05


def rows_of(path):
    """Rows after the first second."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    if not rows or "time" not in rows[0]:
        sys.exit(f"error: {path} has no rows with a column `time`")
    start = float(rows[0]["time"])
    return [row for row in rows if float(row["time"]) - start > 1.0]


def mean(values):
    values = sorted(value for value in values if math.isfinite(value))
    if not values:
        return math.nan
    cut = int(TRIMMED * len(values))
    return statistics.fmean(values[cut : len(values) - cut])


def number(row, column, path):
    if column not in row:
        sys.exit(f"error: {path} has no column `{column}`")
    return float(row[column]) if row[column] else math.nan


def of_log(path, columns):
    """Speed forwards and sideways, roll, pitch and height of a log."""
    rows = rows_of(path)
    return [mean(number(row, column, path) for row in rows) for column in columns]


def of_walk(path):
    """The same for a simulated walk, whose log has the base's position, quaternion and velocity in the world."""
    samples = []
    for row in rows_of(path):
        w, x, y, z = (float(row[f"base_quat_{axis}"]) for axis in "wxyz")
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        vx, vy = (float(row[f"base_vel_{axis}"]) for axis in "xy")
        forwards, sideways = math.cos(yaw) * vx + math.sin(yaw) * vy, math.cos(yaw) * vy - math.sin(yaw) * vx
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        samples.append((forwards, sideways, roll, pitch, float(row["base_pos_z"])))
    if not samples:
        sys.exit(f"error: the simulated walk {path.name} ends within a second")
    return [mean(column) for column in zip(*samples)]


def simulate(args, theta, commands, folder):
    """The policy's walks under the commands in the simulator of `theta`."""
    plan = folder / "commands.csv"
    lines = [f"{at},0,{','.join(map(str, command))}\n" for at, command in enumerate(commands)]
    plan.write_text("trajectory,time,vx_cmd,vy_cmd,wz_cmd\n" + "".join(lines))
    command = [args.gaitfit, "collect", args.policy, "--commands", plan, "--out", folder / "walks", "--privileged"]
    command += ["--seconds", str(args.seconds)]
    command += (["--theta", theta] if theta else []) + (["--robot", args.robot] if args.robot else [])
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"error: {' '.join(map(str, command))}: {done.stderr.strip()}")
    return [of_walk(path) for path in sorted((folder / "walks").glob("*.csv"))]


def relative(motions):
    """The same with heights relative to their mean over all commands."""
    level = statistics.fmean(motion[4] for motion in motions)
    return [[*motion[:4], motion[4] - level] for motion in motions]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="the policy that walked")
    parser.add_argument("logs", nargs="+", type=pathlib.Path, help="logs with one command each, and motion capture")
    parser.add_argument("--theta", action="append", default=[], metavar="NAME=FILE", help="a fit (repeatable)")
    parser.add_argument("--robot", help="robot file, if the policy does not name it")
    parser.add_argument("--gaitfit", default=str(ROOT / "target/release/gaitfit"), help="the program")
    parser.add_argument("--seconds", type=float, default=6.0, help="length of the simulated walks, s")
    parser.add_argument(
        "--columns",
        default="vicon_vx,vicon_vy,roll,pitch,vicon_z",
        help="speed forwards, speed sideways, roll, pitch and height in the logs",
    )
    args = parser.parse_args()
    columns = args.columns.split(",")
    if len(columns) != len(QUANTITIES):
        sys.exit(f"error: --columns names {len(columns)} columns; it takes {len(QUANTITIES)}")
    trials = {}
    for path in args.logs:
        rows = rows_of(path)
        if not rows or any(row.get(name) != rows[0].get(name) for row in rows for name in COMMANDS):
            sys.exit(f"error: {path} is shorter than a second, or its command changes")
        row = rows[0]
        trials.setdefault(tuple(number(row, column, path) for column in COMMANDS), []).append(of_log(path, columns))
    commands = sorted(trials)
    sources = {"log": relative([trials[command][0] for command in commands])}
    for more in range(1, min(map(len, trials.values()))):
        sources[f"trial {more + 1}"] = relative([trials[command][more] for command in commands])
    fits = {"robot file": None, **dict(one.split("=", 1) for one in args.theta if "=" in one)}
    if any("=" not in one for one in args.theta) or len(fits) != 1 + len(args.theta) or set(fits) & set(sources):
        sys.exit("error: --theta takes NAME=FILE, and each name once")
    for name, theta in fits.items():
        with tempfile.TemporaryDirectory() as folder:
            sources[name] = relative(simulate(args, theta, commands, pathlib.Path(folder)))
    for at, (quantity, digits) in enumerate(QUANTITIES.items()):
        print(f"\n| command | {' | '.join(f'{name}: {quantity}' for name in sources)} |")
        print("| --- " * (len(sources) + 1) + "|")
        for row, command in enumerate(commands):
            numbers = " | ".join(f"{motions[row][at]:.{digits}f}" for motions in sources.values())
            print(f"| {command[0]:g}, {command[1]:g}, {command[2]:g} | {numbers} |")
        far = lambda motions: statistics.fmean(abs(a[at] - b[at]) for a, b in zip(motions, sources["log"]))
        print(f"| mean distance from the log | {' | '.join(f'{far(one):.3f}' for one in sources.values())} |")


if __name__ == "__main__":
    main()
