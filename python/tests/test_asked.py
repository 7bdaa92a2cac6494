"""What new users looked for and did not find."""

import dataclasses
import inspect
import json
import sys
import time
import unittest
from typing import get_type_hints
from unittest import mock

import numpy as np

import gaitfit
from gaitfit import Interface, Policy
from gaitfit.config import Finetune, Parameter, TrueNumber, TrueParameter

from .common import DEMO, Case
from .test_own_policy import network

POLICY = "assets/go2-walk.safetensors"
SHORT = {"trajectories": 64, "seconds": 1.0, "drift": 0, "progress": False}


class Worlds(Case):
    def test_a_robot_with_other_values_is_compared_trajectory_by_trajectory(self) -> None:
        calves = TrueParameter("frictionloss", joints=["*_calf_joint"], value=2.0)
        nominal, other = gaitfit.evaluate(POLICY, **SHORT), gaitfit.evaluate(POLICY, theta=[calves], **SHORT)
        found = gaitfit.compare(other, nominal)
        self.assertTrue(found.paired)
        self.assertGreater(found.tracking_error.mean - found.tracking_error.ci95, 0.0)
        apart = other.linear_velocity_error.mean - nominal.linear_velocity_error.mean
        self.assertAlmostEqual(found.linear_velocity_error.mean, apart, places=9)
        # Unpaired it is less certain.
        unpaired = gaitfit.compare(other, gaitfit.evaluate(POLICY, seed=1, **SHORT))
        self.assertFalse(unpaired.paired)
        self.assertGreater(unpaired.linear_velocity_error.ci95, found.linear_velocity_error.ci95)
        heavy = gaitfit.evaluate(POLICY, theta=[calves, TrueNumber("payload_mass", value=3.0)], **SHORT)
        self.assertNotEqual(heavy.reward, other.reward)
        for theta, error, words in (
            (3, TypeError, "theta is 3; it must be a path"),
            ([3], TypeError, "theta has 3"),
            (TrueParameter("frictionloss"), ValueError, "a frictionloss without a value"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                gaitfit.evaluate(POLICY, theta=theta, **SHORT)
        rows = {row["quantity"]: row for row in found.rows()}
        self.assertEqual(rows["tracking_error"]["mean"], found.tracking_error.mean)
        self.assertIn(f"velocity error {apart:+.3f} ± ", repr(found))
        self.assertIn("falls +0.0 ± ", repr(found))
        self.assertEqual(json.loads(found.to_json())["on"], found.on)
        with self.assertRaisesRegex(TypeError, "against is 3; give what gaitfit.evaluate returned"):
            gaitfit.compare(nominal, 3)  # type: ignore[arg-type]

    def test_a_policy_that_follows_a_motion_is_measured_by_its_distance(self) -> None:
        walked = gaitfit.evaluate(POLICY, trajectories=2, seconds=0.5, drift=0, progress=False)
        self.assertIsNone(walked.motion_error)
        follows = dataclasses.replace(walked, motion_error=gaitfit.results.Estimate(0.05, 0.01), verdict=None)
        self.assertIn("0.050 rad off its motion", repr(follows))
        rows = {row["quantity"]: row for row in follows.rows()}
        self.assertEqual((rows["motion_error"]["mean"], rows["motion_error"]["unit"]), (0.05, "rad"))
        self.assertNotIn("linear_velocity_error", rows)
        with self.assertRaisesRegex(ValueError, "theta is empty"):
            gaitfit.evaluate(POLICY, theta=[], trajectories=2, progress=False)

    def test_files_of_another_kind_are_named(self) -> None:
        for call, words in (
            (lambda: gaitfit.evaluate(POLICY, robot="examples/go2-ground/robot.toml", **SHORT), "this is TOML, and a robot's file is XML"),
            (lambda: gaitfit.explain(DEMO / "fit.csv", "assets/go2.xml"), "none of the logs can be explained"),
            (lambda: gaitfit.train(settings={"train.num_env": 3}), "expected one of `num_envs`"),
        ):
            with self.subTest(words), self.assertRaisesRegex(gaitfit.GaitfitError, words):
                call()
        for call, words in (
            (lambda: gaitfit.fit(logs="no.csv"), "logs: there is no file no.csv"),
            (lambda: gaitfit.fit(logs=DEMO / "fit.csv", robot="no.xml"), "robot: there is no file no.xml"),
            (lambda: gaitfit.read_robot("unitree-go1"), "robot: there is no file unitree-go1; the built-in robot is 'unitree-go2'"),
            (lambda: gaitfit.evaluate("no.onnx", **SHORT), "policy: there is no file no.onnx"),
            (lambda: gaitfit.explain("no.csv", "assets/go2.xml"), "logs: there is no file no.csv"),
        ):
            with self.subTest(words), self.assertRaisesRegex(FileNotFoundError, words):
                call()

    def test_walks_are_explained(self) -> None:
        play = TrueParameter("play", joints=["*calf*"], value=0.06)
        logs = gaitfit.collect(POLICY, self.folder / "logs", trajectories=3, seconds=8.0, theta=[play], progress=False)
        found = gaitfit.explain(self.folder / "logs", "assets/go2.xml", policy=POLICY)
        self.assertEqual(len(logs.files), 3)
        self.assertIn("backlash", [one.kind for one in found.causes])
        self.assertEqual(len(found.rows()), len(found.causes))
        self.assertIn(found.causes[0].text, repr(found))

    def test_an_explanation_counts_its_work_and_stops(self) -> None:
        gaitfit.collect(POLICY, self.folder / "logs", trajectories=3, seconds=2.0, progress=False)
        events: list[gaitfit.Event] = []
        gaitfit.explain(self.folder / "logs", progress=events.append)
        begun = [(event.what, event.done) for event in events if event.kind == "begin"]
        self.assertEqual(begun, [("log", 0), ("regression", 0)])
        for what in ("log", "regression"):
            steps = [event for event in events if event.kind == "step" and event.what == what]
            done = [event.done for event in steps]
            self.assertEqual(done, sorted(set(done)))
            self.assertEqual(done[-1], steps[-1].total)
            self.assertEqual([event.done for event in events if (event.kind, event.what) == ("end", what)], done[-1:])
        self.assertEqual([event.total for event in events if (event.kind, event.what) == ("step", "log")], [3, 3, 3])
        seen: list[int] = []

        def stop(event: gaitfit.Event) -> bool:
            seen.extend([event.done] if (event.kind, event.what) == ("step", "regression") else [])
            return len(seen) < 2

        with self.assertRaisesRegex(gaitfit.Stopped, "progress function returned False"):
            gaitfit.explain(self.folder / "logs", progress=stop)
        # As many regressions end at once as there are threads.
        self.assertEqual(seen, sorted(set(seen)))
        self.assertEqual(len(seen), 2)

    def test_evaluations_collections_and_validations_count_their_work(self) -> None:
        counts: list[gaitfit.Event] = []
        size = {"trajectories": 64, "seconds": 2.0}
        logs = gaitfit.collect(POLICY, self.folder / "logs", **size, progress=counts.append)
        self.counted(counts, {"logs: simulated second": 128})
        gaitfit.evaluate(POLICY, **size, drift=2, terrain="rough", progress=counts.append)
        walks = {"random commands: simulated second": 128, "constant commands: simulated second": 7 * 2 * 6}
        self.counted(counts, {**walks, "uneven ground: simulated second": None})
        settings = {"optimizer.generations": 2, "optimizer.seeds": 1}
        fitted = gaitfit.fit(DEMO / "adapt.toml", runs=self.folder, settings=settings, progress=False)
        gaitfit.validate(fitted.theta, DEMO / "validate.csv", progress=counts.append)
        self.counted(counts, {"simulation of the logs": 4})
        # Commands of a file are played log by log.
        moves = self.folder / "moves.csv"
        moves.write_text("trajectory,time,vx_cmd,vy_cmd,wz_cmd\n" + "".join(f"{one},0.0,0.3,0.0,0.0\n{one},1.0,0.0,0.0,0.0\n" for one in range(3)))
        gaitfit.collect(POLICY, self.folder / "played", commands=moves, seconds=1.0, progress=counts.append)
        self.counted(counts, {"log": 3})
        self.assertEqual(len(logs.files), 64)

    def counted(self, events: list[gaitfit.Event], totals: dict[str, int | None]) -> None:
        """Each kind of work begins, has steps up to its total, and ends; forgets the events."""
        events = [event for event in (events.copy(), events.clear())[0] if event.what]
        self.assertEqual([event.what for event in events if event.kind == "begin"], list(totals))
        for what, total in totals.items():
            own = [event for event in events if event.what == what]
            self.assertEqual((own[0].kind, own[-1].kind), ("begin", "end"))
            done = [event.done for event in own[1:-1]]
            self.assertEqual(done, sorted(set(done)))
            self.assertEqual({event.kind for event in own[1:-1]}, {"step"})
            self.assertEqual({event.total for event in own}, {done[-1] if total is None else total})
            self.assertEqual(done[-1], own[-1].total)

    def test_evaluations_and_collections_stop_at_a_step(self) -> None:
        long = {"trajectories": 10_000, "seconds": 60.0}
        for name, call in (
            ("evaluate", lambda stop: gaitfit.evaluate(POLICY, **long, progress=stop)),
            ("constant commands", lambda stop: gaitfit.evaluate(POLICY, trajectories=1, seconds=0.1, drift=4096, progress=stop)),
            ("collect", lambda stop: gaitfit.collect(POLICY, self.folder / "logs", trajectories=300, seconds=60.0, progress=stop)),
        ):
            steps: list[gaitfit.Event] = []

            def stop(event: gaitfit.Event) -> bool:
                steps.extend([event] if event.kind == "step" and event.total > 1 else [])
                return not steps

            with self.subTest(name), self.assertRaisesRegex(gaitfit.Stopped, "progress function returned False"):
                call(stop)
            # One step, long before the end.
            self.assertEqual(len(steps), 1)
            self.assertLess(steps[0].done, 0.2 * steps[0].total)

    def test_an_arrangement_with_which_a_policy_walks_is_named(self) -> None:
        right = Interface.read(POLICY)
        self.assertIsNone(gaitfit.evaluate(Policy(network, right), **SHORT).diagnosis)
        mixed = [right.joints[3 * leg + joint] for joint in range(3) for leg in range(4)]
        events: list[gaitfit.Event] = []
        policy = Policy(network, dataclasses.replace(right, joints=mixed))
        # Some of the arrangements that are tried let robots diverge: that is no fault of the policy.
        found = gaitfit.evaluate(policy, **{**SHORT, "progress": events.append})
        assert found.diagnosis is not None
        self.assertEqual(found.diagnosis.changes, ("the joints in the order of the robot's file",))
        self.assertIn(", ".join(f'"{joint}"' for joint in right.joints), found.diagnosis.settings[0])
        self.assertLess(found.diagnosis.measure[1], 0.4 * found.diagnosis.measure[0])
        self.assertIn("It walks with the joints in the order of the robot's file: set `joints = [", repr(found))
        begun = time.monotonic()
        self.assertIsNone(gaitfit.evaluate(policy, diagnose=False, **SHORT).diagnosis)
        self.assertLess(time.monotonic() - begun, 0.5 * found.wall_seconds)
        trials = [event for event in events if event.what == "order, signs and scales of joints: trial"]
        self.assertEqual((trials[0].kind, trials[-1].kind, trials[-1].done), ("begin", "end", trials[-1].total))

    def test_values_are_named_where_results_and_errors_say_what_walked(self) -> None:
        calves = TrueParameter("frictionloss", joints=["*_calf_joint"], value=0.3)
        found = gaitfit.evaluate(POLICY, theta=calves, **SHORT)
        self.assertEqual(found.simulator, "go2: frictionloss 0.3 at *_calf_joint")
        difference = gaitfit.compare(found, gaitfit.evaluate(POLICY, **SHORT))
        self.assertEqual(difference.on, "go2: frictionloss 0.3 at *_calf_joint / go2, nominal")
        assert difference.reward is not None
        self.assertGreater(difference.reward.ci95, 0.0)
        with self.assertRaisesRegex(gaitfit.GaitfitError, r"^theta \(frictionloss 0.3 at \*claf\*\): .*matches no joint"):
            gaitfit.evaluate(POLICY, theta=TrueParameter("frictionloss", joints=["*claf*"], value=0.3), **SHORT)

    def test_a_robots_file_tells_what_values_replace(self) -> None:
        go2, file = gaitfit.read_robot(), gaitfit.read_robot("assets/go2.xml")
        self.assertEqual((go2.name, len(go2.joints), round(file.mass, 3)), ("go2", 12, 15.206))
        calf = file.joints["FL_calf_joint"]
        self.assertEqual((calf.frictionloss, calf.torque_limit, calf.range), (0.0, 45.43, (-2.7227, -0.83776)))
        with self.assertRaisesRegex(FileNotFoundError, "there is no file no.xml"):
            gaitfit.read_robot("no.xml")
        with self.assertRaisesRegex(KeyError, "there is no 'knee'; there are FL_hip_joint"):
            go2.joints["knee"]

    def test_an_explanation_without_causes_says_what_it_looked_for(self) -> None:
        gaitfit.collect(POLICY, self.folder / "logs", trajectories=3, seconds=8.0, progress=False)
        found = gaitfit.explain(self.folder / "logs", progress=False)
        self.assertEqual(found.causes, ())
        self.assertIn("odd_joints", repr(found))
        try:
            self.assertIn("text", found.to_dataframe().columns)
        except ImportError as missing:
            self.skipTest(str(missing))


class Runs(Case):
    def test_a_stage_stops_at_the_step_at_which_it_is_asked_to(self) -> None:
        seen: list[tuple[str, int]] = []

        def stop(event: gaitfit.Event) -> bool:
            seen.extend([(event.kind, event.done)] if event.kind in ("begin", "step", "end") else [])
            return (event.kind, event.done) != ("step", 2)

        size = {"train.num_envs": 32, "train.iterations": 4}
        common = {"runs": self.folder, "name": "t", "settings": size}
        with self.assertRaises(gaitfit.Stopped):
            gaitfit.train(**common, progress=stop)
        self.assertEqual(seen, [("begin", 0), ("step", 1), ("step", 2)])
        seen.clear()
        trained = gaitfit.train(**common, resume=True, progress=stop)
        self.assertEqual(seen, [("begin", 2), ("step", 3), ("step", 4), ("end", 4)])
        rows = trained.history()
        self.assertEqual([row["iteration"] for row in rows], [1, 2, 3, 4])
        self.assertAlmostEqual(float(np.mean([row["reward"] for row in rows])), trained.seeds[0].reward)

    def test_a_configuration_names_the_policy(self) -> None:
        size = {"train.num_envs": 32, "train.iterations": 1}
        tuned = gaitfit.finetune(config=Finetune(policy=POLICY), runs=self.folder, settings=size, progress=False)
        self.assertEqual(tuned.seeds[0].iterations, 1)
        with self.assertRaisesRegex(TypeError, "the policy is missing"):
            gaitfit.finetune(config=Finetune(), progress=False)

    def test_fits_have_histories_and_charts_in_axes(self) -> None:
        short = {"optimizer.generations": 3, "optimizer.seeds": 1}
        found = gaitfit.fit(DEMO / "adapt.toml", runs=self.folder, settings=short, progress=False)
        self.assertEqual([row["generation"] for row in found.history()], [1, 2, 3])
        try:
            import matplotlib.pyplot as plt
        except ImportError as missing:
            self.skipTest(str(missing))
        figure, axes = plt.subplots(2)
        self.assertIs(gaitfit.plots.parameters(found, axes=axes[0]), figure)
        self.assertIs(gaitfit.plots.convergence(found, axes=axes[1]), figure)
        self.assertEqual([bool(one.lines) for one in axes], [True, True])
        with self.assertRaisesRegex(TypeError, "give axes of matplotlib"):
            gaitfit.plots.parameters(found, axes=3)  # type: ignore[arg-type]
        plt.close("all")


class Steps(Case):
    def test_robots_are_those_of_a_fit(self) -> None:
        stiff = [TrueParameter("frictionloss", value=3.0), TrueParameter("delay", value=0.03)]
        fitted, nominal = (gaitfit.Robots(policy=POLICY, num_envs=3, seed=1, theta=theta) for theta in (stiff, None))
        np.testing.assert_array_equal(fitted.observation, nominal.observation)
        for robots in (fitted, nominal):
            for _ in range(10):
                robots.step(np.ones((3, 12)))
        travelled = [np.abs(robots.motion().joint_velocity).mean() for robots in (fitted, nominal)]
        self.assertLess(travelled[0], 0.7 * travelled[1])
        # A value that the file has anyway changes nothing.
        same = gaitfit.Robots(policy=POLICY, num_envs=3, seed=1, theta=TrueParameter("frictionloss", value=0.0))
        for _ in range(10):
            same.step(np.ones((3, 12)))
        np.testing.assert_array_equal(same.observation, nominal.observation)

    def test_a_misspelt_attribute_is_not_set(self) -> None:
        robots = gaitfit.Robots(num_envs=2)
        with self.assertRaisesRegex(AttributeError, "Robots have no 'comands' to set; did you mean 'commands'"):
            robots.comands = [0.5, 0.0, 0.0]  # type: ignore[attr-defined]

    def test_what_is_misspelt_or_given_twice_is_named(self) -> None:
        log = gaitfit.read_log(DEMO / "fit.csv")
        for call, words in (
            (lambda: Parameter("friction"), "; did you mean 'frictionloss'"),  # type: ignore[arg-type]
            (lambda: gaitfit.fit(logs=log, settings={"costs": "wasss"}), "costs has 'wasss'; did you mean 'wass'"),
            (lambda: gaitfit.fit(logs=[log] * 2, runs=self.folder), "logs has the same log twice"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                call()

    def test_hints_can_be_read(self) -> None:
        for name in gaitfit.__all__:
            one = getattr(gaitfit, name)
            if inspect.isfunction(one) or (inspect.isclass(one) and one.__module__.startswith("gaitfit")):
                with self.subTest(name):
                    get_type_hints(one)
        self.assertIn("config", get_type_hints(gaitfit.fit))
        self.assertIn("theta", get_type_hints(gaitfit.Robots.__init__))

    def test_robots_at_a_policys_own_task_follow_given_commands(self) -> None:
        policy = gaitfit.load_policy(POLICY)
        robots = gaitfit.Robots(policy=policy, num_envs=3, seed=1)
        self.assertEqual(robots.interface.observation_width, policy.interface.observation_width)
        at = [term if isinstance(term, str) else term.quantity for term in robots.interface.observation].index("command")
        width = {"base_angular_velocity": 3, "projected_gravity": 3, "command": 3, "joint_position": 12}
        first = sum(width[term if isinstance(term, str) else term.quantity] for term in list(robots.interface.observation)[:at])
        robots.commands = [0.5, 0.0, 0.25]
        np.testing.assert_allclose(robots.commands, [[0.5, 0.0, 0.25]] * 3)
        np.testing.assert_allclose(robots.observation[:, first : first + 3], [[0.5, 0.0, 0.25]] * 3)
        robots.commands = np.arange(9).reshape(3, 3)
        np.testing.assert_allclose(robots.commands[2], [6.0, 7.0, 8.0])
        with self.assertRaisesRegex(ValueError, "read-only"):
            robots.commands[:] = 0.0
        for wrong in ([0.5, 0.0], np.zeros((2, 3)), [0.0, np.nan, 0.0]):
            with self.assertRaisesRegex(ValueError, r"needed: \(3,\) or \(3, 3\), all finite"):
                robots.commands = wrong
        with self.assertRaisesRegex(ValueError, "config and policy are given"):
            gaitfit.Robots("train.toml", policy=POLICY)
        self.assertIn(gaitfit.Robots(num_envs=2, device="auto").device, ("cpu", "cuda:0"))

    def test_parts_that_need_other_packages_say_so(self) -> None:
        with mock.patch.dict(sys.modules, {"gymnasium": None}):
            sys.modules.pop("gaitfit.gym", None)
            with self.assertRaisesRegex(ImportError, r"gaitfit.gym needs a package .*pip install \"gaitfit\[gym\]\""):
                import gaitfit.gym  # noqa: F401

    def test_a_state_has_whose_episode_ended(self) -> None:
        try:
            from gaitfit.gym import AutoresetMode, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        one, other = (GaitfitVecEnv(num_envs=32, autoreset_mode=AutoresetMode.NEXT_STEP) for _ in range(2))
        for number in range(100):
            _, _, terminated, truncated, _ = one.step(np.full((32, 12), 4.0 * np.sin(number), np.float32))
            if (terminated | truncated).any():
                break
        other.set_state(one.state())
        three = GaitfitVecEnv(num_envs=3)
        before = three.state()
        with self.assertRaises(ValueError):
            three.set_state((one.state()[0], np.ones(3), np.ones(3), np.ones(3, bool)))
        for kept, now in zip(before[1:], three.state()[1:], strict=True):
            np.testing.assert_array_equal(kept, now)
        for mine, theirs in zip(one.step(np.zeros((32, 12)))[:4], other.step(np.zeros((32, 12)))[:4]):
            np.testing.assert_array_equal(mine, theirs)
        self.assertTrue((other.robots.state().steps[terminated | truncated] == 0).all())

    def test_tables_keep_their_own_names(self) -> None:
        log = gaitfit.Log.from_dataframe(
            {"t": [0.0, 0.1], "knee": [0.0, 1.0], "dq_knee": [1.0, 1.0]}, names={"t": "time", "knee": "q_knee"}
        )
        self.assertEqual((log.joints, log.dt), (["knee"], 0.1))
        with self.assertRaisesRegex(ValueError, "names has 'x', which is no column"):
            gaitfit.Log.from_dataframe({"q_knee": [0.0]}, names={"x": "time"})

    def test_a_missing_column_is_named_beside_another_one(self) -> None:
        table = {"time": [0.0, 0.1], "q_a": [0.0, 1.0], "q_b": [0.0, 1.0], "dq_b": [1.0, 1.0]}
        with self.assertRaisesRegex(ValueError, "no column dq_a; a log needs it beside dq_b"):
            gaitfit.Log.from_dataframe(table)
        table = {"time": [0.0, 0.1], "q_a": [0.0, 1.0]}
        with self.assertRaisesRegex(ValueError, "no column dq_a; a log needs it beside q_a"):
            gaitfit.Log.from_dataframe(table)


if __name__ == "__main__":
    unittest.main()
