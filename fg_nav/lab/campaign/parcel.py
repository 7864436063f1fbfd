"""What goes to a worker and what comes back: a job with all it needs, and its results.

A worker of another machine sees no disk of ours: the files of a recorded walk go with the job, and the results come
back in memory. Whoever sent the job keeps them.

A worker holds the walk that it was at last, as it was made ready, under the name that the sender gave it: the next job
on that walk needs no files, and neither simulates nor reads. A worker that does not hold it, being a new one or having
worked for somebody else, brings nothing, and is sent the job again with its files.

Nothing that goes wrong in a cell may end the campaign: what is not an error of ours is a bug, and that cell's result.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.kept import Key, Result
from fg_nav.lab.campaign.made import Job, Ready, results_of

KILLED = "it ended its worker, again and again: out of memory, or a crash"
"""Why there is nothing of a cell that killed too many workers."""


@dataclass(frozen=True)
class Parcel:
    """A job and the files of its walk, name and content; without files those of the job's paths are read.

    `walk` is the name under which the worker may hold the walk, the same for nothing else; it holds none without. Where
    the worker `has_walk`, as the sender believes, the files are left out.
    """

    job: Job
    files: tuple[tuple[str, bytes], ...] = ()
    walk: tuple[str, ...] = ()
    has_walk: bool = False


@dataclass(frozen=True)
class Brought:
    """What came of it: results, none where the worker did not hold the walk, and what made them.

    `code` is the sum over the code that made them (`kept.code_sum`), `seconds` the time it took; None where it is not
    known.
    """

    results: tuple[Result, ...]
    code: str
    seconds: float | None


@dataclass
class _Held:
    """A walk that this worker was at last, and the folder, gone again, that its files were in."""

    walk: tuple[str, ...]
    ready: Ready
    folder: str = ""


_HELD: list[_Held] = []
"""One or none: two campaigns may be at one worker, in threads of their own, so who works takes it out."""


def parcel(job: Job, with_files: bool, walk: tuple[str, ...] = (), has_walk: bool = False) -> Parcel:
    """Pack a job; a file that cannot be read is left out, and the worker will miss it."""
    if job.path is None or not with_files:
        return Parcel(job, (), walk)
    if has_walk:
        return Parcel(job, (), walk, True)
    contents = []
    for path in {job.path, *job.beside, job.truth or job.path}:
        try:
            contents.append((path.name, path.read_bytes()))
        except OSError:
            continue
    return Parcel(job, tuple(contents), walk)


def unpacked(sent: Parcel) -> Brought:
    """Make the results of a parcel, on the worker."""
    began, code = perf_counter(), kept.code_sum()
    held = _taken(sent.walk)
    if held is None and sent.has_walk:
        return Brought((), code, None)
    results = _made(sent.job, held, code) if held is not None else _made_of_files(sent, code)
    return Brought(results, code, perf_counter() - began)


def _taken(walk: tuple[str, ...]) -> _Held | None:
    """Take out what is held; None, and gone, if it is another walk."""
    try:
        held = _HELD.pop()
    except IndexError:
        return None
    return held if held.walk == walk else None


def _made_of_files(sent: Parcel, code: str) -> tuple[Result, ...]:
    job = sent.job
    if not sent.files or job.path is None:
        return _made(job, _Held(sent.walk, Ready(job.source)), code)
    with tempfile.TemporaryDirectory(prefix="fg-nav-") as name:
        folder = Path(name)
        for file, content in sent.files:
            (folder / file).write_bytes(content)
        here = replace(job, path=folder / job.path.name, truth=job.truth and folder / job.truth.name)
        return _made(here, _Held(sent.walk, Ready(here.source), f"{folder}{os.sep}"), code)


def _made(job: Job, held: _Held, code: str) -> tuple[Result, ...]:
    """Make the results, and hold the walk; not after a bug, nor without a session where its files are gone."""
    try:
        results = list(results_of(job, code, held.ready))
        if held.walk and not (held.folder and held.ready.refused):
            _HELD[:] = [held]
    except Exception as error:
        results = list(_one_by_one(job, held, code, error))
    return tuple(replace(one, failed=one.failed.replace(held.folder, "")) if held.folder else one for one in results)


def _one_by_one(job: Job, held: _Held, code: str, bug: Exception) -> Iterator[Result]:
    """Make each cell alone; that of one is the bug's."""
    cells = in_cells(job)
    if len(cells) == 1:
        yield failed(job, f"a bug ({type(bug).__name__}: {bug})", code)
        return
    for cell in cells:
        yield from _made(cell, _Held((), Ready(held.ready.source)), code)


def failed(job: Job, reason: str, code: str) -> Result:
    """Result of a job of one cell that cannot be had."""
    [(magnetometer, methods)] = job.missing.items()
    [(method, settings)] = methods.items()
    return Result(Key(job.group, job.field, job.walk, magnetometer, method), settings, code, reason)


def in_cells(job: Job) -> list[Job]:
    """Split a job into those of one cell each."""
    return [
        replace(job, missing={magnetometer: {method: settings}})
        for magnetometer, methods in job.missing.items()
        for method, settings in methods.items()
    ]
