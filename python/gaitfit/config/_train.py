"""Settings of trainings. Written by tools/make_python_config.py from the settings' structs: do not edit."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from .._settings import Settings
from ._fit import Preset
from ._task import Task

Cone = Literal["pyramidal", "elliptic"]
Cell = Literal["lstm", "gru"]
Precision = Literal["bf16", "tf32", "f32"]
Schedule = Literal["adaptive", "fixed"]


@dataclass(frozen=True, kw_only=True)
class Size(Settings):
    """How much is trained.

    Attributes:
        num_envs: Robots that are stepped together. In a file: ``environments``. Default: 4096.
        steps: Control steps of a rollout. Default: 24.
        iterations: Rollouts and updates. Default: 400, of finetune 150.

    >>> settings = Train(train=Size(num_envs=512, iterations=300))
    """

    num_envs: int | None = None
    steps: int | None = None
    iterations: int | None = None


@dataclass(frozen=True, kw_only=True)
class Memory(Settings):
    """Recurrent layers before the actor, and as many of their own before the critic.

    Attributes:
        cell: Kind of the layers, ``gru`` or ``lstm``; a GRU if absent. One of ``lstm``, ``gru``.
        width: Units of every layer; 64 if absent.
        layers: Layers, one behind the other; one if absent.

    >>> settings = Train(ppo=Ppo(memory=Memory(cell="gru", width=64, layers=1)))
    """

    cell: Cell | None = None
    width: int | None = None
    layers: int | None = None


@dataclass(frozen=True, kw_only=True)
class Ppo(Settings):
    """Settings of the networks and of proximal policy optimisation (Schulman et al. 2017).

    Attributes:
        actor_hidden: Widths of the actor's hidden layers. Default: [128, 128, 128].
        critic_hidden: Widths of the critic's hidden layers. Default: [128, 128, 128].
        activation: Activation of both networks. Default: 'elu'.
        output_gain: Factor on the actor's first output weights: small, so that the first actions are near 0. Default:
            0.1.
        initial_std: Standard deviation of actions at the start, before any learning. Default: 1.0.
        fixed_std: Holds the standard deviation at this value instead of learning it. Default: of finetune 0.5.
        normalise_observations: Whether observations are shifted and scaled by their running mean and deviation. Default:
            False.
        normalise_advantage: Whether advantages are shifted and scaled to mean 0 and deviation 1 over the whole rollout.
            Default: True.
        gamma: γ, a control step. Default: 0.99.
        lambda_: λ of generalised advantage estimation. In a file: ``lambda``. Default: 0.95.
        clip: ε: the probability ratio is clipped to 1 ± ε, and the value's change to ± ε. Default: 0.2.
        clipped_value_loss: Whether the value loss is the greater of the clipped and the plain one. Default: True.
        value_coefficient: Factor on the value loss. Default: 1.0.
        entropy_coefficient: Factor on the entropy bonus. Default: 0.005, of finetune 0.0.
        learning_rate: Learning rate of Adam, at the start or always. Default: 0.001, of finetune 0.0003.
        schedule: How it moves. One of ``adaptive``, ``fixed``. Default: 'adaptive'.
        desired_kl: KL divergence that the adaptive schedule aims for, nats. Default: 0.01.
        learning_rate_limits: Min and max learning rate of the adaptive schedule. Default: [1e-05, 0.01], of finetune
            [1e-05, 0.001].
        max_gradient_norm: Limit on the Euclidean norm of the whole gradient (actor, critic and log-std together).
            Default: 1.0.
        critic_warmup: Updates at the start in which only the critic learns, its loss unclipped and its learning rate
            constant. By default 0; of a fine-tuning 5, or 20 if the policy has no critic. A critic of another simulator,
            or a fresh one, then does not mislead the actor.
        epochs: Passes over the samples in an update. Default: 5.
        minibatches: Gradient steps in a pass; with a memory each is over whole robots. Default: 4.
        memory: Recurrent layers before both networks, which see what these make of their observations; without it each
            network sees its observation alone.
        precision: How exactly a GPU multiplies matrices; a CPU does so in ``f32``. One of ``bf16``, ``tf32``, ``f32``.
            Default: 'bf16'.

    >>> settings = Train(ppo=Ppo(epochs=3, desired_kl=0.015))
    """

    actor_hidden: Sequence[int] | None = None
    critic_hidden: Sequence[int] | None = None
    activation: str | Mapping[str, float] | None = None
    output_gain: float | None = None
    initial_std: float | None = None
    fixed_std: float | None = None
    normalise_observations: bool | None = None
    normalise_advantage: bool | None = None
    gamma: float | None = None
    lambda_: float | None = None
    clip: float | None = None
    clipped_value_loss: bool | None = None
    value_coefficient: float | None = None
    entropy_coefficient: float | None = None
    learning_rate: float | None = None
    schedule: Schedule | None = None
    desired_kl: float | None = None
    learning_rate_limits: tuple[float, float] | None = None
    max_gradient_norm: float | None = None
    critic_warmup: int | None = None
    epochs: int | None = None
    minibatches: int | None = None
    memory: Memory | None = None
    precision: Precision | None = None


@dataclass(frozen=True, kw_only=True)
class Train(Settings):
    """All settings of one training run.

    Attributes:
        name: Name of the run and of its folder; the configuration file's stem, or else the task's name, when absent.
        robot: Robot file (MJCF or URDF); the built-in Go2 when absent.
        lenient: Drop what the engine cannot simulate in the robot file instead of refusing it. Default: False.
        runs: Folder that holds the run folders. Default: 'runs'.
        seeds: One training each, one after the other. Default: [1].
        checkpoint_seconds: Seconds between checkpoints. Default: 30.0.
        preset: Solver effort of the physics. One of ``fast``, ``accurate``, ``converged``. Default: 'fast'.
        cone: Friction cones of the physics; those of the robot file when absent. One of ``pyramidal``, ``elliptic``.
        train: How much is trained.
        ppo: Networks and optimisation.
        task: What is trained.

    >>> settings = Train(robot="go2.xml", task=Task(control_dt=0.02), train=Size(iterations=300))
    """

    name: str | None = None
    robot: str | os.PathLike[str] | None = None
    lenient: bool | None = None
    runs: str | os.PathLike[str] | None = None
    seeds: Sequence[int] | None = None
    checkpoint_seconds: float | None = None
    preset: Preset | None = None
    cone: Cone | None = None
    train: Size | None = None
    ppo: Ppo | None = None
    task: Task | None = None


@dataclass(frozen=True, kw_only=True)
class Finetune(Settings):
    """All settings of one fine-tuning.

    Attributes:
        name: Name of the run and of its folder; the configuration file's stem, or else ``finetune``, when absent.
        policy: The policy to train further.
        theta: Fitted parameters, a ``theta.toml``; the robot of the file when absent.
        robot: Robot file (MJCF or URDF); the built-in Go2 when absent.
        lenient: Drop what the engine cannot simulate in the robot file instead of refusing it. Default: False.
        allow: Findings that a training may pass over, by name: ``contradicted``, that walks contradict the fit.
        randomise_theta: Whether each robot takes a row of ``draws.csv`` beside the fitted parameters instead of these.
            Default: False.
        spring: Springs on joints, written ``JOINT=STIFFNESS`` or ``JOINT=STIFFNESS@REST``, N·m/rad and rad.
        torque_noise: Standard deviation of Gaussian torques at every joint and physics step, N·m. Default: 0.0.
        runs: Folder that holds the run folders. Default: 'runs'.
        seeds: One training each, one after the other. Default: [1].
        checkpoint_seconds: Seconds between checkpoints. Default: 30.0.
        preset: Solver effort of the physics. One of ``fast``, ``accurate``, ``converged``. Default: 'fast'.
        train: How much is trained.
        ppo: Optimisation.
        task: What differs from the policy's own task; all of the task in the file of a run folder.

    >>> settings = Finetune(policy="walk.safetensors", theta="runs/adapt/theta.toml")
    """

    name: str | None = None
    policy: str | os.PathLike[str] | None = None
    theta: str | os.PathLike[str] | None = None
    robot: str | os.PathLike[str] | None = None
    lenient: bool | None = None
    allow: Sequence[str] | None = None
    randomise_theta: bool | None = None
    spring: Sequence[str] | None = None
    torque_noise: float | None = None
    runs: str | os.PathLike[str] | None = None
    seeds: Sequence[int] | None = None
    checkpoint_seconds: float | None = None
    preset: Preset | None = None
    train: Size | None = None
    ppo: Ppo | None = None
    task: Task | None = None
