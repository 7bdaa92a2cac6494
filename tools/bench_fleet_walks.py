"""Measures what the prior of a fleet of walking robots is worth: Go2s whose numbers scatter by 20 %, and new ones with few walks.

Robots are Go2s in official MuJoCo, which is not the fit's engine, under the committed walk (tools/mujoco_robot.py): friction loss
and armature of hips, thighs and calves and the delay are log-normal around nominal values, and every joint has torque noise. A walk
has 4 s of what joints and IMU measure. `gaitfit.ray.fleet` fits each robot of the fleet to --walks of them, as `gaitfit.fit` does with
`matchr1`. New robots have 4, 8 and 16 walks, in one fit each, alone and with the fleet.

Usage: .venv/bin/python tools/bench_fleet_walks.py [--robots 8] [--new 4] [--out fleet.json]      (with gaitfit, Ray, MuJoCo)

Printed as JSON, for each number of walks: the root mean square of relative errors over new robots and numbers, alone and with the
fleet, and how often 95 % intervals contain the truth; and the scatter of each number, true and estimated.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import gaitfit
from gaitfit.config import Fit, Optimizer, Parameter, Simulation

ROOT = Path(__file__).resolve().parent.parent
POLICY = ROOT / "assets" / "go2-robust.safetensors"
KINDS = ("hip", "thigh", "calf")
CENTRES = {
    "frictionloss_hip": 0.2, "frictionloss_thigh": 0.15, "frictionloss_calf": 0.1,
    "armature_hip": 0.02, "armature_thigh": 0.02, "armature_calf": 0.05,
    "delay": 0.010,
}
COUNTS = (4, 8, 16)
Truth = dict[str, float]


class World:
    """Makes robots, their walks and their fits."""

    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.options, self.folder, self.rng = options, folder, np.random.default_rng(options.seed)
        self.onnx = folder / "walk.onnx"
        self.run(sys.executable, "-m", "gaitfit", "export", str(POLICY), "--onnx", str(self.onnx))

    def run(self, *command: str) -> None:
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        if done.returncode:
            sys.exit(f"{' '.join(command)}: {done.stderr}")

    def robot(self) -> Truth:
        """True numbers of a robot."""
        draws = np.exp(self.rng.normal(0.0, self.options.scatter, len(CENTRES)))
        truth = {name: float(value * draw) for (name, value), draw in zip(CENTRES.items(), draws)}
        # tools/mujoco_robot.py delays by whole physics steps.
        return {**truth, "delay": round(truth["delay"], 3)}

    def walks(self, name: str, truth: Truth, count: int) -> list[str]:
        """The logs of a robot's walks, 4 s each. Walks with a fall are left out, as one would not record them on purpose."""
        lines = [f'model = "{ROOT / "assets" / "go2.xml"}"', f"timestep = 0.001\ndelay = {truth['delay']}\ntorque_noise = {self.options.noise}"]
        for number in ("frictionloss", "armature"):
            lines += [f"[{number}]", *(f'"*_{kind}_joint" = {truth[f"{number}_{kind}"]}' for kind in KINDS)]
        robot, logs = self.folder / f"{name}.toml", self.folder / f"logs-{name}"
        robot.write_text("\n".join(lines) + "\n", encoding="utf-8")
        self.run(
            sys.executable, str(ROOT / "tools" / "mujoco_robot.py"), "collect", "--policy", str(self.onnx), "--robot", str(robot),
            "--out", str(logs), "--trajectories", str(2 * count), "--seconds", "4", "--base", "imu",
            "--log-shift", "0.02", "0.1", "--seed", str(int(self.rng.integers(1, 10**6))),
        )
        sound = [str(file) for file in sorted(logs.glob("*.csv")) if self.is_sound(file)]
        if len(sound) < count:
            sys.exit(f"{name} fell in {2 * count - len(sound)} of {2 * count} walks")
        return sound[:count]

    def is_sound(self, file: Path) -> bool:
        try:
            log = gaitfit.read_log(file)
        except gaitfit.GaitfitError:
            return False
        return log.duration > 3.5 and not any(one.severity == "error" for one in log.check())

    def config(self) -> Fit:
        return Fit(
            robot=ROOT / "assets" / "go2.xml",
            policy=POLICY,
            base="free",
            costs=["matchr1"],
            parameters=[
                Parameter("frictionloss", per="group"), Parameter("armature", per="group"), Parameter("delay", per="all", upper=0.04),
            ],
            simulation=Simulation(preset="fast", robot_timestep=0.001),
            optimizer=Optimizer(seeds=1),
        )


def measured(world: World) -> dict[str, object]:
    options, begun = world.options, time.monotonic()
    truths = {f"robot-{at}": world.robot() for at in range(options.robots)}
    logs = {name: world.walks(name, truth, options.walks) for name, truth in truths.items()}
    if options.alone:
        fleet = gaitfit.fleet({
            name: gaitfit.fit(world.config(), logs=files, runs=world.folder, name=name, progress=False) for name, files in logs.items()
        })
    else:
        import gaitfit.ray

        fleet = gaitfit.ray.fleet(logs, world.config(), runs=world.folder, num_cpus=1, progress=False)
    print(f"{fleet.headline} {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    rows: dict[int, list[list[list[float]]]] = {count: [] for count in COUNTS}
    for at in range(options.new):
        truth = world.robot()
        walks = world.walks(f"new-{at}", truth, max(COUNTS))
        for count in COUNTS:
            result = gaitfit.fit(world.config(), logs=walks[:count], runs=world.folder, name=f"new-{at}-{count}", progress=False)
            rows[count].append(cells(result, fleet, truth))
        print(f"new robot {at + 1} of {options.new}, {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    scatter = {
        name: {
            "true": float(np.std(np.log([truth[name] for truth in truths.values()]), ddof=1)),
            "estimated": number.scatter,
            "interval": number.scatter_interval,
            "scale": number.scale,
        }
        for name, number in fleet.numbers.items()
    }
    return {"scatter": scatter, "left_out": dict(fleet.left_out), "new": {count: summary(values) for count, values in rows.items()}}


def cells(result: gaitfit.FitResult, fleet: gaitfit.Fleet, truth: Truth) -> list[list[float]]:
    """For each number: the estimates alone and with the fleet over the truth, and whether their intervals contain it."""
    together = fleet.estimate(result)
    rows = []
    for name, true in truth.items():
        one, alone = together[name], result.parameters[name]
        intervals = (alone.interval, one.interval)
        rows.append([alone.value / true, one.value / true, *(float(ends is not None and ends[0] <= true <= ends[1]) for ends in intervals)])
    return rows


def summary(rows: list[list[list[float]]]) -> dict[str, object]:
    array = np.array(rows)

    def part(places: list[int]) -> dict[str, float]:
        chosen = array[:, places]
        errors = [float(np.sqrt(np.mean((chosen[..., at] - 1.0) ** 2))) for at in (0, 1)]
        inside = [float(np.mean(chosen[..., at])) for at in (2, 3)]
        return dict(zip(("alone", "with_fleet", "inside_alone", "inside_with_fleet"), errors + inside))

    kinds = {kind: [at for at, name in enumerate(CENTRES) if name.startswith(kind)] for kind in ("frictionloss", "armature", "delay")}
    return {"robots": len(rows), "all": part(list(range(len(CENTRES)))), **{kind: part(at) for kind, at in kinds.items()}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=8)
    parser.add_argument("--new", type=int, default=4)
    parser.add_argument("--walks", type=int, default=4, help="of each robot of the fleet")
    parser.add_argument("--noise", type=float, default=1.0, help="of torques, N·m")
    parser.add_argument("--scatter", type=float, default=0.2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--alone", action="store_true", help="fit the fleet in this process, without Ray: the same bits")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    # Workers of Ray import the package that this process has.
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(gaitfit.__file__).parent.parent), os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        found = measured(World(options, Path(name)))
        os.chdir(ROOT)
    text = json.dumps({"options": {**vars(options), "out": None}, **found}, indent=1)
    print(text)
    if options.out:
        options.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
