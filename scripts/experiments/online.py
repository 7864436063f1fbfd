"""The estimate at the moment: how good it is, whether its sigmas are true, and what a footfall costs.

Walks are pushed through `OnlineNavigator` in blocks of half a second, stances found on the way.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter, sleep
from typing import Any

import harness
import numpy as np
import walks
from harness import option

from experiments import Asked, Column, Experiment, Figures, Found, Task
from fg_nav.evaluation.comparison import compare_at_footfalls
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.campaign.methods import solve_by
from fg_nav.lab.campaign.walks import LOOP, Recorded, Simulated
from fg_nav.lab.walked import AS_STARTED, BEST_YAW
from fg_nav.online import OnlineNavigator, resolve
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.window import AnchorState
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth
from fg_nav.walk import Walk

REAL = (walks.GDIN, walks.OPENSHOE, walks.GDLBIO)
SIMULATED = [(name, level) for name in ("office", "mall") for level in ("smooth", "indoor")]
BLOCK_S = 0.5


def list_online(chosen: Namespace) -> list[Task]:
    """Recorded and simulated walks."""
    data, tasks = walks.data_folder(chosen.data), list[Task]()
    for name in REAL:
        tasks += [
            Task(name, one.name, partial(measure_lines, Recorded(one.path))) for one in walks.list_set(data, name)
        ]
    for case in SIMULATED:
        sources = [Simulated(*case, seed) for seed in harness.seeds_of(chosen)]
        tasks += [Task(" ".join(case), f"{one.seed}", partial(measure_lines, one)) for one in sources]
    return tasks


def measure_lines(source: Recorded | Simulated) -> Found:
    """Push a walk through with its heading given and not, and run the filter `ma2018` on it where it is simulated."""
    walk = source.prepare(LOOP)
    found: dict[str, Any] = {"heading not given": partial(measure_pushed, walk, None)}
    heading = walk.options.heading_rad
    if heading is None:  # of a recorded walk that at which the walk without one ended
        heading = float(compute_heading(push_walk(walk, None)[1].finish().stances.nav_R_body[0]))
    found["heading given"] = partial(measure_pushed, walk, heading)
    if isinstance(source, Simulated) and walk.truth is not None:
        filtered = solve_by("ma2018", replace(walk, truth=None)).solution
        found["ma2018"] = {"moment (m)": rms_error(filtered, filtered.stances, walk.truth)}
    return found


def measure_pushed(walk: Walk, heading: float | None) -> Figures:
    """Compare what a walk said with its end, and its end with the batch solution and the truth."""
    lines, navigator = push_walk(walk, heading)
    smoothed, polished = navigator.finish(), navigator.polish()
    # lines off the path at their samples as the end knows it, over the sigmas told
    names = ("sample", "position", "heading", "pose_cov")
    sample, position, told, covariance = (np.array([getattr(line, name) for line in lines]) for name in names)
    turned = wrap_angle(told - compute_heading(smoothed.nav_R_body[sample]))
    off = np.column_stack([position - smoothed.position[sample], turned])
    worst = (np.abs(off) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))).max(axis=1)
    # the end and the batch at the footfalls that are in both
    one, other = smoothed.stances, polished.stances
    _, ours, theirs = np.intersect1d(one.sample, other.sample, return_indices=True)
    apart = np.linalg.norm(one.position[ours] - other.position[theirs], axis=1)
    found = {
        "worst": float(worst.max()),
        "end ratio": compare_ends(lines, smoothed, walk.truth),
        "gap (m)": float(apart.max(initial=0.0)),
    }
    if isinstance(walk.truth, TrajectoryTruth) and heading is not None:
        assert smoothed.moment is not None
        found["moment (m)"] = rms_error(polished, smoothed.moment, walk.truth)
    return found


def push_walk(walk: Walk, heading: float | None) -> tuple[list[StanceEstimate], OnlineNavigator]:
    """Push a walk through in blocks, and keep the lines of its footfalls; further pieces of a standing are none."""
    navigator, recording = OnlineNavigator(OnlineOptions(heading_rad=heading)), walk.recording
    block, lines = max(1, round(BLOCK_S / recording.period_s)), []
    for start in range(0, len(recording), block):
        part = np.s_[start : start + block]
        mag = None if recording.mag is None else recording.mag[part]
        lines += navigator.push(recording.t[part], recording.acc[part], recording.gyr[part], mag)
    lines += navigator.close()
    said = [line for line in lines if isinstance(line, StanceEstimate)]
    return [line for line in said if not navigator.reported_continues[line.number]], navigator


def compare_ends(lines: Sequence[StanceEstimate], smoothed: Solution, truth: Truth | None) -> float:
    """Distance over the ground of the last line to the true end, over that of the smoothed walk.

    A walk without a truth ends where it began. Both are laid as the smoothed walk is.
    """
    if truth is None:
        start = smoothed.stances.position[0]
        off = np.array([lines[-1].position - start, smoothed.stances.position[-1] - start])
    else:
        found = compare_at_footfalls(smoothed, truth, BEST_YAW if isinstance(truth, FootprintTruth) else AS_STARTED)
        last = min(lines, key=lambda line: abs(line.t - found.t[-1]))
        off = np.array([found.alignment.apply(last.position) - found.truth[-1], found.error[-1]])
    at_moment, at_end = np.linalg.norm(off[:, :2], axis=1)
    return float(at_moment / at_end)


def rms_error(solution: Solution, table: StanceTable, truth: Truth) -> float:
    """Over the ground, laid as started, m."""
    laid = compare_at_footfalls(replace(solution, stances=table), truth, AS_STARTED)
    return float(np.sqrt(np.mean((laid.error[:, :2] ** 2).sum(axis=1))))


# --- a footfall ------------------------------------------------------------------------------------------------------

AT_ONCE_S, FOOTFALLS_HZ = 0.1, 100.0  # samples that come at once, and how many a second
PERCENTILES = {"p50": 50, "p99": 99, "longest": 100}


def measure_footfalls(minutes: float) -> Found:
    """Time each push that returns a line."""
    recording = walks.simulate_long_walk(minutes, harness.FIRST_SEED, FOOTFALLS_HZ, "indoor")
    navigator, ms = OnlineNavigator(OnlineOptions(heading_rad=0.0)), list[float]()
    solver = PacedSolver(navigator)
    block = round(AT_ONCE_S * FOOTFALLS_HZ)
    for start in range(0, len(recording), block):
        part, idle_s = np.s_[start : start + block], solver.idle_s
        mag = None if recording.mag is None else recording.mag[part]
        began = perf_counter()
        lines = navigator.push(recording.t[part], recording.acc[part], recording.gyr[part], mag)
        elapsed_s = perf_counter() - began - (solver.idle_s - idle_s)
        if any(isinstance(line, StanceEstimate) for line in lines):
            ms.append(1e3 * elapsed_s)
    solver.close()
    return {"online": {name: float(np.percentile(ms, q)) for name, q in PERCENTILES.items()}}


class PacedSolver(resolve.Solver):
    """Is given the time that it would have had; `idle_s` is how long it was waited for within that."""

    def __init__(self, navigator: OnlineNavigator) -> None:
        options, self._buffer = navigator.options, navigator.buffer
        self.process = resolve.SolverProcess({None: options})
        super().__init__(resolve.WalkSolver(options, self._buffer), self.process)
        self.idle_s, self._begun = 0.0, (0.0, 0.0)
        navigator._solver = navigator.smoother.solver = self

    def begin(self, task: resolve.Task) -> None:
        """As it does, and note when."""
        self._begun = perf_counter(), self._buffer.newest_s
        super().begin(task)

    def take(self) -> AnchorState | None:
        """As it does, after as long as the walk took since the task."""
        began = perf_counter()
        due = self._begun[0] + self._buffer.newest_s - self._begun[1]
        while not self.is_ready() and perf_counter() < due:
            sleep(0.001)
        self.idle_s += perf_counter() - began
        return super().take()


EXPERIMENTS: Mapping[str, Experiment] = {
    "online": Experiment(
        """Are the lines of a walk in progress true at once, and how near are they to the batch solution.

        Worst |line - smoothed| over the sigma told, of east, north, up and heading; end ratio: distance of the last
        line to the true end over that of the smoothed walk; gap: largest distance of the end of the stream and its
        batch solution at the same footfalls; moment: error of the estimates as reported, rms over the footfalls, beside
        that of `ma2018`, a filter.""",
        list_online,
        (
            Column("worst", "worst", "worst", "{:.1f}"),
            Column("end ratio", "end ratio", pattern="{:.2f}"),
            Column("gap (m)", "gap (m)", "median / worst"),
            Column("moment (m)", "moment (m)"),
            Column("moment (m)", "over ma2018", "median", "{:.2f}", "ma2018"),
        ),
        [
            Asked("worst", "worst", high=5.0),
            *(Asked("end ratio", "median", high=1.3, section=name) for name in REAL),
            Asked("gap (m)", "p95", high=0.1),
            Asked("moment (m)", "median", high=0.7, variant="heading given", over="ma2018"),
        ],
        seeds=20,
    ),
    "footfalls": Experiment(
        """What a footfall costs online, however long the walk, from the push that completes it to its line, ms.

        `OnlineNavigator.push` for hours round a corridor with a magnetometer at 100 Hz, a tenth of a second at a time,
        solved again in a process beside it. The walk is pushed faster than it was walked, so where it waits for the
        other process, the time that this would have had is not counted.""",
        lambda chosen: [Task("the whole walk", "1", partial(measure_footfalls, chosen.minutes))],
        [Column(name, name, "mean", "{:.1f}") for name in PERCENTILES],
        [Asked(name, "mean", high=high) for name, high in (("p50", 10), ("p99", 60), ("longest", 250))],
        options={"minutes": option(20.0, "of walking", metavar="N")},
    ),
}
