"""Short notebooks of examples/notebooks run from their first cell to their last; outputs of all in the files are small."""

import ast
import contextlib
import io
import json
import os
import unittest

import gaitfit

from .common import ROOT, Case

NOTEBOOKS = ROOT / "examples" / "notebooks"


def execute(source: str, names: dict) -> object:
    """Runs a cell as a notebook does; the value of its last expression comes back."""
    body = ast.parse(source).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)


#: The largest output that a file may have, bytes (tools/run_notebooks.py).
MAX_OUTPUT = 200_000


class Files(Case):
    def test_outputs_are_small_and_no_cell_failed(self) -> None:
        for file in sorted(NOTEBOOKS.glob("*.ipynb")):
            for number, cell in enumerate(json.loads(file.read_text(encoding="utf-8"))["cells"]):
                if cell["cell_type"] != "code":
                    continue
                ast.parse("".join(cell["source"]))
                for output in cell["outputs"]:
                    with self.subTest(file.name, cell=number):
                        self.assertNotEqual(output["output_type"], "error")
                        self.assertLess(len(json.dumps(output)), MAX_OUTPUT)

    def test_without_recordings_the_message_says_what_to_do(self) -> None:
        """The notebook of a real robot's walks: its recordings are not part of this project."""
        cells = json.loads((NOTEBOOKS / "real_walks.ipynb").read_text(encoding="utf-8"))["cells"]
        inside = self.folder / "clone"
        (inside / "examples" / "go2-demo").mkdir(parents=True)
        os.chdir(inside)
        names: dict = {}
        with self.assertRaisesRegex(FileNotFoundError, "state your own folder and policy"):
            for cell in cells:
                if cell["cell_type"] == "code":
                    execute("".join(cell["source"]), names)


class Notebooks(Case):
    def run_notebook(self, name: str, *changes: tuple[str, str]) -> dict:
        """The names after its last cell. ``changes``: texts of cells and what stands in their place."""
        try:
            import matplotlib

            matplotlib.use("Agg")
            import matplotlib.pyplot as plt
        except ImportError as missing:
            self.skipTest(str(missing))
        self.addCleanup(plt.close, "all")
        cells = json.loads((NOTEBOOKS / name).read_text(encoding="utf-8"))["cells"]
        sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        for old, new in changes:
            self.assertEqual(sum(source.count(old) for source in sources), 1, old)
            sources = [source.replace(old, new) for source in sources]
        names: dict = {}
        # Runs belong in the test's folder.
        for item in ("assets", "examples"):
            os.symlink(ROOT / item, self.folder / item)
        os.chdir(self.folder)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            for number, source in enumerate(sources):
                with self.subTest(f"{name}, code {number}"):
                    names["last"] = execute(source, names)
        return names

    def test_clamped_leg(self) -> None:
        names = self.run_notebook("clamped_leg.ipynb")
        self.assertIs(names["last"], names["found"])
        page = names["found"]._repr_html_()
        self.assertIn("<iframe srcdoc=", page)
        self.assertIn("frictionloss_hip", page)
        for one in names["found"].parameters.values():
            self.assertAlmostEqual(one.value / one.truth, 1.0, delta=0.1, msg=one.name)

    def test_loop(self) -> None:
        found = self.run_notebook("loop.ipynb")["found"]
        self.assertEqual({one.on for one in found.evaluations}, {"target", "adapted"})

    def test_own_simulator(self) -> None:
        try:
            import mujoco  # noqa: F401
        except ImportError as missing:
            self.skipTest(str(missing))
        names = self.run_notebook("own_simulator.ipynb")
        self.assertLess(abs(names["found"].values["delay"] - 0.007), 0.001)


    def test_rsl_rl(self) -> None:
        """A few iterations instead of two minutes."""
        try:
            import rsl_rl  # noqa: F401
            import torch
        except ImportError as missing:
            self.skipTest(str(missing))
        self.addCleanup(torch.set_num_threads, torch.get_num_threads())
        names = self.run_notebook("rsl_rl.ipynb", ("ROBOTS, STEPS, ITERATIONS = 512, 24, 160", "ROBOTS, STEPS, ITERATIONS = 64, 24, 8"))
        history = names["env"].history
        self.assertEqual(len(history), 8 * 24)
        for step in history[-3:]:
            terms = sum(value for name, value in step.items() if name.startswith("/reward/"))
            self.assertAlmostEqual(terms, step["reward"], places=5)
        pair = [[p.detach().numpy() for p in names[name].parameters()] for name in ("before", "actor")]
        self.assertFalse(any((one == other).all() for one, other in zip(*pair)), "the network has not been trained")


class Charts(Case):
    def test_wrong_things_have_no_chart(self) -> None:
        try:
            import matplotlib

            matplotlib.use("Agg")
            from gaitfit import plots
        except ImportError as missing:
            self.skipTest(str(missing))
        with self.assertRaisesRegex(ValueError, "no chart of results with a"):
            plots.plot({"a": 1})
        with self.assertRaisesRegex(ValueError, "no run folder"):
            plots.convergence({"parameters": []})
        for chart, key in ((plots.parameters, "parameters"), (plots.training, "seeds"), (plots.drift, "drift")):
            for other in ({"verdict": "walks"}, {key: 3}, {key: [1, 2]}):
                with self.subTest(key=key), self.assertRaisesRegex(ValueError, f"have no {key}"):
                    chart(other)
        with self.assertRaisesRegex(ValueError, "have no parameters"):
            plots.plot({"rounds": [{}]})
        log = gaitfit.read_log("examples/go2-demo/fit.csv")
        with self.assertRaisesRegex(ValueError, "no joint 'knee'"):
            plots.log(log, ["knee"])
        self.assertEqual(len(plots.log(log, ["FL_hip", "RR_calf"]).axes), 2)

    def test_an_evaluation_and_a_training_are_drawn(self) -> None:
        try:
            import matplotlib

            matplotlib.use("Agg")
        except ImportError as missing:
            self.skipTest(str(missing))
        walked = gaitfit.evaluate("assets/go2-walk.safetensors", trajectories=8, seconds=0.5, drift=1, progress=False)
        self.assertEqual(len(walked.plot().axes[0].lines), 7)
        self.assertIn(walked.verdict[:10], walked._repr_html_())
        size = {"train.num_envs": 32, "train.iterations": 2}
        trained = gaitfit.train(runs=self.folder, name="t", settings=size, progress=False)
        self.assertEqual(list(trained.plot().axes[0].lines[0].get_xdata()), [1, 2])


if __name__ == "__main__":
    unittest.main()
