"""Parts that workers make, each in a folder that comes back."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import _gaitfit
from .._progress import Kind, Listener
from ._cluster import Cluster, often_lost
from ._limit import CONTINUE, KEPT, Limit
from ._parts import read, write

#: What a part is in a message, by the kind of its work (``how["what"]``).
KINDS = {"fit": "the fit", "training": "the training", "finetuning": "the training", "cell": "the cell"}
#: Parts for each place of the cluster that are begun at a time.
AHEAD = 2


class Order:
    """A part: its name, its folder, folders that it needs, how it is made, and the files that only it needs."""

    def __init__(
        self, name: str, folder: str, needs: Sequence[str], how: Mapping[str, Any], files: Sequence[str] = ()
    ) -> None:
        if os.path.isabs(folder):
            raise ValueError(f"{folder} is an absolute path, which workers do not share: give `runs` as seen from here")
        self.name, self.folder, self.needs, self.how, self.files = name, folder, needs, how, files

    def title(self) -> str:
        """What it is and its name, for messages."""
        return f"{KINDS[self.how['what']]} {self.name}"


class Orders:
    """Makes parts on workers, and keeps what they write."""

    def __init__(
        self,
        cluster: Cluster,
        sources: Mapping[str, bytes],
        every: float,
        listen: Listener,
        limit: Limit,
        folder: str | os.PathLike[str],
    ) -> None:
        self._cluster, self._every, self._listen = cluster, every, listen
        self._limit, self._folder = limit, Path(folder)
        self._sources = cluster.put(sources)
        self._needs: dict[str, Any] = {}
        # A part that is lost is begun here again, from what came of it.
        self._begin = cluster.remote("made", streams=True, max_retries=0)

    def _tell(self, kind: Kind, text: str = "", done: int = 0, total: int = 0) -> None:
        if not self._listen(kind, text, done, total, {}, None) and kind != "end":
            raise _gaitfit.Stopped(f"stopped, because the progress function returned False. {KEPT}")

    def make(self, orders: Sequence[Order]) -> None:
        """Makes all orders. The first failure ends the work; what the workers sent is kept. :class:`gaitfit.Stopped` has the run folder."""
        try:
            self._make(orders)
        except _gaitfit.Stopped as stopped:
            stopped.run_folder = self._folder
            raise

    def _make(self, orders: Sequence[Order]) -> None:
        lost = {order.name: 0 for order in orders}
        done = 0
        if not orders:
            return
        self._tell("begin", "part", 0, len(orders))
        waiting, open_ = deque(orders), dict[Any, Order]()
        try:
            while open_ or waiting:
                self._limit.check()
                # Files of a part are in the object store while it waits for its place: few wait at a time.
                while waiting and len(open_) < AHEAD * max(1, self._cluster.places()):
                    order = waiting.popleft()
                    open_[self._start(order)] = order
                for stream in self._cluster.ready(list(open_)):
                    order = open_[stream]
                    try:
                        files = self._cluster.next(stream)
                    except self._cluster.lost as error:
                        open_.pop(stream)
                        lost[order.name] += 1
                        if lost[order.name] > self._cluster.place.retries:
                            raise _gaitfit.GaitfitError(self._often(order, lost[order.name], error)) from None
                        why = self._cluster.why(error)
                        self._tell("note", f"{order.title()}: its worker was lost, because {why}; another continues it")
                        open_[self._start(order)] = order
                        continue
                    if files is None:
                        open_.pop(stream)
                        done += 1
                        self._tell("step", order.name, done)
                    else:
                        write(Path(order.folder), files)
        finally:
            for stream in open_:
                self._cluster.give_up(stream)
            self._tell("end")

    def _often(self, order: Order, times: int, error: Exception) -> str:
        """The message that a part lost too many workers."""
        why, retries = self._cluster.why(error), self._cluster.place.retries
        kept = f"What they had sent is in {order.folder}, and parts that are complete are kept too. {CONTINUE}."
        return often_lost(order.title(), times, retries, why, kept)

    def _start(self, order: Order) -> Any:
        for needed in order.needs:
            if needed not in self._needs:
                self._needs[needed] = self._cluster.put(read(Path(needed)))
        own = self._cluster.put(read(Path(order.folder)))
        needs = {needed: self._needs[needed] for needed in order.needs}
        needed = self._cluster.put(sources(order.files)) if order.files else self._sources
        return self._begin(
            os.getcwd(), needed, {**needs, order.folder: own}, order.folder, order.how, self._every
        )


def silent(
    _kind: str, _text: str, _done: int, _total: int, _metrics: Mapping[str, float], _seed: int | None
) -> bool:
    """A listener that says nothing."""
    return True


def sources(files: Sequence[str]) -> dict[str, bytes]:
    """The files whose paths are relative; others must be there on every node."""
    return {name: Path(name).read_bytes() for name in files if not os.path.isabs(name)}
