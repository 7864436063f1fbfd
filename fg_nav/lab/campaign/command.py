"""A campaign from its plan to its tables: what `fg-nav lab campaign` does.

The folder of a campaign has the results in `cells`, one small file each, and the tables, which are written when all
results are there and removed while some are missing. The same command continues where it was stopped, however it was,
and makes again what has changed. Results are read one at a time: a long walk's is a megabyte.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign.cluster import Cluster, Notify, check_address, check_installed
from fg_nav.lab.campaign.dispatch import Progress, RemainingTime, dispatch
from fg_nav.lab.campaign.execute import Task, TaskResults
from fg_nav.lab.campaign.folder import Folder, lock_folder, place_of, write_tables
from fg_nav.lab.campaign.plan import read_plan
from fg_nav.lab.store import code, results
from fg_nav.lab.store.results import Key, Result
from fg_nav.text import format_count


@dataclass(frozen=True)
class Request:
    """What the command line asks for.

    Attributes
    ----------
    plan : file.
    out : folder of the campaign.
    scheduler : address of a Dask cluster; None for a local one.
    workers : processes of that; None for one a core.
    renew, retry : make again what other code made, and what failed.
    """

    plan: Path
    out: Path
    scheduler: str | None = None
    workers: int | None = None
    renew: bool = False
    retry: bool = False


@dataclass(frozen=True)
class Summary:
    """All results, in short (`shorten`), and how many of them were stored before."""

    results: tuple[Result, ...]
    stored: int


def run_campaign(request: Request, show: Callable[[Progress], None], notify: Notify) -> Summary:
    """Make what is missing, and write the tables.

    Raises
    ------
    CampaignError, OutputError
        If the plan or the folder cannot be, another campaign runs there, or the cluster is gone.
    """
    check_installed()
    cluster = choose_cluster(request)
    plan = read_plan(request.plan)
    keys = plan.list_keys()
    with lock_folder(request.out, request.plan) as folder:
        # Find what is stored, and what is missing.
        others = folder.describe_others({key.file for key in keys})
        if others:
            notify(others)
        settings = plan.settings(keys)
        missing = [key for key in keys if not _holds(results.read_result(folder.results, key, settings[key]), request)]
        stored = len(keys) - len(missing)
        # Make it, a walk at a time on each worker.
        if missing:
            folder.remove_tables()
            with _note_if_stopped(folder, missing, stored, notify):
                _make(plan.tasks(missing, settings), folder.results, cluster, stored, show, notify)
        # Write the tables.
        short: dict[Key, Result] = {}
        write_tables(request.out, _read_all(folder.results, sorted(keys, key=place_of), settings, short))
    return Summary(tuple(short[key] for key in keys), stored)


def choose_cluster(request: Request) -> Cluster:
    """Return the cluster that was asked for; raises `CampaignError` if it cannot be."""
    if request.scheduler is None:
        from dask.system import CPU_COUNT

        return Cluster(None, request.workers or CPU_COUNT)
    if request.workers is not None:
        raise CampaignError("--workers is for a cluster of our own: leave it out with --scheduler.")
    check_address(request.scheduler)
    return Cluster(request.scheduler)


def _holds(result: Result | None, request: Request) -> bool:
    """Whether there is a result, and it is not to be made again."""
    if result is None or (request.renew and result.code != code.code_sum()):
        return False
    return not (request.retry and result.failed)


@contextmanager
def _note_if_stopped(folder: Folder, missing: Sequence[Key], stored: int, notify: Notify) -> Iterator[None]:
    """Note on Ctrl-C how far it came."""
    try:
        yield
    except KeyboardInterrupt:
        done = stored + folder.count_written({key.file for key in missing})
        total = format_count(stored + len(missing), "result")
        notify(f"stopped: {done} of {total} are kept, the same command goes on from there")
        raise


def _make(
    tasks: Sequence[Task],
    folder: Path,
    cluster: Cluster,
    stored: int,
    show: Callable[[Progress], None],
    notify: Notify,
) -> None:
    remaining = RemainingTime(stored, tasks)
    show(remaining.progress(0 if cluster.remote else cluster.workers_for(tasks)))

    def take(task: Task, made: TaskResults) -> None:
        for result in made.results:
            results.write_result(folder, result)
        remaining.count(task.keys, made.seconds)

    dispatch(tasks, cluster, take, notify, lambda workers: show(remaining.progress(workers)))


def _read_all(
    folder: Path, keys: Sequence[Key], settings: Mapping[Key, Mapping[str, Any]], short: dict[Key, Result]
) -> Iterator[Result]:
    """Read one result after the other, and put down in short what the summary needs."""
    for key in keys:
        result = results.read_result(folder, key, settings[key])
        if result is None:
            path = folder / key.file
            what = "is not what was kept there" if path.exists() else "was there and is gone"
            raise OutputError(f"{path} {what}: run the same command again, it goes on.")
        short[key] = shorten(result)
        yield result


def shorten(result: Result) -> Result:
    """Return what the summary needs: thousands of complete ones are gigabytes."""
    return Result(result.key, {}, result.code, result.failed, result.errors)
