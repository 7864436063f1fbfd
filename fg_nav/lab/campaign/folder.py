"""The folder of a campaign, marked as ours and locked by one campaign at a time, and its tables (docs/campaigns.md).

The lock on the marker file keeps a second campaign out: the system releases it when the process ends, however it ends.
The tables are of the present plan alone: the same campaign gives the same bytes, whenever it was run. What differs from
run to run, times and code, is in a table of its own.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Any

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.store.files import CAMPAIGN_MARKER, PART, atomic_write, find_foreign
from fg_nav.lab.store.results import USED, Key, Result
from fg_nav.lab.walked import WalkErrors
from fg_nav.system.processes import lock
from fg_nav.text import to_json

RESULTS, RESULTS_CSV, TIMINGS = "results.parquet", "results.csv", "timings.parquet"
TABLES = (RESULTS, RESULTS_CSV, TIMINGS)
RESULTS_FOLDER = "cells"

WORDS = ("group", "field", "walk", "magnetometer", "method", "preset", "parameters")  # Columns of the key.
ERRORS = tuple(item.name for item in fields(WalkErrors) if item.name != "alignment")
COLUMNS = {
    **dict.fromkeys((*WORDS, "failed", "alignment"), "string"),
    **dict.fromkeys((*ERRORS, "end_percent", "landmark_mean_m"), "double"),
    **dict.fromkeys(("footfalls", "used_footfalls", "samples"), "int64"),
    "notes": "string",
}  # Of the results, with the types that Arrow has.
TIMING_COLUMNS = {**dict.fromkeys(WORDS, "string"), "runtime_s": "double", "us_per_sample": "double", "code": "string"}

BATCH = 1000  # Results that are written into the tables at once: a long one is a megabyte.


@contextmanager
def lock_folder(out: Path) -> Iterator[None]:
    """Make the folder if it is missing, and lock it while the block runs.

    Raises `CampaignError` if another campaign runs there, `OutputError` if something else fills it, or it cannot be.
    """
    try:
        foreign = find_foreign(out, CAMPAIGN_MARKER, (RESULTS_FOLDER, *TABLES))
        if foreign:
            raise OutputError(f"{out} holds what is no campaign's ('{foreign}'): choose another --out.")
        (out / RESULTS_FOLDER).mkdir(parents=True, exist_ok=True)
        marker = (out / CAMPAIGN_MARKER).open("a")
    except OSError as error:
        raise OutputError(f"{out} cannot be written ({error.strerror}): choose another --out.") from None
    with marker:
        try:
            locked = lock(marker.fileno())
        except BlockingIOError:
            raise CampaignError(
                f"another campaign is at work in {out}: wait until it is done, or choose another --out."
            ) from None
        if locked:  # nobody else writes there: what is half written is of campaigns that were killed
            for part in out.rglob(f".*{PART}"):
                part.unlink(missing_ok=True)
        yield


def count_others(out: Path, files: Collection[str]) -> int:
    """Return how many results the folder has in other files than these."""
    return sum(name.endswith(".json") and name not in files for name in os.listdir(out / RESULTS_FOLDER))


def write_tables(folder: Path, results: Iterable[Result]) -> None:
    """Write all tables, of results in the order of `place_of`; each table is complete or as it was.

    Raises `OutputError` if the system refuses.
    """
    import pyarrow as pa
    from pyarrow import csv, parquet

    schema, timing_schema = (
        pa.schema([(name, pa.type_for_alias(kind)) for name, kind in columns.items()])
        for columns in (COLUMNS, TIMING_COLUMNS)
    )
    with (
        atomic_write(folder / RESULTS) as one,
        atomic_write(folder / RESULTS_CSV) as other,
        atomic_write(folder / TIMINGS) as third,
        parquet.ParquetWriter(one, schema) as as_parquet,
        csv.CSVWriter(other, schema) as as_csv,
        parquet.ParquetWriter(third, timing_schema) as timings,
    ):
        rows_of_each = ((list(rows_of(result)), timing_of(result)) for result in results)
        while some := list(islice(rows_of_each, BATCH)):
            table = pa.Table.from_pylist([row for rows, _ in some for row in rows], schema=schema)
            as_parquet.write_table(table)
            as_csv.write_table(table)
            timings.write_table(pa.Table.from_pylist([timing for _, timing in some], schema=timing_schema))


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
    """Return what differs from run to run; no times of a result that failed."""
    times = {} if result.failed else {"runtime_s": result.runtime_s, "us_per_sample": result.us_per_sample}
    return {**words_of(result.key), **times, "code": result.code}
