"""Times one PPO update in PyTorch on the CPU and sets gaitfit's beside it.

The same work everywhere: 4,096 environments × 24 steps, 5 epochs × 4 minibatches, actor 45-128-128-128-12, critic
48-128-128-128-1, ELU, learnable log-std, clipped surrogate and value losses, closed-form KL for the learning rate,
gradient norm clipped to 1, Adam. Advantages are estimated and normalised in it too. Synthetic samples: this measures
cost, not learning. Measure on an idle machine: threads of PyTorch wait for each other busily, so that neighbours make it
many times slower, its CPU time included, and gaitfit hardly.

Two programs in PyTorch, both eager: `lean` is written below for speed alone (densities and KL in closed form, one
fused Adam, no logging); `rsl_rl` is `PPO.compute_returns` and `PPO.update` of rsl_rl, with which legged robots are
commonly trained. It also evaluates the last values (4,096 rows), draws actions anew and has the entropy row by row, and
clips the gradients of actor and critic apart. gaitfit skips rows whose clipped loss has no derivative, of which these
samples have few: `clip_fraction` says how many ratios were outside the clip.

Usage: .venv/bin/python tools/bench_ppo_torch.py [--threads 2] [--repeats 5] [--gaitfit BENCH_UPDATE] [--json FILE]
BENCH_UPDATE is the compiled example `bench_update` (cargo build --release -p gaitfit-learn --example bench_update).
Runs of the programs alternate, so that all meet the same machine.
"""

import argparse
import importlib.metadata
import json
import os
import pathlib
import platform
import statistics
import subprocess
import time

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

ENVIRONMENTS, STEPS, EPOCHS, MINIBATCHES = 4096, 24, 5, 4
OBSERVATION, CRITIC_OBSERVATION, ACTION = 45, 48, 12
CLIP, ENTROPY, VALUE, GAMMA, LAMBDA, NORM, DESIRED_KL = 0.2, 0.01, 1.0, 0.99, 0.95, 1.0, 0.01


def network(inputs, outputs):
    layers, width = [], inputs
    for hidden in (128, 128, 128):
        layers += [torch.nn.Linear(width, hidden), torch.nn.ELU()]
        width = hidden
    return torch.nn.Sequential(*layers, torch.nn.Linear(width, outputs))


class Lean:
    """A learner and a rollout to learn from again and again."""

    def __init__(self):
        torch.manual_seed(0)
        self.actor, self.critic = network(OBSERVATION, ACTION), network(CRITIC_OBSERVATION, 1)
        self.log_std = torch.nn.Parameter(torch.zeros(ACTION))
        self.parameters = [*self.actor.parameters(), *self.critic.parameters(), self.log_std]
        self.optimiser = torch.optim.Adam(self.parameters, lr=1e-4, fused=True)
        shape = (STEPS, ENVIRONMENTS)
        self.observation = torch.randn(*shape, OBSERVATION)
        self.critic_observation = torch.randn(*shape, CRITIC_OBSERVATION)
        self.reward, self.last_value = torch.randn(shape), torch.randn(ENVIRONMENTS)
        self.done = (torch.rand(shape) < 0.002).float()
        with torch.no_grad():
            self.mean = self.actor(self.observation)
            self.value = self.critic(self.critic_observation).squeeze(-1)
            self.action = self.mean + torch.randn_like(self.mean)
            self.log_probability = self.density(self.mean, self.action)

    def density(self, mean, action):
        z = (action - mean) * torch.exp(-self.log_std)
        return (-0.5 * z * z - self.log_std - 0.9189385332).sum(-1)

    def advantages(self):
        advantage, running, following = torch.empty_like(self.reward), 0.0, self.last_value
        for step in reversed(range(STEPS)):
            alive = 1.0 - self.done[step]
            delta = self.reward[step] + GAMMA * alive * following - self.value[step]
            running = delta + GAMMA * LAMBDA * alive * running
            advantage[step], following = running, self.value[step]
        returns = advantage + self.value
        return (advantage - advantage.mean()) / (advantage.std() + 1e-8), returns

    def run(self):
        with torch.no_grad():
            advantage, returns = self.advantages()
        rows = STEPS * ENVIRONMENTS
        flat = [
            array.reshape(rows, -1) if array.dim() == 3 else array.reshape(rows)
            for array in (
                self.observation, self.critic_observation, self.action, self.mean,
                self.log_probability, self.value, advantage, returns,
            )
        ]
        old_log_std, rate = self.log_std.detach().clone(), 1e-3
        for _ in range(EPOCHS):
            for index in torch.randperm(rows).chunk(MINIBATCHES):
                observation, critic_observation, action, old_mean, old_density, old_value, gain, target = (
                    array.index_select(0, index) for array in flat
                )
                mean, value = self.actor(observation), self.critic(critic_observation).squeeze(-1)
                with torch.no_grad():
                    shift = (old_mean - mean).square() + torch.exp(2 * old_log_std)
                    kl = (self.log_std - old_log_std + 0.5 * shift * torch.exp(-2 * self.log_std) - 0.5).sum(-1).mean()
                    # Decided as in training, though the rate stays: the samples are always the same.
                    rate = rate / 1.5 if kl > 2 * DESIRED_KL else rate * 1.5 if kl < DESIRED_KL / 2 else rate
                ratio = torch.exp(self.density(mean, action) - old_density)
                surrogate = torch.maximum(-gain * ratio, -gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
                bounded = old_value + (value - old_value).clamp(-CLIP, CLIP)
                value_loss = torch.maximum((value - target).square(), (bounded - target).square()).mean()
                entropy = (self.log_std + 1.4189385332).sum()
                self.optimiser.zero_grad()
                (surrogate + VALUE * value_loss - ENTROPY * entropy).backward()
                torch.nn.utils.clip_grad_norm_(self.parameters, NORM)
                self.optimiser.step()


class RslRl:
    """The same with rsl_rl's learner and storage."""

    def __init__(self):
        torch.manual_seed(0)
        widths = {"actor": OBSERVATION, "critic": CRITIC_OBSERVATION}
        self.last = TensorDict({key: torch.randn(ENVIRONMENTS, width) for key, width in widths.items()}, [ENVIRONMENTS])
        groups = {key: [key] for key in widths}
        normal = {"class_name": "rsl_rl.modules.distribution.GaussianDistribution", "std_type": "log"}
        hidden = (128, 128, 128)
        actor = MLPModel(self.last, groups, "actor", ACTION, hidden, "elu", distribution_cfg=normal)
        critic = MLPModel(self.last, groups, "critic", 1, hidden, "elu")
        storage = RolloutStorage("rl", ENVIRONMENTS, STEPS, self.last, [ACTION])
        self.ppo = PPO(
            actor, critic, storage, EPOCHS, MINIBATCHES, CLIP, GAMMA, LAMBDA, VALUE, ENTROPY,
            learning_rate=1e-4, max_grad_norm=NORM, schedule="adaptive", desired_kl=DESIRED_KL,
        )  # fmt: skip
        with torch.inference_mode():
            for _ in range(STEPS):
                observations = self.last.apply(torch.randn_like)
                self.ppo.act(observations)
                done = torch.rand(ENVIRONMENTS) < 0.002
                self.ppo.process_env_step(observations, torch.randn(ENVIRONMENTS), done, {})

    def run(self):
        with torch.inference_mode():
            self.ppo.compute_returns(self.last)
        self.ppo.update()


class Gaitfit:
    """The compiled example, one update a process; it times itself."""

    def __init__(self, program, threads):
        self.command = [program.resolve(), str(threads), "1"]
        self.clip_fraction = None

    def seconds(self):
        output = subprocess.run(self.command, check=True, capture_output=True, text=True).stdout
        figure = json.loads(output)
        self.clip_fraction = figure["diagnostics"]["clip_fraction"]
        return figure["seconds"][0], figure["cpu_seconds"][0] if figure["cpu_seconds"] else None


class Timed:
    """A program of this process, warm."""

    def __init__(self, update):
        self.update = update
        update.run()

    def seconds(self):
        wall, cpu = time.perf_counter(), time.process_time()
        self.update.run()
        return time.perf_counter() - wall, time.process_time() - cpu


def summary(figures):
    walls, cpus = zip(*figures)
    known = [cpu for cpu in cpus if cpu is not None]
    of_cpu = {"cpu": statistics.median(known)} if known else {}
    return {"best": min(walls), "median": statistics.median(walls), **of_cpu}


def processor():
    """Its name, where the system tells."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--gaitfit", type=pathlib.Path, help="the compiled example bench_update")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures here")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    programs = {"lean": Timed(Lean()), "rsl_rl": Timed(RslRl())}
    if arguments.gaitfit:
        programs["gaitfit"] = Gaitfit(arguments.gaitfit, arguments.threads)
    figures = {name: [] for name in programs}
    for _ in range(arguments.repeats):
        for name, program in programs.items():
            figures[name].append(program.seconds())
    seconds = {name: summary(of_program) for name, of_program in figures.items()}
    result = {
        "threads": arguments.threads,
        "cores": os.cpu_count(),
        "processor": processor(),
        "torch_version": torch.__version__,
        "rsl_rl_version": importlib.metadata.version("rsl-rl-lib"),
        "seconds": seconds,
    }
    if "gaitfit" in seconds:
        ours = seconds["gaitfit"]
        result["clip_fraction"] = programs["gaitfit"].clip_fraction
        result["ratio"] = {
            name: {key: of_program[key] / value for key, value in ours.items()}
            for name, of_program in seconds.items()
            if name != "gaitfit"
        }
    print(json.dumps(result, indent=2))
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
