"""`fg-nav lab campaign` and `reproduce` on a terminal: progress, and at the end the results."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from fg_nav.commands.shared import RESULTS, Answer
from fg_nav.lab.campaign.cluster import KILLED, choose_cluster
from fg_nav.lab.campaign.command import TABLES, run_campaign
from fg_nav.lab.reproduce.command import print_rows
from fg_nav.lab.reproduce.command import reproduce as reproduce_paper
from fg_nav.lab.reproduce.results import describe_reproduction
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import Result
from fg_nav.lab.verbs import CampaignRequest, ReproduceRequest
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, CLOSURE
from fg_nav.report.terminal import can_show_progress, console, remark, ruled_table
from fg_nav.text import format_count, to_json

MODES = (AS_STARTED, BEST_YAW, CLOSURE)  # Of errors, the first that a walk has counts.
MAX_REASONS = 10  # Of failures, that are printed.


def campaign(request: CampaignRequest) -> Answer:
    """Make the results of a plan that are not there yet, and return them all."""
    out, errors = request.out or RESULTS / request.plan.stem, Console(stderr=True)

    def notify(words: str) -> None:
        remark(f"note: {words}")

    execute = choose_cluster(request.scheduler, request.workers, notify)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=errors, transient=True, disable=not can_show_progress(errors)) as bars:
        bar = bars.add_task("results", total=None)

        def show(made: int, total: int) -> None:
            bars.update(bar, total=total, completed=made)

        done, stored = run_campaign(request.plan, out, execute, request.renew, request.retry, show, notify)
    results = [{**to_json(one.key), "failed": one.failed, "errors": one.errors} for one in done]
    content = {"folder": str(out), "stored_before": stored, "results": results}
    return Answer(content, partial(print_campaign, done, stored, out))


def reproduce(request: ReproduceRequest) -> Answer:
    """Make the experiments of a paper, and return what they came to."""
    out = request.out or RESULTS / f"reproduce-{request.paper}"
    found = reproduce_paper(
        request.paper, out, request.seeds, request.first, request.workers, request.quick, request.force
    )
    return Answer({"folder": str(out), **describe_reproduction(found)}, lambda: print_rows(found, out))


def print_campaign(done: Sequence[Result], stored: int, place: Path) -> None:
    """Print medians by case and method, what failed, and where the tables are."""
    out = console()
    cases: dict[tuple[str, ...], list[Result]] = {}
    for result in done:
        key = result.key
        cases.setdefault((key.group, key.field, key.magnetometer, key.method), []).append(result)
    # Medians of the first kind of error that a walk has.
    table = ruled_table("case", "walks", "failed", "end error (m)", "rmse (m)")
    for case, some in cases.items():
        kinds = [[one.errors[mode] for mode in MODES if mode in one.errors] for one in some if not one.failed]
        medians = []
        for name in ("end_m", "rmse_m"):
            known = [value for value in (getattr(kind[0], name) for kind in kinds) if value is not None]
            medians.append(f"{median(known):.3f}" if known else "-")
        table.add_row(", ".join(case), str(len(some)), str(sum(bool(one.failed) for one in some)), *medians)
    out.print(table)
    out.print(
        "medians over the walks that did not fail; as started, or by the best yaw, or the closure without a truth"
    )
    # Where the results are from, and why some failed.
    notes = [f"{format_count(len(done), 'result')}, {stored} of them from before"]
    other = sum(one.code != code_sum() for one in done)
    if other:
        notes.append(f"{format_count(other, 'result')} made by other code or libraries: --renew makes them again")
    failures = [one for one in done if one.failed]
    for one in failures[:MAX_REASONS]:
        key = one.key
        case = (key.group, key.field, key.walk, key.magnetometer, key.method)
        notes.append(f"failed: {', '.join(case)}: {one.failed}")
    if len(failures) > MAX_REASONS:
        notes.append(f"and {len(failures) - MAX_REASONS} more failed: see the column `failed`")
    if failures:
        fewer = ", with fewer --workers for memory" if any(one.failed == KILLED for one in failures) else ""
        notes.append(f"{format_count(len(failures), 'result')} failed: --retry makes them again{fewer}")
    for note in notes:
        out.print(f"note: {note}", soft_wrap=True)
    out.print(f"files: {place} ({', '.join(TABLES)})", soft_wrap=True)
