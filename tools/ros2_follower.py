"""A robot whose joints follow ROS 2 commands, with CycloneDDS and without ROS: for trying `gaitfit preflight` and `run`.

Reads a robot's file (messages = "ros2"). Each joint is a wheel with inertia 0.04 kg m^2 and friction 0.3 N m s/rad, turned by
the torque of its last command: stiffness (position - q) + damping (velocity - dq) + effort. It publishes joint states in the
reverse order with `_joint` behind names without topic_name, and a level inertial unit, --rate a second. --imu-stops: seconds
after the first command with stiffness at which the inertial unit falls silent. It ends after SECONDS, or when its standard
input is closed, and prints what it felt as a JSON line: commands, the largest gains, and the last command.

Needs the package cyclonedds (11.0.1).
Usage: python tools/ros2_follower.py robot.toml [--domain 1] [--interface lo] [--seconds 60] [--rate 500] [--imu-stops S]
"""

import argparse
import json
import select
import sys
import time
import tomllib

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from ros2_messages import (
    DynamicJointState,
    Float64MultiArray,
    Header,
    Imu,
    JointState,
    Quaternion,
    Time,
    Vector3,
)

INERTIA, FRICTION = 0.04, 0.3
PARTS = ["position", "velocity", "effort", "stiffness", "damping"]


class Joint:
    """A joint and its last command."""

    def __init__(self, motor):
        self.name = motor.get("topic_name", motor["joint"] + "_joint")
        self.q, self.dq, self.torque = motor["lying"], 0.0, 0.0
        self.command = dict.fromkeys(PARTS, 0.0)
        low, high = motor.get("range", (-1e9, 1e9))
        self.stops = low - 0.05, high + 0.05

    def step(self, dt):
        """Moves for `dt` seconds."""
        command = self.command
        for _ in range(4):
            self.torque = (
                command["stiffness"] * (command["position"] - self.q)
                + command["damping"] * (command["velocity"] - self.dq)
                + command["effort"]
            )
            self.dq += dt / 4 * (self.torque - FRICTION * self.dq) / INERTIA
            self.q = min(max(self.q + dt / 4 * self.dq, self.stops[0]), self.stops[1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--domain", type=int, default=1)
    parser.add_argument("--interface", default="lo")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=500.0)
    parser.add_argument("--imu-stops", type=float)
    arguments = parser.parse_args()
    with open(arguments.robot, "rb") as file:
        robot = tomllib.load(file)
    assert robot["messages"] == "ros2", "the robot's file has other messages"
    settings = (
        "<CycloneDDS><Domain><General><Interfaces>"
        f'<NetworkInterface name="{arguments.interface}" multicast="true"/>'
        "</Interfaces></General><Discovery><ParticipantIndex>auto</ParticipantIndex></Discovery></Domain></CycloneDDS>"
    )
    domain = Domain(arguments.domain, settings)
    participant = DomainParticipant(arguments.domain)
    qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10))

    def topic(key, default, kind):
        return Topic(participant, "rt" + robot.get(key, default), kind)

    states = DataWriter(participant, topic("state_topic", "/joint_states", JointState), qos=qos)
    imus = DataWriter(participant, topic("imu_topic", "/imu/data", Imu), qos=qos)
    named = "Float64MultiArray" not in robot.get("command_type", "")
    kind = DynamicJointState if named else Float64MultiArray
    commands = DataReader(participant, topic("command_topic", "/joint_commands", kind), qos=qos)
    order = robot.get("command_order", PARTS)
    joints = [Joint(motor) for motor in robot["motors"]]
    by_name = {joint.name: joint for joint in joints}
    felt = {"commands": 0, "stiffness": 0.0, "damping": 0.0}
    driven = None

    def take(message):
        nonlocal driven
        if named:
            for name, value in zip(message.joint_names, message.interface_values):
                by_name[name].command.update(zip(value.interface_names, value.values))
        else:
            for k, joint in enumerate(joints):
                joint.command.update(zip(order, message.data[k * len(order) : (k + 1) * len(order)]))
        felt["commands"] += 1
        for gain in ("stiffness", "damping"):
            felt[gain] = max(felt[gain], *(joint.command[gain] for joint in joints))
        if driven is None and any(joint.command["stiffness"] > 0 for joint in joints):
            driven = time.perf_counter()

    print(json.dumps({"ready": True}), flush=True)
    begin, now, dt, zeros = time.perf_counter(), 0.0, 1 / arguments.rate, [0.0] * 9
    while now < arguments.seconds:
        if select.select([sys.stdin], [], [], 0)[0] and not sys.stdin.readline():
            break
        time.sleep(max(now + dt - (time.perf_counter() - begin), 0))
        for message in commands.take(N=50):
            # A writer that goes leaves a sample without content.
            if isinstance(message, kind):
                take(message)
        # As many steps as time passed, should this computer have been busy.
        while now + dt <= time.perf_counter() - begin:
            now += dt
            for joint in joints:
                joint.step(dt)
        ns = time.time_ns()
        header = Header(Time(ns // 10**9, ns % 10**9), "base")
        stopped = arguments.imu_stops is not None and driven is not None
        if not (stopped and time.perf_counter() > driven + arguments.imu_stops):
            level, still, up = Quaternion(0.0, 0.0, 0.0, 1.0), Vector3(0.0, 0.0, 0.0), Vector3(0.0, 0.0, 9.81)
            imus.write(Imu(header, level, zeros, still, zeros, up, zeros))
        backwards = joints[::-1]
        states.write(
            JointState(
                header,
                [joint.name for joint in backwards],
                [joint.q for joint in backwards],
                [joint.dq for joint in backwards],
                [joint.torque for joint in backwards],
            )
        )
    felt["last"] = [joint.command for joint in joints][:1]
    felt["angles"] = [round(joint.q, 4) for joint in joints]
    print(json.dumps(felt), flush=True)
    del domain


if __name__ == "__main__":
    main()
