"""A campaign from its plan to its tables: what `fg-nav campaign` does.

The folder of a campaign has the results in `cells`, one small file each, and beside them the tables, written when all
cells are there and taken away while some are missing. The same command goes on where it was stopped, however it was,
and makes anew what has changed. Results are read one at a time: a long walk's is a megabyte.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from fg_nav.errors import CampaignError, OutputError
from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.cells import recorded_keys, simulated_keys
from fg_nav.lab.campaign.cluster import Cluster, check_address, check_installed
from fg_nav.lab.campaign.crew import Tell
from fg_nav.lab.campaign.folder import Folder, held
from fg_nav.lab.campaign.kept import Key, Result
from fg_nav.lab.campaign.made import Job, jobs_of
from fg_nav.lab.campaign.pace import Pace, Standing
from fg_nav.lab.campaign.parcel import Brought
from fg_nav.lab.campaign.plan import Plan, read_plan
from fg_nav.lab.campaign.recordings import RECORDED, Walk
from fg_nav.lab.campaign.session import on_cluster
from fg_nav.lab.campaign.settings import settings_of
from fg_nav.lab.campaign.table import place_of, write_tables
from fg_nav.wording import counted


@dataclass(frozen=True)
class Wanted:
    """What was asked for.

    Attributes
    ----------
    plan : file.
    out : folder of the campaign.
    scheduler : address of a Dask cluster; None for one of our own.
    workers : processes of that; None for one a core.
    renew, retry : make anew what other code made, and what failed.
    """

    plan: Path
    out: Path
    scheduler: str | None = None
    workers: int | None = None
    renew: bool = False
    retry: bool = False


@dataclass(frozen=True)
class Done:
    """All results, in short (`in_short`), and how many of them were there before."""

    results: tuple[Result, ...]
    joined: int


def campaign(wanted: Wanted, show: Callable[[Standing], None], tell: Tell) -> Done:
    """Make what is missing, and write the tables.

    Raises
    ------
    CampaignError, OutputError
        If the plan or the folder cannot be, another campaign is at work there, or the cluster is gone.
    """
    check_installed()
    cluster = cluster_of(wanted)
    plan = read_plan(wanted.plan)
    keys = keys_of(plan)
    with held(wanted.out, wanted.plan) as folder:
        others = folder.others({key.file for key in keys})
        if others:
            tell(others)
        settings = settings_of_plan(plan, keys)
        holds = {key for key in keys if _holds(kept.kept(folder.cells, key, settings[key]), wanted)}
        missing = [key for key in keys if key not in holds]
        if missing:
            folder.take_tables_away()
            jobs = jobs_of_plan(plan, missing, settings)
            with _told_if_stopped(folder, missing, len(holds), tell):
                _make(jobs, folder.cells, cluster, len(holds), show, tell)
        short: dict[Key, Result] = {}
        write_tables(wanted.out, _read(folder.cells, sorted(keys, key=place_of), settings, short))
    return Done(tuple(short[key] for key in keys), len(holds))


@contextmanager
def _told_if_stopped(folder: Folder, missing: Sequence[Key], holds: int, tell: Tell) -> Iterator[None]:
    """Tell on Ctrl-C how far it came."""
    try:
        yield
    except KeyboardInterrupt:
        done = holds + folder.written({key.file for key in missing})
        total = counted(holds + len(missing), "result")
        tell(f"stopped: {done} of {total} are kept, the same command goes on from there")
        raise


def _read(
    folder: Path, keys: Sequence[Key], settings: Mapping[Key, Mapping[str, Any]], short: dict[Key, Result]
) -> Iterator[Result]:
    """Read one result after the other, and put down in short what the summary needs."""
    for key in keys:
        result = kept.kept(folder, key, settings[key])
        if result is None:
            path = folder / key.file
            what = "is not what was kept there" if path.exists() else "was there and is gone"
            raise OutputError(f"{path} {what}: run the same command again, it goes on.")
        short[key] = in_short(result)
        yield result


def in_short(result: Result) -> Result:
    """Return what the summary needs: thousands of whole ones are gigabytes."""
    return Result(result.key, {}, result.code, result.failed, result.errors)


def cluster_of(wanted: Wanted) -> Cluster:
    """Return the cluster that was asked for; raises `CampaignError` if it cannot be."""
    if wanted.scheduler is None:
        from dask.system import CPU_COUNT

        return Cluster(None, wanted.workers or CPU_COUNT)
    if wanted.workers is not None:
        raise CampaignError("--workers is for a cluster of our own: leave it out with --scheduler.")
    check_address(wanted.scheduler)
    return Cluster(wanted.scheduler)


def keys_of(plan: Plan) -> list[Key]:
    """All cells of a plan; raises `CampaignError` if two would be kept in one file."""
    recorded: dict[str, list[str]] = {}
    for walk in plan.walks:
        recorded.setdefault(walk.group, []).append(walk.name)
    simulated = (plan.scenarios, plan.fields, plan.magnetometers, plan.methods, plan.seeds)
    calibrated = {walk.group for walk in plan.walks if walk.reading.calibration is not None}
    keys = simulated_keys(*simulated) + recorded_keys(recorded, RECORDED, plan.magnetometers, plan.methods, calibrated)
    by_file: dict[str, Key] = {}
    for key in keys:
        other = by_file.setdefault(key.file.casefold(), key)
        if other is not key:
            raise CampaignError(
                f"'{other.walk}' of '{other.group}' and '{key.walk}' of '{key.group}' would be kept in one file: "
                "rename one."
            )
    return keys


def settings_of_plan(plan: Plan, keys: Sequence[Key]) -> dict[Key, Mapping[str, Any]]:
    """What each cell is made with; the walks of one scenario share it."""
    sums = {(walk.group, walk.name): (walk.sums(), walk.reading) for walk in plan.walks}
    own = {one.name: one for one in plan.own}
    simulated = cache(settings_of)
    return {
        key: settings_of(key, True, *sums[key.group, key.walk])
        if key.field == RECORDED
        else simulated(replace(key, walk=""), own=own.get(key.group))
        for key in keys
    }


def jobs_of_plan(plan: Plan, missing: Sequence[Key], settings: Mapping[Key, Mapping[str, Any]]) -> list[Job]:
    """What is missing, walk by walk."""
    walks: dict[tuple[str, str], Walk] = {(walk.group, walk.name): walk for walk in plan.walks}
    own = {one.name: one for one in plan.own}
    return [
        _recorded(job, walks[job.group, job.walk]) if job.field == RECORDED else replace(job, own=own.get(job.group))
        for job in jobs_of(missing, settings)
    ]


def _recorded(job: Job, walk: Walk) -> Job:
    truth = walk.truth and walk.truth.resolve()
    return replace(job, path=walk.path.resolve(), truth=truth, beside=walk.beside, reading=walk.reading)


def _holds(result: Result | None, wanted: Wanted) -> bool:
    """Whether there is a result, and it is not to be made anew all the same."""
    if result is None or (wanted.renew and result.code != kept.code_sum()):
        return False
    return not (wanted.retry and result.failed)


def _make(
    jobs: Sequence[Job], folder: Path, cluster: Cluster, joined: int, show: Callable[[Standing], None], tell: Tell
) -> None:
    pace = Pace.of(joined, jobs)
    show(pace.standing(0 if cluster.far else cluster.workers_for(jobs)))

    def take(job: Job, brought: Brought, workers: int) -> None:
        for result in brought.results:
            kept.keep(folder, result)
        pace.came(job.keys, brought.seconds)

    on_cluster(jobs, cluster, take, tell, lambda workers, at: show(pace.standing(workers, at)))
