"""The tables of a campaign, from its stored results: the same campaign gives the same bytes, whenever it was run.

======================= ===========================================================================================
results.parquet         one row a result and alignment, in the order of their keys; a result that failed has one row
results.csv             the same
timings.parquet         one row a result, with what differs from run to run: its time, and the code that made it
======================= ===========================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Any

from fg_nav.evaluation.walked import WalkErrors
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.store.files import atomic_write
from fg_nav.lab.store.results import USED, Key, Result
from fg_nav.text import to_json

RESULTS, RESULTS_CSV, TIMINGS = "results.parquet", "results.csv", "timings.parquet"
TABLES = (RESULTS, RESULTS_CSV, TIMINGS)

WORDS = ("group", "field", "walk", "magnetometer", "method", "preset", "parameters")
"""Columns of the key."""

ERRORS = tuple(item.name for item in fields(WalkErrors) if item.name != "alignment")


BATCH = 1000
"""Results that are written into the tables at once."""


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
