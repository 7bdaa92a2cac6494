"""Joint torques of a PD controller as the fit has it: delay, encoder bias, factors on gains, offset, limits that may fall with
speed, noise, networks; and what sensors with errors read.

    drive = Drive(load(), kp=25.0, kd=0.5, step=model.opt.timestep)
    joints = [model.joint(name) for name in drive.joints]  # the order of targets, angles and torques
    place, dof = [joint.qposadr[0] for joint in joints], [joint.dofadr[0] for joint in joints]
    drive.send(target, data.qpos[place], data.qvel[dof])   # at every control period
    torque = drive.torque(data.qpos[place], data.qvel[dof])  # at every physics step, with the next two lines
    data.qfrc_applied[dof] = torque
    load_theta.stribeck(model, data, load(), torque)  # for stiction and load_friction
    gravity, rates = imu(load(), gravity, rates)  # what the policy observes
    late = LateImu(load(), model.opt.timestep)
    gravity, rates = late(gravity, rates)  # at every physics step, before `imu`; what the policy observes is the last one
    velocities = Velocities(load(), model.opt.timestep)
    dq_read = velocities(dq)            # at every physics step; what the policy observes is the last one

Delete the model's own actuators, or give its motors controls of 0. Do not put the torques into data.ctrl: it has the
order of the actuators, and their gears multiply it.
"""

import collections
import math

import numpy as np


def imu(theta, gravity, rates):
    """Readings of the robot's inertial unit for a direction of gravity and angular velocity (rad/s) in the base's frame:
    the unit is turned by roll and pitch in the base, and its gyro is biased. Vectors may be rows (..., 3)."""
    roll, pitch = theta["sensors"]["imu_tilt"]
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    turn = np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])
    return np.asarray(gravity) @ turn, np.asarray(rates) @ turn + theta["sensors"]["gyro_bias"]


class LateImu:
    """What a late inertial unit reads of the base's direction of gravity and angular velocity; its other errors: `imu`."""

    def __init__(self, theta, step):
        late, whole = math.modf(theta["numbers"]["imu_delay"] / step)
        self.part, self.past = late, collections.deque(maxlen=int(whole) + 2)

    def __call__(self, gravity, rates):
        self.past.append((np.asarray(gravity, dtype=float), np.asarray(rates, dtype=float)))
        last = len(self.past) - 1
        older = self.past[0]
        newer = self.past[min(1, last)] if last + 1 == self.past.maxlen else older
        gravity, rates = (new + self.part * (old - new) for old, new in zip(older, newer))
        return gravity / np.linalg.norm(gravity, axis=-1, keepdims=True), rates


class Velocities:
    """Joint velocities as slow sensors read them: a first-order filter."""

    def __init__(self, theta, step):
        self.share, self.read = step / (theta["sensors"]["velocity_lag"] + step), None

    def __call__(self, dq):
        dq = np.asarray(dq, dtype=float)
        self.read = dq if self.read is None else self.read + self.share * (dq - self.read)
        return self.read


class Network:
    """y = W3 tanh(W2 tanh(W1 x + b1) + b2) + b3, x = (q - rest, dq) of three samples, newest first, times their scales."""

    def __init__(self, saved):
        parts = np.split(np.array(saved["weights"]), np.cumsum([48, 8, 32, 4, 4]))
        self.layers = [(parts[i].reshape(shape), parts[i + 1]) for i, shape in ((0, (6, 8)), (2, (8, 4)), (4, (4, 1)))]
        self.scales = saved["position_scale"], saved["velocity_scale"], saved["output_scale"]
        self.rest, self.past = saved["rest"], None

    def __call__(self, q, dq):
        now = (q - self.rest) * self.scales[0], dq * self.scales[1]
        self.past = [now, *(self.past or [now, now])[:2]]
        x = np.array(self.past).ravel()
        for weights, bias in self.layers[:2]:
            x = np.tanh(x @ weights + bias)
        weights, bias = self.layers[2]
        return float((x @ weights + bias)[0]) * self.scales[2]


class Drive:
    """One robot's controller. kp, kd: stated gains, one number or one a joint (0 for a joint without a motor)."""

    def __init__(self, theta, kp, kd, step, seed=0):
        self.joints, self.step, self.time = list(theta["joints"]), step, 0.0
        column = lambda key: np.array([joint[key] for joint in theta["joints"].values()], dtype=float)
        self.kp, self.kd = column("kp_factor") * kp, column("kd_factor") * kd
        self.bias, self.offset, self.delay = column("encoder_bias"), column("torque_offset"), column("delay")
        self.limit, self.stall, self.speed = (
            np.nan_to_num(column(key), nan=math.inf) for key in ("torque_limit", "stall_torque", "no_load_speed"))
        self.noise, self.random = theta["torque_noise"], np.random.default_rng(seed)
        self.sent = collections.deque()
        networks = [(saved["kind"], self._place(saved["joint"]), Network(saved)) for saved in theta["networks"]]
        self.action_delta = [(j, network) for kind, j, network in networks if kind == "action_delta"]
        self.resid_act = [(j, network) for kind, j, network in networks if kind == "resid_act"]

    def _place(self, joint):
        plain = lambda name: name.removesuffix("_joint")
        return [plain(name) for name in self.joints].index(plain(joint))

    def _reach(self, dq):
        """Largest torque in the direction of dq: it falls with speed where a joint has a no-load speed."""
        falling = np.clip(self.stall * (1.0 - dq / self.speed), 0.0, self.limit)
        return np.where(np.isinf(self.speed), self.limit, falling)

    def send(self, target, q, dq):
        """Sends position targets, rad. q, dq: true angles and velocities."""
        target = np.array(target, dtype=float)
        for j, network in self.action_delta:
            target[j] += network(q[j] + self.bias[j], dq[j])
        self.sent.appendleft((self.time, target))
        while len(self.sent) > 2 and self.sent[-2][0] + self.delay.max() < self.time:
            self.sent.pop()

    def torque(self, q, dq):
        """Torques of the physics step that begins now, N·m: of the mean over the step of the target in force."""
        q, dq = np.asarray(q, dtype=float), np.asarray(dq, dtype=float)
        begin, end = self.time, self.time + self.step
        target, until = np.zeros(len(self.joints)), np.full(len(self.joints), end)
        for number, (time, sent) in enumerate(self.sent):
            oldest = number + 1 == len(self.sent)
            since = np.full_like(until, begin) if oldest else np.clip(time + self.delay, begin, end)
            target += sent * np.clip(until - since, 0.0, None) / self.step
            until = np.minimum(until, since)
        reading = q + self.bias
        torque = np.clip(self.kp * (target - reading) - self.kd * dq + self.offset, -self._reach(-dq), self._reach(dq))
        for j, network in self.resid_act:
            torque[j] += network(reading[j], dq[j])
        self.time = end
        return torque + self.noise * self.random.standard_normal(len(torque))
