"""mypy and pyright, strict: the package and the examples are clean, and mistakes that were silent are found."""

import json
import os
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

from .common import PACKAGE, ROOT, Case

SCRIPT = ROOT / "examples" / "python" / "typed_fit.py"
#: A line of the script, and a mistake in it.
MISTAKES = {
    "field": ("print(result.headline)", "print(result.heedline)"),
    "cost": ('costs="matcho"', 'costs="wasss"'),
    "device": ('device="cpu"', 'device="tpu"'),
    "setting": ("generations=60", "generatoins=60"),
    "kind": ('Parameter("armature"', 'Parameter("armatur"'),
    "parameter": ("{one.unit}", "{one.units}"),
}


def found(name: str) -> list[str]:
    """The command of a checker, or an empty list."""
    try:
        __import__(name)
    except ImportError:
        return []
    return [sys.executable, "-m", name]


class Checkers(Case):
    def checked(self, checker: str, files: list[Path]) -> dict[str, list[str]]:
        """The errors of each file by its name."""
        command = found(checker)
        if not command:
            self.skipTest(f"{checker} is not installed: tools/setup_venv.sh")
        # As a user has it: the package in another folder, and no configuration of ours.
        environment = {**os.environ, "MYPYPATH": str(PACKAGE), "MYPY_CACHE_DIR": str(self.folder / "cache")}
        names = [str(file) for file in files]
        if checker == "mypy":
            done = subprocess.run(
                [*command, "--strict", "--config-file", os.devnull, "--follow-imports=silent", "--no-error-summary", *names],
                capture_output=True, text=True, env=environment, cwd=self.folder, check=False,
            )
            self.assertIn(done.returncode, (0, 1), done.stderr)
            lines = [line for line in done.stdout.splitlines() if ": error: " in line]
            return {file.name: [line for line in lines if line.startswith((str(file), file.name))] for file in files}
        settings = {"extraPaths": [str(PACKAGE)], "typeCheckingMode": "strict", "include": names, "pythonPlatform": "Linux"}
        (self.folder / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
        done = subprocess.run(
            [*command, "--outputjson", "--project", str(self.folder / "pyrightconfig.json"), "--pythonpath", sys.executable],
            capture_output=True, text=True, cwd=self.folder, check=False,
        )
        diagnostics = json.loads(done.stdout)["generalDiagnostics"]
        return {
            file.name: [one["message"] for one in diagnostics if Path(one["file"]).name == file.name] for file in files
        }

    def test_devices_of_robots(self) -> None:
        text = 'import gaitfit\nfrom gaitfit.gym import GaitfitVecEnv\nrobots = gaitfit.Robots(num_envs=2, device="cpu")\nmany = GaitfitVecEnv(num_envs=2, device="cpu")\n'
        files = [self.folder / f"{name}.py" for name in ("right", "robots", "many")]
        lines = text.splitlines(keepends=True)
        for file, wrong in zip(files, (None, 2, 3), strict=True):
            file.write_text("".join(line.replace('"cpu"', '"tpu"') if number == wrong else line for number, line in enumerate(lines)))
        for checker in ("mypy", "pyright"):
            errors = self.checked(checker, files)
            self.assertEqual(errors.pop("right.py"), [], checker)
            self.assertEqual({name: len(lines) for name, lines in errors.items()}, {"robots.py": 1, "many.py": 1}, errors)

    def scripts(self) -> list[Path]:
        """The script, and one file for each mistake."""
        text = SCRIPT.read_text(encoding="utf-8")
        right = self.folder / "right.py"
        shutil.copy(SCRIPT, right)
        files = [right]
        for name, (before, after) in MISTAKES.items():
            self.assertEqual(text.count(before), 1, name)
            files.append(self.folder / f"wrong_{name}.py")
            files[-1].write_text(text.replace(before, after), encoding="utf-8")
        return files

    def judge(self, errors: dict[str, list[str]]) -> None:
        self.assertEqual(errors.pop("right.py"), [])
        for name, lines in errors.items():
            with self.subTest(name):
                self.assertNotEqual(lines, [])

    def test_mypy_finds_the_mistakes(self) -> None:
        self.judge(self.checked("mypy", self.scripts()))

    def test_pyright_finds_the_mistakes(self) -> None:
        self.judge(self.checked("pyright", self.scripts()))

    def test_mypy_accepts_the_package(self) -> None:
        command = found("mypy")
        if not command:
            self.skipTest("mypy is not installed: tools/setup_venv.sh")
        cache = str(self.folder / "cache")
        examples = [str(file) for file in (ROOT / "examples" / "python").glob("*.py")]
        done = subprocess.run(
            [*command, "--cache-dir", cache, "--no-error-summary", "gaitfit", *examples], capture_output=True, text=True, cwd=PACKAGE, check=False
        )
        self.assertEqual(done.stdout, "")

    def test_pyright_accepts_the_package(self) -> None:
        command = found("pyright")
        if not command:
            self.skipTest("pyright is not installed: tools/setup_venv.sh")
        # The package with its own settings, strict, and the examples as strictly.
        examples = {
            # Absolute folders are left out without an error.
            "include": [os.path.relpath(ROOT / "examples" / "python", self.folder)], "extraPaths": [str(PACKAGE)], "typeCheckingMode": "strict",
            "reportMissingImports": False, "reportMissingModuleSource": False, "reportMissingTypeStubs": False, "pythonPlatform": "Linux",
            # What a package that is absent would give is unknown.
            **{f"reportUnknown{kind}Type": False for kind in ("Member", "Variable", "Argument", "Parameter")},
        }
        (self.folder / "pyrightconfig.json").write_text(json.dumps(examples), encoding="utf-8")
        for project in (PACKAGE, self.folder / "pyrightconfig.json"):
            done = subprocess.run(
                [*command, "--outputjson", "--project", str(project), "--pythonpath", sys.executable],
                capture_output=True, text=True, check=False,
            )
            answer = json.loads(done.stdout)
            self.assertGreater(answer["summary"]["filesAnalyzed"], 1)
            self.assertEqual([(one["file"], one["message"]) for one in answer["generalDiagnostics"]], [], project)

    def test_the_script_runs(self) -> None:
        done = subprocess.run(
            [sys.executable, str(SCRIPT), str(self.folder)],
            capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(PACKAGE)}, cwd=ROOT,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("delay", done.stdout)
        self.assertIn("error on another log: 0.00", done.stdout)


if __name__ == "__main__":
    unittest.main()
