"""Measures what the prior of a fleet is worth: robots whose numbers scatter by 20 %, and new robots with few logs.

Robots are simulated Go2s that walk with a policy. Friction loss and armature of each joint kind are log-normal around nominal
values, and motors have torque noise. A log is a walk of --seconds with a command of its own. `gaitfit.fit` fits every robot of
the fleet to --fleet-logs logs with the cost `matchr1`, and `gaitfit.fleet` describes all of them. New robots are fitted to 1, 2,
4 and 8 logs, alone and combined with the fleet.

Usage: .venv/bin/python tools/bench_fleet.py [--robots 12] [--new 8] [--out fleet.json]      (with the package gaitfit)

Printed as JSON: for each number of logs the root mean square of relative errors over new robots and numbers, alone and with
the fleet, how often 95 % intervals contain the truth, and the scatter of each number, true and estimated.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import gaitfit
from gaitfit.config import Fit, Optimizer, Parameter

POLICY = Path(__file__).parent.parent / "assets" / "go2-walk.safetensors"
NOMINAL = {
    "frictionloss": {"hip": 0.21, "thigh": 0.17, "calf": 0.62},
    "armature": {"hip": 0.015, "thigh": 0.019, "calf": 0.047},
}
NAMES = [f"{kind}_{joint}" for kind, joints in NOMINAL.items() for joint in joints]
CENTRES = np.array([value for joints in NOMINAL.values() for value in joints.values()])
COUNTS = (1, 2, 4, 8)
Truth = dict[str, float]
#: For each number: estimate alone and with the fleet over the truth, whether the intervals contain it, and their widths over it.
Cells = list[list[float]]


class World:
    """Makes robots, their logs and their fits."""

    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.options, self.folder, self.rng = options, folder, np.random.default_rng(options.seed)

    def robot(self) -> Truth:
        """True numbers of a robot."""
        values = CENTRES * np.exp(self.rng.normal(0.0, self.options.scatter, len(NAMES)))
        return dict(zip(NAMES, values.tolist()))

    def logs(self, name: str, truth: Truth, count: int) -> list[Path]:
        """Logs of a robot: as many as the program collects at a time, of which the first are kept."""
        text = "format = 2\n"
        for number, value in truth.items():
            kind, joint = number.rsplit("_", 1)
            text += f'\n[[parameter]]\nname = "{number}"\nkind = "{kind}"\njoints = ["*_{joint}_joint"]\nvalue = {value!r}\n'
        theta = self.folder / f"{name}.toml"
        theta.write_text(text, encoding="utf-8")
        out = self.folder / f"{name}-logs"
        seed = int(self.rng.integers(2**31))
        gaitfit.collect(
            POLICY, out, trajectories=max(COUNTS), seconds=self.options.seconds, theta=theta, seed=seed,
            torque_noise=self.options.torque_noise, progress=False,
        )
        return sorted(out.glob("*.csv"))[:count]

    def fit(self, logs: list[Path], name: str) -> gaitfit.FitResult:
        parameters = [Parameter("frictionloss", per="group", upper=2.0), Parameter("armature", per="group", upper=0.2)]
        config = Fit(
            parameters=parameters, optimizer=Optimizer(replicates=self.options.replicates), swings=False, effects=False,
            odd_joints=False,
        )
        return gaitfit.fit(config, logs=logs, policy=POLICY, costs="matchr1", runs=self.folder, name=name, progress=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--new", type=int, default=8)
    parser.add_argument("--fleet-logs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=11.0)
    parser.add_argument("--scatter", type=float, default=0.2)
    parser.add_argument("--torque-noise", type=float, default=2.5, help="N·m")
    parser.add_argument("--replicates", type=int, default=2, help="sets of simulated logs that correct a fit")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        # Each new robot makes the numbers surer; what is there already is kept.
        for found in measured(World(options, Path(name))):
            text = json.dumps({"options": {**vars(options), "out": None}, **found}, indent=1)
            if options.out:
                options.out.write_text(text + "\n", encoding="utf-8")
    print(text)


def measured(world: World) -> Iterator[dict[str, object]]:
    """The measured numbers after each new robot."""
    options = world.options
    truths, fits = [], {}
    for at in range(options.robots):
        truths.append(world.robot())
        name = f"robot-{at}"
        fits[name] = world.fit(world.logs(name, truths[-1], options.fleet_logs), name)
        print(f"{name} of {options.robots}", flush=True)
    fleet = gaitfit.fleet(fits)
    own = [cells(fits[name], fleet.robots[name], truth) for name, truth in zip(fits, truths)]
    scatter = {}
    for name, one in fleet.numbers.items():
        logs_of_truth = np.log([truth[name] for truth in truths])
        scatter[name] = {
            "true": float(np.std(logs_of_truth, ddof=1)),
            "estimated": one.scatter,
            "interval": one.scatter_interval,
            "center_over_true": one.center / float(np.exp(np.mean(logs_of_truth))),
        }
    rows: dict[int, list[Cells]] = {count: [] for count in COUNTS}
    for at in range(options.new):
        truth, name = world.robot(), f"new-{at}"
        logs = world.logs(name, truth, max(COUNTS))
        for count in COUNTS:
            result = world.fit(logs[:count], f"{name}-{count}")
            rows[count].append(cells(result, fleet.estimate(result), truth))
        print(f"{name} of {options.new}", flush=True)
        yield {"scatter": scatter, "fleet": summary(own), "new": {count: summary(values) for count, values in rows.items()}}


def cells(result: gaitfit.FitResult, estimates: dict[str, gaitfit.results.FleetEstimate], truth: Truth) -> Cells:
    rows = []
    for name, true in truth.items():
        one, alone = estimates[name], result.parameters[name].interval
        assert alone is not None
        intervals = (alone, one.interval)
        inside = [float(lower <= true <= upper) for lower, upper in intervals]
        rows.append([one.alone / true, one.value / true, *inside, *[(upper - lower) / true for lower, upper in intervals]])
    return rows


def rms(ratios: np.ndarray) -> float:
    return float(np.sqrt(np.mean((ratios - 1.0) ** 2)))


def summary(rows: list[Cells]) -> dict[str, object]:
    array = np.array(rows)
    kinds = {kind: [at for at, name in enumerate(NAMES) if name.startswith(kind)] for kind in NOMINAL}
    found: dict[str, object] = {"count": len(rows)}
    for kind, places in kinds.items():
        part = array[:, places]
        found[kind] = {
            "alone": rms(part[..., 0]),
            "with_fleet": rms(part[..., 1]),
            "inside_alone": float(np.mean(part[..., 2])),
            "inside_with_fleet": float(np.mean(part[..., 3])),
            "width_alone": float(np.median(part[..., 4])),
            "width_with_fleet": float(np.median(part[..., 5])),
        }
    return found


if __name__ == "__main__":
    main()
