"""Makes messages of ROS 2 for the tests of gaitfit-robot, in crates/gaitfit-robot/tests/fixtures (ros2_*.cdr), with CycloneDDS.

The bytes on the wire without the four of the CDR header. Numbers are counted: the n-th of a message is n / 8. --check compares
instead of writing.

Needs the package cyclonedds (11.0.1).
Usage: python tools/make_ros2_fixtures.py [--out FOLDER] [--check]
"""

import argparse
import itertools
import pathlib
import sys

from ros2_messages import (
    DynamicJointState,
    Float64MultiArray,
    Header,
    Imu,
    InterfaceValue,
    JointState,
    MultiArrayDimension,
    MultiArrayLayout,
    Quaternion,
    Time,
    Vector3,
)

ROOT = pathlib.Path(__file__).resolve().parent.parent


def messages():
    """The messages by name."""
    counter = itertools.count(1)

    def numbers(count):
        return [next(counter) / 8 for _ in range(count)]

    def header(frame):
        return Header(Time(1_700_000_000, 123_456_789), frame)

    yield "joint_state", JointState(header("base"), ["hip", "lower_leg"], numbers(2), numbers(2), [])
    counter = itertools.count(1)
    yield (
        "imu",
        Imu(
            header("imu_link"),
            Quaternion(*numbers(4)),
            numbers(9),
            Vector3(*numbers(3)),
            numbers(9),
            Vector3(*numbers(3)),
            numbers(9),
        ),
    )
    counter = itertools.count(1)
    kinds = ["position", "velocity", "effort", "stiffness", "damping"]
    values = [InterfaceValue(kinds, numbers(5)) for _ in range(2)]
    yield "dynamic", DynamicJointState(header(""), ["hip", "lower_leg"], values)
    counter = itertools.count(1)
    layout = MultiArrayLayout([MultiArrayDimension("joints × interfaces", 10, 10)], 0)
    yield "array", Float64MultiArray(layout, numbers(10))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "crates/gaitfit-robot/tests/fixtures")
    parser.add_argument("--check", action="store_true", help="compare with what is there")
    arguments = parser.parse_args()
    for name, message in messages():
        wire = message.serialize()
        assert wire[:2] == b"\x00\x01", "not plain little-endian CDR"
        path, content = arguments.out / f"ros2_{name}.cdr", wire[4:]
        if not arguments.check:
            path.write_bytes(content)
        elif path.read_bytes() != content:
            sys.exit(f"{path} is not what CycloneDDS writes")
        print(f"{path.name}: {len(content)} bytes")


if __name__ == "__main__":
    main()
