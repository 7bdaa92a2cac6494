"""Settings of tasks. Written by tools/make_python_config.py from the settings' structs: do not edit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from .._settings import Settings

TaskName = Literal["velocity", "biped"]
FrameOrder = Literal["terms", "frames", "newest_first"]
HistoryStart = Literal["first", "zeros"]
Quantity = Literal[
    "base_angular_velocity", "projected_gravity", "command", "joint_position", "joint_velocity", "last_action",
    "base_linear_velocity", "base_height", "gait_phase", "gait_sine", "constant", "earlier_action",
    "reference_joint_position", "reference_joint_velocity", "reference_orientation", "reference_phase",
]


@dataclass(frozen=True, kw_only=True)
class Term(Settings):
    """One part of an observation.

    Attributes:
        quantity: What is observed. One of ``base_angular_velocity``, ``projected_gravity``, ``command``,
            ``joint_position``, ``joint_velocity``, ``last_action``, ``base_linear_velocity``, ``base_height``,
            ``gait_phase``, ``gait_sine``, ``constant``, ``earlier_action``, ``reference_joint_position``,
            ``reference_joint_velocity``, ``reference_orientation``, ``reference_phase``.
        scale: Factor on it: one number for all its elements, or one an element; none means 1.
        history: Frames: the present one and those of the control periods before it. 1, the default, is the present alone.
        ahead: Control periods by which the reference motion is read ahead; for quantities of the motion.

    >>> settings = TaskPolicy(observation=[Term("base_angular_velocity", scale=[0.25]), Term("joint_position", history=5)])
    """

    quantity: Quantity = field(kw_only=False)
    scale: Sequence[float] | None = None
    history: int | None = None
    ahead: int | None = None


@dataclass(frozen=True, kw_only=True)
class History(Settings):
    """How the frames of terms with a history lie in a row, and what stands for frames before an episode's start.

    Attributes:
        order: Which number follows which. One of ``terms``, ``frames``, ``newest_first``.
        start: What the frames before an episode's first observation hold. One of ``first``, ``zeros``.

    >>> settings = TaskPolicy(history=History(order="frames", start="zeros"))
    """

    order: FrameOrder | None = None
    start: HistoryStart | None = None


@dataclass(frozen=True, kw_only=True)
class TaskPolicy(Settings):
    """How a new policy sees and moves the robot.

    Attributes:
        observation: The actor's observation, part by part.
        critic_observation: The critic's observation, part by part.
        joints: Patterns over the joints that the policy moves; all of them if there is none. The others are held in the
            default pose by their gains.
        velocity_joints: Names or patterns of joints with velocity targets, rad/s, such as wheels: torque = kd (target −
            velocity). Their kp and their pose are 0, and the policy does not observe their positions.
        history: How past frames lie in a row, where terms have a history.
        default_pose: Pose at action zero, rad; 0 where no pattern matches.
        action_scale: Target change per unit action, rad; rad/s for ``velocity_joints``. Default: 0.25.
        action_clip: Largest action magnitude, before scaling; absent: not limited.
        kp: Position gain, N·m/rad. Default: 25.0.
        kd: Velocity gain, N·m·s/rad. Default: 0.5.
        gait_frequency: Frequency of the gait clock, Hz, for policies that observe it.

    >>> settings = Task(policy=TaskPolicy(action_scale=0.25, kp=25.0, kd=0.5))
    """

    observation: Sequence[Term] | None = None
    critic_observation: Sequence[Term] | None = None
    joints: Sequence[str] | None = None
    velocity_joints: Sequence[str] | None = None
    history: History | None = None
    default_pose: Mapping[str, float] | None = None
    action_scale: float | Mapping[str, float] | None = None
    action_clip: float | Mapping[str, float] | None = None
    kp: float | Mapping[str, float] | None = None
    kd: float | Mapping[str, float] | None = None
    gait_frequency: float | None = None


@dataclass(frozen=True, kw_only=True)
class Curriculum(Settings):
    """Commands of a training that begin in smaller ranges and grow to those of ``Command``. One of ``tracking`` and
    ``iterations`` says when.

    Attributes:
        x: Forward at first, m/s; without it the final range.
        y: To the left at first, m/s.
        yaw: Yaw rate at first, rad/s.
        tracking: Ranges grow by a step when the tracking rewards pass this share of their greatest value.
        step: Such a step, as a share of the way from the first ranges to the final ones.
        iterations: Ranges grow evenly over this many iterations.

    >>> settings = Command(curriculum=Curriculum(x=(-0.3, 0.3), tracking=0.8))
    """

    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    yaw: tuple[float, float] | None = None
    tracking: float | None = None
    step: float | None = None
    iterations: int | None = None


@dataclass(frozen=True, kw_only=True)
class Command(Settings):
    """Velocity commands in the heading frame, drawn uniformly.

    Attributes:
        x: Forward, m/s. Default: [-1.0, 1.0].
        y: To the left, m/s. Default: [-1.0, 1.0].
        yaw: Yaw rate, rad/s. Default: [-1.0, 1.0].
        seconds: Time until the next command, s. Default: 4.0.
        standing: Share of commands that are zero. Default: 0.05.
        curriculum: How the ranges grow in a training; without it they are the same from the start.

    >>> settings = Task(command=Command(x=(-0.5, 1.5), yaw=(-1.0, 1.0)))
    """

    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    yaw: tuple[float, float] | None = None
    seconds: float | None = None
    standing: float | None = None
    curriculum: Curriculum | None = None


@dataclass(frozen=True, kw_only=True)
class Fall(Settings):
    """When a robot counts as fallen.

    Attributes:
        contacts: Patterns over names of geoms that must not touch the ground. Default: ['trunk', 'head', 'chin'].
        tilt: Angle between wanted and actual posture, degrees. Default: 60.0.
        height: Lowest height of the base's origin above the ground under it, m. Default: 0.12.

    >>> settings = Task(fall=Fall(tilt=1.0))
    """

    contacts: Sequence[str] | None = None
    tilt: float | None = None
    height: float | None = None


@dataclass(frozen=True, kw_only=True)
class Start(Settings):
    """How an episode starts: at rest in a pose, plus uniform deviations.

    Attributes:
        pose: Joint angles, rad; the default pose where no pattern matches. Joints that follow others start where their
            leaders put them.
        pitch: Pitch of the base, degrees; −90 is nose up. Default: 0.0.
        yaw: Half range of the heading, degrees. Default: 180.0.
        joint_position: Half range of joint angles about the pose, rad. Default: 0.1.
        joint_velocity: Half range of joint velocities, rad/s. Default: 0.0.
        linear_velocity: Half range of the base's linear velocity along x and y, m/s. Default: 0.0.
        angular_velocity: Half range of the base's angular velocity, rad/s. Default: 0.0.
        tilt: Half range of roll and pitch about the start's orientation, degrees. Default: 5.0.

    >>> settings = Task(start=Start(tilt=10.0, linear_velocity=0.3))
    """

    pose: Mapping[str, float] | None = None
    pitch: float | None = None
    yaw: float | None = None
    joint_position: float | None = None
    joint_velocity: float | None = None
    linear_velocity: float | None = None
    angular_velocity: float | None = None
    tilt: float | None = None


@dataclass(frozen=True, kw_only=True)
class Randomisation(Settings):
    """What differs between the robots, drawn uniformly once a robot.

    Attributes:
        base_mass: Mass added to the base, kg. Default: [-1.0, 3.0].
        base_com: Shift of the base's centre of mass along each axis: half range, m. Default: 0.02.
        kp: Factor on all position gains. Default: [0.9, 1.1].
        kd: Factor on all velocity gains. Default: [0.9, 1.1].
        floor_friction: Factor on the friction between feet and ground. Default: [0.8, 1.6].
        frictionloss: Dry friction torque of the joints, N·m. Default: [0.0, 0.0].
        armature: Reflected rotor inertia of the joints, kg·m². Default: [0.0, 0.0].
        delay: Delay from a target to the motors, added to the robot's own, s. Default: [0.0, 0.0].

    >>> settings = Task(randomisation=Randomisation(floor_friction=(0.4, 1.2)))
    """

    base_mass: tuple[float, float] | None = None
    base_com: float | None = None
    kp: tuple[float, float] | None = None
    kd: tuple[float, float] | None = None
    floor_friction: tuple[float, float] | None = None
    frictionloss: tuple[float, float] | None = None
    armature: tuple[float, float] | None = None
    delay: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Push(Settings):
    """Pushes: the base's velocity jumps.

    Attributes:
        seconds: Time between pushes, s; 0 is never. Default: 5.0.
        velocity: Half range of the jump along x and y, m/s. Default: 0.5.

    >>> settings = Task(push=Push(seconds=8.0, velocity=0.3))
    """

    seconds: float | None = None
    velocity: float | None = None


@dataclass(frozen=True, kw_only=True)
class Terrain(Settings):
    """Uneven ground: a grid of square cells, levels of difficulty along x and kinds along y. Each robot starts in the
    middle of a cell. Pairs of sizes are those of the first and of the last level.

    Attributes:
        kind: What is on the cells: a kind, or kinds with their shares of the columns. Of slopes and stairs every other
            column is a pit, out of which a robot climbs.
        levels: Levels of difficulty: cells along x.
        columns: Cells along y.
        size: Edge of a cell, m.
        platform: Edge of the level place in the middle of slopes and stairs, m.
        step_height: Height of a step of stairs, m.
        step_depth: Depth of a step of stairs, m.
        slope: Slope: rise over run.
        roughness: Largest height of rough ground above and below its middle, m.
        rough_distance: Distance of the heights of rough ground that are drawn, m.
        cell: Distance of neighbouring vertices, m; feet must have a radius of at most half of it.
        border: Width of the level ground around all cells, m. An episode ends, as if time were up, half a metre from its
            edge.
        seed: Seed of the rough ground.
        curriculum: Whether robots move among the levels: one that leaves its cell goes one up, one that falls or comes
            less than half as far as was commanded goes one down, one that passes the last level starts at any. Otherwise
            each episode starts at any level.
        start_level: The highest level, from 0, that a robot of a curriculum begins at; the last one, if there are fewer.

    >>> settings = Task(terrain=Terrain(kind="rough"))
    """

    kind: str | Mapping[str, float] | None = None
    levels: int | None = None
    columns: int | None = None
    size: float | None = None
    platform: float | None = None
    step_height: tuple[float, float] | None = None
    step_depth: tuple[float, float] | None = None
    slope: tuple[float, float] | None = None
    roughness: tuple[float, float] | None = None
    rough_distance: float | None = None
    cell: float | None = None
    border: float | None = None
    seed: int | None = None
    curriculum: bool | None = None
    start_level: int | None = None


@dataclass(frozen=True, kw_only=True)
class Task(Settings):
    """What the robot is asked to do, how it starts and ends, what is randomised, and what it is paid for.

    Attributes:
        base: The built-in task that it begins with; other settings change it. One of ``velocity``, ``biped``.
        episode_seconds: Longest episode, s. Default: 20.0.
        control_dt: Time between actions, s. Default: 0.02.
        substeps: Physics steps between actions. Default: 4.
        robot_timestep: Physics step of the robot that the simulation stands for, s: forces that depend on velocity act
            half of it late. Absent: the simulation's own.
        feet: The feet: names of geoms, or of bodies, whose geoms are one foot together.
        gait: Feet that should move together in the gait, for example the diagonals of a trot; groups alternate.
        self_contact: Which of the robot's own parts touch each other; absent: none.
        posture: Direction of gravity in the body frame in the wanted posture, unit: (0, 0, −1) on four legs. Default:
            [0.0, 0.0, -1.0].
        height: Height of the base's origin above the ground that the rewards want, m. Default: 0.3.
        swing_height: Height of a foot's centre above the ground in mid-swing that the rewards want, m. Default: 0.1.
        swing_seconds: Time a foot is off the ground in a step that the rewards want, s. Default: 0.25.
        tracking_width: Width of the velocity tracking reward, exp(−error²/width²), m/s. Default: 0.5.
        yaw_tracking_width: The same of the yaw rate, rad/s. Default: 0.5.
        policy: The policy's interface.
        command: Commands.
        fall: When an episode ends as a fall.
        start: How an episode starts.
        noise: Half range of the uniform noise on the actor's observation. One of ``base_angular_velocity``,
            ``projected_gravity``, ``command``, ``joint_position``, ``joint_velocity``, ``last_action``,
            ``base_linear_velocity``, ``base_height``, ``gait_phase``, ``gait_sine``, ``constant``, ``earlier_action``,
            ``reference_joint_position``, ``reference_joint_velocity``, ``reference_orientation``, ``reference_phase``.
        randomisation: What differs between the robots.
        push: Pushes.
        terms: Reward terms of one's own by name: expressions; their weights are in ``rewards``.
        terrain: Uneven ground in the place of the robot file's planes; absent: the robot file's ground.
        rewards: Weight of each reward term; a step pays the weight times the term times ``control_dt``.

    Names in expressions of ``terms``, with their elements where they are rows:

    - ``command`` (``x``, ``y``, ``yaw``): commanded velocity: forward, left, m/s; yaw rate, rad/s
    - ``velocity`` (``x``, ``y``, ``z``): velocity of the base: forward, left, up, m/s
    - ``angular_velocity`` (``x``, ``y``, ``z``): of the base, in its own frame, rad/s
    - ``yaw_rate``: angular velocity about the vertical, rad/s
    - ``gravity`` (``x``, ``y``, ``z``): direction of gravity in the base's frame, length 1
    - ``uprightness``: cosine of the angle between actual and wanted posture
    - ``height``: height of the base's origin above the ground under it, m
    - ``qpos``, ``default_pose``, ``target`` (joints): joint positions; positions at action 0; position targets of this
      step, rad. Without names, joints with velocity targets are left out
    - ``qvel``, ``qacc`` (joints): joint velocities, rad/s, and accelerations, rad/s²
    - ``tau`` (joints): motor torques, N·m
    - ``action``, ``last_action`` (joints of the policy): this step's action and the previous one, as the policy gives
      them
    - ``contact``, ``landed`` (feet): 1 on the ground; 1 in the step in which the foot comes down
    - ``foot_height``, ``foot_speed`` (feet): height of the foot's centre above the ground under it, m; its horizontal
      speed, m/s
    - ``air_time``, ``contact_time``, ``last_air_time`` (feet): time in the air so far, on the ground so far, and in the
      last flight, s
    - ``body_contacts``: parts on the ground, other than feet and parts that end the episode
    - ``walking``, ``fallen``: 1 if the command asks for movement; 1 in the step of a fall
    - ``clock``: phase of the gait clock, 0 to 1
    - ``dt``: time between actions, s
    - ``gait_group`` (feet): number of the foot's group in the task's ``gait``, from 0; −1 outside the gait
    - ``wanted_height``, ``swing_height``, ``swing_seconds``, ``tracking_width``, ``yaw_tracking_width``: the task's
      settings (``wanted_height`` is ``height``)

    - A quantity with elements is a row of numbers. ``tau["*_calf"]`` picks elements by name or pattern, ``tau["FL_*",
      "RR_hip"]`` by several; they stay in the robot's order. One element is a number.
    - Operators and functions go element by element: ``+ - * / ^``, ``< <= > >= == !=`` (1 or 0), ``and or not``, ``abs
      sqrt square exp ln sin cos tanh floor``, ``min(a, b)``, ``max(a, b)``, ``clamp(x, low, high)``, ``select(condition,
      yes, no)``. Rows in one operation must have the same length.
    - ``first(row)`` and ``second(row)`` are rows with one element of each pair: ``sum(first(contact) ==
      second(contact))`` counts the pairs of feet that are both down or both up. The row has at most 32 elements.
    - ``sum``, ``mean``, ``norm``, ``min`` and ``max`` of a row are numbers. The whole expression must be a number.
    - ``-2^2`` is −4. ``not`` binds less than comparisons, so put ``not contact`` in brackets as a factor: ``x * (not
      contact)``.
    - An expression has at most 1000 characters, 256 operators, numbers and quantities, 32 sums or other folds, and 32
      nested brackets, signs and functions.

    >>> settings = Task(episode_seconds=10.0, tracking_width=0.25)
    """

    base: TaskName | None = None
    episode_seconds: float | None = None
    control_dt: float | None = None
    substeps: int | None = None
    robot_timestep: float | None = None
    feet: Sequence[str] | None = None
    gait: Sequence[Sequence[str]] | None = None
    self_contact: Literal["off", "file", "limbs"] | Sequence[tuple[str, str]] | None = None
    posture: tuple[float, float, float] | None = None
    height: float | None = None
    swing_height: float | None = None
    swing_seconds: float | None = None
    tracking_width: float | None = None
    yaw_tracking_width: float | None = None
    policy: TaskPolicy | None = None
    command: Command | None = None
    fall: Fall | None = None
    start: Start | None = None
    noise: Mapping[Quantity, float] | None = None
    randomisation: Randomisation | None = None
    push: Push | None = None
    terms: Mapping[str, str] | None = None
    terrain: Terrain | None = None
    rewards: Mapping[str, float] | None = None
