"""Publishes a robot's ROS 2 topics with CycloneDDS, without ROS: for tests of `gaitfit record`.

Three joints swing: joint k is at 0.3 sin(2π t + k) rad, t seconds after the first message. Topics, in DDS's names:
rt/joint_states (sensor_msgs/JointState, --rate a second), rt/imu/data (sensor_msgs/Imu, 100 a second: the base turns about z at
0.2 rad/s), rt/joint_commands (sensor_msgs/JointState: the target is where the joint will be 20 ms later), rt/cmd_vel
(geometry_msgs/Twist, 10 a second: 0.5, 0, 0.1). Nothing of ROS is needed. It prints a JSON line
when it publishes and ends after SECONDS, or when its standard input is closed.

Needs the package cyclonedds (11.0.1).
Usage: python tools/ros2_robot.py [--domain 1] [--interface lo] [--seconds 10] [--rate 200] [--gap 0] [--best-effort]
       (--gap: seconds in the middle without a message)
"""

import argparse
import json
import math
import select
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from ros2_messages import Header, Imu, JointState, Quaternion, Time, Twist, Vector3

JOINTS = ["hip", "thigh", "calf"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--domain", type=int, default=1)
    parser.add_argument("--interface", default="lo")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=200.0)
    parser.add_argument("--gap", type=float, default=0.0)
    parser.add_argument("--best-effort", action="store_true", help="publish as sensors do")
    arguments = parser.parse_args()
    settings = (
        "<CycloneDDS><Domain><General><Interfaces>"
        f'<NetworkInterface name="{arguments.interface}" multicast="true"/>'
        "</Interfaces></General><Discovery><ParticipantIndex>auto</ParticipantIndex></Discovery></Domain></CycloneDDS>"
    )
    domain = Domain(arguments.domain, settings)
    participant = DomainParticipant(arguments.domain)
    reliable = Policy.Reliability.Reliable(duration(milliseconds=100))
    qos = Qos(Policy.Reliability.BestEffort if arguments.best_effort else reliable, Policy.History.KeepLast(10))

    def writer(name, kind):
        return DataWriter(participant, Topic(participant, name, kind), qos=qos)

    states, imus = writer("rt/joint_states", JointState), writer("rt/imu/data", Imu)
    targets, commands = writer("rt/joint_commands", JointState), writer("rt/cmd_vel", Twist)
    print(json.dumps({"ready": True}), flush=True)
    begin, start_ns, tick, sent = time.perf_counter(), time.time_ns(), 0, 0
    zeros = [0.0] * 9
    while tick < arguments.seconds * arguments.rate:
        if select.select([sys.stdin], [], [], 0)[0] and not sys.stdin.readline():
            break
        at = tick / arguments.rate
        wait = at - (time.perf_counter() - begin)
        if wait > 0:
            time.sleep(wait)
        tick += 1
        if abs(at - arguments.seconds / 2) < arguments.gap / 2:
            continue
        now = start_ns + round(at * 1e9)

        def header(late_ns=0, now=now):
            stamp = now + late_ns
            return Header(Time(stamp // 10**9, stamp % 10**9), "")

        phase = [math.tau * at + k for k in range(len(JOINTS))]
        position = [0.3 * math.sin(p) for p in phase]
        velocity = [0.3 * math.tau * math.cos(p) for p in phase]
        states.write(JointState(header(), JOINTS, position, velocity, [0.0] * 3))
        ahead = [0.3 * math.sin(p + math.tau * 0.02) for p in phase]
        targets.write(JointState(header(500_000), JOINTS, ahead, [], []))
        if tick % max(round(arguments.rate / 100), 1) == 0:
            turned = Quaternion(0.0, 0.0, math.sin(0.1 * at), math.cos(0.1 * at))
            rates = Vector3(0.0, 0.0, 0.2)
            imus.write(Imu(header(), turned, zeros, rates, zeros, Vector3(0.0, 0.0, 9.81), zeros))
        if tick % max(round(arguments.rate / 10), 1) == 0:
            commands.write(Twist(Vector3(0.5, 0.0, 0.0), Vector3(0.0, 0.0, 0.1)))
        sent += 1
    print(json.dumps({"states": sent}), flush=True)
    del domain


if __name__ == "__main__":
    main()
