"""Steps a second of gaitfit.Robots on the processor and, where PyTorch sees one, on a GPU.

Usage: python tools/bench_robots.py [--robots 4096 65536] [--steps 200] [--devices cpu cuda] [--policy]
Actions are there before and do not change. With --policy they come from a network of PyTorch (128 x 3) on the observations,
on the robots' device; on the processor observations and actions are shared too.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import gaitfit
import numpy as np


def rate(device: str, count: int, steps: int, policy: bool) -> tuple[float, float]:
    """Samples a second, and seconds until the first step was done."""
    begin = time.perf_counter()
    robots = gaitfit.Robots(num_envs=count, seed=1, device=device, stagger=True)
    actions: Any = np.random.default_rng(1).normal(0.0, 0.3, size=(count, robots.num_actions)).astype(np.float32)
    network: Any = None
    if policy or device != "cpu":
        import torch

        torch.set_grad_enabled(False)
        actions = torch.from_numpy(actions).to(robots.device)
        if policy:
            observation, widths = torch.from_dlpack(robots.observation), [robots.observation.shape[1], 128, 128, 128]
            layers = [layer for pair in zip(widths, widths[1:]) for layer in (torch.nn.Linear(*pair), torch.nn.ELU())]
            network = torch.nn.Sequential(*layers, torch.nn.Linear(128, robots.num_actions)).to(robots.device)
    ask = (lambda: network(observation)) if policy else (lambda: actions)
    robots.step(ask())
    started = time.perf_counter() - begin
    for _ in range(10):
        robots.step(ask())
    begin = time.perf_counter()
    for _ in range(steps):
        robots.step(ask())
    return count * steps / (time.perf_counter() - begin), started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=[4096, 65536])
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--devices", nargs="+", default=["cpu", "cuda"])
    parser.add_argument("--policy", action="store_true")
    arguments = parser.parse_args()
    for device in arguments.devices:
        for count in arguments.robots:
            # Of a processor's step there is little to gain by more of them.
            steps = arguments.steps if device != "cpu" else max(arguments.steps // 10, 5)
            samples, started = rate(device, count, steps, arguments.policy)
            print(
                f"{device:6} {count:7} robots: {samples / 1e6:8.3f} M samples/s, {1e3 * count / samples:8.3f} ms a step, "
                f"first step after {started:.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
