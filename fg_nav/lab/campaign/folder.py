"""The folder of a campaign: marked as ours, locked by one campaign at a time, and its results of other plans.

The marker file names the plan that was last run there. The lock on it keeps a second campaign out: the system releases
it when the process ends, however it ends. On a system or network disk without locks no campaign is kept out.

Another plan is not refused in the folder: a plan grows, and results that no plan has any more do no harm. Each result
is stored by its key, and the tables are of the present plan alone.

The tables of a campaign, from its stored results: the same campaign gives the same bytes, whenever it was run.

======================= ===========================================================================================
results.parquet         one row a result and alignment, in the order of their keys; a result that failed has one row
results.csv             the same
timings.parquet         one row a result, with what differs from run to run: its time, and the code that made it
======================= ===========================================================================================
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path
from typing import IO, Any

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.store.files import CAMPAIGN_MARKER, PART, atomic_write, find_foreign, list_visible
from fg_nav.lab.store.results import USED, Key, Result
from fg_nav.lab.walked import WalkErrors
from fg_nav.system.processes import lock
from fg_nav.text import format_count, to_json

RESULTS, RESULTS_CSV, TIMINGS = "results.parquet", "results.csv", "timings.parquet"
TABLES = (RESULTS, RESULTS_CSV, TIMINGS)

WORDS = ("group", "field", "walk", "magnetometer", "method", "preset", "parameters")  # Columns of the key.

ERRORS = tuple(item.name for item in fields(WalkErrors) if item.name != "alignment")


BATCH = 1000  # Results that are written into the tables at once.


def write_tables(folder: Path, results: Iterable[Result]) -> None:
    """Write all tables, of results in the order of `place_of`; each table is complete or as it was.

    Only a batch of results is in memory at a time: a long one is a megabyte.

    Raises
    ------
    OutputError
        If the system refuses.
    """
    import pyarrow as pa
    from pyarrow import csv, parquet

    errors, times = results_schema(pa), timings_schema(pa)
    with (
        atomic_write(folder / RESULTS) as one,
        atomic_write(folder / RESULTS_CSV) as other,
        atomic_write(folder / TIMINGS) as third,
        parquet.ParquetWriter(one, errors) as as_parquet,
        csv.CSVWriter(other, errors) as as_csv,
        parquet.ParquetWriter(third, times) as timings,
    ):
        for some in _batches(results):
            table = pa.Table.from_pylist([row for rows, _ in some for row in rows], schema=errors)
            as_parquet.write_table(table)
            as_csv.write_table(table)
            timings.write_table(pa.Table.from_pylist([timing for _, timing in some], schema=times))


def _batches(results: Iterable[Result]) -> Iterator[list[tuple[list[dict[str, Any]], dict[str, Any]]]]:
    """Yield the rows of so many results at once; the results themselves are released."""
    rows = ((list(rows_of(result)), timing_of(result)) for result in results)
    while some := list(islice(rows, BATCH)):
        yield some


def results_schema(pa: Any) -> Any:
    """Return the columns of the results, by the library of the extra."""
    text, number, count = pa.string(), pa.float64(), pa.int64()
    return pa.schema(
        [(name, text) for name in (*WORDS, "failed", "alignment")]
        + [(name, number) for name in (*ERRORS, "end_percent", "landmark_mean_m")]
        + [(name, count) for name in ("footfalls", "used_footfalls", "samples")]
        + [("notes", text)]
    )


def timings_schema(pa: Any) -> Any:
    """Return the columns of the timings."""
    numbers = [("runtime_s", pa.float64()), ("us_per_sample", pa.float64()), ("code", pa.string())]
    return pa.schema([(name, pa.string()) for name in WORDS] + numbers)


def words_of(key: Key) -> dict[str, str]:
    """Return the columns of the key, the changed parameters as JSON."""
    method = method_of(key.method)
    changes = json.dumps(dict(method.changes), sort_keys=True) if method.changes else ""
    of_walk = (key.group, key.field, key.walk, key.magnetometer)
    return dict(zip(WORDS, (*of_walk, method.name, method.preset, changes), strict=True))


def place_of(key: Key) -> tuple[str, ...]:
    """Return the place of a result among others: its first columns, as text."""
    return tuple(words_of(key).values())


def rows_of(result: Result) -> Iterator[dict[str, Any]]:
    """Yield one row an alignment; one without figures if there is none."""
    head: dict[str, Any] = {**words_of(result.key), "failed": result.failed}
    if result.failed:
        yield head
        return
    used = {"footfalls": len(result.used), "used_footfalls": result.used.count(USED)}
    head |= {"notes": "; ".join(result.notes), "samples": result.samples, **used}
    for mode, errors in sorted(result.errors.items()):
        at_landmarks = result.landmark_m.get(mode)
        mean = sum(at_landmarks) / len(at_landmarks) if at_landmarks else None
        figures = {"end_percent": to_json(errors.end_percent), "landmark_mean_m": mean}
        yield {**head, "alignment": mode, **{name: getattr(errors, name) for name in ERRORS}, **figures}


def timing_of(result: Result) -> dict[str, Any]:
    """Return what differs from run to run."""
    times = {"runtime_s": result.runtime_s, "us_per_sample": result.us_per_sample}
    return {**words_of(result.key), **(dict.fromkeys(times) if result.failed else times), "code": result.code}


RESULTS_FOLDER = "cells"


@dataclass(frozen=True)
class Folder:
    """Locked by this campaign; `before` is the plan that was last run there, empty if it was this or none."""

    out: Path
    before: str = ""

    @property
    def results(self) -> Path:
        """Folder of the results."""
        return self.out / RESULTS_FOLDER

    def describe_others(self, files: Collection[str]) -> str:
        """Return one sentence if there are results in other files than these; or ""."""
        number = sum(name.endswith(".json") and name not in files for name in os.listdir(self.results))
        if number == 0:
            return ""
        last = f" (the last one there was {self.before})" if self.before else ""
        return (
            f"{self.out} has {format_count(number, 'result')} of other plans than this{last}: the tables leave them out"
        )

    def count_written(self, files: Collection[str]) -> int:
        """Return how many of these results were written since the folder is locked, by the clock of its own disk."""
        since = (self.out / CAMPAIGN_MARKER).stat().st_mtime_ns
        with os.scandir(self.results) as entries:
            return sum(entry.name in files and entry.stat().st_mtime_ns >= since for entry in entries)

    def remove_tables(self) -> None:
        """Remove tables, which would look complete next to results that they do not have."""
        for name in TABLES:
            (self.out / name).unlink(missing_ok=True)


@contextmanager
def lock_folder(out: Path, plan: Path) -> Iterator[Folder]:
    """Make the folder if it is missing, and lock it while the block runs.

    Raises
    ------
    CampaignError
        If another campaign runs there.
    OutputError
        If something else fills the folder, or the system refuses.
    """
    try:
        foreign = find_foreign(out, CAMPAIGN_MARKER, (RESULTS_FOLDER, *TABLES)) or _find_foreign_result(out)
        if foreign:
            raise OutputError(f"{out} holds what is no campaign's ('{foreign}'): choose another --out.")
        (out / RESULTS_FOLDER).mkdir(parents=True, exist_ok=True)
        marker = (out / CAMPAIGN_MARKER).open("a+", encoding="utf-8", errors="surrogateescape")
    except OSError as error:
        raise OutputError(f"{out} cannot be written ({error.strerror}): choose another --out.") from None
    with marker:
        if _lock(marker, out):
            _remove_parts(out)
        yield Folder(out, _note_plan(marker, str(plan.resolve())))


def _find_foreign_result(out: Path) -> str:
    """Return a name among the results of a folder without a marker that is no result, or ""."""
    if (out / CAMPAIGN_MARKER).is_file():
        return ""
    others = (name for name in list_visible(out / RESULTS_FOLDER) if not name.endswith((".json", PART)))
    return next((f"{RESULTS_FOLDER}/{name}" for name in others), "")


def _lock(file: IO[str], out: Path) -> bool:
    """Lock a file until it is closed; False if there are no locks."""
    try:
        return lock(file.fileno())
    except BlockingIOError:
        raise CampaignError(
            f"another campaign is at work in {out}: wait until it is done, or choose another --out."
        ) from None


def _remove_parts(out: Path) -> None:
    """Remove what killed campaigns left half written: with the lock, no other process writes there."""
    for folder in (out, out / RESULTS_FOLDER):
        for name in os.listdir(folder):
            if name.startswith(".") and name.endswith(PART):
                (folder / name).unlink(missing_ok=True)


def _note_plan(marker: IO[str], plan: str) -> str:
    """Write the plan into the marker; returns the one that stood there if it was another."""
    marker.seek(0)
    before = marker.read().strip()
    marker.seek(0)
    marker.truncate()
    marker.write(f"{plan}\n")
    marker.flush()
    return "" if before == plan else before
