"""Prints, as a table in Markdown, the guesses of `gaitfit init` beside what people chose for the same robots.

FOLDER has the configurations that `gaitfit init` wrote. CHOICES is a JSON object with an entry for each robot; its key is the
configuration's name without .toml. An entry has `title`, `groups` (joint groups by pattern), `kp`, `kd`, `action_scale` and
`pose` (patterns over joint names; the last one that matches counts), `standing_height` (of the base in that pose),
`control_period`, `commands` (largest forward, sideways, turning), `feet` and optionally `armature`. SI units.

Each cell is the guess, then in brackets the choice. Ratios are guess over choice, over all joints of the legs. The column
`pose` has the largest difference of a default angle, rad, and its joint; the last one the rotor inertia that trainings add.

Usage: python3 init_guesses.py FOLDER CHOICES.json [ROBOT ...] [--json FILE]
"""

import argparse
import fnmatch
import json
import pathlib
import tomllib

HEAD = "robot | kp | ratio | kd | ratio | action scale | pose | height | commands | rotor inertia".split(" | ")


def of(table, joint):
    """The value of a joint in a number or a table of patterns, as gaitfit reads it: a name, else the last pattern."""
    if not isinstance(table, dict):
        return table
    if joint in table:
        return table[joint]
    found = [value for pattern, value in table.items() if fnmatch.fnmatchcase(joint, pattern)]
    return found[-1] if found else None


def span(values, form="{:.3g}"):
    """A number, or the smallest and the largest."""
    low, high = (form.format(value) for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"


def by_group(groups, joints, guess, choice):
    """`hip, thigh 24 (20); calf 20 (20)`: groups of joints with the same numbers are joined."""
    cells = []
    for name, pattern in groups.items():
        those = [joint for joint in joints if fnmatch.fnmatchcase(joint, pattern)]
        cell = f"{span([of(guess, joint) for joint in those])} ({span([of(choice, joint) for joint in those])})"
        if cells and cells[-1][1] == cell:
            cells[-1][0].append(name)
        else:
            cells.append(([name], cell))
    if len(cells) == 1:
        return cells[0][1]
    return "; ".join(f"{', '.join(names)} {cell}" for names, cell in cells)


def ratios(joints, guess, choice):
    """Guess over choice of each joint; none where the choice is zero."""
    return {joint: of(guess, joint) / of(choice, joint) for joint in joints if of(choice, joint)}


def compare(path, choice):
    """All numbers of a robot: what `init` wrote, what people chose, and how they differ."""
    task = tomllib.loads(path.read_text())["task"]
    policy, command = task["policy"], task["command"]
    joints = policy.get("joints", list(policy["default_pose"]))
    guess = {name: {joint: of(policy[name], joint) for joint in joints} for name in ("kp", "kd", "action_scale")}
    guess["pose"] = {joint: of(policy["default_pose"], joint) for joint in joints}
    people = {
        name: {joint: of(choice[name], joint) for joint in joints} for name in ("kp", "kd", "action_scale", "pose")
    }
    guess["commands"] = [max(command.get(axis, [0])) for axis in ("x", "y", "yaw")]
    guess["height"], guess["feet"] = task["height"], task["feet"]
    guess["control_period"] = task.get("control_dt", policy.get("control_dt", 0.02))
    guess["armature"] = task.get("randomisation", {}).get("armature")
    differences = {joint: guess["pose"][joint] - people["pose"][joint] for joint in joints}
    ratio = {name: ratios(joints, guess[name], people[name]) for name in ("kp", "kd")}
    return {"guess": guess, "choice": people, "ratio": ratio, "pose_difference": differences}


def row(choice, found):
    """A line of the table."""
    guess, people, joints = found["guess"], found["choice"], list(found["guess"]["kp"])
    worst = max(found["pose_difference"], key=lambda joint: abs(found["pose_difference"][joint]))
    gains = []
    for name in ("kp", "kd"):
        these = found["ratio"][name].values()
        gains += [by_group(choice["groups"], joints, guess[name], people[name]), span(these, "{:.2g}") if these else "–"]
    per_second = ", ".join(f"{value:g}" for value in guess["commands"])
    wanted = ", ".join(f"{value:g}" for value in choice["commands"])
    inertia = [span(value) if value else "file" for value in (guess["armature"], choice.get("armature"))]
    scales = [span(these["action_scale"].values()) for these in (guess, people)]
    cells = [choice["title"], *gains, f"{scales[0]} ({scales[1]})"]
    cells.append(f"{abs(found['pose_difference'][worst]):.2f}, {worst}")
    cells.append(f"{guess['height']:.2f} ({choice['standing_height']:.2f})")
    return cells + [f"{per_second} ({wanted})", f"{inertia[0]} ({inertia[1]})"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("choices", type=pathlib.Path)
    parser.add_argument("robots", nargs="*", help="names of entries; all without it")
    parser.add_argument("--json", type=pathlib.Path, help="also write every joint's numbers")
    args = parser.parse_args()
    choices = json.loads(args.choices.read_text())
    names = args.robots or list(choices)
    found = {name: compare(args.folder / f"{name}.toml", choices[name]) for name in names}
    print(f"| {' | '.join(HEAD)} |\n|{' --- |' * len(HEAD)}")
    for name in names:
        print(f"| {' | '.join(row(choices[name], found[name]))} |")
    if args.json:
        args.json.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
