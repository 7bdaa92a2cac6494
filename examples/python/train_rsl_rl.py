"""rsl_rl's PPO trains the built-in Go2 to walk in gaitfit's engine, and `gaitfit evaluate` says whether it walks.

Usage: python examples/python/train_rsl_rl.py [--environments 4096] [--iterations 400] [--out runs/rsl-rl]
                                              [--device cpu] [--robots-device cpu] [--threads N]
                                              [--compare 10]

Needs `pip install ./python rsl-rl-lib tensordict torch`. `--device` is PyTorch's, and robots step there too; with
`--robots-device cpu` they step on the processor. It ends with the policy as FOLDER/policy.toml and
FOLDER/policy.safetensors, which the program reads too, and with exit code 1 if the robot does not walk: error of velocity at
most 0.15 m/s, of turning at most 0.20 rad/s, at most 1 % falls. `--compare N` has gaitfit's own learner do N iterations of the
same size, for its throughput.
"""

import argparse
import json
import statistics
import struct
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

import gaitfit
from gaitfit.rsl_rl import RslRlVecEnv

STEPS = 24
LIMITS = {"linear_velocity_error": 0.15, "angular_velocity_error": 0.20, "fall_rate": 0.01}


def settings() -> dict[str, Any]:
    """The defaults of `gaitfit train`, as rsl_rl has them."""
    network = {"class_name": "MLPModel", "hidden_dims": [128, 128, 128], "activation": "elu"}
    return {
        "num_steps_per_env": STEPS,
        "save_interval": 100,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**network, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0}},
        "critic": network,
        "algorithm": {"class_name": "PPO", "num_learning_epochs": 5, "num_mini_batches": 4, "entropy_coef": 0.005},
    }


def write(layers: list[torch.nn.Linear], interface: gaitfit.Interface, folder: Path) -> Path:
    """The network as safetensors, and the description that makes it a policy."""
    tensors, header, data = {}, {}, b""
    for number, layer in enumerate(layers):
        tensors[f"actor.{2 * number}.weight"], tensors[f"actor.{2 * number}.bias"] = layer.weight, layer.bias
    for name, tensor in tensors.items():
        values = tensor.detach().cpu().numpy().astype("<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [len(data), len(data) + len(values)]}
        data += values
    text = json.dumps(header).encode()
    (folder / "policy.safetensors").write_bytes(struct.pack("<Q", len(text)) + text + data)
    description = folder / "policy.toml"
    description.write_text(f'file = "policy.safetensors"\nactivation = "elu"\n{interface.to_toml()}')
    return description


class Timed(RslRlVecEnv):
    """The environment, with the time that its steps take."""

    seconds = 0.0

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        begun = time.perf_counter()
        found = super().step(actions)
        self.seconds += time.perf_counter() - begun
        return found


def own_speed(environments: int, iterations: int, threads: int | None, folder: Path) -> float:
    """Samples a second of gaitfit's own learner."""
    size = {"train.num_envs": environments, "train.steps": STEPS, "train.iterations": iterations}
    found = gaitfit.train(settings=size, runs=folder, name="own", device="cpu", threads=threads, progress=False)
    lines = (found.policy.parent / "metrics.jsonl").read_text().splitlines()
    speeds: list[float] = [json.loads(line)["samples_per_second"] for line in lines]
    return statistics.median(speeds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--environments", type=int, default=4096)
    parser.add_argument("--iterations", type=int, default=400)
    parser.add_argument("--device", default="cpu", help="PyTorch's device")
    parser.add_argument("--robots-device", help="where robots step; PyTorch's device by default")
    parser.add_argument("--threads", type=int, help="of the robots; one a core by default")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/rsl-rl"))
    parser.add_argument("--trajectories", type=int, default=2000, help="of the evaluation at the end")
    parser.add_argument("--compare", type=int, default=0, metavar="N", help="iterations of gaitfit's own learner")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(arguments.seed)

    env = Timed(
        num_envs=arguments.environments,
        seed=arguments.seed,
        threads=arguments.threads,
        device=arguments.device,
        robots_device=arguments.robots_device,
    )
    runner = OnPolicyRunner(env, settings(), log_dir=None, device=arguments.device)
    begun = time.perf_counter()
    runner.learn(num_learning_iterations=arguments.iterations)
    seconds = time.perf_counter() - begun
    samples = arguments.environments * STEPS * arguments.iterations
    print(f"rsl_rl through RslRlVecEnv: {samples / seconds:,.0f} samples/s, {seconds:.0f} s in all, "
          f"{100 * env.seconds / seconds:.0f} % of it in the environment ({samples / env.seconds:,.0f} samples/s)")

    actor = runner.get_inference_policy(device="cpu")
    layers = [module for module in actor.mlp.modules() if isinstance(module, torch.nn.Linear)]
    description = write(layers, env.robots.interface, arguments.out)
    policy = gaitfit.Policy(actor.mlp, env.robots.interface, name="rsl_rl", task=env.robots.task)
    found = gaitfit.evaluate(policy, trajectories=arguments.trajectories, drift=0, progress=False)
    print(f"rsl_rl's policy: {found.verdict}")
    walks = True
    measured = {
        "linear_velocity_error": found.linear_velocity_error,
        "angular_velocity_error": found.angular_velocity_error,
        "fall_rate": found.fall_rate,
    }
    for name, most in LIMITS.items():
        value = measured[name].mean
        walks &= bool(np.isfinite(value) and value <= most)
        print(f"  {name} {value:.3f} (at most {most})")
    print(f"written: {description}")
    if arguments.compare:
        speed = own_speed(arguments.environments, arguments.compare, arguments.threads, arguments.out)
        print(f"gaitfit's own learner: {speed:,.0f} samples/s, {speed / (samples / seconds):.1f} times rsl_rl's")
    if not walks:
        sys.exit("It does not walk yet: train longer (--iterations).")


if __name__ == "__main__":
    main()
