"""What goes to a worker and what comes back: a job with all it needs, and its results.

A worker of another machine sees no disk of ours: the files of a recorded walk go with the job, and the results come
back in memory. Whoever sent the job keeps them.

Nothing that goes wrong in a cell may end the campaign: what is not an error of ours is a bug, and that cell's result.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from fg_nav.campaign import kept
from fg_nav.campaign.kept import Key, Result
from fg_nav.campaign.made import Job, results_of


@dataclass(frozen=True)
class Parcel:
    """A job and the files of its walk, name and content; without files those of the job's paths are read."""

    job: Job
    files: tuple[tuple[str, bytes], ...] = ()


@dataclass(frozen=True)
class Brought:
    """What came of it: results, the sum over the code that made them (`kept.code_sum`), and the time it took."""

    results: tuple[Result, ...]
    code: str
    seconds: float


def parcel(job: Job, with_files: bool) -> Parcel:
    """Pack a job; a file that cannot be read is left out, and the worker will miss it."""
    if job.path is None or not with_files:
        return Parcel(job)
    contents = []
    for path in {job.path, *job.beside, job.truth or job.path}:
        try:
            contents.append((path.name, path.read_bytes()))
        except OSError:
            continue
    return Parcel(job, tuple(contents))


def unpacked(sent: Parcel) -> Brought:
    """Make the results of a parcel, on the worker."""
    began, code = perf_counter(), kept.code_sum()
    if not sent.files or sent.job.path is None:
        return Brought(tuple(_results(sent.job, code)), code, perf_counter() - began)
    with tempfile.TemporaryDirectory(prefix="fg-nav-") as name:
        folder = Path(name)
        for file, content in sent.files:
            (folder / file).write_bytes(content)
        truth = sent.job.truth
        here = replace(sent.job, path=folder / sent.job.path.name, truth=truth and folder / truth.name)
        made = [replace(one, failed=one.failed.replace(f"{folder}{os.sep}", "")) for one in _results(here, code)]
        return Brought(tuple(made), code, perf_counter() - began)


def _results(job: Job, code: str) -> Iterator[Result]:
    try:
        yield from list(results_of(job, code))
    except Exception as error:
        cells = in_cells(job)
        if len(cells) == 1:
            yield failed(job, f"a bug ({type(error).__name__}: {error})", code)
        for cell in cells if len(cells) > 1 else ():
            yield from _results(cell, code)


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
