"""Writes python/gaitfit/config/_fit.py, _task.py, _train.py and _loop.py from the Rust structs of the settings.

Usage: python tools/make_python_config.py [--check]      (--check: exit code 1 if the files are not current)

Fields, types and documentation are those of the structs, choices those of their enums, and defaults those of the files that
`gaitfit config` prints, which tests of the library compare with the structs. It needs only Python 3.11.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
import textwrap
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CRATES = ROOT / "crates"
SETTINGS = CRATES / "gaitfit-settings" / "src" / "settings"
TASK = CRATES / "gaitfit-learn" / "src" / "task"
THETA = CRATES / "gaitfit-adapt" / "src" / "theta"
OUT = ROOT / "python" / "gaitfit" / "config"
WIDTH = 122


@dataclass
class Class:
    """A class to write: its name, and the struct and the table of defaults that it is made from."""

    name: str
    struct: str
    file: Path
    defaults: str = ""
    first: str = ""
    #: Another struct, and those of its fields that the class has too.
    more: tuple[str, Path, tuple[str, ...]] | None = None


FIT = [
    Class("Gains", "GainsConfig", SETTINGS / "mod.rs", "fit.gains"),
    Class("ValidateGains", "FileGains", SETTINGS / "mod.rs"),
    Class("Parameter", "ParameterRule", THETA / "joint_parameters.rs", first="kind"),
    Class("Network", "NetworkRule", THETA / "networks.rs", first="kind"),
    Class("Number", "RobotRule", THETA / "robot_numbers.rs", first="kind"),
    Class("Prior", "Prior", THETA / "prior.rs"),
    Class("Simulation", "SimulationConfig", SETTINGS / "mod.rs", "fit.simulation"),
    Class("Falls", "FallsConfig", SETTINGS / "mod.rs", "fit.falls"),
    Class("Optimizer", "OptimizerConfig", SETTINGS / "mod.rs", "fit.optimizer"),
    Class("Check", "CheckConfig", SETTINGS / "mod.rs", "fit.check"),
    Class("Fit", "AdaptConfig", SETTINGS / "mod.rs", "fit"),
]
TASKS = [
    Class("Term", "Term", CRATES / "gaitfit-policy" / "src" / "term.rs", first="quantity"),
    Class("History", "History", CRATES / "gaitfit-policy" / "src" / "history.rs"),
    Class("TaskPolicy", "PolicySettings", TASK / "settings.rs", "task.policy"),
    Class("Curriculum", "CurriculumSettings", TASK / "settings.rs"),
    Class("Command", "CommandSettings", TASK / "settings.rs", "task.command"),
    Class("Fall", "FallSettings", CRATES / "gaitfit-policy" / "src" / "walker" / "fall.rs", "task.fall"),
    Class("Start", "StartSettings", TASK / "settings.rs", "task.start"),
    Class("Randomisation", "RandomisationSettings", TASK / "settings.rs", "task.randomisation"),
    Class("Push", "PushSettings", TASK / "settings.rs", "task.push"),
    Class("Terrain", "TerrainSettings", TASK / "terrain" / "settings.rs"),
    Class("Task", "TaskSettings", TASK / "settings.rs", "task"),
]
TRAIN = [
    Class("Size", "TrainingSettings", CRATES / "gaitfit-learn" / "src" / "training.rs", "train.train"),
    Class("Memory", "MemorySettings", CRATES / "gaitfit-learn" / "src" / "ppo" / "settings.rs"),
    Class("Ppo", "Settings", CRATES / "gaitfit-learn" / "src" / "ppo" / "settings.rs", "train.ppo"),
    Class("Train", "TrainConfig", SETTINGS / "train.rs", "train"),
    Class("Finetune", "FinetuneConfig", SETTINGS / "finetune.rs", "finetune"),
]
LOOP = [
    Class("Truth", "TruthConfig", SETTINGS / "controls.rs"),
    Class("Controls", "ControlsConfig", SETTINGS / "controls.rs", "loop.controls"),
    Class("TrueParameter", "TrueParameter", SETTINGS / "target.rs", first="kind"),
    Class("TrueNumber", "TrueNumber", SETTINGS / "target.rs", first="kind"),
    Class("Target", "TargetConfig", SETTINGS / "target.rs", first="kind"),
    Class("Evaluate", "EvaluateConfig", SETTINGS / "loop_.rs", "loop.evaluate"),
    Class(
        "Collect", "CollectSettings", CRATES / "gaitfit" / "src" / "collect.rs", "collect",
        more=("WorldSettings", CRATES / "gaitfit-world" / "src" / "world.rs", ("preset", "seed")),
    ),
    Class("Loop", "LoopConfig", SETTINGS / "loop_.rs", "loop"),
]
#: Enums whose values are choices, with what serde makes of a variant's name.
ENUMS = {
    "Base": SETTINGS / "mod.rs",
    "TargetKind": SETTINGS / "target.rs",
    "TaskName": SETTINGS / "task.rs",
    "Method": CRATES / "gaitfit-adapt" / "src" / "fit" / "options.rs",
    "RandomNumbers": CRATES / "gaitfit-adapt" / "src" / "fit" / "options.rs",
    "CovarianceKind": CRATES / "gaitfit-adapt" / "src" / "cmaes" / "settings.rs",
    "BoundHandling": CRATES / "gaitfit-adapt" / "src" / "cmaes" / "settings.rs",
    "Sharing": THETA / "sharing.rs",
    "NetworkName": THETA / "network_kind.rs",
    "NetworkStart": THETA / "networks.rs",
    "RobotNumber": THETA / "robot_numbers.rs",
    "FindingKind": CRATES / "gaitfit-log" / "src" / "finding.rs",
    "Preset": CRATES / "gaitfit-physics" / "src" / "settings.rs",
    "Cone": CRATES / "gaitfit-model" / "src" / "model.rs",
    "Cell": CRATES / "gaitfit-policy" / "src" / "network" / "cell.rs",
    "Schedule": CRATES / "gaitfit-learn" / "src" / "ppo" / "settings.rs",
    "Precision": CRATES / "gaitfit-learn" / "src" / "ppo" / "settings.rs",
    "FrameOrder": CRATES / "gaitfit-policy" / "src" / "history.rs",
    "HistoryStart": CRATES / "gaitfit-policy" / "src" / "history.rs",
    "Quantity": CRATES / "gaitfit-policy" / "src" / "quantity.rs",
}
#: Types that Python writes in its own way.
TYPES = {
    "String": "str",
    "PathBuf": "str | os.PathLike[str]",
    "bool": "bool",
    **dict.fromkeys(("f64", "f32"), "float"),
    **dict.fromkeys(("usize", "u16", "u32", "u64"), "int"),
    "Interval": "tuple[float, float]",
    **dict.fromkeys(("PerJoint", "JointNumber"), "float | Mapping[str, float]"),
    "JointTable": "Mapping[str, float]",
    "NoiseSettings": "Mapping[Quantity, float]",
    "Spring": "str",
    "SelfContact": 'Literal["off", "file", "limbs"] | Sequence[tuple[str, str]]',
    "Kinds": "str | Mapping[str, float]",
    "Activation": "str | Mapping[str, float]",
    "CostKind": "Cost",
    "JointParameter": "ParameterKind",
    "Table": "Task",
    "TrainingSettings": "Size",
    "ppo::Settings": "Ppo",
    "gaitfit_policy::Term": "Term",
    "Task": "Task",
}
#: Fields that name files or folders.
PATHS = {"commands", "robot", "policy", "known", "theta", "logs", "validate", "runs"}
#: Keys of a file that have another name in Python; the same table is KEYS in gaitfit/_settings.py.
NAMES = {
    "parameter": "parameters", "number": "numbers", "network": "networks", "lambda": "lambda_", "environments": "num_envs"
}
#: An example of each class: where it is given.
EXAMPLES = {
    "Gains": "Fit(gains=Gains(kp=20.0, kd=0.5))",
    "ValidateGains": 'Fit(validate_gains=[ValidateGains(files=["*stiff*"], kp=30.0, kd=0.8)])',
    "Parameter": 'Fit(parameters=[Parameter("frictionloss", per="group", upper=1.5), Parameter("delay", per="all")])',
    "Network": 'Fit(networks=[Network("resid_act", joints=["*_calf_joint"])])',
    "Number": 'Fit(numbers=[Number("payload_mass", upper=5.0)])',
    "Prior": 'Fit(prior={"frictionloss_calf": Prior(value=0.2, deviation=0.05)})',
    "Simulation": 'Fit(simulation=Simulation(preset="fast", robot_timestep=0.001))',
    "Falls": "Fit(falls=Falls(margin_seconds=0.5))",
    "Optimizer": "Fit(optimizer=Optimizer(generations=50, seeds=3))",
    "Check": "Fit(check=Check(converged=True, rmse_rad=0.01))",
    "Fit": 'Fit(robot="go2.xml", logs=["walks"], policy="walk.onnx", costs=["wass"])',
    "Term": 'TaskPolicy(observation=[Term("base_angular_velocity", scale=[0.25]), Term("joint_position", history=5)])',
    "History": 'TaskPolicy(history=History(order="frames", start="zeros"))',
    "TaskPolicy": "Task(policy=TaskPolicy(action_scale=0.25, kp=25.0, kd=0.5))",
    "Curriculum": "Command(curriculum=Curriculum(x=(-0.3, 0.3), tracking=0.8))",
    "Command": "Task(command=Command(x=(-0.5, 1.5), yaw=(-1.0, 1.0)))",
    "Fall": "Task(fall=Fall(tilt=1.0))",
    "Start": "Task(start=Start(tilt=10.0, linear_velocity=0.3))",
    "Randomisation": "Task(randomisation=Randomisation(floor_friction=(0.4, 1.2)))",
    "Push": "Task(push=Push(seconds=8.0, velocity=0.3))",
    "Terrain": 'Task(terrain=Terrain(kind="rough"))',
    "Task": "Task(episode_seconds=10.0, tracking_width=0.25)",
    "Size": "Train(train=Size(num_envs=512, iterations=300))",
    "Memory": 'Train(ppo=Ppo(memory=Memory(cell="gru", width=64, layers=1)))',
    "Ppo": "Train(ppo=Ppo(epochs=3, desired_kl=0.015))",
    "Train": 'Train(robot="go2.xml", task=Task(control_dt=0.02), train=Size(iterations=300))',
    "Finetune": 'Finetune(policy="walk.safetensors", theta="runs/adapt/theta.toml")',
    "Truth": 'Controls(truth=Truth(theta="truth.toml"))',
    "Controls": "Loop(controls=Controls(nominal=False))",
    "TrueParameter": 'Target("simulated", parameters=[TrueParameter("frictionloss", value=0.2)])',
    "TrueNumber": 'Target("simulated", numbers=[TrueNumber("payload_mass", value=2.0)])',
    "Target": 'Loop(target=Target("simulated"))',
    "Evaluate": "Loop(evaluate=Evaluate(trajectories=300))",
    "Collect": "Collect(trajectories=8, seconds=10.0, privileged=True)",
    "Loop": 'Loop(policy="walk.safetensors", logs=["walks"], evaluate=Evaluate(trajectories=300))',
}
#: Fields that users cannot set.
HIDDEN = {"joint_kind", "decided", "policy_sha256", "theta_sha256", "world", "device"}


def read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def documentation(lines: list[str]) -> str:
    """The words of `///` lines, without links that only Rust's documentation follows."""
    text = " ".join(line.strip().removeprefix("///").strip() for line in lines)
    text = re.sub(r"[;,:]?\s*(see|as) \[`[^`]*`\](\([^)]*\))?( says)?", "", text)
    text = re.sub(r"\[`(?:\w+::)*(\w+)`\](?:\([^)]*\))?", r"``\1``", text)
    text = re.sub(r"(?<!`)`([^`]+)`(?!`)", r"``\1``", text)
    return text.replace("\\", "\\\\").strip()


def body(text: str, kind: str, name: str) -> tuple[str, str]:
    """The documentation and the lines of a struct or an enum."""
    found = re.search(rf"((?:^[ \t]*///[^\n]*\n|^[ \t]*#\[[^\n]*\]\n)*)^pub {kind} {name} \{{\n(.*?)^\}}", text, re.M | re.S)
    if found is None:
        sys.exit(f"make_python_config.py: there is no {kind} {name}")
    docs = [line for line in found.group(1).splitlines() if line.strip().startswith("///")]
    return documentation(docs), found.group(2)


def cased(variant: str, style: str) -> str:
    words = re.findall(r"[A-Z][a-z0-9]*", variant)
    joint = {"kebab-case": "-", "snake_case": "_"}.get(style, "")
    return joint.join(word.lower() for word in words)


def choices(name: str) -> list[str]:
    text = read(ENUMS[name])
    # Quantities are rows of a table.
    table = re.search(r"^quantities! \{$(.*)", text, re.M | re.S)
    if table:
        return re.findall(r'^    [A-Z]\w+ "(\w+)" \{$', table.group(1), re.M)
    # Numbers of the robot are rows of one, too.
    table = re.search(r"^robot_numbers! \{$(.*?)^\}", text, re.M | re.S)
    if table:
        return re.findall(r'^    [A-Z]\w+ (\w+); "', table.group(1), re.M)
    style = re.search(rf'#\[serde\(rename_all = "([^"]+)"\)\]\n(?:#\[.*\]\n)*pub enum {name} ', text)
    _, lines = body(text, "enum", name)
    found, renamed = [], None
    for line in lines.splitlines():
        given = re.search(r'#\[serde\(rename = "([^"]+)"\)\]', line)
        variant = re.match(r"    (\w+),?$", line)
        if given:
            renamed = given.group(1)
        elif variant:
            found.append(renamed or cased(variant.group(1), style.group(1) if style else "lowercase"))
            renamed = None
    return found


def literal(values: list[str]) -> str:
    return "Literal[" + ", ".join(f'"{value}"' for value in values) + "]"


def kinds(file: Path, begin: str, end: str) -> list[tuple[str, list[str], str, str]]:
    """Name, lines of documentation, unit and defaults of what a fit can search, from a table of Rust."""
    text = read(file)
    found, docs, named = [], [], None
    start = text.index(begin)
    for line in text[start : text.index(end, start)].splitlines():
        line = line.strip()
        row = re.match(r'\w+ (\w+)(?: of \w+)?; "([^"]*)";', line)
        search = re.match(r"(?:Some\()?\(([^)]*)\)\)?(?:;|$)", line)
        if line.startswith("///"):
            docs.append(line)
        elif row:
            named = (row.group(1), docs, row.group(2))
            docs = []
        elif search and named:
            found.append((*named, search.group(1)))
            named = None
    return found


def joint_kinds() -> list[tuple[str, list[str], str, str]]:
    file = CRATES / "gaitfit-physics" / "src" / "joint_parameter.rs"
    return kinds(file, "macro_rules! joint_parameters", "macro_rules! define")


def robot_kinds() -> list[tuple[str, list[str], str, str]]:
    return kinds(ENUMS["RobotNumber"], "\nrobot_numbers! {", "\n}\n")


def parameter_kinds() -> list[tuple[str, str, str, str]]:
    """Name, documentation, unit and defaults of what a fit can search of a joint."""
    return [(name, documentation(docs), unit, search) for name, docs, unit, search in joint_kinds()]


def kinds_table(found: list[tuple[str, list[str], str, str]]) -> str:
    """Lines of adapt.toml: name, unit, bounds, start, deviation, and the first sentence of the documentation."""
    lines = []
    for name, docs, unit, search in found:
        words = " ".join(line.removeprefix("///").strip() for line in docs).split(". ")[0].rstrip(".").replace("`", "")
        words = re.sub(rf", {re.escape(unit)}(?=[,;:]|$| [(])", "", words, count=1)
        lower, upper, start, deviation = (f"{float(number):g}" for number in search.split(","))
        head = f"#   {name:17} {unit:9} {f'[{lower}, {upper}]':13} {start:4} {deviation:6}"
        lines += textwrap.wrap(words, width=120, initial_indent=f"{head} ", subsequent_indent=f"#{' ' * len(head)}")
    return "".join(f"{line}\n" for line in lines)


def settings_with_kinds() -> str:
    """adapt.toml with the present kinds of parameters."""
    text = read(SETTINGS / "adapt.toml")
    for after, found, before in (
        ("start, initial deviation:\n", joint_kinds(), "# per = "),
        ("with these numbers:\n", robot_kinds(), "\n[prior]"),
    ):
        begin = text.index(after) + len(after)
        text = text[:begin] + kinds_table(found) + text[text.index(before, begin) :]
    return text


def python_type(rust: str, owner: Class, field: str, classes: dict[str, str]) -> str:
    rust = rust.strip()
    option = re.fullmatch(r"Option<(.*)>", rust)
    if option:
        return python_type(option.group(1), owner, field, classes)
    several = re.fullmatch(r"Vec<(.*)>", rust)
    if several:
        inner = python_type(several.group(1), owner, field, classes)
        # One cost may stand for a list of one.
        return f"{inner} | Sequence[{inner}]" if inner == "Cost" else f"Sequence[{inner}]"
    table = re.fullmatch(r"(?:BTreeMap|IndexMap)<String, (.*)>", rust)
    if table:
        return f"Mapping[str, {python_type(table.group(1), owner, field, classes)}]"
    array = re.fullmatch(r"\[(\w+); (\d)\]", rust)
    if array:
        return f"tuple[{', '.join([TYPES[array.group(1)]] * int(array.group(2)))}]"
    if rust == "String" and field in PATHS:
        return "str | os.PathLike[str]"
    if rust in ENUMS:
        return rust
    if rust in TYPES:
        return TYPES[rust]
    if rust in classes:
        return classes[rust]
    sys.exit(f"make_python_config.py: {owner.struct}.{field} has the type {rust}, which has no type in Python yet")


def fields_of(
    owner: Class, classes: dict[str, str], only: tuple[str, ...] = ()
) -> tuple[str, list[tuple[str, str, str]]]:
    """The documentation of a struct, and name, type and documentation of its fields, or of ``only`` some."""
    whole, lines = body(read(owner.file), "struct", owner.struct)
    found, docs = [], []
    for line in lines.splitlines():
        if line.strip().startswith("///"):
            docs.append(line)
        elif field := re.match(r"    (?:pub )?(\w+): (.*),$", line):
            name = field.group(1)
            if name not in HIDDEN and (not only or name in only):
                found.append((name, python_type(field.group(2), owner, name, classes), documentation(docs)))
            docs = []
    if owner.more:
        struct, file, names = owner.more
        found += fields_of(Class(owner.name, struct, file), classes, names)[1]
    return whole, found


def function_defaults(name: str) -> dict:
    """The defaults of a function of the package, from the dictionary that it has."""
    tree = ast.parse(read(OUT.parent / "_walks.py"))
    assigned = (one for one in tree.body if isinstance(one, ast.AnnAssign) and getattr(one.target, "id", None) == name)
    return ast.literal_eval(next(assigned).value)


def default_tables() -> dict[str, dict]:
    return {
        "fit": tomllib.loads(read(SETTINGS / "adapt.toml")),
        "walk": tomllib.loads(read(SETTINGS / "walk.toml")),
        "train": tomllib.loads(read(SETTINGS / "train.toml")),
        "finetune": tomllib.loads(read(SETTINGS / "finetune.toml")),
        "loop": tomllib.loads(read(SETTINGS / "loop.toml")),
        "evaluate": function_defaults("_EVALUATE"),
        "collect": function_defaults("_COLLECT"),
        "task": tomllib.loads(read(TASK / "velocity.toml")),
    }


def at(tables: dict[str, dict], path: str) -> object:
    found: object = tables
    for key in path.split("."):
        if not isinstance(found, dict) or key not in found:
            return None
        found = found[key]
    return found


def default_text(owner: Class, field: str, tables: dict[str, dict]) -> str:
    """The default of a field, where it is short."""
    if not owner.defaults:
        return ""
    texts = []
    places = [("", f"{owner.defaults}.{field}")]
    if owner.defaults.startswith("fit"):
        places.append(("of walks ", f"walk{owner.defaults.removeprefix('fit')}.{field}"))
    if owner.name == "Evaluate":
        places = [("of a loop ", f"{owner.defaults}.{field}"), ("of gaitfit.evaluate ", f"evaluate.{field}")]
        if len({at(tables, place) for _, place in places}) == 1:
            places = [("", f"evaluate.{field}")]
    if owner.defaults in ("train.train", "train.ppo"):
        places.append(("of finetune ", f"finetune{owner.defaults.removeprefix('train')}.{field}"))
    for whose, place in places:
        value = at(tables, place)
        if value is None or isinstance(value, dict) or (isinstance(value, list) and any(isinstance(one, dict) for one in value)):
            continue
        text = repr(value)
        if len(text) <= 40 and value not in ("", []) and text not in [one.split()[-1] for one in texts]:
            texts.append(f"{whose}{text}")
    return f" Default: {', '.join(texts)}." if texts else ""


def named_choices(kind: str) -> str:
    """The choices of a field's type, where it has some."""
    found = {"ParameterKind": [name for name, *_ in parameter_kinds()], "Cost": COSTS}
    for name in dict.fromkeys(re.findall(r"\b[A-Z]\w+", kind)):
        values = found.get(name) or (choices(name) if name in ENUMS else [])
        if values:
            return f" One of {', '.join(f'``{value}``' for value in values)}."
    return ""


def expressions() -> list[str]:
    """What expressions of ``Task.terms`` may name, and their operators, from the page on tasks."""
    text = read(ROOT / "docs" / "tasks.md")
    start = text.index("| name | elements | content |")
    part = text[start : text.index("\n\nA wrong expression", start)].replace("`", "``")
    lines = ["", "    Names in expressions of ``terms``, with their elements where they are rows:", ""]
    for line in part.splitlines()[2:]:
        if line.startswith("|"):
            name, elements, content = (one.strip() for one in line.strip("|").split("|"))
            line = f"- {name}{f' ({elements})' if elements else ''}: {content}"
        lines += textwrap.wrap(line, WIDTH, initial_indent="    ", subsequent_indent="      ") or [""]
    return lines


def written(owner: Class, classes: dict[str, str], tables: dict[str, dict]) -> str:
    whole, fields = fields_of(owner, classes)
    whole = re.sub(r"``(\w+)``", lambda name: f"``{classes.get(name[1], name[1])}``", whole)
    if owner.name == "Task":
        fields.insert(0, ("base", "TaskName", "The built-in task that it begins with; other settings change it."))
    head = f"@dataclass(frozen=True, kw_only=True)\nclass {owner.name}(Settings):"
    lines = [head, *textwrap.wrap(f'"""{whole}', WIDTH, initial_indent="    ", subsequent_indent="    ")]
    lines += ["", "    Attributes:"]
    for name, kind, docs in fields:
        docs = docs if docs.endswith((".", ":")) else f"{docs}."
        # Kinds of parameters are explained one by one below.
        docs += "" if (owner.name, name) == ("Parameter", "kind") else named_choices(kind)
        docs += f" In a file: ``{name}``." if name in NAMES else ""
        text = f"{NAMES.get(name, name)}: {docs}{default_text(owner, name, tables)}"
        lines += textwrap.wrap(
            text, WIDTH, initial_indent="        ", subsequent_indent="            ", break_long_words=False,
            break_on_hyphens=False,
        )
    if owner.name == "Parameter":
        lines += ["", "    Kinds, each with its unit and, by default, (lower, upper, start, deviation). A value replaces that of the robot's"]
        lines += ["    file; those without unit that start at 1 are factors:", ""]
        for name, docs, unit, search in parameter_kinds():
            text = f"- ``{name}``, {unit}, ({search}): {docs}"
            lines += textwrap.wrap(text, WIDTH, initial_indent="    ", subsequent_indent="      ", break_long_words=False)
    if owner.name == "Task":
        lines += expressions()
    lines += ["", f"    >>> settings = {EXAMPLES[owner.name]}"]
    lines += ['    """', ""]
    for name, kind, _ in fields:
        if name == owner.first:
            lines.append(f"    {NAMES.get(name, name)}: {kind} = field(kw_only=False)")
        else:
            lines.append(f"    {NAMES.get(name, name)}: {kind} | None = None")
    return "\n".join(lines) + "\n"


def alias(name: str, values: list[str]) -> str:
    """A type of choices, on one line if it fits."""
    line = f"{name} = {literal(values)}\n"
    if len(line) <= WIDTH:
        return line
    inside = textwrap.wrap(", ".join(f'"{value}"' for value in values) + ",", WIDTH, initial_indent="    ",
                           subsequent_indent="    ", break_on_hyphens=False)
    return "\n".join([f"{name} = Literal[", *inside, "]\n"])


def aliases(names: list[str]) -> str:
    return "".join(alias(name, choices(name)) for name in names)


HEAD = '"""{doc} Written by tools/make_python_config.py from the settings\' structs: do not edit."""\n\n'
COSTS = ["wass", "matcho", *[f"matchr{n}" for n in (1, 2, 5, 10, 20)], "matchs", *[f"matchs{n}" for n in (1, 5, 10, 20, 50)]]


def files() -> dict[str, str]:
    tables = default_tables()
    classes = {one.struct: one.name for one in [*FIT, *TASKS, *TRAIN, *LOOP] if one.struct not in ("Settings", "Term")}

    def text(group: list[Class]) -> str:
        return "\n\n".join(written(one, classes, tables) for one in group)

    fit_enums = ["Base", "Method", "RandomNumbers", "CovarianceKind", "BoundHandling", "Sharing", "NetworkName"]
    fit_enums += ["NetworkStart", "RobotNumber", "FindingKind", "Preset"]
    task_enums = ["TaskName", "FrameOrder", "HistoryStart", "Quantity"]
    imports = "from __future__ import annotations\n\nimport os\nfrom collections.abc import Mapping, Sequence\n"
    imports += "from dataclasses import dataclass, field\nfrom typing import Literal\n\n"
    return {
        "_fit.py": HEAD.format(doc="Settings of fits.")
        + imports
        + "from .._settings import Settings\n\n"
        + aliases(fit_enums)
        + alias("ParameterKind", [name for name, *_ in parameter_kinds()])
        + "#: Of ``matchr`` and ``matchs`` the common numbers of samples; settings by name take any.\n"
        + alias("Cost", COSTS)
        + "\n\n"
        + text(FIT),
        "_task.py": HEAD.format(doc="Settings of tasks.")
        + imports.replace("import os\n", "")
        + "from .._settings import Settings\n\n"
        + aliases(task_enums)
        + "\n\n"
        + text(TASKS),
        "_train.py": HEAD.format(doc="Settings of trainings.")
        + imports.replace("dataclass, field", "dataclass")
        + "from .._settings import Settings\nfrom ._fit import Preset\nfrom ._task import Task\n\n"
        + aliases(["Cone", "Cell", "Precision", "Schedule"])
        + "\n\n"
        + text(TRAIN),
        "_loop.py": HEAD.format(doc="Settings of loops, evaluations and collections.")
        + imports.replace("import Mapping, Sequence", "import Sequence")
        + "from .._settings import Settings\nfrom ._fit import Fit, ParameterKind, Preset, RobotNumber\nfrom ._train import Finetune\n\n"
        + aliases(["TargetKind"])
        + "\n\n"
        + text(LOOP),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    stale = [name for name, text in files().items() if not (OUT / name).exists() or read(OUT / name) != text]
    settings = SETTINGS / "adapt.toml"
    if read(settings) != settings_with_kinds():
        stale.append(str(settings))
    if check and stale:
        sys.exit(f"not current: {', '.join(stale)}; run tools/make_python_config.py")
    for name, text in files().items():
        (OUT / name).write_text(text, encoding="utf-8")
    settings.write_text(settings_with_kinds(), encoding="utf-8")


if __name__ == "__main__":
    main()
