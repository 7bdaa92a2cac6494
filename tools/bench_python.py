"""Times the Python package's functions beside those of other packages, on this machine.

- `gaitfit.costs.wasserstein` beside `scipy.stats.wasserstein_distance`, column by column, on arrays as a fit has them.
- `gaitfit.CMA` beside `cmaes.CMA` (and `cmaes.SepCMA`): one generation, ask and tell, costs of nothing.

Numbers are medians; the programs take turns, so that all meet the same machine. Measure a release build on an idle
machine: pip install ./python scipy cmaes, and then

Usage: python tools/bench_python.py [--repeats 9] [--json FILE]
"""

import argparse
import json
import platform
import statistics
import time

import cmaes
import numpy as np
import scipy
from scipy.stats import wasserstein_distance

import gaitfit

SAMPLES = [(300, 300, 12), (1800, 1800, 12), (1800, 90000, 12), (20000, 20000, 36)]
DIMENSIONS = [(12, "full"), (100, "full"), (1164, "full"), (1164, "separable")]


def timed(function) -> float:
    begun = time.perf_counter()
    function()
    return time.perf_counter() - begun


def compare(programs: dict, repeats: int) -> dict:
    """Median seconds of each program, which take turns."""
    for function in programs.values():
        function()
    found = {name: [] for name in programs}
    for _ in range(repeats):
        for name, function in programs.items():
            found[name].append(timed(function))
    return {name: statistics.median(times) for name, times in found.items()}


def distances(first: int, second: int, columns: int, repeats: int) -> dict:
    rng = np.random.default_rng(0)
    a = rng.normal(size=(first, columns)).astype(np.float32)
    b = rng.normal(0.1, 1.2, size=(second, columns))
    return compare(
        {
            "gaitfit": lambda: gaitfit.costs.wasserstein(a, b),
            "scipy": lambda: [wasserstein_distance(a[:, column], b[:, column]) for column in range(columns)],
        },
        repeats,
    )


def generations(n: int, covariance: str, repeats: int) -> tuple[int, dict]:
    start = np.full(n, 0.5)
    ours = gaitfit.CMA(start, np.full(n, 0.3), seed=1, covariance=covariance)
    population = len(ours.ask())
    kind = cmaes.CMA if covariance == "full" else cmaes.SepCMA
    theirs = kind(mean=start.copy(), sigma=0.3, population_size=population, seed=1)
    costs = np.random.default_rng(0).normal(size=population)
    # With 1,164 coordinates every ninth generation decomposes the covariance.
    count = 200 if n < 500 else 9

    def we() -> None:
        for _ in range(count):
            ours.ask()
            ours.tell(costs)

    def they() -> None:
        for _ in range(count):
            theirs.tell([(theirs.ask(), cost) for cost in costs])

    return population, {name: seconds / count for name, seconds in compare({"gaitfit": we, "cmaes": they}, repeats).items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9, help="of each measurement; the median counts")
    parser.add_argument("--json", help="also write the numbers to this file")
    arguments = parser.parse_args()
    rows = []
    for first, second, columns in SAMPLES:
        found = distances(first, second, columns, arguments.repeats)
        rows.append((f"wasserstein, {first} and {second} samples × {columns}", "scipy", found))
    for n, covariance in DIMENSIONS:
        population, found = generations(n, covariance, arguments.repeats)
        rows.append((f"CMA-ES, n = {n}, {covariance}, population {population}, a generation", "cmaes", found))
    print(f"gaitfit {gaitfit.__version__}, SciPy {scipy.__version__}, cmaes {cmaes.__version__}, NumPy {np.__version__}, "
          f"Python {platform.python_version()}")
    print("| what | gaitfit, ms | other, ms | ratio |\n| --- | --- | --- | --- |")
    for what, other, found in rows:
        ours, theirs = 1e3 * found["gaitfit"], 1e3 * found[other]
        print(f"| {what} | {ours:.3f} | {other} {theirs:.3f} | {theirs / ours:.1f} |")
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:
            json.dump([{"what": what, "seconds": found} for what, _, found in rows], file, indent=1)


if __name__ == "__main__":
    main()
