"""Makes messages of Unitree's Python SDK for the tests of gaitfit-robot, in crates/gaitfit-robot/tests/fixtures.

For a command and a state of each family of messages (unitree_go, and unitree_hg as hg_*), every field filled with its own number: the bytes on the wire without the four of the CDR header
(.cdr), and the C struct that the SDK's checksum is over, with the checksum in its last word (.c). The same SDK gives the
same bytes; --check compares instead of writing.

Needs the packages cyclonedds (11.0.1) and numpy, and the SDK's folder (unitree_sdk2_python, BSD-3).
Usage: python tools/make_robot_fixtures.py [--sdk FOLDER] [--out FOLDER] [--check]
"""

import argparse
import pathlib
import struct
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
SDK = ROOT.parent / "shared/third_party/unitree_sdk2_python"


def fill(message, count):
    """Gives every number of a message its own value; returns how many were given."""
    for name, value in vars(message).items():
        if isinstance(value, list):
            for index, item in enumerate(value):
                if hasattr(item, "__dataclass_fields__"):
                    count = fill(item, count)
                else:
                    count += 1
                    value[index] = number(message, name, count)
        elif hasattr(value, "__dataclass_fields__"):
            count = fill(value, count)
        else:
            count += 1
            setattr(message, name, number(message, name, count))
    return count


def number(message, name, count):
    kind = str(message.__dataclass_fields__[name].type)
    for word, value in (
        ("float32", struct.unpack("<f", struct.pack("<f", -1.7 + 0.123 * count))[0]),
        # The SDK packs temperatures and fan speeds as signed numbers.
        ("uint8", count % 127),
        ("int16", 37 * count % 30000 * (-1) ** count),
        ("uint16", 101 * count % 32749),
        ("int32", -70001 * count),
        ("uint32", 2654435761 * count % 2**32),
    ):
        # "int16" is in "uint16" too: the longer name comes with its letter.
        if f".{word}" in kind or f"'{word}'" in kind or kind == word:
            return value
    raise TypeError(f"{name}: {kind}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sdk", type=pathlib.Path, default=SDK)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "crates/gaitfit-robot/tests/fixtures")
    parser.add_argument("--check", action="store_true", help="compare with what is there")
    arguments = parser.parse_args()
    sys.path.insert(0, str(arguments.sdk))
    from unitree_sdk2py.idl import default
    from unitree_sdk2py.utils.crc import CRC

    crc = CRC()
    for name, message, pack in (
        ("lowcmd", default.unitree_go_msg_dds__LowCmd_(), crc._CRC__PackLowCmd),
        ("lowstate", default.unitree_go_msg_dds__LowState_(), crc._CRC__PackLowState),
        ("hg_lowcmd", default.unitree_hg_msg_dds__LowCmd_(), crc._CRC__PackHGLowCmd),
        ("hg_lowstate", default.unitree_hg_msg_dds__LowState_(), crc._CRC__PackHGLowState),
    ):
        fill(message, 0)
        message.crc = crc.Crc(message)
        words = pack(message)
        # The SDK leaves out the last word where it sums up.
        struct_bytes = struct.pack(f"<{len(words)}I", *words) + struct.pack("<I", message.crc)
        wire = message.serialize()
        assert wire[:4] == b"\x00\x01\x00\x00", "not plain little-endian CDR"
        for ending, content in (("cdr", wire[4:]), ("c", struct_bytes)):
            path = arguments.out / f"{name}.{ending}"
            if arguments.check:
                if path.read_bytes() != content:
                    sys.exit(f"{path} is not what the SDK writes")
            else:
                path.write_bytes(content)
            print(f"{path.name}: {len(content)} bytes")


if __name__ == "__main__":
    main()
