"""A campaign from its plan to its tables: what `fg-nav lab campaign` does (docs/campaigns.md).

The folder of a campaign is marked as ours and locked by one campaign at a time: the system releases the lock when the
process ends, however it ends. It has the results in `cells`, one small file each, and the tables, which are written
when all results are there and removed while some are missing. The same command continues where it was stopped, and
makes again what has changed. Results are read one at a time: a long walk's is a megabyte.

The tables are of the present plan alone: the same campaign gives the same bytes, whenever it was run. What differs from
run to run, times and code, is in a table of its own.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Any

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign.cluster import Notify
from fg_nav.lab.campaign.execute import Execute, make
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.plan import read_plan
from fg_nav.lab.store.files import CAMPAIGN_MARKER, MARKERS, PART, atomic_write, list_visible
from fg_nav.lab.store.results import USED, Key, Result, read_result
from fg_nav.lab.walked import WalkErrors
from fg_nav.system.processes import lock
from fg_nav.text import format_count, to_json

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


def run_campaign(
    plan: Path,
    out: Path,
    execute: Execute,
    renew: bool = False,
    retry: bool = False,
    show: Callable[[int, int], None] = lambda done, total: None,
    notify: Notify = lambda words: None,
) -> tuple[list[Result], int]:
    """Make what a plan's folder lacks, and write the tables; `renew` and `retry` as of `make`.

    Returns all results, in short, and how many of them were stored before. Raises `CampaignError` or `OutputError` if
    plan or folder cannot be, another campaign runs there, or the cluster is gone.
    """
    asked = read_plan(plan)
    settings = asked.settings()
    with lock_folder(out):
        ours = {key.file for key in settings}
        others = sum(name.endswith(".json") and name not in ours for name in os.listdir(out / RESULTS_FOLDER))
        if others:
            words = format_count(others, "result")
            notify(f"{out} has {words} of other plans than this: the tables leave them out")
        # Make what is missing; tables would look complete next to results that they do not have.
        for name in TABLES:
            (out / name).unlink(missing_ok=True)
        stored = done = None
        try:
            for done, total in make(settings, out / RESULTS_FOLDER, execute, asked.find_source, renew, retry):
                stored = done if stored is None else stored
                show(done, total)
        except KeyboardInterrupt:
            if done is not None:
                words = f"{done} of {format_count(len(settings), 'result')}"
                notify(f"stopped: {words} are kept, the same command goes on from there")
            raise
        # Write the tables; of each result keep what the summary needs.
        short: dict[Key, Result] = {}

        def read() -> Iterator[Result]:
            for key in sorted(settings, key=place_of):
                result = read_result(out / RESULTS_FOLDER, key, settings[key])
                if result is None:
                    path = out / RESULTS_FOLDER / key.file
                    raise OutputError(f"{path} is not what was kept there: run the same command again, it goes on.")
                short[key] = Result(key, {}, result.code, result.failed, result.errors)
                yield result

        write_tables(out, read())
    return [short[key] for key in settings], stored or 0


@contextmanager
def lock_folder(out: Path) -> Iterator[None]:
    """Make the folder if it is missing, and lock it while the block runs.

    Raises `CampaignError` if another campaign runs there, `OutputError` if something else fills it, or it cannot be.
    """
    try:
        if not (out / CAMPAIGN_MARKER).is_file():
            foreign = [marker for marker in MARKERS if (out / marker).is_file()]
            foreign += [name for name in list_visible(out) if name not in (RESULTS_FOLDER, *TABLES)]
            if foreign:
                raise OutputError(f"{out} holds what is no campaign's ('{foreign[0]}'): choose another --out.")
        (out / RESULTS_FOLDER).mkdir(parents=True, exist_ok=True)
        marker = (out / CAMPAIGN_MARKER).open("a")
        locked = lock(marker.fileno())
    except BlockingIOError:
        words = f"another campaign is at work in {out}: wait until it is done, or choose another --out."
        raise CampaignError(words) from None
    except OSError as error:
        raise OutputError(f"{out} cannot be written ({error.strerror}): choose another --out.") from None
    with marker:
        if locked:  # nobody else writes there: what is half written is of campaigns that were killed
            for part in out.rglob(f".*{PART}"):
                part.unlink(missing_ok=True)
        yield


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


def place_of(key: Key) -> tuple[str, ...]:
    """Return the first columns of a result, by which rows are ordered; the changed parameters as JSON."""
    method = method_of(key.method)
    changes = json.dumps(dict(method.changes), sort_keys=True) if method.changes else ""
    return (key.group, key.field, key.walk, key.magnetometer, method.name, method.preset, changes)


def rows_of(result: Result) -> Iterator[dict[str, Any]]:
    """Yield one row an alignment; one without figures if there is none."""
    head: dict[str, Any] = {**dict(zip(WORDS, place_of(result.key), strict=True)), "failed": result.failed}
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
    return {**dict(zip(WORDS, place_of(result.key), strict=True)), **times, "code": result.code}
