"""Writes docs/api/*.md, the pages of the Python package's functions and classes, from their docstrings.

Usage: python tools/make_python_api.py [--check]      (--check: exit code 1 if the pages are not current)

It reads the sources as text, so it needs only Python 3.11.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "python" / "gaitfit"
OUT = ROOT / "docs" / "api"


@dataclass
class Page:
    """A page: its title, what it begins with, and the names of each module on it (all public ones without names)."""

    file: str
    title: str
    intro: str
    parts: list[tuple[str, str, list[str]]]


#: Names of types in signatures.
TYPES = """| type | what |
| --- | --- |
| `PathLike` | `str` or `os.PathLike[str]` |
| `Settings` | settings by their names in a file, with dots between tables: `{"optimizer.generations": 50}` |
| `Cost` | `"wass"`, `"matcho"`, `"matchr1"`, … |
| `Resume` | `True`, `False` or `"auto"` |
| `Device` | `"cpu"`, `"cuda"`, `"cuda:1"`, …, several GPUs as `"cuda:0,1"`, or `"auto"` |
| `RobotsDevice` | as `Device`, but one GPU at most |
| `Theta` | a fit's result or its `theta.toml`, a `gaitfit.config.TrueParameter` or `TrueNumber`, or a list of these |
| `Progresses` | `True`, `False`, a function of an `Event`, or a list of functions and `True` |"""

ERRORS = """| error | when |
| --- | --- |
| `FileNotFoundError` | a file is missing |
| `TypeError`, `ValueError` | an argument is wrong |
| `gaitfit.GaitfitError` | files, settings or robots cannot be used, or the work failed; the text says why and what to do |
| `gaitfit.Stopped`, a `GaitfitError` | `progress` returned `False`, or `max_seconds` were over (a fit returns what it has instead). `run_folder` is the run's folder, with what is done; `None` for stages that keep nothing |
| `KeyboardInterrupt` | Ctrl-C. It has `run_folder`, too, if the run has one |"""
DEVICE_ARRAY = """On a GPU arrays are `gaitfit.DeviceArray`: `shape`, `dtype` (`"float32"` or `"bool"`), `device`, `numpy()`, which copies it to \
the processor, and DLPack: `torch.from_dlpack(array)` and other libraries take it without a copy."""

PAGES = [
    Page("stages", "Python: stages", "The commands of the program as functions. [Call it from Python](../python.md) begins with examples.\n\n" + TYPES + "\n\n" + ERRORS, [
        ("gaitfit", "_stages.py", ["fit", "validate", "explain", "loop"]),
        ("gaitfit", "_walks.py", ["train", "finetune", "evaluate", "collect"]),
        ("gaitfit", "_stages.py", ["compare"]),
        ("gaitfit", "_fleet.py", ["fleet"]),
        ("gaitfit", "results/_read.py", ["load"]),
        ("gaitfit", "_progress.py", ["Event"]),
        ("gaitfit.callbacks", "callbacks.py", []),
    ]),
    Page("config", "Python: settings", "`gaitfit.config`: settings as dataclasses. A setting that is left out has gaitfit's default.", [
        ("gaitfit.config", "_settings.py", ["Settings"]),
        ("gaitfit.config", "config/_fit.py", []),
        ("gaitfit.config", "config/_task.py", []),
        ("gaitfit.config", "config/_train.py", []),
        ("gaitfit.config", "config/_loop.py", []),
    ]),
    Page("results", "Python: results", "`gaitfit.results`: what stages return.", [
        ("gaitfit.results", "results/_base.py", ["Result", "Estimate", "Doubt", "Check"]),
        ("gaitfit.results", "results/_fit.py", []),
        ("gaitfit.results", "results/_walk.py", []),
        ("gaitfit.results", "results/_loop.py", []),
        ("gaitfit.results", "results/_fleet.py", ["Fleet", "FleetNumber", "FleetEstimate"]),
        ("gaitfit.plots", "plots.py", []),
    ]),
    Page("logs", "Python: logs, policies and simulators", "Logs as arrays, policies, and a fit of a simulator of your own.", [
        ("gaitfit", "_logs.py", ["Log", "Finding"]),
        ("gaitfit", "_log_files.py", ["read_log"]),
        ("gaitfit", "_policy_file.py", ["load_policy", "LoadedPolicy"]),
        ("gaitfit", "_robot_file.py", ["read_robot", "RobotFile", "RobotJoint"]),
        ("gaitfit", "_observer.py", ["Observer"]),
        ("gaitfit", "_policy.py", ["Policy", "Interface", "Term"]),
        ("gaitfit", "_own_simulator.py", ["fit_simulator", "Simulator", "Parameter", "FitOutcome"]),
        ("gaitfit.mujoco", "mujoco.py", []),
        ("gaitfit.mujoco_warp", "mujoco_warp.py", []),
        ("gaitfit", "_cma.py", ["CMA"]),
        ("gaitfit.costs", "costs.py", []),
    ]),
    Page("robots", "Python: robots", "Robots at a task for a learner of your own. [Robots](../python-robots.md) begins with examples.\n\n" + DEVICE_ARRAY, [
        ("gaitfit", "_robots.py", ["Robots"]),
        ("gaitfit", "_robots_state.py", ["Motion", "RobotsState"]),
        ("gaitfit", "_terms.py", ["Terms"]),
        ("gaitfit", "_training_terms.py", ["TrainingRobots"]),
        ("gaitfit.gym", "gym.py", []),
        ("gaitfit.sb3", "sb3.py", []),
        ("gaitfit.rsl_rl", "rsl_rl.py", []),
    ]),
    Page("ray", "Python: many machines", "`gaitfit.ray`: the same on a Ray cluster. [Many machines](../scale.md) begins with examples.", [
        ("gaitfit.ray", "ray/_fit.py", ["fit"]),
        ("gaitfit.ray", "ray/_fleet.py", ["fleet"]),
        ("gaitfit.ray", "ray/_train.py", ["train", "finetune"]),
        ("gaitfit.ray", "ray/_tables.py", ["reproduce"]),
    ]),
]
Definition = ast.FunctionDef | ast.ClassDef


def text_of(docstring: str) -> list[str]:
    """A docstring as Markdown: roles and literals as code, arguments as lists, examples as blocks."""
    text = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", docstring)
    text = re.sub(r"``([^`]+)``", r"`\1`", text)
    lines: list[str] = []
    inside = False
    listed = False
    for line in text.splitlines():
        example = line.startswith((">>>", "..."))
        if example and not inside:
            lines += ["", "```python"]
            inside = True
        elif inside and not line.strip():
            lines.append("```")
            inside = False
        if inside:
            lines.append(line.replace("      # doctest: +SKIP", ""))
            continue
        item = re.match(r"    (\w[\w, ]*): (.*)$", line)
        if line in ("Arguments:", "Attributes:"):
            listed = True
            lines += ["", f"{line[:-1]}:", ""]
        elif listed and item:
            names = ", ".join(f"`{name.strip()}`" for name in item.group(1).split(","))
            lines.append(f"- {names}: {item.group(2)}")
        elif listed and line.startswith("        "):
            lines.append(f"  {line.strip()}")
        else:
            listed = listed and not line.strip()
            lines.append(line)
    return [*lines, "```"] if inside else lines


def signature(name: str, node: ast.FunctionDef, without_self: bool) -> list[str]:
    """How it is called, one argument a line where there are many."""
    arguments = node.args
    parts: list[str] = []
    positional = arguments.posonlyargs + arguments.args
    defaults: list[ast.expr | None] = [None] * (len(positional) - len(arguments.defaults)) + list(arguments.defaults)
    for number, (one, default) in enumerate(zip(positional, defaults)):
        if not (without_self and number == 0):
            parts.append(argument(one, default))
    if arguments.vararg:
        parts.append(f"*{arguments.vararg.arg}")
    elif arguments.kwonlyargs:
        parts.append("*")
    parts += [argument(one, default) for one, default in zip(arguments.kwonlyargs, arguments.kw_defaults)]
    if arguments.kwarg:
        parts.append(f"**{arguments.kwarg.arg}")
    result = "" if node.returns is None else f" -> {ast.unparse(node.returns)}"
    line = f"{name}({', '.join(parts)}){result}"
    return [line] if len(line) < 100 else [f"{name}(", *[f"    {part}," for part in parts], f"){result}"]


def argument(one: ast.arg, default: ast.expr | None) -> str:
    kind = "" if one.annotation is None else f": {ast.unparse(one.annotation)}"
    given = "" if default is None else f" = {ast.unparse(default)}"
    return f"{one.arg}{kind}{given}"


def documented(module: str, node: Definition) -> list[str]:
    docstring = ast.get_docstring(node)
    if docstring is None:
        return []
    lines = [f"## {module}.{node.name}", ""]
    if isinstance(node, ast.FunctionDef):
        return [*lines, "```python", *signature(node.name, node, False), "```", "", *text_of(docstring), ""]
    made = next((one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"), None)
    if made is not None:
        made.returns = None
        lines += ["```python", *signature(node.name, made, True), "```", ""]
    else:
        fields = [one for one in node.body if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)]
        rows = [f"    {ast.unparse(one)}".replace(" = field(kw_only=False)", "") for one in fields]
        if rows:
            lines += ["```python", f"class {node.name}:", *rows, "```", ""]
    lines += [*text_of(docstring), ""]
    for one in node.body:
        if not isinstance(one, ast.FunctionDef) or (one.name.startswith("_") and one.name != "__call__"):
            continue
        docstring = ast.get_docstring(one)
        if docstring is None:
            continue
        decorators = [ast.unparse(decorator) for decorator in one.decorator_list]
        is_property, is_static = "property" in decorators, "staticmethod" in decorators
        name = f"{node.name}.{one.name}"
        called = [f"{name}: {ast.unparse(one.returns)}"] if is_property and one.returns else signature(name, one, not is_static)
        lines += [f"### {name}", "", "```python", *called, "```", "", *text_of(docstring), ""]
    return lines


def written(page: Page) -> str:
    lines = [f"# {page.title}", "", page.intro, ""]
    for module, file, names in page.parts:
        tree = ast.parse((PACKAGE / file).read_text(encoding="utf-8"))
        nodes = {one.name: one for one in tree.body if isinstance(one, Definition)}
        missing = [name for name in names if name not in nodes]
        if missing:
            sys.exit(f"make_python_api.py: {file} has no {missing[0]}")
        for name in names or [name for name in nodes if not name.startswith("_")]:
            lines += documented(module, nodes[name])
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(lines))
    return text.rstrip() + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    pages = {f"{page.file}.md": written(page) for page in PAGES}
    there = {file.name: file.read_text(encoding="utf-8") for file in OUT.glob("*.md")} if OUT.exists() else {}
    if check and pages != there:
        stale = sorted(name for name in pages.keys() | there.keys() if pages.get(name) != there.get(name))
        sys.exit(f"not current: {', '.join(stale)}; run tools/make_python_api.py")
    OUT.mkdir(exist_ok=True)
    for name, text in pages.items():
        (OUT / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
