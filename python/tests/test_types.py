"""Stubs say what the native half is, and everything public has types and a docstring."""

import ast
import doctest
import importlib
import importlib.util
import inspect
import re
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np

import gaitfit
from gaitfit import _gaitfit

from .common import ROOT, Case

STUB = Path(gaitfit.__file__).parent / "_gaitfit.pyi"
ARRAY = re.compile(r"NDArray|ArrayLike")


def public(owner: object) -> dict[str, object]:
    return {name: value for name, value in vars(owner).items() if not name.startswith("_")}


class Stubs(Case):
    def test_the_stub_names_what_is_there(self) -> None:
        tree = ast.parse(STUB.read_text(encoding="utf-8"))
        functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
        self.assertEqual(set(functions) | set(classes), set(public(_gaitfit)))
        for name, node in functions.items():
            self.assertEqual(self.stubbed(node), self.native(getattr(_gaitfit, name)), name)
        for name, node in classes.items():
            if name in ("GaitfitError", "Stopped"):
                continue
            native = getattr(_gaitfit, name)
            methods = {one.name: one for one in node.body if isinstance(one, ast.FunctionDef)}
            fields = {one.target.id for one in node.body if isinstance(one, ast.AnnAssign)}
            own = {method for method in methods if not method.startswith("__")}
            self.assertEqual(own | fields, set(public(native)), name)
            if "__init__" in methods:
                self.assertEqual(self.stubbed(methods["__init__"])[1:], self.native(native), name)
            for method in set(methods) - {"__init__"}:
                self.assertEqual(self.stubbed(methods[method]), self.native(getattr(native, method)), f"{name}.{method}")

    def stubbed(self, node: ast.FunctionDef) -> list[str]:
        return [argument.arg for argument in node.args.args + node.args.kwonlyargs]

    def native(self, function: object) -> list[str]:
        return list(inspect.signature(function).parameters)


class Documentation(Case):
    def test_everything_public_has_types_and_a_docstring(self) -> None:
        self.assertTrue((STUB.parent / "py.typed").exists())
        self.assertEqual(sorted(gaitfit.__all__), gaitfit.__all__)
        for name in gaitfit.__all__:
            value = getattr(gaitfit, name)
            if inspect.isclass(value) and issubclass(value, Exception):
                self.assertGreater(len(inspect.getdoc(value) or ""), 12, name)
            elif inspect.isclass(value):
                methods = {f"{name}.{key}": one for key, one in public(value).items() if callable(one) or isinstance(one, property)}
                self.check(name, value)
                for method, one in methods.items():
                    self.check(method, one.fget if isinstance(one, property) else one)
            elif callable(value):
                self.check(name, value)
            elif inspect.ismodule(value):
                for key, one in public(value).items():
                    if inspect.isfunction(one) and one.__module__.startswith("gaitfit"):
                        self.check(f"{name}.{key}", one)

    def check(self, name: str, value: object) -> None:
        text = inspect.getdoc(value) or ""
        self.assertGreater(len(text), 12, f"{name} has no docstring")
        if name == "Simulator":
            # A protocol: what counts is the call.
            return self.check("Simulator()", value.__call__)
        if inspect.isclass(value) and value.__init__ is object.__init__:
            # Nobody makes it.
            return None
        function = value.__init__ if inspect.isclass(value) else value
        signature = inspect.signature(function)
        for parameter in signature.parameters.values():
            if parameter.name != "self":
                self.assertIsNot(parameter.annotation, inspect.Parameter.empty, f"{name}: {parameter.name} has no type")
        annotations = [str(parameter.annotation) for parameter in signature.parameters.values()]
        if ARRAY.search(" ".join([*annotations, str(signature.return_annotation)])):
            self.assertRegex(text, r"shape|``\(|one number for each", f"{name} takes or returns arrays and says no shape")

    def test_docstrings_examples_work(self) -> None:
        """Every example of a docstring runs, and every function and class that people use has one."""
        names = ["_cma", "_given", "_log_files", "_logs", "_policy", "_policy_file", "_progress", "_robots", "_stages", "_terms", "_walks", "_own_simulator"]
        names += ["callbacks", "config", "costs", "results", "results._read", "results._fit"]
        for optional, package in (("gym", "gymnasium"), ("plots", "matplotlib")):
            if importlib.util.find_spec(package) is not None:
                names.append(optional)
        for name in names:
            module = importlib.import_module(f"gaitfit.{name}")
            with self.subTest(name):
                found = doctest.testmod(module, extraglobs={"gaitfit": gaitfit, "np": np}, verbose=False)
                self.assertEqual(found.failed, 0)

    def test_the_pages_of_the_book_are_current(self) -> None:
        tool = [sys.executable, str(ROOT / "tools" / "make_python_api.py"), "--check"]
        found = subprocess.run(tool, capture_output=True, text=True, check=False)
        self.assertEqual((found.returncode, found.stderr), (0, ""))

    def test_every_argument_is_described(self) -> None:
        owners = [gaitfit]
        for name, package in (("gym", "gymnasium"), ("plots", "matplotlib"), ("mujoco", "mujoco"), ("callbacks", "sys"), ("ray", "sys")):
            if importlib.util.find_spec(package) is not None:
                owners.append(importlib.import_module(f"gaitfit.{name}"))
        count = 0
        for owner in owners:
            for name in getattr(owner, "__all__", public(owner)):
                value = getattr(owner, name)
                if inspect.ismodule(value) or not callable(value) or not value.__module__.startswith(owner.__name__):
                    continue
                parts = {name: value.__init__ if inspect.isclass(value) else value}
                if inspect.isclass(value):
                    if issubclass(value, Exception):
                        continue
                    parts |= {f"{name}.{key}": one for key, one in public(value).items() if inspect.isfunction(one)}
                for key, function in parts.items():
                    text = inspect.getdoc(value if key == name else function) or ""
                    # The document of a result is described once, in Result.
                    known = {"self", "args", "kwargs", "document"}
                    arguments = [one for one in inspect.signature(function).parameters if one not in known]
                    missing = [one for one in arguments if not re.search(rf"\b{one}\b", text)]
                    self.assertEqual(missing, [], f"{owner.__name__}.{key} does not describe them")
                    count += 1
        self.assertGreater(count, 80)
        for name in ("fit", "validate", "train", "finetune", "evaluate", "collect", "loop", "read_log", "load_policy", "load"):
            for words in (">>>", "Raises"):
                self.assertIn(words, inspect.getdoc(getattr(gaitfit, name)) or "", name)


if __name__ == "__main__":
    unittest.main()
