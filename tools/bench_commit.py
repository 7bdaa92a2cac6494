#!/usr/bin/env python3
"""Measures the speed of a built program and appends it, with the commit, to docs/results/benchmarks.csv.

One row a benchmark. `load` is the system's load (one minute) before it: a number above the idle machine's says that the
speed is too low. Compare rows of one machine and one profile alone.

Usage: tools/bench_commit.py [--gaitfit target/release/gaitfit] [--profile release] [--train]
"""

import argparse
import csv
import datetime
import json
import os
import pathlib
import platform
import subprocess

ROOT = pathlib.Path(__file__).parent.parent
FILE = ROOT / "docs" / "results" / "benchmarks.csv"
HEADER = ["date", "commit", "profile", "machine", "load", "benchmark", "value", "unit"]


def output(*words):
    return subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def commit():
    """The short hash; + if files differ from it."""
    changed = output("git", "status", "--porcelain", "--untracked-files=no")
    return output("git", "rev-parse", "--short", "HEAD") + ("+" if changed else "")


def machine(isa):
    model = platform.processor() or platform.machine()
    info = pathlib.Path("/proc/cpuinfo")
    if info.exists():
        names = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        model = names[0] if names else model
    return f"{model}, {os.cpu_count()} threads, {isa}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gaitfit", default=str(ROOT / "target" / "release" / "gaitfit"))
    parser.add_argument("--profile", default="release", help="how the program was built")
    parser.add_argument("--train", action="store_true", help="measure iterations of PPO too, about half a minute")
    args = parser.parse_args()
    runs = [(f"physics, {preset}, one thread", ["physics", "--preset", preset]) for preset in ("fast", "accurate")]
    if args.train:
        runs.append(("train, 4,096 robots, all threads", ["train"]))
    rows = []
    for name, words in runs:
        load = os.getloadavg()[0]
        found = json.loads(output(args.gaitfit, "bench", *words, "--device", "cpu", "--json"))
        if words[0] == "physics":
            value, unit = found["substeps_per_second"] / 1e6, "million steps/s"
        else:
            value, unit = found["iteration_seconds"], "s/iteration"
        today = datetime.date.today().isoformat()
        rows.append([today, commit(), args.profile, machine(found["isa"]), f"{load:.2f}", name, f"{value:.3f}", unit])
        print(name, f"{value:.3f}", unit)
    new = not FILE.exists()
    with FILE.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(([HEADER] if new else []) + rows)


if __name__ == "__main__":
    main()
