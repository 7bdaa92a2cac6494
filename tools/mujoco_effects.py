"""What real robots have and gaitfit's simulator lacks, on a robot in official MuJoCo: the table [effects] of mujoco_robot.py.

    [effects]
    backlash = { "*_calf*" = 0.015 }        # rad, play between motor and link; encoders are at the motors
    elasticity = { "*_calf*" = 250.0 }      # N·m/rad, stiffness between motor and link
    load_friction = { "*" = 0.1 }           # N·m of dry friction for each N·m of the motor's torque
    stiction = { "*" = 0.3 }                # N·m of dry friction at rest beyond that in motion; it falls over 0.1 rad/s
    velocity_filter = 40.0                  # Hz, first order, of joint velocities as read
    encoder_step = 0.002                    # rad
    imu_tilt = [1.7, 1.2]                   # degrees about x and y
    gyro_bias = [0.02, -0.01, 0.01]         # rad/s
    imu_late = 0.005                        # s, of orientation and rates
    soft_ground = 0.06                      # s, time constant of contacts (MuJoCo's solref; 0.02 is its default)
    slope = 2.0                             # degrees about y
"""

import collections
import dataclasses
import fnmatch
import math

import mujoco
import numpy as np

STRIBECK = 0.1  # rad/s
# Of the joint between motor and link: what it needs for the simulation to be steady.
PLAY = {"armature": 2e-4, "damping": 0.02}


@dataclasses.dataclass(frozen=True)
class Effects:
    """See the head of this file."""

    backlash: dict = dataclasses.field(default_factory=dict)
    elasticity: dict = dataclasses.field(default_factory=dict)
    load_friction: dict = dataclasses.field(default_factory=dict)
    stiction: dict = dataclasses.field(default_factory=dict)
    velocity_filter: float = 0.0
    encoder_step: float = 0.0
    imu_tilt: tuple = (0.0, 0.0)
    gyro_bias: tuple = (0.0, 0.0, 0.0)
    imu_late: float = 0.0
    soft_ground: float = 0.0
    slope: float = 0.0

    def check(self):
        """Why the table cannot be used; None if it can."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            numbers = value.values() if isinstance(value, dict) else value if isinstance(value, (tuple, list)) else [value]
            if not all(isinstance(x, (int, float)) and math.isfinite(x) and abs(x) < 1e6 for x in numbers):
                return f"{field.name} is no number"
            if field.name not in ("imu_tilt", "gyro_bias", "slope") and any(x < 0 for x in numbers):
                return f"{field.name} is negative"
        if len(self.imu_tilt) != 2 or len(self.gyro_bias) != 3:
            return "imu_tilt has two numbers, gyro_bias three"
        return None

    def build(self, spec, hinges):
        """Adds the joints between motors and links to a model's description."""
        for pattern, play in [*self.backlash.items(), *self.elasticity.items()]:
            soft = pattern in self.elasticity and play == self.elasticity[pattern]
            for name in fnmatch.filter(list(hinges), pattern):
                joint = hinges[name]
                own = {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": joint.axis, "pos": joint.pos, "armature": PLAY["armature"]}
                if soft:
                    own |= {"stiffness": [play, 0, 0], "damping": [PLAY["damping"] + 2e-3 * play, 0, 0]}
                else:
                    own |= {"range": [-play / 2, play / 2], "limited": True, "damping": [PLAY["damping"], 0, 0]}
                    own |= {"solref_limit": [0.004, 1.0]}
                joint.parent.add_joint(name=f"{name}_{'spring' if soft else 'play'}", **own)

    def ground(self, model):
        """Softness and slope of the ground of a compiled model."""
        if self.soft_ground:
            model.geom_solref[:, 0] = self.soft_ground
        if self.slope:
            g, angle = np.linalg.norm(model.opt.gravity), math.radians(self.slope)
            model.opt.gravity[:] = [g * math.sin(angle), 0, -g * math.cos(angle)]

    @property
    def at_every_step(self):
        return bool(self.load_friction or self.stiction or self.velocity_filter or self.imu_late)


class Feelings:
    """Sensors and friction of one robot as it moves."""

    def __init__(self, effects, model, position, velocity, motors, joints):
        self.effects, self.model, self.joints = effects, model, joints
        self.position, self.velocity, self.motors = position, velocity, motors
        per = lambda table: np.array([next((v for p, v in table.items() if fnmatch.fnmatch(j, p)), 0.0) for j in joints])
        self.load, self.stiction = per(effects.load_friction), per(effects.stiction)
        self.friction = model.dof_frictionloss[velocity].copy()
        self.rates = np.zeros(len(joints))
        late = round(effects.imu_late / model.opt.timestep)
        self.past = collections.deque(maxlen=late + 1)

    def before(self, data):
        """Dry friction of the next step."""
        if self.load.any() or self.stiction.any():
            rest = np.exp(-((data.qvel[self.velocity] / STRIBECK) ** 2))
            loads = self.load * np.abs(data.actuator_force[self.motors])
            self.model.dof_frictionloss[self.velocity] = self.friction + loads + self.stiction * rest

    def after(self, data):
        """What filters and the late inertial unit remember of a step."""
        self.past.append(np.concatenate([data.qpos[3:7], data.qvel[3:6]]))
        if self.effects.velocity_filter:
            share = 1 - math.exp(-2 * math.pi * self.effects.velocity_filter * self.model.opt.timestep)
            self.rates += share * (data.qvel[self.velocity] - self.rates)

    def positions(self, data):
        step = self.effects.encoder_step
        read = data.qpos[self.position]
        return np.round(read / step) * step if step else read

    def velocities(self, data):
        return self.rates.copy() if self.effects.velocity_filter else data.qvel[self.velocity]

    def imu(self, data):
        """Orientation, wxyz, and rates, rad/s, as the unit reads them."""
        seen = self.past[0] if self.effects.imu_late and self.past else np.concatenate([data.qpos[3:7], data.qvel[3:6]])
        roll, pitch = np.radians(self.effects.imu_tilt)
        tilt, turned = np.zeros(4), np.zeros(4)
        mujoco.mju_euler2Quat(tilt, [roll, pitch, 0.0], "xyz")
        mujoco.mju_mulQuat(turned, seen[:4], tilt)
        back, rates = np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(back, tilt)
        mujoco.mju_rotVecQuat(rates, seen[4:], back)
        return np.concatenate([turned, rates + self.effects.gyro_bias])
