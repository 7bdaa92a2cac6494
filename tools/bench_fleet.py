"""Measures what the prior of a fleet is worth: robots whose numbers scatter by 20 %, and new robots with few logs.

Robots are Go2s with clamped bases and legs in the air, simulated by official MuJoCo, which is not the fit's engine. Friction loss,
armature and damping of each joint kind, and the delay, are log-normal around nominal values. A log is short (--seconds), every
joint follows a sine of its own at 200 Hz, and encoders are coarse (--noise): so a log leaves something open. Each robot of the
fleet has two fits of one log each, which calibrate the intervals. New robots have 1, 2, 4 and 8 logs: one fit of all of them, and
fits of one log each that are combined with the fleet.

Usage: .venv/bin/python tools/bench_fleet.py [--robots 20] [--new 12] [--out fleet.json]      (with the package gaitfit)

Printed as JSON, for each number of logs: the root mean square of relative errors over new robots and numbers, alone and with the
fleet, and how often 95 % intervals contain the truth; and the scatter of each number, true and estimated.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

import gaitfit
from gaitfit.config import Fit, Optimizer, Parameter, Simulation
from gaitfit.mujoco import ClampedRobot

ROBOT = Path(__file__).parent.parent / "assets" / "go2.xml"
KINDS = ("hip", "thigh", "calf")
NOMINAL = {"frictionloss": (0.21, 0.17, 0.62), "armature": (0.015, 0.019, 0.047), "damping": (0.19, 0.22, 0.31)}
NAMES = [f"{number}_{kind}" for number in NOMINAL for kind in KINDS] + ["delay"]
CENTRES = np.array([value for values in NOMINAL.values() for value in values] + [0.007])
JOINTS = [f"{leg}_{kind}" for leg in ("FL", "FR", "RL", "RR") for kind in KINDS]
DT, KP, KD = 0.005, [20.0, 20.0, 40.0] * 4, [1.0, 1.0, 2.0] * 4
COUNTS = (1, 2, 4, 8)
Truth = dict[str, float]
#: For each number: one fit's estimate, the mean of fits of one log each, and that with the fleet, over the truth; and whether the
#: fit's interval and the fleet's contain it.
Cells = list[list[float]]


class World:
    """Makes robots, their logs and their fits."""

    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.options, self.folder, self.rng = options, folder, np.random.default_rng(options.seed)
        self.parameters = [gaitfit.Parameter(f"{number}:*_{kind}", 0.0, 10.0) for number in NOMINAL for kind in KINDS]
        self.parameters.append(gaitfit.Parameter("delay", 0.0, 0.05))

    def robot(self) -> Truth:
        """True numbers of a robot."""
        return dict(zip(NAMES, (CENTRES * np.exp(self.rng.normal(0.0, self.options.scatter, len(NAMES)))).tolist()))

    def log(self, truth: Truth) -> gaitfit.Log:
        """A log of a robot, from a start at rest."""
        rng, noise = self.rng, self.options.noise
        time = np.arange(0.0, self.options.seconds, DT)[:, None]
        waves = np.sin(2 * np.pi * rng.uniform(1.0, 3.0, 12) * time + rng.uniform(0.0, 2 * np.pi, 12))
        target = np.tile([0.0, 0.95, -1.75], 4) + 0.3 * waves
        still = gaitfit.Log.from_arrays(
            joints=JOINTS, dt=DT, position=target, velocity=0 * target, target=target, kp=KP, kd=KD
        )
        simulate = ClampedRobot(ROBOT, still, self.parameters, timestep=0.0005)
        moved = simulate(np.array([list(truth.values())]))[0]
        position = np.asarray(moved["position"])[0] + rng.normal(0.0, noise, target.shape)
        velocity = np.asarray(moved["velocity"])[0] + rng.normal(0.0, 30 * noise, target.shape)
        return gaitfit.Log.from_arrays(
            joints=JOINTS, dt=DT, position=position, velocity=velocity, target=target, kp=KP, kd=KD
        )

    def fit(self, logs: list[gaitfit.Log], name: str) -> gaitfit.FitResult:
        config = Fit(
            robot=ROBOT,
            costs=["matcho"],
            parameters=[
                Parameter("frictionloss", per="group", upper=3.0),
                Parameter("armature", per="group", upper=0.3),
                Parameter("damping", per="group", upper=2.0),
                Parameter("delay", per="all", upper=0.03),
            ],
            simulation=Simulation(timestep=0.00125),
            # One start may end in a local minimum.
            optimizer=Optimizer(method="least-squares", seeds=self.options.seeds),
        )
        return gaitfit.fit(config, logs=logs, runs=self.folder, name=name, progress=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--new", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=0.6)
    parser.add_argument("--noise", type=float, default=0.01, help="of positions, rad; of velocities 30/s times as much")
    parser.add_argument("--scatter", type=float, default=0.2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=3, help="starts of each fit")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        found = measured(World(options, Path(name)))
    text = json.dumps({"options": {**vars(options), "out": None}, **found}, indent=1)
    print(text)
    if options.out:
        options.out.write_text(text + "\n", encoding="utf-8")


def measured(world: World) -> dict[str, object]:
    options = world.options
    truths = [world.robot() for _ in range(options.robots)]
    fits = {
        f"robot-{at}": [
            world.fit([world.log(truth)], f"robot-{at}-{repeat}") for repeat in (1, 2)
        ]
        for at, truth in enumerate(truths)
    }
    fleet = gaitfit.fleet(fits)
    rows: dict[int, list[Cells]] = {count: [] for count in COUNTS}
    left_out = 0
    for at in range(options.new):
        truth = world.robot()
        logs = [world.log(truth) for _ in range(max(COUNTS))]
        single = [world.fit([log], f"new-{at}-{number}") for number, log in enumerate(logs)]
        # An estimate at the bound 0 has no logarithm. Its log is left out of all columns.
        usable = [
            (log, one) for log, one in zip(logs, single) if all(parameter.value > 0 for parameter in one.parameters.values())
        ]
        left_out += len(single) - len(usable)
        for count in COUNTS:
            chosen, alone = zip(*usable[:count])
            joint = alone[0] if count == 1 else world.fit(list(chosen), f"new-{at}-all-{count}")
            rows[count].append(cells(joint, fleet.estimate(list(alone)), truth))
    scatter = {}
    for name, one in fleet.numbers.items():
        logs_of_truth = np.log([truth[name] for truth in truths])
        scatter[name] = {
            "true": float(np.std(logs_of_truth, ddof=1)),
            "estimated": one.scatter,
            "interval": one.scatter_interval,
            "center_over_true": one.center / float(np.exp(np.mean(logs_of_truth))),
            "calibration": one.calibration,
        }
    own = [
        cells(several[0], fleet.robots[name], truth) for (name, several), truth in zip(fits.items(), truths)
    ]
    new = {count: summary(values) for count, values in rows.items()}
    return {"scatter": scatter, "fleet": summary(own), "new": new, "fits_at_bound": left_out}


def cells(result: gaitfit.FitResult, estimates: dict[str, gaitfit.results.FleetEstimate], truth: Truth) -> Cells:
    rows = []
    for name, true in truth.items():
        one, alone = estimates[name], result.parameters[name].interval
        assert alone is not None
        inside = [float(lower <= true <= upper) for lower, upper in (alone, one.interval)]
        rows.append([result.parameters[name].value / true, one.alone / true, one.value / true, *inside])
    return rows


def summary(rows: list[Cells]) -> dict[str, object]:
    array = np.array(rows)

    def part(places: list[int]) -> dict[str, float]:
        chosen = array[:, places]
        errors = [float(np.sqrt(np.mean((chosen[..., at] - 1.0) ** 2))) for at in (0, 1, 2)]
        inside = [float(np.mean(chosen[..., at])) for at in (3, 4)]
        return dict(zip(("one_fit", "mean_of_fits", "with_fleet", "inside_one_fit", "inside_with_fleet"), errors + inside))

    kinds = {kind: [at for at, name in enumerate(NAMES) if name.startswith(kind)] for kind in (*NOMINAL, "delay")}
    return {"robots": len(rows), "all": part(list(range(len(NAMES)))), **{kind: part(at) for kind, at in kinds.items()}}


if __name__ == "__main__":
    main()
