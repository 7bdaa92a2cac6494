"""The paper's tables, whose cells workers make."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from .. import _gaitfit
from .._arguments import count, flag, mapping, maybe, path, text
from .._arguments import threads as checked
from .._progress import Progresses, listener
from ..results import Table
from ..results import _read
from .._given import PathLike, Settings, sets
from ._cluster import Cluster, Place
from ._limit import Limit
from ._orders import Order, Orders, silent, sources


def reproduce(
    table: str,
    *,
    full: bool = False,
    seeds: int = 1,
    only: str | None = None,
    settings: Settings | None = None,
    experiments: PathLike = "experiments",
    runs: PathLike | None = None,
    max_seconds: float | None = None,
    threads: int | None = None,
    progress: Progresses = True,
    address: str | None = None,
    num_cpus: float = 1,
    num_gpus: float = 0,
    retries: int = 10,
    every: float = 20.0,
) -> Table:
    """Runs a table of the paper or continues it, as ``gaitfit reproduce``, its cells and seeds on a Ray cluster.

    Arguments:
        table: One of those that ``gaitfit reproduce list`` prints.
        full: Whether to run it at the paper's scale.
        seeds: Seeds of each cell.
        only: Part of the names of the cells to run.
        settings: Changes of the experiments' settings, by name.
        experiments: Folder of the experiment files.
        runs: Folder of the run folders.
        max_seconds: Wall time of the call, s; after it the call stops with :class:`Stopped`. Repeat the same call to continue.
        threads, progress: As for :func:`gaitfit.fit`.
        address, num_cpus, num_gpus, retries: As for :func:`gaitfit.ray.fit`, for each cell.
        every: Time between parts that a worker sends, s.

    What cells of a scenario share is made first. What workers send is kept in the table's folder: another node continues a lost
    worker's cell from there, and the same call continues after this process was killed. Paths in experiment files are seen from the current folder, or
    from the file's; absolute ones must lead to the same file on every node.

    Returns the table. Raises ``ValueError`` and :class:`GaitfitError` for a table or cells that there are not, and
    ``FileNotFoundError`` without the experiment files.

    >>> table = gaitfit.ray.reproduce("1")      # doctest: +SKIP
    """
    limit, place, listen = Limit(max_seconds), Place(num_cpus, num_gpus, retries), listener(progress) or silent
    given = {} if settings is None else mapping("settings", settings, '{"target.trajectories": 8}')
    if runs is not None or "runs" in given:
        # Workers have an image of this folder, in which only relative paths are the same.
        given["runs"] = os.path.relpath(path("runs", given["runs"] if runs is None else runs))
    request = {
        "table": text("table", table),
        "full": flag("full", full),
        "seeds": count("seeds", seeds, 1),
        "only": maybe(text, "only", only),
        "sets": sets(given),
        "experiments": os.path.relpath(path("experiments", experiments)),
        "threads": checked(threads),
        "device": "cpu",
    }
    cluster = Cluster(address, place)
    plan = json.loads(_gaitfit.reproduce_plan(request))
    folder = plan["run_folder"]
    theirs = {**request, "threads": cluster.place.threads, "device": cluster.place.device}
    parts = [part for part in plan["parts"] if not part["finished"]]
    orders = Orders(cluster, sources(plan["files"]), every, listen, limit, folder)
    shared = [part for part in parts if part["kind"] == "shared"]
    cells = [part for part in parts if part["kind"] == "cell"]

    def order(part: Mapping[str, Any]) -> Order:
        needs = [] if part["kind"] == "shared" else [f"shared/{part['scenario']}/seed-{part['seed']}/logs"]
        where = f"{folder}/{part['folder']}"
        return Order(
            f"{part['name']}, seed {part['seed']}",
            where,
            [f"{folder}/{name}" for name in needs],
            {"what": "cell", "request": theirs, "part": json.dumps(part)},
        )

    wanted = {(part["scenario"], part["seed"]) for part in cells}
    orders.make([order(part) for part in shared if (part["scenario"], part["seed"]) in wanted or not cells])
    orders.make([order(part) for part in cells])
    return _read.table_result(json.loads(_gaitfit.reproduce(request, listen)))
