"""Writes crates/gaitfit-adapt/tests/fixtures/cmaes_traces.json: runs of the Python package `cmaes` 0.13 with their
normal draws, which gaitfit must repeat generation by generation.

Usage: .venv/bin/python tools/make_cmaes_traces.py

The package samples B·D·z, which depends on the signs and order of the eigenvectors that LAPACK happens to choose.
So it is handed z = Bᵀ ζ, with ζ the recorded draw: the sample is then B·D·Bᵀ ζ = C^½ ζ, the same for every choice.
Draws are rounded to three decimals to keep the file small; their distribution does not matter here.
"""

import json
from pathlib import Path

import cmaes
import numpy as np

OUT = Path(__file__).resolve().parent.parent / "crates/gaitfit-adapt/tests/fixtures/cmaes_traces.json"


def sphere(x):
    return float(np.sum(x**2))


def rosenbrock(x):
    return float(np.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2))


def ellipsoid(x):
    """Condition 1e4."""
    return float(np.sum(10 ** (4 * np.arange(len(x)) / (len(x) - 1)) * x**2))


class Recorder:
    """Stands in for the package's generator and keeps what it hands out."""

    def __init__(self, optimizer, seed):
        self.optimizer = optimizer
        self.rng = np.random.RandomState(seed)
        self.draws = []

    def randn(self, n):
        zeta = np.round(self.rng.randn(n), 3)
        self.draws.append([float(value) for value in zeta])
        if isinstance(self.optimizer, cmaes.CMA):
            basis, _ = self.optimizer._eigen_decomposition()
            return basis.T @ zeta
        return zeta


def trace(name, kind, function, start, deviation, sigma, bounds, generations, seed, population=None, resampling=100,
          covariance=True):
    """Runs in coordinates u = x / deviation, as gaitfit does inside; bounds are of x."""
    start, deviation = np.array(start), np.array(deviation)
    options = {"population_size": population, "n_max_resampling": resampling}
    if bounds is not None:
        bounds = np.array(bounds, dtype=float)
        options["bounds"] = bounds / deviation[:, None]
    make = cmaes.CMA if kind == "full" else cmaes.SepCMA
    optimizer = make(mean=start / deviation, sigma=sigma, **options)
    recorder = Recorder(optimizer, seed)
    optimizer._rng = recorder
    rows = []
    for _ in range(generations):
        solutions, draws = [], []
        for _ in range(optimizer.population_size):
            recorder.draws = []
            u = optimizer.ask()
            draws.append(recorder.draws)
            solutions.append((u, function(u * deviation)))
        best = min(cost for _, cost in solutions)
        optimizer.tell(solutions)
        optimizer._eigen_decomposition()
        row = {
            "draws": draws,
            "mean": optimizer.mean.tolist(),
            "sigma": float(optimizer._sigma),
            "stop": bool(optimizer.should_stop()),
        }
        if covariance:
            c = optimizer._C
            row["covariance"] = (c[np.tril_indices(len(start))] if c.ndim == 2 else c).tolist()
        rows.append(row)
        if row["stop"]:
            break
    stopped = rows[-1]["stop"]
    print(f"{name}: {len(rows)} generations, best {best:.3e}{', stopped' if stopped else ''}")
    return {
        "name": name,
        "kind": kind,
        "function": function.__name__,
        "start": start.tolist(),
        "deviation": deviation.tolist(),
        "sigma": sigma,
        "bounds": None if bounds is None else bounds.tolist(),
        "population": optimizer.population_size,
        "resampling": resampling,
        "generations": rows,
    }


def main():
    traces = [
        trace("sphere", "full", sphere, [3, -2, 1, 4], [1] * 4, 1.3, None, 30, 1),
        trace("rosenbrock", "full", rosenbrock, [0.5, -0.5, 0.3, 0, -1], [1] * 5, 0.5, None, 30, 2),
        trace("ellipsoid, odd population", "full", ellipsoid, [1, 1, 1, 1, 1, 1], [1] * 6, 0.8, None, 30, 3, 11),
        trace("sphere, deviations", "full", sphere, [3, -2, 1, 4], [1, 0.1, 2, 0.5], 1.0, None, 30, 4),
        trace("ellipsoid, corner", "full", ellipsoid, [0.6, 0.5, 1, 1.5], [1, 0.5, 1, 0.25], 0.7,
              [[0.5, 2], [0.5, 2], [-1, 2], [0.1, 9]], 30, 5, resampling=6),
        trace("rosenbrock, box", "full", rosenbrock, [0.2, 0.2, 0.2, 0.2], [1] * 4, 0.3, [[-1, 0.6]] * 4, 30, 6,
              resampling=10),
        trace("sphere until it stops", "full", sphere, [1, -1], [1] * 2, 0.5, None, 300, 7, covariance=False),
        trace("sphere, separable", "separable", sphere, [3, -2, 1, 4], [1] * 4, 1.3, None, 30, 8),
        trace("ellipsoid, separable", "separable", ellipsoid, [1, 1, 1, 1, 1, 1], [1, 1, 1, 0.5, 0.2, 0.1], 0.8,
              None, 30, 9),
        trace("rosenbrock, separable, box", "separable", rosenbrock, [0.2] * 5, [1] * 5, 0.3, [[-1, 0.6]] * 5, 30,
              10, resampling=8),
        trace("sphere until it stops, separable", "separable", sphere, [1, -1], [1] * 2, 0.5, None, 300, 11,
              covariance=False),
    ]
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps({"package": f"cmaes {cmaes.__version__}", "traces": traces}, separators=(",", ":")) + "\n")
    print(f"wrote {OUT} ({OUT.stat().st_size} bytes)")


if __name__ == "__main__":
    main()
