"""Runs `gaitfit loop` with Unitree's simulator server as the robot, its Go2 altered, and measures drift before and after.

For each seed, side by side, each on a DDS domain of its own: starts tools/link_server.py with the altered Go2; has
`gaitfit loop` collect walks from it, fit, and train; then has the first and the new policy walk drift trials, each on a
fresh server. A trial is the paper's: stand, a constant command for 4 s, stand. What is measured is how far from where it
should the robot ends, seen from where it was when the command began: m, and rad of heading. The server says where it was.

The vendor's feet resist turning on the spot, those of the built-in Go2 do not, and no joint's friction can stand for it:
fit and training have the built-in Go2 with the contact that the vendor's file gives its feet (OUT/go2.xml). With
`--built-in-feet` they have it as it is. Nothing of how the server's Go2 was altered is told to them.

A round trains twice, with physics steps of 2.5 ms, and the loop takes the policy that follows best in the fitted simulator
(`--trainings`, `--substeps`). Look at `pace` in the results: a server that does not keep real time spoils the logs.

Writes OUT/seed-N.json for each seed as soon as it is done, and OUT/drift.json with all of them; what programs say is in
OUT/seed-N.log. A seed that fails says why in its file, and the others go on.

Needs a `gaitfit` that was built with `--features dds`, the packages numpy, mujoco and cyclonedds, and the vendor's
software (tools/link_server.py --vendor).
Usage: python tools/go2_loop.py --gaitfit target/release/gaitfit --out FOLDER [--seeds 1,2,3,4,5] [--threads 3]
       [--walks 16] [--iterations 150] [--speeds 0.5,0.5,0.5] ...; --help says the rest
"""

import argparse
import concurrent.futures
import csv
import json
import math
import os
import pathlib
import subprocess
import sys
import time
import traceback
import xml.etree.ElementTree as ElementTree

ROOT = pathlib.Path(__file__).resolve().parent.parent
TRIALS = [("+x", 0, 1), ("-x", 0, -1), ("+y", 1, 1), ("-y", 1, -1), ("+yaw", 2, 1), ("-yaw", 2, -1)]
STAND, COMMAND = 1.5, 4.0


def robot_file(arguments):
    """Writes the built-in Go2 with feet that touch the ground as the vendor's do; "" for the built-in one as it is."""
    if arguments.built_in_feet:
        return ""
    vendor = ElementTree.parse(arguments.vendor / "unitree_mujoco/unitree_robots/go2/go2.xml").getroot()
    tree = ElementTree.parse(ROOT / "assets/go2.xml")
    foot = 'default//default[@class="foot"]/geom'
    for path, names in [(foot, ("condim", "friction")), ("option", ("cone", "impratio"))]:
        for name in names:
            tree.getroot().find(path).set(name, vendor.find(path).get(name))
    path = arguments.out / "go2.xml"
    tree.write(path, encoding="unicode")
    return str(path)


def loop_config(arguments, seed, folder):
    """The loop's settings: how the fit and the training differ from the defaults."""
    return f"""policy = {json.dumps(str(arguments.policy))}
robot = {json.dumps(arguments.robot)}
runs = {json.dumps(str(folder))}
held_out = 0

[target]
kind = "unitree-go2"
interface = "{arguments.interface}"
domain = {arguments.domain + seed - 1}
yes = true
patience = {arguments.patience}
trajectories = {arguments.walks}
seconds = 4.0
pause = 1.0
seed = {1000 * seed}
last_walk = false

[adapt]
costs = ["matchr1"]
simulation = {{ robot_timestep = {arguments.dt}, preset = "{arguments.preset}" }}
optimizer = {{ seeds = 1, seed = {seed}, restarts = 0, replicates = {arguments.replicates} }}

[[adapt.parameter]]
kind = "frictionloss"
per = "all"
joints = ["*"]
upper = 1.5

[[adapt.parameter]]
kind = "armature"
per = "all"
joints = ["*"]

[[adapt.parameter]]
kind = "damping"
per = "all"
joints = ["*"]

[[adapt.parameter]]
kind = "delay"
per = "all"
joints = ["*"]

[[adapt.number]]
kind = "payload_mass"

[finetune]
preset = "{arguments.preset}"
seeds = {[seed + 100 * number for number in range(arguments.trainings)]}
train = {{ environments = {arguments.environments}, iterations = {arguments.iterations} }}

[finetune.task]
substeps = {arguments.substeps}
tracking_width = {arguments.width}
yaw_tracking_width = {arguments.width}
rewards = {{ track_yaw_rate = {arguments.yaw_weight} }}

[evaluate]
trajectories = 64
drift = 4
seed = {seed}
"""


class Server:
    """The vendor's server on a domain, as long as it is asked for."""

    def __init__(self, arguments, domain, log, seconds=600):
        options = ["frictionloss", "armature", "payload", "dt"]
        words = [sys.executable, str(ROOT / "tools/link_server.py"), str(ROOT / "crates/gaitfit-robot/robots/go2.toml")]
        words += ["--model", str(arguments.vendor / "unitree_mujoco/unitree_robots/go2/go2.xml")]
        words += ["--vendor", str(arguments.vendor)]
        words += ["--domain", str(domain), "--interface", arguments.interface, "--seconds", str(seconds)]
        for name in options:
            words += [f"--{name}", str(getattr(arguments, name))]
        words.append("--real-time")
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, env=environment
        )
        if not self.process.stdout.readline():
            raise RuntimeError("the server did not start; the log says why")

    def end(self):
        """Ends it; what it saw."""
        out, _ = self.process.communicate("", timeout=60)
        return json.loads(out.splitlines()[-1])


def call(words, log, timeout):
    """Runs a program to its end; what it printed."""
    print("$", *words, file=log, flush=True)
    done = subprocess.run(
        words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, text=True, timeout=timeout, check=False
    )
    if done.returncode:
        raise RuntimeError(f"`{' '.join(words[:3])} …` ended with {done.returncode}; the log says why")
    return done.stdout


def attempts(arguments, log, attempt):
    """What `attempt(number)` gives, tried anew where it fails: on a busy machine the guard stops walks now and then."""
    for number in range(1, arguments.attempts + 1):
        try:
            return attempt(number)
        except (RuntimeError, subprocess.TimeoutExpired):
            if number == arguments.attempts:
                raise
            traceback.print_exc(file=log)
    raise AssertionError


def trial_commands(path, speeds, repeats):
    """The commands of all trials, one after another; when each trial begins, s, and its command."""
    trials, rows, now = [], [], 0.0
    for _ in range(repeats):
        for name, axis, sign in TRIALS:
            command = [0.0, 0.0, 0.0]
            command[axis] = sign * speeds[axis]
            rows += [[now, 0.0, 0.0, 0.0], [now + STAND, *command]]
            trials.append((name, now + STAND, command))
            now += STAND + COMMAND
            rows.append([now, 0.0, 0.0, 0.0])
            now += STAND
            rows.append([now, 0.0, 0.0, 0.0])
    kept = [row for row, following in zip(rows, rows[1:], strict=False) if following[0] > row[0]] + rows[-1:]
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "vx", "vy", "wz"])
        writer.writerows(kept)
    return trials


def pose_at(path, when):
    """Where the base was, between two rows of the server's path: x, y, m, heading, rad."""
    after = next((index for index, row in enumerate(path) if row[4] >= when), None)
    if not after:
        raise RuntimeError("the server's path does not cover the walk")
    first, second = path[after - 1], path[after]
    part = (when - first[4]) / max(second[4] - first[4], 1e-9)
    turn = math.remainder(second[3] - first[3], math.tau)
    x, y = (first[k] + part * (second[k] - first[k]) for k in range(2))
    return x, y, first[3] + part * turn


def loop(arguments, domain, config, log):
    """A round of the loop. One that was stopped goes on: what was walked is not walked again."""

    def attempt(number):
        server = Server(arguments, domain, log)
        try:
            words = [str(arguments.gaitfit), "loop", str(config), "--json", "--device", arguments.device]
            resume = ["--resume"] if number > 1 else []
            found = json.loads(call([*words, "--threads", str(arguments.threads), *resume], log, 1800))
        finally:
            seen = server.end()
        return found | {"pace": seen["pace"]}

    return attempts(arguments, log, attempt)


def drift(arguments, policy, domain, folder, log):
    """Drift trials of a policy on a fresh server, which lies on its belly at first."""
    return attempts(
        arguments, log, lambda number: drift_once(arguments, policy, domain, folder.with_name(f"{folder.name}-{number}"), log)
    )


def drift_once(arguments, policy, domain, folder, log):
    """The trials once."""
    folder.mkdir(parents=True, exist_ok=True)
    trials = trial_commands(folder / "trials.csv", arguments.speeds, arguments.repeats)
    server = Server(arguments, domain, log)
    try:
        words = [str(arguments.gaitfit), "run", str(policy), "--robot", "unitree-go2", "--interface", arguments.interface]
        words += ["--domain", str(domain), "--yes", "--patience", str(arguments.patience), "--json"]
        words += ["--commands", str(folder / "trials.csv"), "--out", str(folder / "run")]
        summary = json.loads(call(words, log, 300))
    finally:
        seen = server.end()
    walk = folder / "run" / "walk.csv"
    with open(walk, encoding="utf-8") as file:
        last = list(file)[-1]
    # The last row is written when it is known: what it says of the time since the walk began ties both clocks together.
    began = walk.stat().st_mtime - float(last.split(",")[0])
    found = []
    for name, at, command in trials:
        x, y, heading = pose_at(seen["path"], began + at)
        end_x, end_y, end_heading = pose_at(seen["path"], began + at + COMMAND + STAND - 0.2)
        cos, sin = math.cos(heading), math.sin(heading)
        along = cos * (end_x - x) + sin * (end_y - y) - COMMAND * command[0]
        aside = cos * (end_y - y) - sin * (end_x - x) - COMMAND * command[1]
        turn = math.remainder(end_heading - heading - COMMAND * command[2], math.tau)
        found.append(
            {"trial": name, "command": command, "x": along, "y": aside, "heading": turn, "distance": math.hypot(along, aside)}
        )
    mean = lambda numbers: sum(numbers) / len(numbers)  # noqa: E731
    return {
        "position_drift": mean([one["distance"] for one in found]),
        "heading_drift": mean([abs(one["heading"]) for one in found]),
        "trials": found,
        "least_up": seen["least_up"],
        "held_up": seen["held_up"],
        "pace": seen["pace"],
        "state_age_ms": summary["state_age_ms"],
        "clamped": summary["clamped"],
        "commands": summary["commands"],
    }


def one_seed(arguments, seed):
    """The whole experiment of a seed."""
    domain = arguments.domain + seed - 1
    folder = arguments.out / f"seed-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    times = {}

    def lap(name):
        times[name] = round(time.monotonic() - begun - sum(times.values()), 1)

    found = {"seed": seed, "domain": domain}
    with open(arguments.out / f"seed-{seed}.log", "w", encoding="utf-8") as log:
        try:
            config = folder / "loop.toml"
            config.write_text(loop_config(arguments, seed, folder), encoding="utf-8")
            # Beside the loop, on a server of its own.
            with concurrent.futures.ThreadPoolExecutor(1) as beside:
                before = beside.submit(
                    drift, arguments, arguments.policy, domain + max(arguments.seeds), folder / "before", log
                )
                result = loop(arguments, domain, config, log)
                lap("loop")
                found["before"] = before.result()
            fit = result["rounds"][0]["adapt"]["fits"][0]
            found["loop"] = {key: result[key] for key in ("stage_seconds", "warnings", "doubts", "policy", "pace")}
            found["fit"] = {key: fit[key] for key in fit if key in ("cost_name", "cost", "nominal_cost", "parameters")}
            found["after"] = drift(arguments, result["policy"], domain, folder / "after", log)
            lap("drift after")
            for what in ("position_drift", "heading_drift"):
                found[f"{what}_ratio"] = found["after"][what] / found["before"][what]
        except Exception as error:  # noqa: BLE001 - one seed must not end the others
            traceback.print_exc(file=log)
            found["error"] = f"{type(error).__name__}: {error}"
    found["seconds"] = times
    (arguments.out / f"seed-{seed}.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    said = found.get("error") or ", ".join(
        f"{what.replace('_', ' ')} {found['before'][what]:.3f} -> {found['after'][what]:.3f}"
        for what in ("position_drift", "heading_drift")
    )
    print(f"seed {seed}: {said} ({sum(times.values()):.0f} s)", flush=True)
    return found


def summary(arguments, seeds):
    """All seeds, and the mean over those that came to an end with its 95 % interval."""
    done = [seed for seed in seeds if "error" not in seed]
    quantile = {2: 12.706, 3: 4.303, 4: 3.182, 5: 2.776, 6: 2.571, 7: 2.447, 8: 2.365, 9: 2.306, 10: 2.262}

    def estimate(numbers):
        count = len(numbers)
        mean = sum(numbers) / count
        if count not in quantile:
            return {"mean": mean, "ci95": None}
        deviation = math.sqrt(sum((number - mean) ** 2 for number in numbers) / (count - 1))
        return {"mean": mean, "ci95": quantile[count] * deviation / math.sqrt(count)}

    found = {"settings": {key: str(value) for key, value in vars(arguments).items()}, "failed": len(seeds) - len(done)}
    for what in ("position_drift", "heading_drift") if done else ():
        found[what] = {when: estimate([seed[when][what] for seed in done]) for when in ("before", "after")}
        found[what]["ratio"] = estimate([seed[f"{what}_ratio"] for seed in done])
    return {**found, "seeds": seeds}


def main():
    numbers = lambda kind: lambda text: [kind(part) for part in text.split(",")]  # noqa: E731
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gaitfit", type=pathlib.Path, required=True, help="the program, built with --features dds")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for all that is made; it must be new")
    parser.add_argument("--policy", type=pathlib.Path, default=ROOT / "assets/go2-walk.safetensors")
    parser.add_argument("--vendor", type=pathlib.Path, default=ROOT.parent / "shared/third_party")
    parser.add_argument("--interface", default="lo")
    parser.add_argument(
        "--domain", type=int, default=1, help="domain of seed 1; seed N has this plus N - 1, and another for its first drift"
    )
    parser.add_argument("--seeds", type=numbers(int), default=[1, 2, 3, 4, 5], help="numbers with commas")
    parser.add_argument("--jobs", type=int, default=5, help="seeds side by side")
    parser.add_argument("--device", default="cpu", help="of fit and training: cpu or cuda")
    parser.add_argument("--threads", type=int, default=3, help="threads of each seed's fit and training")
    parser.add_argument("--walks", type=int, default=16, help="walks of 4 s that the loop collects")
    parser.add_argument(
        "--replicates",
        type=int,
        default=0,
        help="sets of simulated logs that the fit is corrected by; 0: not at all, for a server's clock in Python makes noise "
        "that is none of the robot's",
    )
    parser.add_argument(
        "--trainings", type=int, default=2, help="of a round; the policy is taken that does best where it was trained"
    )
    parser.add_argument("--iterations", type=int, default=150, help="of a training")
    parser.add_argument("--environments", type=int, default=2048, help="robots of the training")
    parser.add_argument(
        "--preset",
        default="accurate",
        choices=["fast", "accurate"],
        help="of the simulators of fit and training: the vendor's stiff feet (impratio 100) need accurate",
    )
    parser.add_argument("--substeps", type=int, default=8, help="physics steps of the training in a control period of 20 ms")
    parser.add_argument("--width", type=float, default=0.25, help="widths of the rewards for tracking, m/s and rad/s")
    parser.add_argument("--yaw-weight", type=float, default=5.0, help="weight of the reward for the yaw rate")
    parser.add_argument("--built-in-feet", action="store_true", help="fit and train with the built-in Go2's feet")
    parser.add_argument("--speeds", type=numbers(float), default=[0.5, 0.5, 0.5], help="of the trials: m/s, m/s, rad/s")
    parser.add_argument("--repeats", type=int, default=1, help="of each trial")
    parser.add_argument("--attempts", type=int, default=3, help="of walks that the guard stops")
    parser.add_argument("--patience", type=int, default=300, help="how old a state may be, ms")
    parser.add_argument("--frictionloss", type=float, default=0.15, help="what the server's Go2 has more, N·m")
    parser.add_argument("--armature", type=float, default=0.02, help="what it has more, kg·m²")
    parser.add_argument("--payload", type=float, default=2.0, help="on its base, kg")
    parser.add_argument("--dt", type=float, default=0.002, help="physics step of the server, s")
    arguments = parser.parse_args()
    if len(arguments.speeds) != 3:
        parser.error("--speeds: give three numbers: ahead, aside, m/s, and turning, rad/s")
    if arguments.out.exists() and any(arguments.out.iterdir()):
        parser.error(f"--out: {arguments.out} is not empty; name a new folder")
    for name in ("gaitfit", "policy", "vendor"):
        path = getattr(arguments, name).resolve()
        if not path.exists():
            parser.error(f"--{name}: {path} is not there")
        setattr(arguments, name, path)
    arguments.out = arguments.out.resolve()
    arguments.out.mkdir(parents=True, exist_ok=True)
    arguments.robot = robot_file(arguments)
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        seeds = list(pool.map(lambda seed: one_seed(arguments, seed), arguments.seeds))
    found = summary(arguments, seeds)
    (arguments.out / "drift.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    print(json.dumps({key: found[key] for key in found if key not in ("seeds", "settings")}, indent=2))
    sys.exit(1 if found["failed"] else 0)


if __name__ == "__main__":
    main()
