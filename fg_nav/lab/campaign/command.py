"""A campaign from its plan to its tables: what `fg-nav lab campaign` does.

The folder of a campaign has the results in `cells`, one small file each, and the tables, which are written when all
results are there and removed while some are missing. The same command continues where it was stopped, however it was,
and makes again what has changed. Results are read one at a time: a long walk's is a megabyte.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign.cluster import Notify, check_address, check_installed, run_on_dask
from fg_nav.lab.campaign.execute import Execute, make
from fg_nav.lab.campaign.folder import RESULTS_FOLDER, TABLES, count_others, lock_folder, place_of, write_tables
from fg_nav.lab.campaign.plan import read_plan
from fg_nav.lab.store import results
from fg_nav.lab.store.results import Key, Result
from fg_nav.text import format_count


@dataclass(frozen=True)
class Summary:
    """All results, in short, and how many of them were stored before."""

    results: Sequence[Result]
    stored: int


def run_campaign(
    plan: Path,
    out: Path,
    execute: Execute,
    renew: bool = False,
    retry: bool = False,
    show: Callable[[int, int], None] = lambda done, total: None,
    notify: Notify = lambda words: None,
) -> Summary:
    """Make what a plan's folder lacks, and write the tables; `renew` and `retry` as of `make`.

    Raises
    ------
    CampaignError, OutputError
        If the plan or the folder cannot be, another campaign runs there, or the cluster is gone.
    """
    asked = read_plan(plan)
    settings = asked.settings(asked.list_keys())
    with lock_folder(out):
        others = count_others(out, {key.file for key in settings})
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
                result = results.read_result(out / RESULTS_FOLDER, key, settings[key])
                if result is None:
                    path = out / RESULTS_FOLDER / key.file
                    raise OutputError(f"{path} is not what was kept there: run the same command again, it goes on.")
                short[key] = Result(key, {}, result.code, result.failed, result.errors)
                yield result

        write_tables(out, read())
    return Summary([short[key] for key in settings], stored or 0)


def choose_cluster(scheduler: str | None, workers: int | None, notify: Notify) -> Execute:
    """Return what executes tasks on a cluster; raises `CampaignError` if it cannot be, or without Dask."""
    check_installed()
    from dask.system import CPU_COUNT

    if scheduler is not None:
        if workers is not None:
            raise CampaignError("--workers is for a cluster of our own: leave it out with --scheduler.")
        check_address(scheduler)
    return partial(run_on_dask, scheduler=scheduler, workers=workers or CPU_COUNT, notify=notify)
