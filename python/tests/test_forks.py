"""Forks and threads while a stage runs with a function of the user: no crash and no hang, in a process with a time limit."""

import os
import subprocess
import sys
import unittest

from .common import PACKAGE, ROOT, Case

#: What both programs below begin with.
BEGIN = """
import faulthandler, multiprocessing, os, sys, tempfile, threading
faulthandler.dump_traceback_later(100, exit=True)
import numpy as np
import gaitfit
from gaitfit import Policy

FILE = "assets/go2-walk.safetensors"

def walks(act=None, **more):
    # A policy that walks: of others `evaluate` also tries other arrangements, for seconds.
    arguments = {"trajectories": 4, "seconds": 0.5, "drift": 0, "progress": False, **more}
    return gaitfit.evaluate(Policy(act or gaitfit.load_policy(FILE), FILE), **arguments).linear_velocity_error.mean

def pendulum(candidates):
    time = np.arange(50)[None, :, None]
    angle = np.exp(-candidates[:, :1, None] * time / 50.0) * np.cos(time / 5.0)
    return [{"position": angle, "velocity": np.gradient(angle, axis=1)}]

def searched(simulate, **more):
    truth = pendulum(np.array([[0.7]]))[0]
    log = gaitfit.Log(truth["position"][0], truth["velocity"][0], joints=["swing"])
    arguments = {"cost": "matcho", "generations": 12, "progress": False, **more}
    return gaitfit.fit_simulator(simulate, log, [gaitfit.Parameter("damping", 0.0, 2.0)], **arguments).values["damping"]

def forked(work):
    # What a child gave, or how it ended.
    pid = os.fork()
    if pid == 0:
        return work()
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
"""


class Forks(Case):
    def run_program(self, program: str) -> "tuple[list[str], str]":
        environment = {**os.environ, "PYTHONPATH": str(PACKAGE)}
        command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", BEGIN + program]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr[-3000:])
        return done.stdout.splitlines(), done.stderr

    def test_forks_inside_a_function(self) -> None:
        """Children that end themselves, raise, come back, and compute; the stage of the parent goes on."""
        said, errors = self.run_program("""
def ends(code):
    def end():
        print("bye", code)
        sys.exit(code)
    return end

def raises():
    raise LookupError("in the child")

def new_process(results):
    process = multiprocessing.get_context("fork").Process(target=lambda: results.put(walks()))
    process.start()
    return process

walking = gaitfit.load_policy(FILE)
results = multiprocessing.get_context("fork").SimpleQueue()
codes, todo = [], [ends(0), ends(7), ends(None), ends("a text"), raises, lambda: None]

def act(observation):
    if todo:
        codes.append(forked(todo.pop(0)))
    elif len(codes) == 6:
        process = new_process(results)
        codes.append(results.get())
        process.join()
        codes.append(process.exitcode)
    return walking(observation)

expected = walks()
print(walks(act) == expected, codes[6] == expected, *codes[:6], codes[7], flush=True)

# The same in a function that hears of progress, and in a simulator, which the calling thread runs as any function.
heard = []
def progress(event):
    if not heard:
        heard.append(forked(ends(3)))
with tempfile.TemporaryDirectory() as runs:
    size = {"train.num_envs": 16, "train.iterations": 2}
    trained = gaitfit.train(runs=runs, name="small", settings=size, progress=progress)
print(len(trained.seeds), *heard, flush=True)
seen = []
def simulate(candidates):
    if not seen:
        seen.append(None)
        seen[0] = forked(lambda: os._exit(4 if searched(pendulum) > 0.5 else 5))
    return pendulum(candidates)
print(searched(simulate) == searched(pendulum), *seen)
""")
        byes = sorted(line for line in said if line.startswith("bye"))
        self.assertEqual(byes, ["bye 0", "bye 3", "bye 7", "bye None", "bye a text"])
        others = [line for line in said if not line.startswith("bye")]
        self.assertEqual(others, ["True True 0 7 0 1 1 1 0", "1 3", "True 4"])
        self.assertIn("LookupError: in the child", errors)
        self.assertIn("cannot go on with the stage that called the function", errors)

    def test_forks_beside_stages_in_threads(self) -> None:
        """The main thread forks while others evaluate, fit and step; children compute what the parent does."""
        said, _ = self.run_program("""
robots = gaitfit.Robots(num_envs=600, threads=2)
def steps():
    robots.step(np.zeros((600, 12)))
    return float(robots.reward.sum())

def once(which):
    return [walks(), searched(pendulum), gaitfit.costs.wasserstein(np.arange(9.0), np.ones(4))][which]

expected = [once(which) for which in range(3)]
stop, wrong = threading.Event(), []

def beside(which):
    while not stop.is_set():
        if which == 3:
            steps()
        elif once(which) != expected[which]:
            wrong.append(which)

threads = [threading.Thread(target=beside, args=(which,)) for which in range(4)]
for thread in threads:
    thread.start()

def child():
    fine = [once(which) for which in range(3)] == expected and np.isfinite(gaitfit.Robots(num_envs=8).step(np.zeros((8, 12))))
    os._exit(0 if fine else 1)

codes = [forked(child) for _ in range(12)]
with multiprocessing.get_context("fork").Pool(2) as pool:
    pooled = pool.map_async(once, (0, 1, 2, 0)).get(60)
stop.set()
for thread in threads:
    thread.join()
print(set(codes), wrong, pooled == [*expected, expected[0]])
""")
        self.assertEqual(said, ["{0} [] True"])


if __name__ == "__main__":
    unittest.main()
