"""Prints, as a table in Markdown, how gaitfit reads the robot files of folders, and how far `forward` is from MuJoCo.

Every .xml and .urdf below the folders counts that has something that moves. A file is read plainly, leniently, or not at
all; a file that is refused shows why. The error is that of tools/compare_forward.py: MuJoCo C on random states, the
largest difference of M, qfrc_bias, qacc and the state after one step, relative to the state's largest entry. MuJoCo gets
the file without its pictures (their files may be missing), and, where it is read leniently, without what gaitfit leaves
out. `forward` adds no floor: a robot without one is compared in the air. Of balls on height fields only states count in
which MuJoCo has one contact for each. Exit code 3 if an error exceeds the tolerance.

Usage: .venv/bin/python tools/robots_table.py ../shared/data/robots --gaitfit target/release/gaitfit
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys

import compare_forward as forward

NOTHING_MOVES = "no body of the file can move"


def inspect(gaitfit, path, lenient):
    """The summary of `gaitfit inspect`, or its message."""
    command = [gaitfit, "inspect", str(path), "--json"] + ["--lenient"] * lenient
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return json.loads(done.stdout), None
    message = done.stderr.strip().removeprefix("error: ")
    # Without places, which depend on the folder.
    return None, re.sub(r"(^\S+:\d+:\d+: |\S*/)", "", message).split("; ")[0]


def how(gaitfit, path):
    """(summary or None, lenient, how it is read in words); None if nothing of the file moves."""
    summary, refused = inspect(gaitfit, path, False)
    if summary:
        return summary, False, "; ".join(["plainly", *changes(summary)])
    if NOTHING_MOVES in refused:
        return None
    summary, worse = inspect(gaitfit, path, True)
    if summary:
        return summary, True, "; ".join([f"leniently: {refused}", *changes(summary)])
    return None, False, f"refused: {worse}"


def changes(summary):
    """What was added or mended, and warned of, in a few words."""
    for change in summary["changed"]:
        if change["what"].startswith("inertia"):
            continue
        yield "with a floor" if change["what"].startswith("floor") else change["what"]
    mended = sum(change["what"].startswith("inertia") for change in summary["changed"])
    if mended:
        yield f"{mended} inertias mended"
    for warning in summary["warnings"]:
        if "effort limit" in warning:
            yield "no effort limit"
        elif "touches the ground" in warning:
            yield "nothing touches the ground"


def error(args, path, lenient, floor):
    """The worst relative difference, or why there is none; and whether it is too large. `floor`: gaitfit added one."""
    try:
        model = forward.load(path, lenient)
    except (ValueError, SystemExit) as refused:
        text = " ".join(str(refused).split())
        return f"MuJoCo refuses it: {text[:100]}", False
    states = forward.comparable(model, forward.make_states(model, args.states, args.seed))
    expected, contacts, _ = forward.reference(model, states)
    try:
        found = forward.run(path, states, args.gaitfit, lenient=lenient, stderr=subprocess.DEVNULL)
    except subprocess.CalledProcessError:
        # Contact pairs with the floor of a scene.
        return ("only with its scene", False) if floor else ("`forward` refuses it", True)
    worst = max(relative for _, relative, _ in forward.differences(found, expected).values())
    fewer = "" if len(contacts) == args.states else f" ({len(contacts)} states)"
    return f"{worst:.0e}, {contacts.mean():.1f}{fewer}", not worst <= args.tolerance


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=pathlib.Path, nargs="+", help="folders with robot files")
    parser.add_argument("--gaitfit", default="gaitfit", help="gaitfit program (default: the one in PATH)")
    parser.add_argument("--states", type=int, default=60, help="states of each robot [60]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tolerance", type=float, default=1e-9, help="largest error that passes [1e-9]")
    args = parser.parse_args()

    failed = False
    print("| file | joints | contacts | read | error, contacts |\n| --- | --- | --- | --- | --- |")
    for folder in args.folders:
        for path in sorted(p for p in folder.rglob("*") if p.suffix in (".xml", ".urdf")):
            found = how(args.gaitfit, path)
            if found is None:
                continue
            summary, lenient, read = found
            sizes = (len(summary["joints"]), summary["pairs"]) if summary else ("", "")
            floor = bool(summary) and any(change["what"].startswith("floor") for change in summary["changed"])
            text, wrong = error(args, path, lenient, floor) if summary else ("", False)
            failed |= wrong
            print(f"| `{path.relative_to(folder)}` | {sizes[0]} | {sizes[1]} | {read} | {text} |", flush=True)
    if failed:
        print(f"an error above the tolerance of {args.tolerance:g}", file=sys.stderr)
        sys.exit(3)


if __name__ == "__main__":
    main()
