"""Writes crates/gaitfit-adapt/tests/fixtures/costs.json: distances by SciPy and NumPy that gaitfit must reproduce.

Usage: .venv/bin/python tools/make_cost_fixtures.py

`pairs`: two samples and scipy.stats.wasserstein_distance of them.
`costs`: small recordings of two sides and the costs Wass and MatchO, written out in NumPy from their definition.
The simulated side is rounded to float32, as gaitfit's simulator hands it over.
"""

import json
from pathlib import Path

import numpy as np
from scipy.stats import wasserstein_distance

OUT = Path(__file__).resolve().parent.parent / "crates/gaitfit-adapt/tests/fixtures/costs.json"


def f32(values):
    return np.asarray(values, dtype=np.float32).astype(np.float64)


def pairs(rng):
    made = {
        "single samples": ([-1.5], [2.25]),
        "single against many": ([0.5], rng.normal(size=9)),
        "equal counts": (rng.normal(size=40), rng.normal(0.3, 2.0, size=40)),
        "unequal counts, coprime": (rng.normal(size=37), rng.normal(-1.0, 0.5, size=50)),
        "unequal counts, multiple": (rng.normal(size=60), rng.uniform(-3, -1, size=20)),
        "ties within and across": (rng.integers(-3, 4, size=45), rng.integers(-2, 6, size=31)),
        "identical": (f32(rng.normal(size=25)), None),
        "all negative": (-rng.exponential(size=30) - 1, -rng.exponential(2.0, size=41)),
        "signed zeros": ([0.0, -0.0, 0.0, 1.0], [-0.0, -0.0, -1.0]),
        "far apart scales": (rng.normal(size=30) * 1e-4, rng.normal(size=33) * 1e3),
        # Above 256 samples gaitfit sorts by radix.
        "many": (np.round(rng.normal(size=400), 2), np.round(rng.normal(0.1, 1.1, size=310), 2)),
    }
    rows = []
    for name, (simulated, robot) in made.items():
        simulated = f32(simulated)
        robot = simulated.copy() if robot is None else np.asarray(robot, dtype=np.float64)
        distance = wasserstein_distance(simulated, robot)
        rows.append(
            {"name": name, "simulated": list(simulated), "robot": list(robot), "distance": float(distance)}
        )
    return rows


def costs(rng):
    """Three joints, action included, two recordings of different length, pre-roll 3. Wass also against simulated
    recordings that are longer and more than the robot's."""
    joints, skip = 3, 3
    signals = ["position", "velocity", "action"]

    def run(samples, spread, offset):
        base = rng.normal(size=(samples, joints)).cumsum(axis=0)
        return {
            "position": spread * base + offset,
            "velocity": 4 * spread * rng.normal(size=(samples, joints)) - offset,
            "action": np.round(rng.uniform(-1, 1, size=(samples, joints)), 1),
        }

    robot = [run(18, 0.1, 0.2), run(25, 0.1, -0.1)]
    aligned = [{s: f32(r[s] + 0.05 * rng.normal(size=r[s].shape)) for s in signals} for r in robot]
    free = [{s: f32(m) for s, m in run(n, 0.13, 0.0).items()} for n in (21, 30, 11)]

    def pool(runs, signal):
        return np.concatenate([r[signal][skip:] for r in runs])

    def scales(signal):
        data = pool(robot, signal)
        low, high = data.min(axis=0), data.max(axis=0)
        return 2 / (high - low), -(high + low) / (high - low)

    def wass(runs, signal):
        scale, shift = scales(signal)
        sides = [pool(runs, signal) * scale + shift, pool(robot, signal) * scale + shift]
        return [float(wasserstein_distance(sides[0][:, j], sides[1][:, j])) for j in range(joints)]

    def match_o(signal):
        scale, _ = scales(signal)
        error = (pool(aligned, signal) - pool(robot, signal)) * scale
        return float(np.sqrt(np.mean(error**2)))

    error = pool(aligned, "position") - pool(robot, "position")
    flat = lambda runs: [{s: list(r[s].ravel()) for s in signals} for r in runs]
    return {
        "joints": joints,
        "skip": skip,
        "robot": flat(robot),
        "aligned": flat(aligned),
        "free": flat(free),
        "wass_aligned": [wass(aligned, s) for s in signals],
        "wass_free": [wass(free, s) for s in signals],
        "match_o": [match_o(s) for s in signals],
        "position_rmse_first": float(np.sqrt(np.mean(error[: 18 - skip] ** 2))),
        "position_rmse_first_per_joint": list(np.sqrt(np.mean(error[: 18 - skip] ** 2, axis=0))),
    }


def main():
    rng = np.random.default_rng(20240607)
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps({"pairs": pairs(rng), "costs": costs(rng)}) + "\n")
    print(f"wrote {OUT} ({OUT.stat().st_size} bytes)")


if __name__ == "__main__":
    main()
