"""Processes of a cluster that do tasks, each one after another, and that stay from batch to batch."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

from ._cluster import Cluster, Lost, often_lost

#: Tasks that a worker has at the same time, where enough are left: it need not wait for the next one.
AHEAD = 2


class Workers:
    """Workers of a cluster, as many as have a place.

    A process that stays does not ask the cluster for its place at every batch, which takes some tenths of a second.
    """

    def __init__(self, cluster: Cluster, work: str, arguments: Sequence[Any]) -> None:
        self._cluster, self._work, self._arguments = cluster, work, arguments
        #: Workers that are there, and the tasks that each has, the first one first.
        self._open: dict[Any, list[int]] = {}
        #: Workers that begin, by what says that they have.
        self._beginning: dict[Any, Any] = {}

    def answers(self, tasks: Sequence[bytes]) -> Iterator[tuple[int, Any] | None]:
        """Has all tasks done; answers with their numbers as they come, and ``None`` where nothing came for a moment.

        A task whose worker is lost goes to another, up to ``retries`` times. Who closes the iterator gives up the tasks that
        are left.
        """
        left, lost = deque(range(len(tasks))), [0] * len(tasks)
        asked: dict[Any, tuple[int, Any]] = {}
        try:
            while left or asked:
                self._grow(len(tasks))
                self._ask(tasks, left, asked)
                ready = self._cluster.ready([*asked, *self._beginning])
                if not ready:
                    yield None
                for reference in ready:
                    if reference in self._beginning:
                        self._begun(reference)
                        continue
                    if reference not in asked:
                        # Of a worker that was lost meanwhile.
                        continue
                    number, worker = asked.pop(reference)
                    try:
                        answer = self._cluster.get(reference)
                    except Lost as error:
                        again = self._drop(worker, asked, number)
                        for one in again:
                            lost[one] += 1
                        left.extendleft(reversed(again))
                        if lost[number] > self._cluster.place.retries:
                            what = f"a part of the fit's simulations (one of {len(tasks)} that are shared at a time)"
                            kept = "The run folder keeps what the fit did before; the same call with resume=True continues it."
                            raise Lost(
                                often_lost(what, lost[number], self._cluster.place.retries, str(error), kept)
                            ) from None
                        continue
                    self._open[worker].remove(number)
                    yield number, answer
        finally:
            if asked:
                self.end()

    def end(self) -> None:
        """Ends all workers; others begin when they are needed."""
        for worker in [*self._open, *self._beginning.values()]:
            self._cluster.end(worker)
        self._open.clear()
        self._beginning.clear()

    def _grow(self, most: int) -> None:
        """Begins workers for all places that have none."""
        wanted = min(most, self._cluster.places())
        for _ in range(wanted - len(self._open) - len(self._beginning)):
            worker = self._cluster.actor({}, *self._arguments)
            self._beginning[worker.begin.remote()] = worker

    def _begun(self, reference: Any) -> None:
        worker = self._beginning.pop(reference)
        try:
            self._cluster.get(reference)
        except Lost:
            return
        self._open[worker] = []

    def _ask(self, tasks: Sequence[bytes], left: deque[int], asked: dict[Any, tuple[int, Any]]) -> None:
        """Gives tasks to workers that have none, and then a second one to each while there are enough for all."""
        for ahead in range(AHEAD):
            for worker, own in self._open.items():
                enough = len(left) > (len(self._open) if ahead else 0)
                if len(own) <= ahead and enough:
                    number = left.popleft()
                    own.append(number)
                    asked[worker.work.remote(self._work, tasks[number])] = (number, worker)

    def _drop(self, worker: Any, asked: dict[Any, tuple[int, Any]], first: int) -> list[int]:
        """Takes back the tasks of a worker that is lost."""
        self._open.pop(worker, None)
        self._cluster.end(worker)
        others = [reference for reference, (_, whose) in asked.items() if whose is worker]
        return [first, *(asked.pop(reference)[0] for reference in others)]
