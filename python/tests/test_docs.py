"""Docstrings: every argument is described, everything public has an example, and every example runs."""

import doctest
import importlib
import inspect
import pkgutil
import re
import unittest
from collections.abc import Iterator
from types import ModuleType

import numpy as np

import gaitfit
from gaitfit.results._read import loop_result, table_result

from .common import DEMO, Case

POLICY = "assets/go2-walk.safetensors"
#: What is public besides ``gaitfit.__all__``; some need packages that may be absent.
MODULES = ("callbacks", "config", "costs", "gym", "mujoco", "mujoco_warp", "plots", "ray", "results", "rsl_rl", "sb3")
#: Examples that are not run, because they need a cluster, a GPU, a service, or minutes.
MAX_SKIPPED = 45


def module(name: str) -> "ModuleType | None":
    """A module of the package, or nothing if a package that it needs is absent."""
    try:
        return importlib.import_module(name)
    except ImportError as missing:
        if str(missing.name).startswith("gaitfit"):
            raise
        print(f"{name} is left out: {missing}")
        return None


def public() -> "Iterator[tuple[str, object]]":
    """Every public function and class, by its name."""
    for owner in [gaitfit, *filter(None, (module(f"gaitfit.{name}") for name in MODULES))]:
        names = getattr(owner, "__all__", [name for name in vars(owner) if not name.startswith("_")])
        for name in names:
            value = getattr(owner, name)
            mine = str(getattr(value, "__module__", "")).startswith("gaitfit")
            # Types of choices have no docstring of their own.
            if mine and (inspect.isfunction(value) or inspect.isclass(value)):
                if not (inspect.isclass(value) and issubclass(value, Exception)):
                    yield f"{owner.__name__}.{name}", value


def methods(name: str, value: object) -> "Iterator[tuple[str, object]]":
    """The public methods of a class."""
    for key, one in vars(value).items() if inspect.isclass(value) else ():
        function = one.__func__ if isinstance(one, (classmethod, staticmethod)) else one
        if inspect.isfunction(function) and not key.startswith("_"):
            yield f"{name}.{key}", function


def arguments(function: object) -> list[str]:
    # The document of a result is described once, in Result.
    return [one for one in inspect.signature(function).parameters if one not in {"self", "cls", "args", "kwargs", "document"}]


class Words(Case):
    def test_every_argument_is_described(self) -> None:
        count = 0
        for name, value in public():
            made = value.__init__ if inspect.isclass(value) and value.__init__ is not object.__init__ else value
            native = inspect.isclass(value) and name.endswith("DeviceArray")
            for key, function in [] if native else [(name, made), *methods(name, value)]:
                # Fields of a base class are described there.
                described = value.__mro__ if key == name and inspect.isclass(value) else [value if key == name else function]
                text = " ".join(one.__doc__ or "" for one in described if one is not object)
                missing = [one for one in arguments(function) if not re.search(rf"\b{one}\b", text)]
                self.assertEqual(missing, [], f"{key} does not describe them")
                count += 1
        self.assertGreater(count, 150)

    def test_what_functions_return_and_raise_is_said(self) -> None:
        silent = []
        for name, value in public():
            parts = [(name, value)] if inspect.isfunction(value) else [one for one in methods(name, value) if arguments(one[1])]
            for key, function in parts:
                text = inspect.getdoc(function) or ""
                if not re.search(r"\b([Rr]aises|Refused)\b", text) or (function is value and not re.search(r"\b[Rr]eturns\b", text)):
                    silent.append(key)
        self.assertEqual(silent, [])

    def test_everything_public_has_an_example(self) -> None:
        without = [name for name, value in public() if ">>> " not in (inspect.getdoc(value) or "")]
        self.assertEqual(without, [])


class Examples(Case):
    """Examples use what stages returned by these names: ``result``, ``walked``, ``trained``, ``collected``, ``fleet``, ``looped``, ``table``."""

    def returned(self) -> dict[str, object]:
        runs = self.folder / "runs"
        short = {"optimizer.generations": 3, "optimizer.seeds": 1}
        result = gaitfit.fit(DEMO / "adapt.toml", costs="matcho", settings=short, runs=runs, progress=False)
        walked = gaitfit.evaluate(POLICY, trajectories=4, seconds=0.2, drift=1, progress=False)
        texts = ("name", "robot", "before", "after", "policy", "onnx", "stopped_because", "run_folder")
        loop = {
            **dict.fromkeys(texts, "before"), "target": None, "rounds": [], "comparisons": [], "doubts": [], "warnings": [],
            "wall_seconds": 1.0, "stage_seconds": {}, "evaluations": [{**walked.to_dict(), "on": "target", "policy": "before"}],
        }
        row = {"cell": "a", "scenario": "b", "seconds": 1.0, "errors_percent": {"delay": {"mean": 2.0, "ci95": None}}}
        return {
            "gaitfit": gaitfit,
            "np": np,
            "result": result,
            "walked": walked,
            "trained": gaitfit.train(
                runs=runs, name="t", settings={"train.num_envs": 32, "train.iterations": 2}, progress=False
            ),
            "collected": gaitfit.collect(POLICY, self.folder / "logs", trajectories=2, seconds=0.2, progress=False),
            "fleet": gaitfit.fleet(dict.fromkeys("abcde", result)),
            "looped": loop_result(loop),
            "table": table_result({"table": "t", "title": "T", "full": False, "rows": [row], "run_folder": "runs/t"}),
        }

    def test_every_example_runs(self) -> None:
        given = self.returned()
        try:
            import matplotlib

            matplotlib.use("Agg")
        except ImportError:
            pass
        finder, runner = doctest.DocTestFinder(exclude_empty=True), doctest.DocTestRunner(verbose=False)
        run, skipped = 0, 0
        for found in pkgutil.walk_packages(gaitfit.__path__, "gaitfit."):
            if found.name.endswith("__main__") or (one := module(found.name)) is None:
                continue
            for test in finder.find(one, extraglobs=given):
                skip = sum(doctest.SKIP in example.options for example in test.examples)
                run, skipped = run + len(test.examples) - skip, skipped + skip
                with self.subTest(test.name):
                    said: list[str] = []
                    self.assertEqual(runner.run(test, out=said.append).failed, 0, "".join(said))
        self.assertGreater(run, 120)
        self.assertLessEqual(skipped, MAX_SKIPPED)


if __name__ == "__main__":
    unittest.main()
