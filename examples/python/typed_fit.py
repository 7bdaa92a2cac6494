"""Fits a clamped Go2 with typed settings, checks the fit on another log, and stops early if the cost is low enough.

Usage: python examples/python/typed_fit.py [FOLDER]      (from the repository's root; FOLDER: where the run goes, default runs)

A type checker knows every name here: `mypy --strict` and pyright find a misspelt setting, field, cost or device before it runs.
"""

import sys
from pathlib import Path

import gaitfit
from gaitfit.config import Fit, Optimizer, Parameter, Simulation


def enough(event: gaitfit.Event) -> bool:
    """Whether to continue: `False` stops the fit, and `resume="auto"` continues it later."""
    return event.metrics.get("matcho/seed-1/best_so_far", 1.0) > 1e-6


def main(runs: Path) -> None:
    log = gaitfit.read_log("examples/go2-demo/fit.csv").between(0.0, 4.0)
    for finding in log.check():
        print(f"{finding.severity}: {finding.kind}: {finding.message}")
    config = Fit(
        robot="assets/go2.xml",
        parameters=[
            Parameter("frictionloss", per="group", upper=1.5),
            Parameter("armature", per="group", upper=0.2),
            Parameter("damping", per="group", upper=1.0),
            Parameter("delay", per="all", upper=0.02),
        ],
        simulation=Simulation(timestep=0.00125),
        optimizer=Optimizer(generations=60, seeds=1),
    )
    result = gaitfit.fit(config, logs=log, costs="matcho", runs=runs, name="typed", device="cpu", resume="auto", progress=enough)
    print(result.headline)
    for name, one in result.parameters.items():
        interval = "" if one.interval is None else f", 95 %: {one.interval[0]:.4g} to {one.interval[1]:.4g}"
        print(f"{name:20} {one.value:8.4f} {one.unit}{interval}")
    checked = gaitfit.validate(result.theta, "examples/go2-demo/validate.csv")
    print(f"error on another log: {checked.rmse_rad or float('nan'):.4f} rad")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs"))
