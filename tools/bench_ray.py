#!/usr/bin/env python3
"""Measures what a fit pays for Ray, and what more nodes give: local clusters of nodes with one core each.

    python tools/bench_ray.py --nodes 1,2 --out ray.json

It needs the package gaitfit and Ray in the interpreter's environment, and as many cores as nodes. Logs are made with the
policy ``--policy``. A fit of `wass` has generations of about ``--seconds`` on one core. In each of ``--repeats`` rounds it runs
in this process on one thread, and then on clusters of so many nodes, so that what else the machine does hits all alike. What
counts is the median time of a generation, the first two aside: workers open the fit in them. Times are of `metrics.jsonl`.

A machine with fewer cores than nodes, or busy ones, says little by that. So tasks that only sleep are handed out besides, a
generation of ``--seconds`` in all: what they take beyond that is what sharing itself costs.

Printed as JSON: seconds a generation, the overhead of one node over this process, the throughput of more nodes over one's,
bytes of logs, of what is sent to each node once, and of tasks and answers of a generation.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import gaitfit
import gaitfit.ray
from gaitfit.ray._fit import Crew

SKIPPED = 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--policy", default="assets/go2-robust.safetensors")
    parser.add_argument("--trajectories", type=int, default=64, help="logs")
    parser.add_argument("--log-seconds", type=float, default=4.0, help="length of a log, s")
    parser.add_argument("--seconds", type=float, default=1.0, help="a generation on one core, s")
    parser.add_argument("--generations", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--nodes", default="1,2", help="numbers of nodes, the first one 1")
    parser.add_argument("--population", type=int, default=0, help="0 chooses it by --seconds")
    parser.add_argument("--out", help="file for the JSON besides")
    options = parser.parse_args()
    nodes = [int(number) for number in options.nodes.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        found = Bench(options, Path(folder)).run(nodes)
    text = json.dumps(found, indent=1)
    print(text)
    if options.out:
        Path(options.out).write_text(text + "\n", encoding="utf-8")


class Bench:
    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.options, self.folder, self.count = options, folder, 0
        self.logs = folder / "logs"
        gaitfit.collect(
            options.policy,
            self.logs,
            trajectories=options.trajectories,
            seconds=options.log_seconds,
            progress=False,
        )
        self.population = options.population or self.chosen()

    def chosen(self) -> int:
        """Candidates of a generation that takes as long as was asked for on one core."""
        few = 8
        took = statistics.median(self.times(gaitfit.fit, few, 5, threads=1))
        return max(2, round(few * self.options.seconds / took))

    def times(self, fit: Callable[..., gaitfit.FitResult], population: int, generations: int, **more: object) -> list[float]:
        """Seconds of each generation."""
        self.count += 1
        name = f"fit-{self.count}"
        settings = {
            "costs": ["wass"],
            "optimizer.seeds": 1,
            "optimizer.population": population,
            "optimizer.generations": generations,
            "optimizer.tolerance": 1e-300,
        }
        fit(
            logs=self.logs,
            policy=self.options.policy,
            runs=self.folder,
            name=name,
            settings=settings,
            progress=False,
            **more,
        )
        lines = (self.folder / name / "metrics.jsonl").read_text(encoding="utf-8").splitlines()
        at = [json.loads(line)["wall_seconds"] for line in lines]
        return [later - earlier for earlier, later in zip(at, at[1:])][SKIPPED - 1 :]

    def run(self, nodes: list[int]) -> dict[str, object]:
        alone: list[float] = []
        shared: dict[int, list[float]] = {count: [] for count in nodes}
        asleep: dict[int, list[float]] = {count: [] for count in nodes}
        sent = Sent()
        for number in range(self.options.repeats):
            generations = self.options.generations
            alone.append(statistics.median(self.times(gaitfit.fit, self.population, generations, threads=1)))
            for count in nodes:
                with cluster(count):
                    asleep[count].append(sleeping(self.options.seconds, count))
                with sent.counted(), cluster(count):
                    times = self.times(gaitfit.ray.fit, self.population, generations)
                shared[count].append(statistics.median(times))
            print(f"round {number + 1}: alone {alone[-1]:.3f} s, nodes {shared}", file=sys.stderr, flush=True)
        one = shared[nodes[0]]
        overhead = [there / here - 1 for there, here in zip(one, alone)]
        speed = {count: [first / own for first, own in zip(one, shared[count])] for count in nodes}
        generations = self.options.generations * self.options.repeats * len(nodes)
        return {
            "machine": f"{platform.machine()}, {os.cpu_count()} cores",
            "population": self.population,
            "generation_seconds": {"alone": alone, **{f"{count} nodes": times for count, times in shared.items()}},
            "overhead": {"median": statistics.median(overhead), "rounds": overhead},
            "throughput_over_one_node": {
                f"{count} nodes": {"median": statistics.median(one), "rounds": one} for count, one in speed.items()
            },
            "beyond_sleep": {f"{count} nodes": statistics.median(more) for count, more in asleep.items()},
            "bytes": {
                "logs": sum(file.stat().st_size for file in self.logs.glob("*.csv")),
                "sent_once": sent.parcel,
                "task": sent.tasks / max(1, sent.count),
                "answer": sent.answers / max(1, sent.count),
                "tasks_a_generation": sent.count / generations,
            },
        }


def sleeping(seconds: float, nodes: int) -> float:
    """Share that a generation takes beyond the time its tasks sleep, three for each node, the median of ten."""
    from unittest import mock

    from gaitfit.ray import _cluster
    from gaitfit.ray._workers import Workers

    def entry(_streams: bool) -> Callable[..., None]:
        def sleep(_version: str, _name: str, task: bytes) -> None:
            import time

            time.sleep(float(task))

        return sleep

    count = 3 * nodes
    tasks = [str(seconds / count).encode()] * count
    took = []
    with mock.patch.object(_cluster, "_entry", entry):
        workers = Workers(_cluster.Cluster(None, _cluster.Place(num_cpus=1, num_gpus=0, retries=0)), "sleep", ())
        for _ in range(10 + SKIPPED):
            begun = time.perf_counter()
            list(workers.answers(tasks))
            took.append(time.perf_counter() - begun)
        workers.end()
    return statistics.median(took[SKIPPED:]) / (seconds / nodes) - 1


class Sent:
    """Counts what goes to workers and comes back."""

    def __init__(self) -> None:
        self.parcel = self.tasks = self.answers = self.count = 0

    def counted(self) -> object:
        from unittest import mock

        open_, work = Crew.open, Crew.work

        def opened(crew: Crew, parcel: bytes, mark: str) -> None:
            self.parcel = len(parcel)
            open_(crew, parcel, mark)

        def worked(crew: Crew, tasks: list[bytes]) -> object:
            self.count += len(tasks)
            self.tasks += sum(map(len, tasks))
            for answer in work(crew, tasks):
                self.answers += 0 if answer is None else len(answer[1])
                yield answer

        return mock.patch.multiple(Crew, open=opened, work=worked)


class cluster:  # noqa: N801
    """A cluster of nodes with one core, and the driver's without a place for tasks."""

    def __init__(self, count: int) -> None:
        self.count = count

    def __enter__(self) -> None:
        # Ray's workers are nice to other programs; this process is not, and is what they are compared with.
        os.environ.setdefault("RAY_worker_niceness", "0")
        import ray
        from ray.cluster_utils import Cluster

        head = {"num_cpus": 0, "include_dashboard": False, "object_store_memory": 2 * 10**8}
        self.cluster = Cluster(initialize_head=True, head_node_args=head)
        for _ in range(self.count):
            self.cluster.add_node(num_cpus=1, object_store_memory=2 * 10**8)
        ray.init(address=self.cluster.address, logging_level="error", log_to_driver=False)
        self.cluster.wait_for_nodes()

    def __exit__(self, *_: object) -> None:
        import ray

        ray.shutdown()
        self.cluster.shutdown()


if __name__ == "__main__":
    main()
