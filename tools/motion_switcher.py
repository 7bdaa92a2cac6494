"""A motion switcher for tests: the vendor's RPC server (unitree_sdk2_python, rpc/server.py, unchanged) with the two calls
that release a robot's own walking. It has a mode until it is released as often as --stubborn says and once more. It prints
a JSON line when it is ready and one for each call, and ends when its standard input is closed.

Needs the package cyclonedds, and the vendor's software.
Usage: python tools/motion_switcher.py [--vendor FOLDER] [--domain 1] [--interface lo] [--mode normal] [--stubborn 0]
       [--code 0]
"""

import argparse
import json
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vendor", type=pathlib.Path, default=ROOT.parent / "shared/third_party")
    parser.add_argument("--domain", type=int, default=1)
    parser.add_argument("--interface", default="lo")
    parser.add_argument("--mode", default="normal", help="its mode at first; empty: released")
    parser.add_argument("--stubborn", type=int, default=0, help="releases that it takes and does not follow")
    parser.add_argument("--code", type=int, default=0, help="status of every answer; 0: well")
    arguments = parser.parse_args()
    sys.path.insert(0, str(arguments.vendor / "unitree_sdk2_python"))

    from unitree_sdk2py.comm.motion_switcher import motion_switcher_api as api
    from unitree_sdk2py.core.channel import ChannelFactoryInitialize
    from unitree_sdk2py.rpc.server import Server

    state = {"name": arguments.mode, "stubborn": arguments.stubborn}

    def said(call):
        # The SDK prints too: JSON lines are ours.
        print(json.dumps({"call": call, "name": state["name"]}), flush=True)

    def check(_):
        said("check")
        return arguments.code, json.dumps({"form": "0", "name": state["name"]})

    def release(_):
        if state["stubborn"] > 0:
            state["stubborn"] -= 1
        else:
            state["name"] = ""
        said("release")
        return arguments.code, ""

    ChannelFactoryInitialize(arguments.domain, arguments.interface)
    server = Server(api.MOTION_SWITCHER_SERVICE_NAME)
    server._SetApiVersion(api.MOTION_SWITCHER_API_VERSION)
    server._RegistHandler(api.MOTION_SWITCHER_API_ID_CHECK_MODE, check, False)
    server._RegistHandler(api.MOTION_SWITCHER_API_ID_RELEASE_MODE, release, False)
    server.Start(False)
    print(json.dumps({"ready": True}), flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
