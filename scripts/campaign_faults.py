"""A campaign whose workers and scheduler are killed comes to the same tables; and how much faster two workers are.

    python scripts/campaign_faults.py [--scenarios NAME NAME] [--seeds N] [--methods NAME ...] [--out DIR]

One plan, 2 scenarios x 3 methods x 8 seeds by default, is run four times by `fg-nav lab campaign`, each in its
own folder:

one worker     on a Dask cluster of its own
two workers    the same; it has the tables that the others are held against
again          the same once more
disturbed      on a scheduler and two workers started here: after a quarter of the cells one worker is killed, after
               half of them the scheduler, which is started again, after three quarters another worker (SIGKILL)

As a supervisor would, the script starts `dask worker` again when it ends, which it does with its scheduler. Time is
that of the whole command.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, sleep

import harness
import psutil
from harness import Figure

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign.folder import RESULTS, RESULTS_CSV, RESULTS_FOLDER

METHODS = ("smoother", "matched-rts", "ma2018")
SCENARIOS = ("office", "office-open")
SPEED_UP = 1.7  # Asked for, of two workers over one.
RUNS = ("one", "two", "again", "disturbed")  # Names of their folders.

MAX_S = 3600.0
TICK_S = 0.1


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the plan four times, and print what differs."""
    given = harness.parse_arguments(__doc__, arguments, scenarios=SCENARIOS, methods=METHODS, seeds=8, out=None)
    with tempfile.TemporaryDirectory(prefix="fg-nav-faults-") as scratch:
        out = given.out or Path(scratch)
        _check_new(out)
        out.mkdir(parents=True, exist_ok=True)
        plan = out / "plan.toml"
        plan.write_text(_plan(given), encoding="utf-8")
        print_all(out, plan)


def _plan(given: argparse.Namespace) -> str:
    lists = {"scenarios": given.scenarios, "methods": given.methods, "fields": ["indoor"]}
    lines = [f"{name} = [{', '.join(repr(one) for one in some)}]" for name, some in lists.items()]
    return "\n".join([*lines, f"seeds = {given.seeds}", ""])


def _check_new(out: Path) -> None:
    """Refuse a folder with campaigns in it: one that is joined proves nothing."""
    there = next((name for name in RUNS if (out / name).exists()), None)
    if there is not None:
        raise CampaignError(f"{out / there} is there already, and would only be joined: choose another --out.")


def print_all(out: Path, plan: Path) -> None:
    """Run, compare, print."""
    one = harness.measure_time(lambda: campaign(plan, out / "one", "--workers", "1"))[0].wall
    two = harness.measure_time(lambda: campaign(plan, out / "two", "--workers", "2"))[0].wall
    again = harness.measure_time(lambda: campaign(plan, out / "again", "--workers", "2"))[0].wall
    harness.print_heading("Undisturbed")
    rows = [("one worker", one), ("two workers", two), ("again", again)]
    harness.print_table(("run", "s"), [(name, f"{seconds:.1f}") for name, seconds in rows])
    harness.print_heading("Disturbed")
    events: list[str] = []
    seconds = harness.measure_time(lambda: events.extend(disturbed(plan, out / "disturbed")))[0].wall
    for event in events:
        print(event)
    print(f"{seconds:.1f} s in all")
    figures = [
        *(same(out / "two", out / other, f"{other} as two") for other in ("one", "again", "disturbed")),
        Figure("time", "speed-up by a second worker", "", one / two, SPEED_UP, pattern="{:.2f}"),
    ]
    harness.print_heading("What was asked")
    harness.print_figures(figures)
    harness.print_verdict(figures)


def same(one: Path, other: Path, name: str) -> Figure:
    """Number of tables that differ by at least a byte."""
    differing = sum((one / table).read_bytes() != (other / table).read_bytes() for table in (RESULTS, RESULTS_CSV))
    return Figure("tables", f"differing tables, {name}", "", float(differing), high=0.0, pattern="{:.0f}")


def command(plan: Path, out: Path, *more: str) -> list[str]:
    """Words of the command line."""
    return [sys.executable, "-m", "fg_nav.cli", "lab", "campaign", str(plan), "--out", str(out), *more]


def campaign(plan: Path, out: Path, *more: str) -> None:
    """Run a campaign to its end; raises `CampaignError` with what it said where it fails."""
    ran = subprocess.run(command(plan, out, *more), capture_output=True, text=True, check=False)
    if ran.returncode:
        raise CampaignError(ran.stderr.strip())


@dataclass
class OwnCluster:
    """A scheduler and two workers as processes of ours."""

    port: int
    started: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def address(self) -> str:
        """Of the scheduler."""
        return f"tcp://127.0.0.1:{self.port}"

    def start_scheduler(self) -> None:
        """Start, or start again on the same port."""
        self.scheduler = self._start("dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port))

    def start_workers(self) -> None:
        """Start two, with the nanny that each has."""
        self.workers = self._start("dask_worker", self.address, "--nworkers", "2", "--nthreads", "1")

    def tend(self) -> None:
        """Start the workers again where they went with their scheduler."""
        if self.workers.poll() is not None:
            self.start_workers()

    def kill_worker(self) -> str:
        """Kill the worker that has worked most; its nanny starts another."""
        own = psutil.Process(self.workers.pid).children(recursive=True)
        workers = [one for one in own if "spawn_main" in " ".join(one.cmdline())]
        victim = max(workers, key=lambda one: sum(one.cpu_times()[:2]))
        victim.kill()
        return f"worker {victim.pid} of {len(workers)} killed"

    def restart_scheduler(self) -> str:
        """Kill the scheduler and start it again."""
        self.scheduler.kill()
        self.scheduler.wait()
        self.start_scheduler()
        return "scheduler killed and started again"

    def end(self) -> None:
        """End all that is left."""
        for process in reversed(self.started):
            if process.poll() is None:
                process.terminate()
                process.wait(timeout=30)

    def _start(self, module: str, *words: str) -> subprocess.Popen[bytes]:
        line = [sys.executable, "-m", f"distributed.cli.{module}", *words, "--no-dashboard"]
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.started.append(process)
        return process


@contextmanager
def own_cluster() -> Iterator[OwnCluster]:
    """Yield a cluster that ends with the block."""
    cluster = OwnCluster(free_port())
    try:
        cluster.start_scheduler()
        sleep(3.0)
        cluster.start_workers()
        yield cluster
    finally:
        cluster.end()


def free_port() -> int:
    """A port that is free."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def disturbed(plan: Path, out: Path) -> list[str]:
    """Run a campaign on a cluster of ours and do it harm; what was done, in words."""
    total = _cells(out.parent / "two")
    with own_cluster() as cluster:
        harm = [(0.25, cluster.kill_worker), (0.5, cluster.restart_scheduler), (0.75, cluster.kill_worker)]
        running = subprocess.Popen(
            command(plan, out, "--scheduler", cluster.address), stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        events, end = [], perf_counter() + MAX_S
        try:
            while running.poll() is None and perf_counter() < end:
                cluster.tend()
                if harm and _cells(out) >= harm[0][0] * total:
                    events.append(f"{_cells(out)} of {total} cells: {harm.pop(0)[1]()}")
                sleep(TICK_S)
        finally:
            if running.poll() is None:
                running.kill()
            said = running.communicate()[0].decode()
    if running.returncode or harm:
        raise CampaignError(f"the disturbed campaign failed with {len(harm)} harms to come: {said.strip()}")
    return [*events, *(line for line in said.splitlines() if line.startswith("note:"))]


def _cells(out: Path) -> int:
    folder = out / RESULTS_FOLDER
    return sum(name.endswith(".json") for name in os.listdir(folder)) if folder.is_dir() else 0


if __name__ == "__main__":
    harness.run(main)
