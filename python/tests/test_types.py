"""Stubs say what the native half is, and everything public has types and a docstring."""

import ast
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

    def test_the_pages_of_the_book_are_current(self) -> None:
        tool = [sys.executable, str(ROOT / "tools" / "make_python_api.py"), "--check"]
        found = subprocess.run(tool, capture_output=True, text=True, check=False)
        self.assertEqual((found.returncode, found.stderr), (0, ""))


if __name__ == "__main__":
    unittest.main()
