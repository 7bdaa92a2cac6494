"""Ready-made functions for progress: what they show and write, with packages that are there and packages that are not."""

import io
import sys
import types
import unittest
from contextlib import redirect_stderr
from unittest import mock

import gaitfit
from gaitfit import Event, callbacks

from .common import DEMO, Case

STEPS = [
    Event("note", "late stamps"),
    Event("begin", what="seed 2, iteration", total=2, seed=2),
    Event("step", "reward 1", "seed 2, iteration", 1, 2, {"train/reward": 1.0}, 2),
    Event("step", "reward 2", "seed 2, iteration", 2, 2, {"train/reward": 2.0}, 2),
    Event("end", what="seed 2, iteration", total=2, seed=2),
]


class Recorded:
    """Stands for a package: keeps how it was called."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple, dict]] = []

    def __getattr__(self, name: str) -> object:
        return lambda *values, **named: self.calls.append((name, values, named))


class Callbacks(Case):
    def test_numbers_go_to_weights_and_biases_and_mlflow(self) -> None:
        run, began = Recorded(), []
        wandb = types.SimpleNamespace(init=lambda **options: began.append(options) or run)
        with mock.patch.dict(sys.modules, {"wandb": wandb}):
            tell = callbacks.WandB(project="go2")
        for event in STEPS:
            tell(event)
        self.assertEqual(began, [{"project": "go2"}])
        self.assertEqual([call[1] for call in run.calls], [({"seed-2/train/reward": float(n), "done": n},) for n in (1, 2)])
        mlflow = Recorded()
        with mock.patch.dict(sys.modules, {"mlflow": mlflow}):
            tell = callbacks.MLflow()
        for event in STEPS:
            tell(event)
        self.assertEqual(mlflow.calls[1], ("log_metrics", ({"seed-2/train/reward": 2.0},), {"step": 2}))

    def test_the_last_step_is_printed_where_work_ends_before_its_total(self) -> None:
        tell, lines = callbacks.Printed(), io.StringIO()
        with redirect_stderr(lines):
            for event in (
                Event("begin", what="generation", total=300),
                *(Event("step", "", "generation", done, 300) for done in range(1, 76)),
                Event("end", what="generation", done=75, total=300),
            ):
                tell(event)
        self.assertIn("generation 75 of 300", lines.getvalue())
        self.assertEqual(lines.getvalue().count("generation"), 2)

    def test_numbers_go_to_tensorboard(self) -> None:
        try:
            from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
        except ImportError as missing:
            self.skipTest(str(missing))
        tell = callbacks.TensorBoard(self.folder / "board")
        settings = {"optimizer.generations": 3, "optimizer.seeds": 1}
        found = gaitfit.fit(DEMO / "adapt.toml", runs=self.folder, name="f", settings=settings, progress=tell)
        read = EventAccumulator(str(self.folder / "board"))
        read.Reload()
        curve = read.Scalars(f"{found.cost_name}/seed-1/best_so_far")
        self.assertEqual([one.step for one in curve], [1, 2, 3])
        self.assertAlmostEqual(curve[-1].value, found.cost, delta=1e-4 * found.cost)

    def test_tqdm_shows_the_work(self) -> None:
        shown = io.StringIO()
        try:
            bar = callbacks.Tqdm(file=shown)
        except ImportError as missing:
            self.skipTest(str(missing))
        for event in STEPS:
            bar(event)
        self.assertIn("2/2", shown.getvalue())
        self.assertIn("seed 2, iteration", shown.getvalue())

    def test_printed_lines(self) -> None:
        told = io.StringIO()
        with redirect_stderr(told):
            for tell in (callbacks.Printed(),):
                for event in STEPS:
                    tell(event)
        self.assertEqual(told.getvalue().splitlines()[0], "note: late stamps")
        self.assertIn("seed 2, iteration 2 of 2  reward 2", told.getvalue())

    def test_lines_are_printed_beside_other_functions(self) -> None:
        told, events = io.StringIO(), []
        settings = {"optimizer.generations": 2, "optimizer.seeds": 1}
        with redirect_stderr(told):
            gaitfit.fit(DEMO / "adapt.toml", runs=self.folder, settings=settings, progress=[True, events.append])
        self.assertIn("generation 2 of 2", told.getvalue())
        self.assertEqual({event.seed for event in events if event.what == "generation"}, {None})
        for wrong in ([False], [True, None], "lines", 1):
            with self.subTest(wrong=wrong), self.assertRaisesRegex(TypeError, "a list of functions, in which True prints"):
                gaitfit.fit(DEMO / "adapt.toml", runs=self.folder, progress=wrong)

    def test_absent_packages_are_named(self) -> None:
        for make, module, package in (
            (callbacks.Tqdm, "tqdm.auto", "tqdm"),
            (callbacks.WandB, "wandb", "wandb"),
            (callbacks.MLflow, "mlflow", "mlflow"),
            (lambda: callbacks.TensorBoard("x"), "tensorboard.summary.writer.event_file_writer", "tensorboard"),
        ):
            with mock.patch.dict(sys.modules, {module: None}):
                with self.subTest(package), self.assertRaisesRegex(ImportError, f"pip install {package}"):
                    make()

    def test_a_training_has_its_numbers(self) -> None:
        events: list[Event] = []
        size = {"train.num_envs": 32, "train.iterations": 2}
        trained = gaitfit.train(runs=self.folder, name="t", settings=size, progress=events.append)
        steps = [event for event in events if event.kind == "step" and event.metrics]
        self.assertEqual([event.done for event in steps], [1, 2])
        self.assertEqual({event.seed for event in events if event.what}, {1})
        mean = sum(event.metrics["train/reward"] for event in steps) / 2
        self.assertAlmostEqual(mean, trained.seeds[0].reward, places=12)
        self.assertIn("ppo/kl", " ".join(steps[0].metrics))

    def test_events_of_several_seeds_are_told_apart(self) -> None:
        events: list[Event] = []
        size = {"train.num_envs": 32, "train.iterations": 1}
        gaitfit.train(runs=self.folder, name="t", seeds=[4, 7], settings=size, progress=events.append)
        counted = [(event.kind, event.seed) for event in events if event.kind in ("begin", "step", "end")]
        self.assertEqual(counted, [(kind, seed) for seed in (4, 7) for kind in ("begin", "step", "end")])
        self.assertEqual({event.seed for event in events if event.kind == "note"} - {None}, set())


if __name__ == "__main__":
    unittest.main()
