"""What a campaign consists of, what of it is kept, and what is missing.

A cell is one result: a method on a walk, under what was known of the iron. Its key says which, its settings what it is
to be made with. Who makes what is missing is left to the caller: processes here (`on_processes`), or a cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.kept import Key, Result
from fg_nav.lab.campaign.made import Job, jobs_of, made
from fg_nav.lab.campaign.pool import as_done
from fg_nav.lab.campaign.sources import LOOP, NONE, RAW, WALK

Settings: TypeAlias = Mapping[Key, Mapping[str, Any]]
"""What each result is made with, in the order of the results."""

Run: TypeAlias = Callable[[Sequence[Job]], None]
"""Makes and keeps what is missing."""


def simulated_keys(
    scenarios: Sequence[str],
    fields: Sequence[str],
    magnetometers: Sequence[str],
    methods: Sequence[str],
    seeds: Sequence[int],
) -> list[Key]:
    """All of simulated walks, method by method within a case."""
    return [
        Key(name, level, str(seed), magnetometer, method)
        for name in scenarios
        for level in fields
        for magnetometer in magnetometers
        for method in methods
        for seed in seeds
    ]


def recorded_keys(
    recorded: Mapping[str, Sequence[str]],
    field: str,
    magnetometers: Sequence[str],
    methods: Sequence[str],
    calibrated: Collection[str] = (),
) -> list[Key]:
    """All of recorded walks, by group.

    What a loop or a simulation would tell, they must tell themselves, or the file that those groups have that are
    `calibrated`.
    """
    return [
        Key(group, field, walk, magnetometer, method)
        for group, walks in recorded.items()
        for magnetometer in _known_of(magnetometers, LOOP if group in calibrated else WALK)
        for method in methods
        for walk in walks
    ]


def _known_of(magnetometers: Sequence[str], best: str) -> list[str]:
    """What can be known of recorded walks, each once."""
    return list(dict.fromkeys(one if one in (WALK, RAW, NONE) else best for one in magnetometers))


def found(folder: Path, settings: Settings) -> dict[Key, Result]:
    """Results that are there and hold."""
    read_in = {key: kept.kept(folder, key, made_with) for key, made_with in settings.items()}
    return {key: result for key, result in read_in.items() if result is not None}


def made_and_kept(
    folder: Path,
    settings: Settings,
    run: Run,
    recorded: Mapping[tuple[str, str], Path] = MappingProxyType({}),
    renew: bool = False,
) -> list[Result]:
    """Return all results, made now where they are missing, or with `renew` where other code made them."""
    holds = found(folder, settings)
    if renew:
        holds = {key: result for key, result in holds.items() if result.code == kept.code_sum()}
    jobs = jobs_of([key for key in settings if key not in holds], settings, recorded)
    if jobs:
        run(jobs)
        holds = found(folder, settings)
    return [holds[key] for key in settings]


def on_processes(jobs: Sequence[Job], folder: Path, processes: int, report: Callable[[float], None]) -> None:
    """Make and keep results, a walk at a time in each process; `report` is told the fraction done."""
    tasks = [partial(made, job, folder, kept.code_sum()) for job in jobs]
    for done, _ in enumerate(as_done(tasks, processes), start=1):
        report(done / len(jobs))
