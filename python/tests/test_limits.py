"""Limits on the time of a call, and the settings classes that stages take as ``config``."""

import time
import unittest

import gaitfit
from gaitfit.config import Collect, Evaluate, Fit, Loop, Optimizer, Parameter, Train

from .common import DEMO, Case

POLICY = "assets/go2-walk.safetensors"
SIZE = {"train.num_envs": 32, "train.iterations": 400}


class Limits(Case):
    def test_a_training_stops_after_its_time_and_continues(self) -> None:
        begun = time.monotonic()
        with self.assertRaisesRegex(gaitfit.Stopped, r"stopped after 1 s \(max_seconds\)") as stopped:
            gaitfit.train(settings=SIZE, runs=self.folder, max_seconds=1.0, progress=False)
        self.assertLess(time.monotonic() - begun, 30.0)
        folder = stopped.exception.run_folder
        self.assertTrue((folder / "seed-1" / "policy.safetensors").exists())
        done = (folder / "seed-1" / "metrics.jsonl").read_text().splitlines()
        with self.assertRaises(gaitfit.Stopped) as again:
            gaitfit.train(settings=SIZE, runs=self.folder, resume=True, max_seconds=1.0, progress=False)
        self.assertEqual(again.exception.run_folder, folder)
        more = (folder / "seed-1" / "metrics.jsonl").read_text().splitlines()
        self.assertGreater(len(more), len(done))
        self.assertEqual(more[: len(done)], done)

    def test_an_evaluation_and_a_collection_stop_after_their_time(self) -> None:
        for call in (
            lambda: gaitfit.evaluate(POLICY, trajectories=10_000, seconds=60.0, max_seconds=0.5, progress=False),
            lambda: gaitfit.collect(POLICY, self.folder / "logs", trajectories=500, seconds=60.0, max_seconds=0.2, progress=False),
        ):
            with self.assertRaisesRegex(gaitfit.Stopped, "max_seconds") as stopped:
                call()
            self.assertIsNone(stopped.exception.run_folder)

    def test_a_fit_returns_what_it_has_and_continues(self) -> None:
        fit = {"settings": {"optimizer.seeds": 1}, "runs": self.folder, "name": "f", "progress": False}
        cut = gaitfit.fit(DEMO / "adapt.toml", max_seconds=1e-3, **fit)
        self.assertFalse(cut.converged)
        self.assertEqual({one.interval for one in cut.parameters.values()}, {None})
        self.assertTrue(any("max_seconds" in one and "no intervals" in one for one in cut.warnings), cut.warnings)
        fit["settings"] = {"optimizer.seeds": 1, "optimizer.generations": 3}
        whole = gaitfit.fit(DEMO / "adapt.toml", resume=True, **fit)
        self.assertEqual(whole.run_folder, cut.run_folder)
        self.assertTrue(all(one.interval for one in whole.parameters.values()))
        self.assertEqual(len(whole.history()), 3)

    def test_a_walks_fit_that_is_cut_short_has_no_intervals(self) -> None:
        gaitfit.collect(POLICY, self.folder / "walks", trajectories=4, seconds=4.0, progress=False)
        settings = {"optimizer.seeds": 1, "optimizer.population": 4, "optimizer.replicates": 1}
        parameters = [Parameter("frictionloss", per="all"), Parameter("delay", per="all", upper=0.05)]
        fit = {
            "config": Fit(parameters=parameters), "logs": self.folder / "walks", "policy": POLICY, "costs": "wass",
            "runs": self.folder, "name": "w", "progress": False,
        }
        cut = gaitfit.fit(**fit, settings=settings | {"optimizer.max_seconds": 1e-9})
        self.assertEqual({one.interval for one in cut.parameters.values()}, {None})
        self.assertTrue(any("not corrected" in one and "no intervals" in one for one in cut.warnings), cut.warnings)
        same = gaitfit.fit(**fit, settings=settings | {"optimizer.max_seconds": 1e-9}, resume=True)
        self.assertEqual(same, cut, "with the same limit it is finished")
        whole = gaitfit.fit(**fit, settings=settings | {"optimizer.generations": 2}, resume=True)
        self.assertEqual(len(whole.history()), 2)
        self.assertTrue(all(one.interval for one in whole.parameters.values()))

    def test_wrong_limits_are_named(self) -> None:
        for wrong, error in ((0.0, ValueError), (float("nan"), ValueError), ("1", TypeError)):
            with self.subTest(wrong), self.assertRaisesRegex(error, "max_seconds is"):
                gaitfit.train(max_seconds=wrong)  # type: ignore[arg-type]


class Configurations(Case):
    def test_an_evaluation_takes_its_settings(self) -> None:
        config = Evaluate(trajectories=16, seconds=0.5, drift=0, seed=3)
        found = gaitfit.evaluate(POLICY, config=config, progress=False)
        self.assertEqual((found.trajectories, found.seconds), (16, 0.5))
        self.assertEqual(found.reward, gaitfit.evaluate(POLICY, trajectories=16, seconds=0.5, drift=0, seed=3, progress=False).reward)
        self.assertEqual(gaitfit.evaluate(POLICY, config=config, trajectories=8, progress=False).trajectories, 8)
        fast = Evaluate(trajectories=16, seconds=0.5, drift=2, drift_speeds=(0.3, 0.0, 0.0))
        trials = gaitfit.evaluate(POLICY, config=fast, progress=False).drift
        self.assertIn(0.3, [trial.command[0] for trial in trials])
        with self.assertRaisesRegex(ValueError, "drift_speeds has 2 elements"):
            gaitfit.evaluate(POLICY, drift_speeds=(0.3, 0.0))  # type: ignore[arg-type]

    def test_a_collection_takes_its_settings(self) -> None:
        found = gaitfit.collect(POLICY, self.folder / "a", config=Collect(trajectories=2, seconds=0.5, privileged=True), progress=False)
        self.assertEqual(len(found.files), 2)
        self.assertIsNotNone(gaitfit.read_log(found.files[0]).base_position)
        self.assertEqual(len(gaitfit.collect(POLICY, self.folder / "b", config=Collect(trajectories=2), trajectories=1, seconds=0.5, progress=False).files), 1)

    def test_a_validation_takes_a_fits_settings(self) -> None:
        config = Fit.read(DEMO / "adapt.toml")
        fitted = gaitfit.fit(config, settings={"optimizer.generations": 2, "optimizer.seeds": 1}, runs=self.folder, progress=False)
        by_file = gaitfit.validate(fitted.theta, DEMO / "validate.csv")
        self.assertEqual(gaitfit.validate(fitted.theta, DEMO / "validate.csv", config=Fit()).rmse_rad, by_file.rmse_rad)
        coarse = gaitfit.validate(fitted.theta, DEMO / "validate.csv", config=Fit(simulation=gaitfit.config.Simulation(timestep=0.01)))
        self.assertNotEqual(coarse.rmse_rad, by_file.rmse_rad)

    def test_each_stage_names_the_class_that_it_takes(self) -> None:
        wrong = Optimizer()
        for call, kind in (
            (lambda: gaitfit.fit(wrong), "Fit"),  # type: ignore[arg-type]
            (lambda: gaitfit.validate("theta.toml", [], config=wrong), "Fit"),  # type: ignore[arg-type]
            (lambda: gaitfit.train(wrong), "Train"),  # type: ignore[arg-type]
            (lambda: gaitfit.finetune(POLICY, config=wrong), "Finetune"),  # type: ignore[arg-type]
            (lambda: gaitfit.evaluate(POLICY, config=wrong), "Evaluate"),  # type: ignore[arg-type]
            (lambda: gaitfit.collect(POLICY, "logs", config=wrong), "Collect"),  # type: ignore[arg-type]
            (lambda: gaitfit.loop(wrong), "Loop"),  # type: ignore[arg-type]
        ):
            with self.subTest(kind), self.assertRaisesRegex(TypeError, f"give a gaitfit.config.{kind}"):
                call()
        for config in (Fit(), Train(), Loop()):
            self.assertEqual(type(config).from_toml(config.to_toml()), config)


if __name__ == "__main__":
    unittest.main()
