"""Ctrl-C, threads, fork, pickles, and the time of the import."""

import math
import multiprocessing
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
import unittest
from collections.abc import Callable
from pathlib import Path

import numpy as np

import gaitfit

from .common import DEMO, PACKAGE, ROOT, Case

LONG = {"optimizer.generations": 100_000, "optimizer.tolerance": 1e-300, "optimizer.seeds": 1}


class Press:
    """Presses Ctrl-C on this process, once, as soon as ``begun``: a fixed time may be too early or too late on a busy machine. A
    thread watches, so that the stage itself calls no Python."""

    def __init__(self, begun: Callable[[], bool]) -> None:
        #: When it was pressed: by the clock, and by this process's processor time, s.
        self.clock, self.work = math.nan, math.nan
        threading.Thread(target=self._watch, args=(begun,), daemon=True).start()

    def _watch(self, begun: Callable[[], bool]) -> None:
        while not begun():
            time.sleep(0.01)
        self.clock, self.work = time.monotonic(), time.process_time()
        os.kill(os.getpid(), signal.SIGINT)


def written(folder: Path, pattern: str) -> Callable[[], bool]:
    """Whether a file of a run has a line."""
    return lambda: any(file.stat().st_size for file in folder.glob(pattern))


def worked(seconds: float) -> Callable[[], bool]:
    """Whether this process has worked so long from now on."""
    begin = time.process_time()
    return lambda: time.process_time() > begin + seconds


def work() -> float:
    search = gaitfit.CMA([1.0, 2.0], [1.0, 1.0], seed=1)
    while search.stop is None:
        search.tell(np.sum(search.ask() ** 2, axis=1))
    robots = gaitfit.Robots(num_envs=8, threads=2)
    robots.step(np.zeros((8, 12)))
    return search.best_cost + float(robots.reward.sum())


def processor_time(process: int) -> float:
    """Processor time of a process on Linux, s; of one that has ended 0."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Interrupts(Case):
    def stopped(self, press: Press, stage: Callable[[], object]) -> None:
        """The stage ends with ``KeyboardInterrupt`` before it has computed for another second on every core. On a busy machine
        that second lasts long, so the clock's bound is wide."""
        with self.assertRaises(KeyboardInterrupt):
            stage()
        clock, work = time.monotonic() - press.clock, time.process_time() - press.work
        print(f"Ctrl-C took {clock:.2f} s, {work:.2f} s of processor time")
        self.assertLess(work, float(os.cpu_count() or 1))
        self.assertLess(clock, 30.0)

    def test_a_fit_stops_within_a_second_and_goes_on(self) -> None:
        def fit(name: str, **more: object) -> gaitfit.FitResult:
            settings = {**LONG, "optimizer.generations": 40}
            return gaitfit.fit(DEMO / "adapt.toml", runs=self.folder, name=name, settings=settings, progress=False, **more)

        def generations() -> int:
            (file,) = self.folder.glob("a*/metrics.jsonl")
            return len(file.read_text().splitlines())

        self.stopped(Press(written(self.folder, "a*/metrics.jsonl")), lambda: fit("a"))
        done = generations()
        resumed, whole = fit("a", resume=True), fit("b")
        self.assertLess(done, generations() / 2, "the fit went on after Ctrl-C")
        self.assertEqual(resumed.to_dict()["parameters"], whole.to_dict()["parameters"])

    def test_a_training_stops_within_a_second(self) -> None:
        settings = {"train.num_envs": 64, "train.iterations": 1000}
        press = Press(written(self.folder, "t*/seed-*/metrics.jsonl"))
        self.stopped(press, lambda: gaitfit.train(runs=self.folder, name="t", settings=settings, progress=False))

    def test_evaluations_and_collections_stop_within_a_second(self) -> None:
        policy, out = "assets/go2-walk.safetensors", self.folder / "logs"
        # Each would take minutes.
        for name, stage in (
            ("trials", lambda: gaitfit.evaluate(policy, trajectories=20_000, seconds=100.0, progress=False)),
            ("drift", lambda: gaitfit.evaluate(policy, trajectories=1, seconds=0.1, drift=4096, progress=False)),
            ("crossings", lambda: gaitfit.evaluate(policy, trajectories=1, drift=0, terrain="rough", progress=False)),
            ("logs", lambda: gaitfit.collect(policy, out, trajectories=2000, seconds=100.0, progress=False)),
        ):
            with self.subTest(name):
                self.stopped(Press(worked(1.0)), stage)
        self.assertEqual(list(out.glob("*.csv")), [])

    def test_validations_stop_within_a_second(self) -> None:
        policy, logs = "assets/go2-walk.safetensors", self.folder / "logs"
        gaitfit.collect(policy, logs, trajectories=2, seconds=100.0, progress=False)
        theta, config = self.folder / "theta.toml", self.folder / "walks.toml"
        theta.write_text('format = 2\n[[parameter]]\nname = "delay"\nkind = "delay"\njoints = ["*"]\nvalue = 0.001\n')
        config.write_text(f'policy = "{ROOT / policy}"\nlogs = ["{logs}"]\n')
        # Long work, because of short physics steps.
        slow = {"simulation.timestep": 0.00002, "simulation.robot_timestep": 0.00002}
        self.stopped(Press(worked(1.5)), lambda: gaitfit.validate(theta, logs, config=config, settings=slow))

    def test_explanations_stop_within_a_second(self) -> None:
        logs = self.folder / "logs"
        gaitfit.collect("assets/go2-walk.safetensors", logs, trajectories=4, seconds=100.0, progress=False)
        self.stopped(Press(worked(0.5)), lambda: gaitfit.explain(logs, "assets/go2.xml"))

    def interrupted(self, words: list[str]) -> tuple[int, str, float]:
        """Exit code, errors, and seconds to the end of a command that is interrupted once it has worked for a second."""
        program = subprocess.Popen(
            [sys.executable, "-m", "gaitfit", *words],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(PACKAGE)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        before = processor_time(program.pid)
        while program.poll() is None and processor_time(program.pid) < before + 1.0:
            time.sleep(0.01)
        clock = time.monotonic()
        program.send_signal(signal.SIGINT)
        errors = program.communicate(timeout=60)[1]
        return program.returncode, errors, time.monotonic() - clock

    @unittest.skipUnless(Path("/proc/self/stat").exists(), "reads processor times as Linux has them")
    def test_commands_that_keep_nothing_end_at_once(self) -> None:
        slow = ["--set", "simulation.timestep=0.00002"]
        code, errors, seconds = self.interrupted(["sensitivity", "examples/go2-demo/adapt.toml", *slow])
        self.assertEqual((code, "Traceback" in errors), (-signal.SIGINT, False), errors)
        self.assertLess(seconds, 5.0)

    @unittest.skipUnless(Path("/proc/self/stat").exists(), "reads processor times as Linux has them")
    def test_the_program_stops_too_and_keeps_nothing(self) -> None:
        for words in (
            ["evaluate", "assets/go2-walk.safetensors", "--trajectories", "20000", "--seconds", "100"],
            ["collect", "assets/go2-walk.safetensors", "--out", str(self.folder / "out"), "--trajectories", "2000", "--seconds", "100"],
        ):
            with self.subTest(words[0]):
                code, errors, seconds = self.interrupted(words)
                print(f"Ctrl-C took {seconds:.2f} s")
                self.assertEqual(code, 130, errors)
                self.assertIn("interrupted", errors)
                self.assertLess(seconds, 30.0)
        self.assertEqual(list(self.folder.rglob("*.csv")), [])

    def test_a_run_that_was_stopped_tells_where_it_is(self) -> None:
        settings = {"train.num_envs": 32, "train.iterations": 20}
        common: dict[str, object] = {"runs": self.folder, "settings": settings}

        def second(event: gaitfit.Event) -> bool:
            return not (event.kind == "step" and event.done == 2)

        with self.assertRaises(gaitfit.Stopped) as caught:
            gaitfit.train(name="t", progress=second, **common)
        folder = caught.exception.run_folder
        self.assertEqual(folder, self.folder / "t")
        walked = gaitfit.evaluate(
            folder / "seed-1" / "policy.safetensors", trajectories=2, seconds=0.1, drift=0, progress=False
        )
        self.assertEqual(walked.trajectories, 2)
        self.assertIsNone(gaitfit.Stopped("a stage without a run folder").run_folder)
        press = Press(written(self.folder, "u/seed-*/metrics.jsonl"))
        with self.assertRaises(KeyboardInterrupt) as pressed:
            gaitfit.train(name="u", progress=False, runs=self.folder, settings={**settings, "train.iterations": 1000})
        self.assertEqual((pressed.exception.run_folder, math.isnan(press.clock)), (self.folder / "u", False))

    def test_a_simulator_of_ones_own_is_interrupted_itself(self) -> None:
        log = gaitfit.Log(np.eye(10)[:, :1], np.eye(10)[:, :1], joints=["a"])

        def simulate(_: object) -> None:
            (self.folder / "called").write_text("now")
            time.sleep(60)

        parameters = [gaitfit.Parameter("p", 0.0, 1.0)]
        press = Press(written(self.folder, "called"))
        self.stopped(press, lambda: gaitfit.fit_simulator(simulate, log, parameters, progress=False))


class Processes(Case):
    def test_forks_and_new_processes_work(self) -> None:
        expected = work()
        for method in ("fork", "spawn"):
            with self.subTest(method), multiprocessing.get_context(method).Pool(2) as pool:
                self.assertEqual(pool.starmap_async(work, [()] * 4).get(120), [expected] * 4)

    def test_threads_work_side_by_side(self) -> None:
        expected, found = work(), []
        threads = [threading.Thread(target=lambda: found.append(work())) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(found, [expected] * 4)

    def test_one_object_in_two_threads_is_an_exception_or_right(self) -> None:
        robots = gaitfit.Robots(num_envs=512, threads=1)
        errors: list[BaseException] = []

        def step() -> None:
            for _ in range(20):
                try:
                    robots.step(np.zeros((512, 12)))
                except BaseException as error:  # noqa: BLE001
                    errors.append(error)

        threads = [threading.Thread(target=step) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertTrue(all(isinstance(error, RuntimeError) for error in errors), errors[:3])
        self.assertTrue(np.isfinite(robots.reward).all())

    def test_policies_and_searches_name_the_second_thread(self) -> None:
        policy, search = gaitfit.load_policy("assets/go2-walk.safetensors"), gaitfit.CMA(np.zeros(200), np.ones(200))
        observation = np.zeros((4000, policy.interface.observation_width), np.float32)
        for what, call in (("policy", lambda: policy(observation)), ("search", search.ask)):
            errors: list[BaseException] = []

            def use(call: "Callable[[], object]" = call, errors: "list[BaseException]" = errors) -> None:
                for _ in range(50):
                    try:
                        call()
                    except BaseException as error:  # noqa: BLE001
                        errors.append(error)

            threads = [threading.Thread(target=use) for _ in range(3)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            self.assertTrue(errors, f"no two threads met in a {what}")
            self.assertTrue(all(isinstance(one, RuntimeError) for one in errors), errors[:3])
            self.assertRegex(str(errors[0]), f"two threads use the same {what} at once: give each thread one of its own")

    def test_robots_are_not_pickled_and_say_so(self) -> None:
        with self.assertRaisesRegex(TypeError, "robots cannot be pickled"):
            pickle.dumps(gaitfit.Robots(num_envs=2))
        error = gaitfit.GaitfitError("why")
        self.assertEqual(pickle.loads(pickle.dumps(error)).args, ("why",))


class Values(Case):
    """What would fill the memory, is no number, or has no place in a file, is an exception with a remedy."""

    def test_huge_numbers_are_refused(self) -> None:
        log = gaitfit.Log(np.eye(10)[:, :1], np.eye(10)[:, :1], joints=["a"])

        def searched(**more: object) -> object:
            return gaitfit.fit_simulator(lambda _: [], log, [gaitfit.Parameter("p", 0.0, 1.0)], progress=False, **more)

        for call, words in (
            (lambda: gaitfit.CMA([1.0], [1.0], population=2**40), "population is 1099511627776; it must be at most 10000"),
            (lambda: gaitfit.CMA(np.zeros(5000), np.ones(5000)), "5000 coordinates; a full covariance takes at most 4096; take .*separable"),
            (lambda: searched(population=2**40), "population is 1099511627776"),
            (lambda: searched(seeds=range(2000)), "seeds has 2000 elements; give 1 to 1000"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                call()

    def test_observations_that_are_no_numbers_are_named(self) -> None:
        policy = gaitfit.load_policy("assets/go2-walk.safetensors")
        observation = np.zeros((3, policy.interface.observation_width))
        for wrong in (np.nan, np.inf, 1e300):
            observation[1, 7] = wrong
            with self.assertRaisesRegex(ValueError, r"observation\[1, 7\] is (nan|inf); it must be finite"):
                policy(observation)
        self.assertEqual(policy(observation[:0]).shape, (0, 12))

    def test_paths_that_are_no_utf_8(self) -> None:
        name = os.fsdecode(b"caf\xe9")
        shutil.copy("assets/go2-walk.safetensors", self.folder / f"{name}.safetensors")
        policy = gaitfit.load_policy(self.folder / f"{name}.safetensors")
        self.assertEqual(policy(np.zeros(policy.interface.observation_width)).shape, (12,))
        # Settings are texts in UTF-8.
        for given in ({"logs": name}, {"runs": self.folder / name}, {"name": name}, {"settings": {"runs": name}}):
            with self.assertRaisesRegex(ValueError, "which is no UTF-8.*Rename the file or folder"):
                gaitfit.fit(DEMO / "adapt.toml", progress=False, **given)

    def test_settings_and_results_without_end(self) -> None:
        endless: list[object] = []
        endless.append(endless)
        with self.assertRaisesRegex(ValueError, "contains itself"):
            gaitfit.fit(DEMO / "adapt.toml", settings={"costs": endless}, progress=False)
        deep = self.folder / "deep.json"
        deep.write_text("[" * 100_000)
        with self.assertRaisesRegex(ValueError, "deep.json is no JSON.*give a run folder"):
            gaitfit.load(deep)

    def test_folders_that_cannot_be_written(self) -> None:
        (self.folder / "file").write_text("")
        short = {"optimizer.generations": 2, "optimizer.seeds": 1}
        for runs in (self.folder / "file", "/proc/runs"):
            with self.subTest(str(runs)), self.assertRaisesRegex((OSError, gaitfit.GaitfitError), "cannot write .*write elsewhere"):
                gaitfit.fit(DEMO / "adapt.toml", runs=runs, settings=short, progress=False)

    def test_the_run_folders_inside_a_folder_are_named(self) -> None:
        for name in ("one", "two"):
            (self.folder / name).mkdir()
            (self.folder / name / "result.json").write_text("{}")
        with self.assertRaisesRegex(FileNotFoundError, "has no result.json.*Run folders in it: one, two"):
            gaitfit.load(self.folder)


class Program(Case):
    def test_the_package_runs_the_program(self) -> None:
        def run(*arguments: str) -> "subprocess.CompletedProcess[str]":
            command = [sys.executable, "-m", "gaitfit", *arguments]
            return subprocess.run(command, cwd=PACKAGE, capture_output=True, text=True)

        self.assertEqual(run("--version").stdout, f"gaitfit {gaitfit.__version__}\n")
        for arguments, code, words in (((), 2, "Usage"), (["inspect", "nowhere.xml"], 1, "nowhere.xml")):
            done = run(*arguments)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn(words, done.stderr)

    def test_the_program_starts_without_numpy(self) -> None:
        code = "import sys, gaitfit.__main__; print('numpy' in sys.modules, len(gaitfit.__all__) <= len(dir(gaitfit)))"
        done = subprocess.run([sys.executable, "-c", code], cwd=PACKAGE, capture_output=True, text=True, check=True)
        self.assertEqual(done.stdout, "False True\n")
        with self.assertRaisesRegex(AttributeError, "no attribute 'nothing'"):
            gaitfit.nothing

    def test_ctrl_c_stops_the_program_with_a_checkpoint(self) -> None:
        sets = [f"runs={str(self.folder)!r}", "optimizer.generations=100000", "optimizer.tolerance=1e-300"]
        command = [sys.executable, "-m", "gaitfit", "adapt", str(DEMO / "adapt.toml"), "--name", "stopped"]
        command += [word for one in sets for word in ("--set", one)]
        environment = {**os.environ, "PYTHONPATH": str(PACKAGE)}
        program = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        metrics = self.folder / "stopped" / "metrics.jsonl"
        for _ in range(1200):
            if program.poll() is not None or metrics.exists() and metrics.stat().st_size:
                break
            time.sleep(0.05)
        program.send_signal(signal.SIGINT)
        errors = program.communicate(timeout=60)[1]
        self.assertEqual(program.returncode, 130, errors)
        self.assertTrue((self.folder / "stopped" / "checkpoint.json").exists(), errors)


class Import(Case):
    def test_the_import_is_fast(self) -> None:
        code = (
            # It measures processor time, so waiting for other work does not count.
            "from time import process_time as now; t = now(); import numpy; n = now(); import gaitfit; gaitfit.fit; "
            "print(n - t, now() - n)"
        )
        # Compiled modules are kept, as after an installation with pip.
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(self.folder)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        runs = [
            [float(word) for word in subprocess.run(
                [sys.executable, "-c", code], cwd=PACKAGE, env=environment, capture_output=True, text=True, check=True
            ).stdout.split()]
            for _ in range(5)
        ]
        numpy, own = map(min, zip(*runs))
        print(f"import: {own:.3f} s after NumPy's {numpy:.3f} s")
        # Other work on the machine makes both imports slower, also in processor time, but not by the same factor. One build took 0.8
        # to 1.05 times NumPy's time in several runs.
        self.assertLess(own, 1.25 * numpy)


if __name__ == "__main__":
    unittest.main()
