"""A policy on a robot in official MuJoCo: what walk_mujoco.py and mujoco_robot.py share.

Everything about the policy (joints, pose, gains, observation, the task it was trained for) is read from the ONNX file's
`gaitfit` metadata, the network runs in onnxruntime, and nothing of gaitfit takes part. Quantities and rules are those of
`gaitfit evaluate`: velocities in the heading frame (square to the body's left axis), the yaw rate about the world's vertical,
one look a control period, the task's rule for falls.
"""

import concurrent.futures
import dataclasses
import fnmatch
import json
import math
import multiprocessing
import pathlib
import sys
import time
import tomllib

import mujoco
import numpy as np
import onnxruntime

from mujoco_effects import Effects, Feelings
from mujoco_motion import Motion

GO2 = pathlib.Path(__file__).parent.parent / "assets/go2.xml"
DIVERGED = [mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC]
# What random numbers are for; each trajectory has its own stream for each.
COMMAND, START, TORQUE_NOISE, LOG_SHIFT = range(4)
# Robots advanced together. Fixed, so that results do not depend on the number of processes.
GROUP = 16
# Between words about how far it is, s.
SAY_SECONDS = 5.0
# What a policy without a task of its own is tried with.
TASK = {
    "command": {"x": [-1.0, 1.0], "y": [-1.0, 1.0], "yaw": [-1.0, 1.0], "seconds": 4.0, "standing": 0.0},
    "fall": {"contacts": ["trunk", "head", "chin"], "tilt": 60.0, "height": 0.12},
}


class Refused(Exception):
    """Bad input; the message says which and why."""


def stream(seed, purpose, number):
    return np.random.default_rng([seed, purpose, number])


@dataclasses.dataclass(frozen=True)
class World:
    """A policy, and how its robot differs from the model file."""

    policy: pathlib.Path
    model: pathlib.Path = GO2
    timestep: float = 0.005  # s
    frictionloss: dict = dataclasses.field(default_factory=dict)  # N·m by joint pattern
    armature: dict = dataclasses.field(default_factory=dict)  # kg·m² by joint pattern
    damping: dict = dataclasses.field(default_factory=dict)  # viscous, N·m·s/rad by joint pattern
    springs: tuple = ()  # (joint, N·m/rad, rad)
    delay: float = 0.0  # s, from a position target to the motor
    torque_noise: float = 0.0  # N·m, standard deviation, drawn at every physics step
    strength: float = 1.0  # torque of the motors over the torque asked for, below their limits
    payload: tuple = ()  # (mass, kg, and its place in the base's frame, x, y, z, m): a point fixed to the base
    friction: float | None = None  # sliding friction of every geom
    ground_only: bool = False  # no contacts between the robot's own parts
    height: float | None = None  # of the base at the start, m; else the feet hang `clearance` above the ground
    clearance: float = 0.002  # m
    joint_noise: float = 0.0  # half range of the starting joint angles, rad
    effects: Effects = dataclasses.field(default_factory=Effects)  # what simulators lack
    fall: dict = dataclasses.field(default_factory=dict)  # replaces parts of the task's rule
    seed: int = 0


class Policy:
    """An ONNX policy written by gaitfit."""

    def __init__(self, path):
        if not path.is_file():
            raise Refused(f"{path}: no such file")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            self.session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's classes share no base but this
            raise Refused(f"{path}: not an ONNX file ({error}); write one with `gaitfit export POLICY --onnx`") from None
        metadata = self.session.get_modelmeta().custom_metadata_map
        try:
            document = json.loads(metadata["gaitfit"])
            self.interface = interface = document["interface"]
            per_joint = ("default_pose", "action_scale", "kp", "kd")
            self.pose, self.scale, self.kp, self.kd = (np.array(interface[key], float) for key in per_joint)
            self.joints, self.dt = interface["joints"], float(interface["control_dt"])
            # Joints whose targets are velocities, rad/s: torque = kd (target - dq).
            self.rolls = np.isin(self.joints, interface.get("velocity_joints", []))
            # Joints that the policy does not move: [{joint, position, kp, kd}].
            self.held = interface.get("held", [])
            self.motion = Motion(interface) if "reference" in interface else None
            self.clip = np.array(interface.get("action_clip") or math.inf)
            task = tomllib.loads(document.get("provenance", {}).get("task") or "")
        except (KeyError, TypeError, ValueError) as error:
            raise Refused(f"{path}: its `gaitfit` metadata cannot be used ({error!r}); export it with gaitfit") from None
        self.command = TASK["command"] | task.get("command", {})
        self.fall = TASK["fall"] | task.get("fall", {})
        # Direction of gravity in the body in the wanted posture, and the turn about y that robots start with, rad.
        self.posture = np.array(task.get("posture", [0.0, 0.0, -1.0]))
        self.pitch = math.radians(task.get("start", {}).get("pitch", 0.0))
        self.given, self.gives = self.session.get_inputs()[0], self.session.get_outputs()[0].name

    def act(self, rows):
        """Actions, neither clipped nor scaled, of rows of observations."""
        return self.session.run([self.gives], {self.given.name: rows})[0].astype(float)

    def targets(self, actions):
        """Joint position targets, rad."""
        return self.pose + self.scale * np.clip(actions, -self.clip, self.clip)


def by_joint(patterns, names, what):
    """Values for the joints that patterns name: {name: value}."""
    found = {}
    for pattern, value in patterns.items():
        matching = fnmatch.filter(names, pattern)
        if not matching:
            raise Refused(f"{what}: `{pattern}` matches no joint; there are {', '.join(names)}")
        for name in matching:
            if name in found:
                raise Refused(f"{what}: two entries match {name}; keep one")
            found[name] = value
    return found


def load(path):
    """The model of a file; one without a plane gets a floor."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise Refused(f"{path}: {error}") from None
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.geoms):
        print(f"note: {path} has no floor; it gets the plane z = 0", file=sys.stderr)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    return spec


def name_geoms(spec):
    """Gives geoms without a name the one that gaitfit gives them: their number in the file, bodies depth first."""
    taken = {geom.name for geom in spec.geoms}
    for number, geom in enumerate(spec.geoms):
        if not geom.name:
            name = f"geom{number}"
            while name in taken:
                name += "_"
            taken.add(name)
            geom.name = name


def undecorate(spec):
    """Takes away what is only to be seen: its files need not be there."""
    seen = [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH and not (g.contype or g.conaffinity)]
    for geom in [g for g in seen if g.parent.explicitinertial]:
        spec.delete(geom)
    for thing in [*spec.geoms, *spec.sites]:
        thing.material = ""
    used = {geom.meshname for geom in spec.geoms}
    for asset in [*spec.materials, *spec.textures, *(mesh for mesh in spec.meshes if mesh.name not in used)]:
        spec.delete(asset)


class Robot:
    """The MuJoCo model of a world, and where the policy's joints lie in it.

    The PD controller is MuJoCo's own affine actuator, which evaluates torque = kp (target - q) - kd dq, clipped at the motor's
    limits, at every physics step, as a motor board does.
    """

    def __init__(self, world, policy):
        spec = load(world.model)
        name_geoms(spec)
        if spec.modelname != policy.interface["robot"]:
            print(f"note: the policy is for robot {policy.interface['robot']}, {world.model} is {spec.modelname}", file=sys.stderr)
        hinges = {joint.name: joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE}
        names = list(hinges)
        for name, value in by_joint(world.frictionloss, names, "frictionloss").items():
            hinges[name].frictionloss = value
        for name, value in by_joint(world.armature, names, "armature").items():
            hinges[name].armature = value
        for name, value in by_joint(world.damping, names, "damping").items():
            # As springs: a polynomial, of which the linear term is used alone.
            hinges[name].damping = [value, 0, 0]
        for pattern, stiffness, angle in world.springs:
            for name in by_joint({pattern: stiffness}, names, "spring"):
                if any(hinges[name].stiffness):
                    raise Refused(f"spring: {name} has one already; a joint takes one")
                # MuJoCo's springs are polynomials: the linear term alone.
                hinges[name].stiffness = [stiffness, 0, 0]
                hinges[name].springref = angle
        if world.payload:
            mass, *place = world.payload
            base = spec.worldbody.first_body()
            # A point has no inertia of its own; MuJoCo wants a little. Without ipos it would lie twice as far away.
            point = {"mass": mass, "ipos": [0, 0, 0], "inertia": [1e-6] * 3, "explicitinertial": True}
            base.add_body(name="payload", pos=place, **point)
        if world.ground_only:
            # Geoms that touch nothing in the file stay so.
            for geom in spec.geoms:
                ground = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
                geom.contype, geom.conaffinity = (1, 0) if ground else (0, int(bool(geom.contype or geom.conaffinity)))
        world.effects.build(spec, hinges)
        undecorate(spec)
        self.model = model = spec.compile()
        world.effects.ground(model)
        model.opt.timestep = world.timestep
        # Files made for MJX ask for one step of the solver, which leaves friction far from what it should be.
        model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = 100, 50, 1e-12
        if world.friction is not None:
            model.geom_friction[:, 0] = world.friction
        self._find_joints(policy, world)
        self.substeps = whole(policy.dt, world.timestep, "the control period")
        self.delay = whole(world.delay, world.timestep, "the delay")
        self.floor = next(g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE)
        self.solid = self._touching()
        fall = policy.fall | world.fall
        self.posture = policy.posture
        self.lowest, self.upright = fall["height"], math.cos(math.radians(fall["tilt"]))
        geoms = {model.geom(g).name: g for g in range(model.ngeom)}
        self.fall_geoms = set()
        for pattern in fall["contacts"]:
            found = {geoms[name] for name in fnmatch.filter(geoms, pattern)}
            if not found:
                raise Refused(f"{world.model} has no geom {pattern}, whose contact is a fall")
            self.fall_geoms |= found

    def _touching(self):
        """Geoms that may touch the floor, by their bit masks or as a pair with it."""
        model, floor = self.model, self.floor
        pairs = {frozenset(pair) for pair in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist())}
        masks = (model.geom_contype & model.geom_conaffinity[floor]) | (model.geom_conaffinity & model.geom_contype[floor])
        found = [g for g in range(model.ngeom) if g != floor and (masks[g] or frozenset((g, floor)) in pairs)]
        if not found:
            raise Refused("nothing of the robot touches the floor")
        return found

    def _find_joints(self, policy, world):
        model = self.model
        bare = lambda name: name.removesuffix("_joint")
        joints = {bare(model.joint(j).name): j for j in range(model.njnt)}
        motors = {int(model.actuator_trnid[a, 0]): a for a in range(model.nu)}
        held = [joint["joint"] for joint in policy.held]
        for name in [*policy.joints, *held]:
            if joints.get(bare(name)) not in motors:
                raise Refused(f"{world.model} has no joint {name} with a motor")
        ids = [joints[bare(name)] for name in policy.joints]
        self.position, self.velocity = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
        self.motors = np.array([motors[j] for j in ids])
        self._drive(world, self.motors, world.strength * policy.kp, world.strength * policy.kd)
        rolling = np.asarray(self.motors)[policy.rolls]
        self.model.actuator_gainprm[rolling, 0] = world.strength * policy.kd[policy.rolls]
        ids = [joints[bare(name)] for name in held]
        self.held_motors = np.array([motors[j] for j in ids], int)
        self.held_position = model.jnt_qposadr[ids]
        self.held_pose, kp, kd = (np.array([joint[key] for joint in policy.held]) for key in ("position", "kp", "kd"))
        self._drive(world, self.held_motors, world.strength * kp, world.strength * kd)

    def _drive(self, world, motors, kp, kd):
        """Makes actuators servos with these gains, within the torque limits that they have."""
        model = self.model
        if (model.actuator_gear[motors] != [1, 0, 0, 0, 0, 0]).any() or model.actuator_gaintype[motors].any():
            raise Refused(f"{world.model}: motors must have gear 1 and a fixed gain")
        # The control of a torque motor is its torque, that of a servo a target.
        plain = (model.actuator_biastype[motors] == mujoco.mjtBias.mjBIAS_NONE) & (model.actuator_ctrllimited[motors] != 0)
        force = model.actuator_forcelimited[motors] != 0
        control = model.actuator_gainprm[motors, :1] * model.actuator_ctrlrange[motors]
        limits = np.where(force[:, None], model.actuator_forcerange[motors], control)
        limits = np.where((force & plain)[:, None], np.sign(control) * np.minimum(abs(limits), abs(control)), limits)
        model.actuator_gainprm[motors, 0] = kp
        model.actuator_biastype[motors] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_biasprm[motors, 0] = 0
        model.actuator_biasprm[motors, 1], model.actuator_biasprm[motors, 2] = -kp, -kd
        model.actuator_forcelimited[motors] = plain | force
        model.actuator_forcerange[motors] = limits
        model.actuator_ctrllimited[motors] = 0

    def start(self, world, policy, number):
        """The robot in the policy's default pose, still, its feet just above the ground."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.model.qpos0
        data.qpos[:7] = 0, 0, 1, math.cos(policy.pitch / 2), 0, math.sin(policy.pitch / 2), 0
        begins = policy.pose if policy.motion is None else policy.motion.joints(0.0)
        spread = stream(world.seed, START, number).uniform(-world.joint_noise, world.joint_noise, len(policy.pose))
        data.qpos[self.position] = begins + spread
        data.qpos[self.held_position] = self.held_pose
        mujoco.mj_kinematics(self.model, data)
        gaps = [mujoco.mj_geomDistance(self.model, data, self.floor, g, 5.0, None) for g in self.solid]
        data.qpos[2] = world.height if world.height is not None else 1 - min(gaps) + world.clearance
        mujoco.mj_forward(self.model, data)
        return data

    def fallen(self, data):
        if data.qpos[2] < self.lowest or -data.xmat[1][6:] @ self.posture < self.upright:
            return True
        for geoms, distance in zip(data.contact.geom, data.contact.dist):
            if self.floor in geoms and distance <= 0 and self.fall_geoms.intersection(geoms.tolist()):
                return True
        return False


def whole(time, timestep, what):
    steps = round(time / timestep)
    if abs(steps * timestep - time) > 1e-9:
        raise Refused(f"{what} of {time} s is no multiple of the timestep of {timestep} s")
    return steps


class Group:
    """Robots in lock step, so that the network runs once a control period. Fallen ones are left where they are."""

    def __init__(self, world, numbers):
        self.world, self.policy = world, Policy(world.policy)
        self.robot = Robot(world, self.policy)
        self.data = [self.robot.start(world, self.policy, number) for number in numbers]
        robot = self.robot
        places = robot.position, robot.velocity, robot.motors, self.policy.joints
        self.feelings = [Feelings(world.effects, robot.model, *places) for _ in numbers]
        self.noise = [stream(world.seed, TORQUE_NOISE, number) for number in numbers]
        self.fallen, self.diverged = np.zeros(len(numbers), bool), np.zeros(len(numbers), bool)
        self.actions = np.zeros((len(numbers), len(self.policy.joints)))
        self.earlier = self.actions
        # Targets of this and earlier periods, newest first; before the first, the default pose.
        periods = 1 + math.ceil(self.robot.delay / self.robot.substeps)
        self.sent = [np.tile(self.policy.pose, (len(numbers), 1)) for _ in range(periods)]
        self.periods = 0
        # Angle by which each robot's motion is turned, rad.
        self.turned = {}
        # Earlier frames of the observation, the oldest first.
        self.past = []
        self._check_width()

    def _check_width(self):
        given, rows = self.policy.given.shape[-1], self.observe(np.zeros((len(self.data), 3)))
        if isinstance(given, int) and given != rows.shape[1]:
            raise Refused(f"{self.world.policy}: the network takes {given} numbers, its observation has {rows.shape[1]}")

    def observe(self, commands):
        """Rows of the interface's terms, scaled, with their past frames."""
        return self._with_past(self._frame(commands))

    def _frame(self, commands):
        """The present frame: rows of the interface's terms, scaled, term by term."""
        rows = [self._observe(*each) for each in zip(self.data, commands, self.actions, self.earlier, self.feelings)]
        return [np.stack(column).astype(np.float32) for column in zip(*rows)]

    def place(self, index):
        """Time in the motion (s) and its heading (rad) of a robot, before its step; nothing of policies without a motion."""
        if self.policy.motion is None:
            return np.zeros(0)
        return np.array([self.periods * self.policy.dt, self.turned[id(self.data[index])]])

    def _with_past(self, frame):
        """Rows of the present frame and those before it, as the interface's history orders them."""
        terms, history = self.policy.interface["observation"], self.policy.interface.get("history", {})
        counts = [term.get("history", 1) for term in terms]
        first = [np.zeros_like(part) for part in frame] if history.get("start") == "zeros" else (self.past or [frame])[0]
        frames = [first] * (max(counts) - len(self.past) - 1) + self.past + [frame]
        if history.get("order", "terms") == "terms":
            parts = [each[k] for k, count in enumerate(counts) for each in frames[-count:]]
        else:
            ordered = frames[-counts[0]:]
            parts = [part for each in (ordered if history["order"] == "frames" else ordered[::-1]) for part in each]
        return np.concatenate(parts, axis=1)

    def _observe(self, data, command, action, earlier, feelings):
        interface = self.policy.interface
        imu, rotation = feelings.imu(data), np.zeros(9)
        mujoco.mju_quat2Mat(rotation, imu[:4])
        rotation = rotation.reshape(3, 3)
        phase = 2 * math.pi * self.periods * self.policy.dt * (interface.get("gait_frequency") or 0.0)
        quantities = {
            "base_angular_velocity": lambda: imu[4:],
            "projected_gravity": lambda: -rotation[2],
            "command": lambda: command,
            "joint_position": lambda: feelings.positions(data) - self.policy.pose,
            "joint_velocity": lambda: feelings.velocities(data),
            "last_action": lambda: action,
            "base_linear_velocity": lambda: rotation.T @ data.qvel[:3],
            "base_height": lambda: data.qpos[2:3],
            "gait_phase": lambda: (math.sin(phase), math.cos(phase)),
            "gait_sine": lambda: (math.sin(phase),),
            "constant": lambda: (1.0,),
            "earlier_action": lambda: earlier,
        }
        if motion := self.policy.motion:
            joints = feelings.positions(data)
            turned = self.turned.setdefault(id(data), motion.turned(imu[:4], joints))

            def later(term):
                return (self.periods + term.get("ahead", 0)) * self.policy.dt

            followed = {
                "reference_joint_position": motion.joints,
                "reference_joint_velocity": motion.speeds,
                "reference_phase": motion.phase,
                "reference_orientation": lambda time: motion.difference(time, turned, imu[:4], joints),
            }
            at = {name: lambda term, of=of: of(later(term)) for name, of in followed.items()}
        else:
            at = {}
        value = lambda term: at[term["quantity"]](term) if term["quantity"] in at else quantities[term["quantity"]]()
        terms = [(value(term), term.get("scale") or [1.0]) for term in interface["observation"]]
        return [np.asarray(value) * np.array(scale) for value, scale in terms]

    def step(self, commands):
        """One control period. Returns the indices of the robots that took part."""
        frame = self._frame(commands)
        self.earlier, self.actions = self.actions, self.policy.act(self._with_past(frame))
        most = max(term.get("history", 1) for term in self.policy.interface["observation"])
        self.past = [*self.past, frame][max(0, len(self.past) + 2 - most):] if most > 1 else []
        self.sent = [self.policy.targets(self.actions), *self.sent[:-1]]
        standing = np.flatnonzero(~self.fallen)
        for index in standing:
            self._advance(index)
        self.periods += 1
        return standing

    def _advance(self, index):
        robot, data = self.robot, self.data[index]
        # The delay ends within this period: until then the older target holds.
        whole_periods, rest = divmod(robot.delay, robot.substeps)
        if rest:
            self._hold(index, self.sent[whole_periods + 1][index], rest)
        self._hold(index, self.sent[whole_periods][index], robot.substeps - rest)
        # Contacts and orientation of the new state.
        mujoco.mj_fwdPosition(robot.model, data)
        # MuJoCo resets a simulation that diverges: its velocities mean nothing then.
        self.diverged[index] = any(data.warning[kind].number for kind in DIVERGED)
        self.fallen[index] = self.diverged[index] or robot.fallen(data)

    def _hold(self, index, targets, steps):
        robot, data, sigma = self.robot, self.data[index], self.world.torque_noise
        data.ctrl[robot.motors] = targets
        data.ctrl[robot.held_motors] = robot.held_pose
        feelings = self.feelings[index]
        if sigma == 0.0 and not self.world.effects.at_every_step:
            mujoco.mj_step(robot.model, data, steps)
            return
        # Beside the motors, so outside their limits.
        for torques in self.noise[index].normal(0.0, sigma, (steps, len(robot.velocity))):
            data.qfrc_applied[robot.velocity] = torques
            feelings.before(data)
            mujoco.mj_step(robot.model, data)
            feelings.after(data)

    def velocity(self, index):
        """Forward and left, m/s, and yaw rate, rad/s."""
        data = self.data[index]
        rotation = data.xmat[1].reshape(3, 3)
        left = rotation[:2, 1] / np.linalg.norm(rotation[:2, 1])
        vx, vy = data.qvel[:2]
        return np.array([left[1] * vx - left[0] * vy, left[0] * vx + left[1] * vy, rotation[2] @ data.qvel[3:6]])

    def pose(self, index):
        """Place, m, and heading, rad."""
        data = self.data[index]
        return np.array([data.qpos[0], data.qpos[1], math.atan2(-data.xmat[1][1], data.xmat[1][4])])


def check(world):
    """Refuses in the caller's process what a worker would stumble over."""
    for key in ("timestep", "delay", "torque_noise", "strength"):
        value = getattr(world, key)
        if not (math.isfinite(value) and (value > 0 if key == "timestep" else 0 <= value <= 1000)):
            raise Refused(f"{key} is {value}; it must be a {'positive' if key == 'timestep' else 'non-negative'} number")
    Group(world, [0])


def parallel(function, jobs, processes, what):
    """Results of `function` over jobs, in their order; each job's result is a list, one a robot, and they are joined. What
    takes long is told on standard error; `what` names the results in the plural."""
    results, total, begun = [], sum(len(job[1]) for job in jobs), time.monotonic()
    said = begun
    with concurrent.futures.ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        for found in pool.map(function, jobs):
            results.extend(found)
            now = time.monotonic()
            if now - said > SAY_SECONDS and len(results) < total:
                left = (now - begun) / len(results) * (total - len(results))
                print(f"{what} {len(results)}/{total}  {left:.0f} s left", file=sys.stderr, flush=True)
                said = now
    return results


def groups(count):
    """Numbers 0..count in groups."""
    return [list(range(first, min(first + GROUP, count))) for first in range(0, count, GROUP)]


def trial(job):
    """Trajectories of one held command each: {error, action_rate, fell, diverged}, means up to the end or the fall."""
    world, numbers, commands, seconds, skip = job
    group = Group(world, numbers)
    errors, rates = [[] for _ in numbers], [[] for _ in numbers]
    for step in range(round(seconds / group.policy.dt)):
        before = group.actions
        for index in group.step(commands):
            if (step + 1) * group.policy.dt > skip and not group.diverged[index]:
                error = group.velocity(index) - commands[index]
                errors[index].append((np.linalg.norm(error[:2]), abs(error[2])))
                rates[index].append(np.sqrt(np.mean((group.actions[index] - before[index]) ** 2)))
    mean = lambda values: np.mean(values, axis=0).tolist() if values else None
    rows = zip(errors, rates, group.fallen, group.diverged)
    return [{"error": mean(e), "action_rate": mean(r), "fell": bool(f), "diverged": bool(d)} for e, r, f, d in rows]


def trials(world, commands, seconds, skip, processes):
    """Statistics of `trial` over commands, named as in `gaitfit evaluate --json`."""
    jobs = [(world, numbers, commands[numbers], seconds, skip) for numbers in groups(len(commands))]
    results = parallel(trial, jobs, processes, "trajectories")
    moved = [result for result in results if result["error"] is not None]
    if not moved:
        raise Refused("no trajectory lasted long enough to be measured")
    return {
        "trajectories": len(results),
        "linear_velocity_error": estimate([result["error"][0] for result in moved]),
        "angular_velocity_error": estimate([result["error"][1] for result in moved]),
        "fall_rate": share([result["fell"] for result in results]),
        "action_rate": estimate([result["action_rate"] for result in moved]),
        "diverged": sum(result["diverged"] for result in results),
        "errors": [compared(result) for result in results],
    }


def compared(result):
    """What of a trajectory is compared with that of another policy: both errors, and 1 after a fall."""
    lasted = result["error"] is not None and not result["diverged"]
    return [*(round(error, 7) for error in result["error"]), int(result["fell"])] if lasted else None


def random_commands(ranges, seed, count):
    """One command a trajectory, uniform in the task's ranges."""
    low, high = np.array([ranges[axis] for axis in ("x", "y", "yaw")]).T
    return np.stack([stream(seed, COMMAND, number).uniform(low, high) for number in range(count)])


def estimate(values):
    """Mean and half the 95 % confidence interval."""
    values = np.asarray(values, float)
    if not len(values):
        return {"mean": None, "ci95": 0.0}
    spread = 1.959964 * values.std(ddof=1) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return {"mean": float(values.mean()), "ci95": float(spread)}


def share(hits):
    """The same of a share, by Wilson's interval, which is not zero at 0 and 1."""
    n, p, z = len(hits), float(np.mean(hits)), 1.959964
    return {"mean": p, "ci95": z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))}


def show(report, title):
    """The statistics as text."""
    lines = [title]
    for name, unit in (
        ("linear_velocity_error", "m/s"),
        ("angular_velocity_error", "rad/s"),
        ("fall_rate", ""),
        ("action_rate", "root mean square of the change a control period"),
    ):
        lines.append(f"{name:24} {report[name]['mean']:.4f} ± {report[name]['ci95']:.4f} {unit}".rstrip())
    return "\n".join(lines)
