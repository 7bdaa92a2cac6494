"""Prints, as a table in Markdown, what `gaitfit init` makes of robot files with nothing edited.

A robot is a file (.xml, .urdf), a folder whose robot files are all tried, or a line `name<TAB>file` of a list (--list; files
are named from the list's folder). Columns: how the file reads (plainly, mended, refused), whether `init` writes a task, the
feet that it chose, the leg's length and the robot's mass, how many things it mended or guessed, and why not where it refuses.

With --out FOLDER the configurations, robot files and pages stay there; each robot is one file then, so that the folder can be
carried to another machine, where `tools/train_robots.py FOLDER` trains them.

Usage: python3 tools/init_table.py --list robots.tsv --gaitfit target/release/gaitfit --out tried
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

ENDINGS = {".xml", ".urdf"}
NOT_ROBOTS = re.compile(r"package\.xml|launch|scene|sensor|terrain|config")


def robots(args):
    """(name, file) of all robots."""
    for path in args.robots:
        if path.is_dir():
            files = sorted(file for file in path.rglob("*") if file.suffix in ENDINGS)
            yield from ((file.stem, file) for file in files if not NOT_ROBOTS.search(str(file.relative_to(path))))
        else:
            yield path.stem, path
    if args.list:
        for line in args.list.read_text().splitlines():
            name, _, file = line.partition("\t")
            if file:
                yield name, args.list.parent / file


def reads(gaitfit, path):
    """Whether the file reads without any change."""
    done = subprocess.run([gaitfit, "inspect", str(path), "--json"], capture_output=True, check=False)
    return done.returncode == 0


def attempt(gaitfit, name, path, folder, seconds, *more):
    """What `init` prints as JSON, or None and its message."""
    command = [gaitfit, "init", str(path.resolve()), "--json", "--force", "--out", f"{name}.toml", *more]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=seconds, cwd=folder)
    except subprocess.TimeoutExpired:
        return None, f"not done in {seconds} s"
    if done.returncode == 0:
        return json.loads(done.stdout), None
    if done.returncode not in (1, 2):
        return None, f"ended with {done.returncode}: {done.stderr[-200:]}"
    # Without places, which depend on the folder.
    return None, re.sub(r"(\S+:\d+:\d+: |\S*/)", "", done.stderr.strip().removeprefix("error: ")).replace("\n", " ")


def found(document, what):
    """All guesses about one thing."""
    return [guess["found"] for guess in document["guesses"] if guess["what"] == what]


def row(name, document, why, plain):
    """One line of the table."""
    if document is None:
        return f"| {name} | {'plainly' if plain else 'refused'} | **no** | | | | {why[:240]} |"
    how = "mended" if document.get("robot_file") else "plainly"
    mended = [guess for guess in document["guesses"] if guess["what"] in ("foot", "base", "mended", "left out")]
    guessed = sum("guess" in guess["found"] for guess in document["guesses"])
    feet = "; ".join(found(document, "feet"))
    size = "; ".join(found(document, "size")).split("; ")[0]
    notes = "; ".join(guess["found"].split("; ")[0] for guess in mended if guess["what"] in ("foot", "mended"))
    return f"| {name} | {how} | yes | {feet.split(':')[0]} | {size} | {len(mended)}, {guessed} | {notes[:200]} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", type=pathlib.Path, nargs="*")
    parser.add_argument("--list", type=pathlib.Path)
    parser.add_argument("--gaitfit", default="target/release/gaitfit")
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=120.0, help="longest that one robot may take")
    args = parser.parse_args()
    args.gaitfit = str(pathlib.Path(args.gaitfit).resolve())
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.out or pathlib.Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        print("| robot | reads | `init` | feet | size | mended, guessed | what was mended, or why not |")
        print("| --- | --- | --- | --- | --- | --- | --- |")
        written = tried = 0
        for name, path in robots(args):
            document, why = attempt(args.gaitfit, name, path, folder, args.seconds)
            if document and args.out and not document.get("robot_file"):
                attempt(args.gaitfit, name, path, folder, args.seconds, "--one-file")
            tried, written = tried + 1, written + (document is not None)
            print(row(name, document, why, reads(args.gaitfit, path)), flush=True)
        print(f"\n{written} of {tried} robots get a task with nothing edited.")
    return 0 if tried else 1


if __name__ == "__main__":
    sys.exit(main())
