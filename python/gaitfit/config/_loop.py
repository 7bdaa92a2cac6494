"""Settings of loops, evaluations and collections. Written by tools/make_python_config.py from the settings' structs: do not edit."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from .._settings import Settings
from ._fit import Fit, ParameterKind, Preset, RobotNumber
from ._train import Finetune

TargetKind = Literal["simulated", "command", "robot", "simulated-go2"]


@dataclass(frozen=True, kw_only=True)
class Truth(Settings):
    """Numbers of a robot that are known, as in tests of the method.

    Attributes:
        theta: Its parameters, a ``theta.toml``.
        spring: Its springs, written ``JOINT=STIFFNESS`` or ``JOINT=STIFFNESS@REST``, N·m/rad and rad.
        torque_noise: Its torque noise at the simulator's steps, N·m.

    >>> settings = Controls(truth=Truth(theta="truth.toml"))
    """

    theta: str | os.PathLike[str] | None = None
    spring: Sequence[str] | None = None
    torque_noise: float | None = None


@dataclass(frozen=True, kw_only=True)
class Controls(Settings):
    """What else π₀ is fine-tuned in, with the same task and as many iterations, where the target can be measured: what a
    user can do without any logs.

    Attributes:
        nominal: The simulator as the robot's file has it. Default: True.
        randomised: Robots that differ at random, as below. Default: True.
        draws: The fitted robot with its numbers drawn from their joint intervals. Default: False.
        truth: The robot itself, where its numbers are known: the best that a fit could do.
        frictionloss: Dry friction torque of the joints, N·m: smallest and largest. Default: [0.0, 0.4].
        armature: Reflected rotor inertia added to the joints, kg·m². Default: [0.0, 0.06].
        delay: Delay from a target to the motors, s. Default: [0.0, 0.02].
        torque_noise: Standard deviation of Gaussian torques at every joint and physics step, N·m. Default: 0.5.

    >>> settings = Loop(controls=Controls(nominal=False))
    """

    nominal: bool | None = None
    randomised: bool | None = None
    draws: bool | None = None
    truth: Truth | None = None
    frictionloss: tuple[float, float] | None = None
    armature: tuple[float, float] | None = None
    delay: tuple[float, float] | None = None
    torque_noise: float | None = None


@dataclass(frozen=True, kw_only=True)
class TrueParameter(Settings):
    """A value of some joints of a simulated target.

    Attributes:
        kind: Quantity. One of ``frictionloss``, ``stiction``, ``stribeck_velocity``, ``load_friction``, ``play``,
            ``compliance``, ``armature``, ``damping``, ``delay``, ``encoder_bias``, ``torque_scale``, ``torque_offset``,
            ``stiffness``, ``spring_torque``, ``no_load_speed``, ``stall_torque``, ``kp_scale``, ``kd_scale``,
            ``link_mass``, ``link_com_x``, ``link_com_y``, ``link_com_z``.
        joints: Patterns over joint names.
        value: Its value on these joints, in the quantity's unit.

    >>> settings = Target("simulated", parameters=[TrueParameter("frictionloss", value=0.2)])
    """

    kind: ParameterKind = field(kw_only=False)
    joints: Sequence[str] | None = None
    value: float | None = None


@dataclass(frozen=True, kw_only=True)
class TrueNumber(Settings):
    """A number of a simulated target.

    Attributes:
        kind: Which number. One of ``torque_noise``, ``base_mass``, ``base_com_x``, ``base_com_y``, ``base_com_z``,
            ``payload_mass``, ``payload_x``, ``payload_y``, ``payload_z``, ``floor_friction``, ``ground_softness``,
            ``ground_impedance``, ``imu_roll``, ``imu_pitch``, ``gyro_bias_x``, ``gyro_bias_y``, ``gyro_bias_z``,
            ``velocity_lag``, ``imu_delay``.
        value: Its value.

    >>> settings = Target("simulated", numbers=[TrueNumber("payload_mass", value=2.0)])
    """

    kind: RobotNumber = field(kw_only=False)
    value: float | None = None


@dataclass(frozen=True, kw_only=True)
class Target(Settings):
    """A robot that can be run from here.

    Attributes:
        kind: How it is run. One of ``simulated``, ``command``, ``robot``, ``simulated-go2``.
        trajectories: Trajectories recorded each round.
        seconds: Length of each, s.
        seed: Seed of the first round's commands and noise; later rounds take the next ones.
        theta: Simulated: a ``theta.toml`` with numbers of the true robot.
        spring: Simulated: springs, written ``JOINT=STIFFNESS`` or ``JOINT=STIFFNESS@REST``, N·m/rad and rad.
        torque_noise: Simulated: standard deviation of Gaussian torques at every joint and physics step, N·m.
        log_shift: Simulated: each log begins this long after the robot, drawn between the two, s.
        preset: Simulated: solver effort. One of ``fast``, ``accurate``, ``converged``.
        timeout_seconds: Command: how long each call of a program may take, s; then it is stopped.
        probe: Command: a program that ends well if the robot is there, and its arguments; if it is not, the loop
            continues without a target. Without one the robot must be there.
        collect: Command: the program that records, and its arguments.
        evaluate: Command: the program that measures, and its arguments.
        robot: Robot: its name or its file (``.toml``), as ``gaitfit run --robot`` takes it.
        interface: Robot: network interface to it, for example ``eth0``.
        domain: Robot: DDS domain; robots are in 0, simulators in others.
        pause: Robot: how long it stands between trajectories, s.
        patience: Robot: how old a state and how late a loop may be, ms; a real one has 20.
        yes: Robot: nobody is asked before it moves; for simulators only.
        last_walk: Robot: whether the last policy walks too, under the commands of the first round.
        parameters: Simulated: true values of joints. In a file: ``parameter``.
        numbers: Simulated: true values of the robot as a whole. In a file: ``number``.

    >>> settings = Loop(target=Target("simulated"))
    """

    kind: TargetKind = field(kw_only=False)
    trajectories: int | None = None
    seconds: float | None = None
    seed: int | None = None
    theta: str | os.PathLike[str] | None = None
    spring: Sequence[str] | None = None
    torque_noise: float | None = None
    log_shift: tuple[float, float] | None = None
    preset: Preset | None = None
    timeout_seconds: float | None = None
    probe: Sequence[str] | None = None
    collect: Sequence[str] | None = None
    evaluate: Sequence[str] | None = None
    robot: str | os.PathLike[str] | None = None
    interface: str | None = None
    domain: int | None = None
    pause: float | None = None
    patience: int | None = None
    yes: bool | None = None
    last_walk: bool | None = None
    parameters: Sequence[TrueParameter] | None = None
    numbers: Sequence[TrueNumber] | None = None


@dataclass(frozen=True, kw_only=True)
class Evaluate(Settings):
    """How policies are measured: in a loop, and by ``gaitfit.evaluate`` as its ``config``. Their defaults differ.

    Attributes:
        trajectories: Trajectories with random commands. Default: of a loop 2000, of gaitfit.evaluate 10000.
        seconds: Length of each, s. Default: of a loop 4.0.
        drift: Robots in each constant-command trial; 0 leaves them out. Default: of a loop 32, of gaitfit.evaluate 64.
        drift_speeds: Speeds of these: ahead and to the side, m/s, and turning, rad/s; half of the task's greatest
            commands when absent.
        seed: Seed of commands, starts and noise. Default: 0.
        preset: Solver effort in the simulator. One of ``fast``, ``accurate``, ``converged``. Default: of a loop
            'accurate', of gaitfit.evaluate 'fast'.

    >>> settings = Loop(evaluate=Evaluate(trajectories=300))
    """

    trajectories: int | None = None
    seconds: float | None = None
    drift: int | None = None
    drift_speeds: tuple[float, float, float] | None = None
    seed: int | None = None
    preset: Preset | None = None


@dataclass(frozen=True, kw_only=True)
class Collect(Settings):
    """What a collection of logs records.

    Attributes:
        trajectories: Trajectories, one log each. Default: 64.
        seconds: Length of each, s. Default: 4.0.
        log_shift: Each log begins this long after the robot, drawn between the two, s. Default: (0.0, 0.0).
        privileged: Whether logs have the base's position and velocity too, which a robot does not measure. Default:
            False.
        commands: A file of commands to play, one sequence a trajectory, instead of drawing them.
        preset: Solver effort. One of ``fast``, ``accurate``, ``converged``. Default: 'fast'.
        seed: Seed of commands, starts and noise. Default: 0.

    >>> settings = Collect(trajectories=8, seconds=10.0, privileged=True)
    """

    trajectories: int | None = None
    seconds: float | None = None
    log_shift: tuple[float, float] | None = None
    privileged: bool | None = None
    commands: str | os.PathLike[str] | None = None
    preset: Preset | None = None
    seed: int | None = None


@dataclass(frozen=True, kw_only=True)
class Loop(Settings):
    """All settings of one loop.

    Attributes:
        name: Name of the run and of its folder; the configuration file's stem when absent.
        policy: The policy that walks.
        robot: Robot file (MJCF or URDF); the built-in Go2 when empty.
        lenient: Drop what the engine cannot simulate in the robot file instead of refusing it. Default: False.
        runs: Folder that holds the run folders. Default: 'runs'.
        logs: Logs of the first round; the target's when empty.
        held_out: One log of so many is not fitted but shows how well the fit predicts; 0: all are fitted. Default: 4.
        rounds: Most rounds. Default: 1.
        improvement: Share by which a round must lower the tracking error for a further one to begin. Default: 0.02.
        references: Whether a policy is fine-tuned in the true simulator too. Default: True.
        controls: What else it is fine-tuned in, to compare.
        checkpoint_seconds: Seconds between checkpoints. Default: 10.0.
        target: The robot, if it can be run from here.
        adapt: What is fitted, and how.
        finetune: Training in the fitted simulator.
        evaluate: What is measured.

    >>> settings = Loop(policy="walk.safetensors", logs=["walks"], evaluate=Evaluate(trajectories=300))
    """

    name: str | None = None
    policy: str | os.PathLike[str] | None = None
    robot: str | os.PathLike[str] | None = None
    lenient: bool | None = None
    runs: str | os.PathLike[str] | None = None
    logs: Sequence[str | os.PathLike[str]] | None = None
    held_out: int | None = None
    rounds: int | None = None
    improvement: float | None = None
    references: bool | None = None
    controls: Controls | None = None
    checkpoint_seconds: float | None = None
    target: Target | None = None
    adapt: Fit | None = None
    finetune: Finetune | None = None
    evaluate: Evaluate | None = None
