"""Settings of fits. Written by tools/make_python_config.py from the settings' structs: do not edit."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from .._settings import Settings

Base = Literal["fixed", "free"]
Method = Literal["auto", "cma-es", "least-squares"]
RandomNumbers = Literal["generation", "run", "candidate"]
CovarianceKind = Literal["full", "separable"]
BoundHandling = Literal["resample", "reflect"]
Sharing = Literal["group", "joint", "all"]
NetworkName = Literal["action_delta", "resid_act"]
NetworkStart = Literal["zero", "random", "features"]
RobotNumber = Literal[
    "torque_noise", "base_mass", "base_com_x", "base_com_y", "base_com_z", "payload_mass", "payload_x", "payload_y",
    "payload_z", "floor_friction", "ground_softness", "ground_impedance", "imu_roll", "imu_pitch", "gyro_bias_x",
    "gyro_bias_y", "gyro_bias_z", "velocity_lag", "imu_delay",
]
FindingKind = Literal[
    "malformed", "missing-joint", "extra-joint", "joint-order", "too-short", "non-monotonic-time", "time-gap",
    "irregular-time", "coarse-time", "time-unit", "rate-mismatch", "repeated-rows", "not-finite", "beyond-position-limit",
    "beyond-velocity-limit", "suspect-unit", "constant-signal", "frozen-target", "velocity-mismatch", "velocity-lag",
    "position-jump", "frozen-position", "velocity-spike", "saturated", "joint-not-following", "stuck", "lying", "fallen",
    "hanging", "target-is-position", "jumps-to-zero", "gains-change", "feed-forward", "quaternion-order", "imu-frame",
    "imu-unit", "imu-sign", "imu-mounting", "imu-mismatch", "gyro-bias", "gyro-lag", "joint-sign",
]
Preset = Literal["fast", "accurate", "converged"]
ParameterKind = Literal[
    "frictionloss", "stiction", "stribeck_velocity", "load_friction", "play", "compliance", "armature", "damping",
    "delay", "encoder_bias", "torque_scale", "torque_offset", "stiffness", "spring_torque", "no_load_speed",
    "stall_torque", "kp_scale", "kd_scale", "link_mass", "link_com_x", "link_com_y", "link_com_z",
]
#: Of ``matchr`` and ``matchs`` the common numbers of samples; settings by name take any.
Cost = Literal[
    "wass", "matcho", "matchr1", "matchr2", "matchr5", "matchr10", "matchr20", "matchs", "matchs1", "matchs5", "matchs10",
    "matchs20", "matchs50",
]


@dataclass(frozen=True, kw_only=True)
class Gains(Settings):
    """PD gains: one number for all joints, or numbers by joint name or pattern.

    Attributes:
        kp: Position gain, N·m/rad.
        kd: Velocity gain, N·m·s/rad.

    >>> settings = Fit(gains=Gains(kp=20.0, kd=0.5))
    """

    kp: float | Mapping[str, float] | None = None
    kd: float | Mapping[str, float] | None = None


@dataclass(frozen=True, kw_only=True)
class ValidateGains(Settings):
    """PD gains of some validation logs.

    Attributes:
        files: Patterns over file names or paths, for example ``run_9.csv`` or ``*stiff*``.
        kp: Position gain, N·m/rad.
        kd: Velocity gain, N·m·s/rad.

    >>> settings = Fit(validate_gains=[ValidateGains(files=["*stiff*"], kp=30.0, kd=0.8)])
    """

    files: Sequence[str] | None = None
    kp: float | Mapping[str, float] | None = None
    kd: float | Mapping[str, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Parameter(Settings):
    """A rule: a parameter, the joints it covers, and what it takes instead of the parameter's defaults.

    Attributes:
        kind: Parameter.
        per: How many joints share a value. One of ``group``, ``joint``, ``all``.
        joints: Patterns over joint names, with or without a final ``_joint``; a joint is covered when any matches.
        name: Name of the entry, or its first part where there are several.
        lower: Lower bound.
        upper: Upper bound.
        start: First mean.
        deviation: First standard deviation.

    Kinds, each with its unit and, by default, (lower, upper, start, deviation). A value replaces that of the robot's
    file; those without unit that start at 1 are factors:

    - ``frictionloss``, N·m, (0.0, 0.5, 0.0, 0.1): Dry (Coulomb) friction torque, N·m.
    - ``stiction``, N·m, (0.0, 0.5, 0.0, 0.1): Dry friction at rest above that in motion (``frictionloss``), N·m.
    - ``stribeck_velocity``, rad/s, (0.01, 1.0, 0.1, 0.05): Velocity at which 1/e of ``stiction`` is left, rad/s (Stribeck
      velocity).
    - ``load_friction``, -, (0.0, 0.5, 0.0, 0.05): Dry friction that grows with load: N·m of friction for each N·m of the
      motor's torque.
    - ``play``, rad, (0.0, 0.1, 0.0, 0.01): Play (backlash) between motor and link, rad: the whole width. Encoders are at
      the motor; so are the rotor's inertia, dry friction and damping.
    - ``compliance``, rad/(N·m), (0.0, 0.02, 0.0, 0.002): Compliance of the gear between motor and link, rad/(N·m): the
      inverse of its stiffness.
    - ``armature``, kg·m², (0.0, 0.5, 0.0, 0.05): Reflected rotor inertia, kg·m².
    - ``damping``, N·m·s/rad, (0.0, 2.0, 0.0, 0.1): Viscous damping, N·m·s/rad.
    - ``delay``, s, (0.0, 0.1, 0.0, 0.01): Time from a position target being sent to it acting, s.
    - ``encoder_bias``, rad, (-0.1, 0.1, 0.0, 0.01): Encoder reading minus true joint angle, rad.
    - ``torque_scale``, -, (0.5, 1.5, 1.0, 0.05): Delivered torque over commanded torque.
    - ``torque_offset``, N·m, (-1.0, 1.0, 0.0, 0.1): Constant torque added to the PD torque, N·m: weight, springs and
      cables that the model lacks.
    - ``stiffness``, N·m/rad, (-100.0, 400.0, 0.0, 2.0): Stiffness of a spring on the joint beside the model's own,
      N·m/rad.
    - ``spring_torque``, N·m, (-800.0, 800.0, 0.0, 2.0): Torque of that spring at angle 0, N·m: its stiffness times its
      rest angle.
    - ``no_load_speed``, rad/s, (5.0, 100.0, 30.0, 5.0): Speed at which the motor's largest torque has fallen to 0, rad/s;
      infinite if it does not fall.
    - ``stall_torque``, N·m, (1.0, 200.0, 40.0, 5.0): Largest torque at standstill on the line that falls to 0 at
      ``no_load_speed``, N·m. It stands beside ``torque_limit``: the smaller of the two holds.
    - ``kp_scale``, -, (0.5, 2.0, 1.0, 0.1): True position gain over the stated one.
    - ``kd_scale``, -, (0.5, 2.0, 1.0, 0.1): True velocity gain over the stated one.
    - ``link_mass``, -, (0.5, 2.0, 1.0, 0.1): True mass and inertia of the link that the joint moves over the model's: the
      body with all that is welded to it.
    - ``link_com_x``, m, (-0.05, 0.05, 0.0, 0.01): Shift of that link's centre of mass along x, m, axes of the joint's
      body.
    - ``link_com_y``, m, (-0.05, 0.05, 0.0, 0.01): The same along y; with the other sign on joints to the right of the
      base, so that mirrored legs share a value.
    - ``link_com_z``, m, (-0.05, 0.05, 0.0, 0.01): The same along z.

    >>> settings = Fit(parameters=[Parameter("frictionloss", per="group", upper=1.5), Parameter("delay", per="all")])
    """

    kind: ParameterKind = field(kw_only=False)
    per: Sharing | None = None
    joints: Sequence[str] | None = None
    name: str | None = None
    lower: float | None = None
    upper: float | None = None
    start: float | None = None
    deviation: float | None = None


@dataclass(frozen=True, kw_only=True)
class Network(Settings):
    """A rule: networks (6 inputs, hidden 8 and 4, tanh, one output) of the joints it covers.

    Attributes:
        kind: The quantity that the networks correct. One of ``action_delta``, ``resid_act``.
        per: How many joints share weights. A network sees its own joint alone either way. One of ``group``, ``joint``,
            ``all``.
        joints: Patterns over joint names, with or without a final ``_joint``; a joint is covered when any matches.
        lower: Lower bound of every weight that is searched.
        upper: Upper bound of every weight that is searched.
        start: Start of the search. One of ``zero``, ``random``, ``features``.
        deviation: First standard deviation of every weight that is searched.
        position_scale: Factor on the joint's angle less its rest angle, 1/rad.
        velocity_scale: Factor on the joint's velocity, s/rad.
        output_scale: Output for a last layer of weight 1, rad or N·m.
        regularisation: Added to every cost times the mean over the networks of b² + Σ w² over the last layer (weights w,
            bias b). Hidden units lie in [−1, 1], so five times that bounds the square of the output in units of
            ``output_scale``: joints that the cost says nothing about stay uncorrected.

    >>> settings = Fit(networks=[Network("resid_act", joints=["*_calf_joint"])])
    """

    kind: NetworkName = field(kw_only=False)
    per: Sharing | None = None
    joints: Sequence[str] | None = None
    lower: float | None = None
    upper: float | None = None
    start: NetworkStart | None = None
    deviation: float | None = None
    position_scale: float | None = None
    velocity_scale: float | None = None
    output_scale: float | None = None
    regularisation: float | None = None


@dataclass(frozen=True, kw_only=True)
class Number(Settings):
    """A rule: a number, and what it takes instead of its defaults.

    Attributes:
        kind: Which number. One of ``torque_noise``, ``base_mass``, ``base_com_x``, ``base_com_y``, ``base_com_z``,
            ``payload_mass``, ``payload_x``, ``payload_y``, ``payload_z``, ``floor_friction``, ``ground_softness``,
            ``ground_impedance``, ``imu_roll``, ``imu_pitch``, ``gyro_bias_x``, ``gyro_bias_y``, ``gyro_bias_z``,
            ``velocity_lag``, ``imu_delay``.
        lower: Lower bound.
        upper: Upper bound.
        start: First mean.
        deviation: First standard deviation.

    >>> settings = Fit(numbers=[Number("payload_mass", upper=5.0)])
    """

    kind: RobotNumber = field(kw_only=False)
    lower: float | None = None
    upper: float | None = None
    start: float | None = None
    deviation: float | None = None


@dataclass(frozen=True, kw_only=True)
class Prior(Settings):
    """An estimate of an entry that was made without the fit, with its standard error: legs in the air, a data sheet, a
    test bench. The search begins there, with steps of that size, and pays for going away.

    Attributes:
        value: The estimate, in the entry's unit.
        deviation: Its standard error, in the same unit.
        by_strength: By how much the estimate rises if the motors' strength (``torque_scale`` of the entry's joints) rises
            by 1. Legs in the air show the joints' resistance relative to the motors' torque. So the estimate assumes
            motors with a strength of 1.
        by_load: By how much the estimate falls if the friction under load (``load_friction`` of the entry's joints) rises
            by 1: with a load friction of c the estimate is lower by c times this. Legs in the air show only the sum of
            both frictions.

    >>> settings = Fit(prior={"frictionloss_calf": Prior(value=0.2, deviation=0.05)})
    """

    value: float | None = None
    deviation: float | None = None
    by_strength: float | None = None
    by_load: float | None = None


@dataclass(frozen=True, kw_only=True)
class Simulation(Settings):
    """How logs are replayed.

    Attributes:
        timestep: Largest physics step, s; each log sample is split into the fewest equal steps not above it. Default:
            0.005.
        robot_timestep: Walking logs: physics step of the simulated robot that made them, or period of the real one's
            motor boards, s. Absent: the fit's own step. Default: of walks 0.001.
        self_contact: Which parts of the robot may touch each other; absent: those of the policy's task, and none of a
            clamped robot.
        preset: Solver effort. One of ``fast``, ``accurate``, ``converged``. Default: 'accurate', of walks 'fast'.
        skip_seconds: Seconds at the start of each log that do not count in costs and errors.
        starts: Walking logs compared by distributions (``wass``) alone: how often a candidate walks each log, from the
            start that the sensors show and from starts near it. Default: 1, of walks 4.
        horizon_seconds: Seconds of each walking log, after the skipped ones, that count; 0 counts all of it. Default:
            0.0.
        threads: Threads; 0 takes one for each core. Default: 0.

    >>> settings = Fit(simulation=Simulation(preset="fast", robot_timestep=0.001))
    """

    timestep: float | None = None
    robot_timestep: float | None = None
    self_contact: Literal["off", "file", "limbs"] | Sequence[tuple[str, str]] | None = None
    preset: Preset | None = None
    skip_seconds: float | None = None
    starts: int | None = None
    horizon_seconds: float | None = None
    threads: int | None = None


@dataclass(frozen=True, kw_only=True)
class Falls(Settings):
    """What falls mean in fits of walking logs.

    Attributes:
        margin_seconds: Time that is cut from a log before a fall, s.
        penalty: Price of a fall in every log: a candidate pays it times the share of the logs in which it falls. By
            default, if the robot never fell, a candidate that falls never beats one that stands; else it pays only for
            more falls than the robot's, beyond chance.

    >>> settings = Fit(falls=Falls(margin_seconds=0.5))
    """

    margin_seconds: float | None = None
    penalty: float | None = None


@dataclass(frozen=True, kw_only=True)
class Optimizer(Settings):
    """The optimiser.

    Attributes:
        method: How seeds search: ``least-squares`` for costs that compare single samples, ``cma-es`` for any, or
            ``auto``. One of ``auto``, ``cma-es``, ``least-squares``. Default: 'auto'.
        population: Candidates a generation; 0 takes 4 + ⌊3 ln n⌋. Default: 0, of walks 32.
        generations: Generations of every start. Default: 200, of walks 300.
        restarts: Starts after the first, each with twice the population of the one before. Default: 0.
        seeds: Independent fits; the spread of a parameter is its standard deviation over them. With 0 ``seed_count``
            chooses their number for the device. Default: 5, of walks 0.
        seed: First seed; the others follow it. Default: 1.
        covariance: Covariance model. One of ``full``, ``separable``. Default: 'full'.
        bounds: What happens to draws outside the bounds. One of ``resample``, ``reflect``. Default: 'reflect'.
        random_numbers: Which candidates see the same random numbers (torque noise). One of ``generation``, ``run``,
            ``candidate``. Default: 'generation'.
        replicates: Sets of simulated logs a round, which correct fits of walking logs by least squares, and a twentieth
            of the simulated robots a round, which correct those by distributions; 0: no correction. Default: 4.
        patience: A seed of CMA-ES stops once the smallest costs of this many generations hardly change: the means of
            their halves differ by less than a fiftieth, standard error included; 0 never, 1 to 3 count as 4. Default: 0,
            of walks 40.
        prior_weight: Cost of a distance of one standard error from a ``[prior]``. Default: 0.0005.
        tolerance: A seed stops once its search distribution is this small: largest standard deviation of any parameter,
            relative to its initial deviation. 0 never stops early. Default: 0.0001.
        max_seconds: Wall time after which the search stops with what it has, s; 0 has no limit. Intervals are measured
            after it, which takes as long again or longer. Estimates of a search that was cut off are not corrected by
            simulated logs, and have no intervals where such a correction belongs to the fit. Default: 0.0.

    >>> settings = Fit(optimizer=Optimizer(generations=50, seeds=3))
    """

    method: Method | None = None
    population: int | None = None
    generations: int | None = None
    restarts: int | None = None
    seeds: int | None = None
    seed: int | None = None
    covariance: CovarianceKind | None = None
    bounds: BoundHandling | None = None
    random_numbers: RandomNumbers | None = None
    replicates: int | None = None
    patience: int | None = None
    prior_weight: float | None = None
    tolerance: float | None = None
    max_seconds: float | None = None


@dataclass(frozen=True, kw_only=True)
class Check(Settings):
    """Checks on the result.

    Attributes:
        converged: Whether the search must have converged. Default: False.
        better_than_nominal: Whether the fitted robot must be closer to the logs than the robot before the fit. Default:
            False.
        sound: Whether the fit must be without any doubt. Default: False.
        cost: Largest cost on the fitted logs, of the first cost.
        validation_cost: The same on the validation logs.
        rmse_rad: Largest free-running position RMSE over the validation logs, rad.

    >>> settings = Fit(check=Check(converged=True, rmse_rad=0.01))
    """

    converged: bool | None = None
    better_than_nominal: bool | None = None
    sound: bool | None = None
    cost: float | None = None
    validation_cost: float | None = None
    rmse_rad: float | None = None


@dataclass(frozen=True, kw_only=True)
class Fit(Settings):
    """All settings of one adaptation.

    Attributes:
        name: Name of the run and of its folder; the configuration file's stem when absent.
        robot: Robot file (MJCF or URDF); for walking logs the built-in Go2 when empty.
        lenient: Drop what the engine cannot simulate in the robot file instead of refusing it. Default: False.
        base: How the robot's base was held while recording. One of ``fixed``, ``free``. Default: 'fixed', of walks
            'free'.
        policy: Walking logs: the policy that walked.
        known: File of parameters that are known already, a theta.toml. The fit's own parameters are added to them.
        logs: Logs to fit.
        validate: Logs to validate on, not used in the fit.
        allow: Findings of ``gaitfit inspect`` that do not forbid using a log. One of ``malformed``, ``missing-joint``,
            ``extra-joint``, ``joint-order``, ``too-short``, ``non-monotonic-time``, ``time-gap``, ``irregular-time``,
            ``coarse-time``, ``time-unit``, ``rate-mismatch``, ``repeated-rows``, ``not-finite``,
            ``beyond-position-limit``, ``beyond-velocity-limit``, ``suspect-unit``, ``constant-signal``,
            ``frozen-target``, ``velocity-mismatch``, ``velocity-lag``, ``position-jump``, ``frozen-position``,
            ``velocity-spike``, ``saturated``, ``joint-not-following``, ``stuck``, ``lying``, ``fallen``, ``hanging``,
            ``target-is-position``, ``jumps-to-zero``, ``gains-change``, ``feed-forward``, ``quaternion-order``,
            ``imu-frame``, ``imu-unit``, ``imu-sign``, ``imu-mounting``, ``imu-mismatch``, ``gyro-bias``, ``gyro-lag``,
            ``joint-sign``.
        costs: Costs to fit, one independent fit each. One of ``wass``, ``matcho``, ``matchr1``, ``matchr2``, ``matchr5``,
            ``matchr10``, ``matchr20``, ``matchs``, ``matchs1``, ``matchs5``, ``matchs10``, ``matchs20``, ``matchs50``.
            Default: ['matcho'], of walks ['wass'].
        odd_joints: Whether to look for joints that differ from the same joint of other legs, and to fit a spring on
            those. Default: False.
        swings: Whether what legs in the air show of friction, damping, armature and delay becomes a prior of a walk's
            fit; by default only where the settings name no parameters. Default: False, of walks True.
        effects: Whether a fit of walks gets further parameters for effects that its logs show without a simulation.
            Examples are play, soft ground and a tilted IMU. By default only where the settings name no parameters.
            Default: False, of walks True.
        runs: Folder that holds the run folders. Default: 'runs'.
        checkpoint_seconds: Seconds between checkpoints. Default: 5.0.
        joint_names: Joint names of the logs → joint names of the robot, where they differ.
        gains: PD gains of logs that do not state their own.
        validate_gains: PD gains of single validation logs; they replace those that the log states.
        groups: Joint groups by name: patterns over the robot's joint names. By default ``hip`` (``*_hip*``), ``thigh``
            and ``calf``; if these do not have all joints, joints whose names differ only in the leg are a group with the
            common part of their names.
        parameters: What to fit. In a file: ``parameter``.
        networks: Networks to fit. In a file: ``network``.
        numbers: Numbers of the whole robot to fit. In a file: ``number``.
        prior: Estimates of entries from before the fit, by their names. The search begins there and pays for the
            distance.
        simulation: How logs are replayed.
        falls: Walking logs: how falls count.
        optimizer: The optimiser.
        check: Checks on the result; a failed one ends the program with exit code 3.
        truth: True values by parameter name, where they are known (simulated robots): shown beside the fit.
        published: Published values by parameter name, as [smallest, largest]: shown beside the fit.

    >>> settings = Fit(robot="go2.xml", logs=["walks"], policy="walk.onnx", costs=["wass"])
    """

    name: str | None = None
    robot: str | os.PathLike[str] | None = None
    lenient: bool | None = None
    base: Base | None = None
    policy: str | os.PathLike[str] | None = None
    known: str | os.PathLike[str] | None = None
    logs: Sequence[str | os.PathLike[str]] | None = None
    validate: Sequence[str | os.PathLike[str]] | None = None
    allow: Sequence[FindingKind] | None = None
    costs: Cost | Sequence[Cost] | None = None
    odd_joints: bool | None = None
    swings: bool | None = None
    effects: bool | None = None
    runs: str | os.PathLike[str] | None = None
    checkpoint_seconds: float | None = None
    joint_names: Mapping[str, str] | None = None
    gains: Gains | None = None
    validate_gains: Sequence[ValidateGains] | None = None
    groups: Mapping[str, Sequence[str]] | None = None
    parameters: Sequence[Parameter] | None = None
    networks: Sequence[Network] | None = None
    numbers: Sequence[Number] | None = None
    prior: Mapping[str, Prior] | None = None
    simulation: Simulation | None = None
    falls: Falls | None = None
    optimizer: Optimizer | None = None
    check: Check | None = None
    truth: Mapping[str, float] | None = None
    published: Mapping[str, tuple[float, float]] | None = None
