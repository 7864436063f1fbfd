"""Are the lines of a walk in progress true at once? What they told at the moment against what the end makes of them.

    python scripts/online_honesty.py [--sets SET ...] [--walks NAME ...] [--seeds N] [--first SEED] [--told WHICH ...]
        [--against SOLUTION] [--inject] [--per-walk] [--data DIR] [--jobs N] [--json FILE]

Sets: gdin, openshoe and gdlbio as recorded (FG_NAV_DATA); office and mall, simulated over a smooth field and an indoor
one. Each walk is pushed through `OnlineNavigator` in blocks of half a second. `--told no` starts it without a heading,
`--told yes` with the true one; of a recorded walk with that at which the walk without one ended.

========== ===========================================================================================================
E N U head |told - smoothed| over the sigma told, the worst line of the walk: east, north, up, heading. Smoothed is the
           path at the same sample as it is known at the end (`--against polished`: in batch); what was told is not
           turned with the map
typical    median of the largest of the four, of the lines beyond `FAR_M` of path: far below one the sigmas say nothing
> 3, > 5   lines with one of the four beyond so many sigmas, %
at         s, of the worst line, and which of the four
end ratio  distance of the last line to the true end, over that of its smoothed estimate; a walk without a truth ends
           where it began. Both as the smoothed walk is laid: as started, or with the best yaw on footprints
gap        largest distance of the end of the stream and its batch solution at the same footfalls, m
taken back lines whose footfall the end does not have
========== ===========================================================================================================

`--inject`: to the footfalls found on the way one is added in the middle of a swing. Distance of the line that is told
ten footfalls later to that of the walk without it, m: as it is, and but for the turn of the map about its origin. With
one footfall more the walk is solved again at others, and a north that only the field shows is then another.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import harness
import numpy as np
from harness import FIRST_SEED, Figure, option, spread
from online_accuracy import BLOCK_S, GAP_BEFORE_M, SAME_FOOTFALL_S, gap_between
from walks import GDIN, GDIN_WALKS, GDLBIO_WALKED, OPENSHOE, REAL_WALKS, RUNNING, data_folder, gdlbio_path, real_path

from fg_nav.arrays import Floats
from fg_nav.detection.causal import CausalStances, Footfall
from fg_nav.errors import EstimationError
from fg_nav.evaluation.comparison import compare_at_footfalls
from fg_nav.frames import compute_heading, wrap_angle, yaw_rotation
from fg_nav.lab.campaign.walks import LOOP, Recorded, Simulated
from fg_nav.lab.walked import AS_STARTED, BEST_YAW
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import StanceEstimate
from fg_nav.solution import Solution
from fg_nav.truth import FootprintTruth, Truth
from fg_nav.walk import Walk

GDLBIO = "gdlbio"
SCENARIOS, FIELDS = ("office", "mall"), ("smooth", "indoor")
SIMULATED = tuple(f"{name} {level}" for name in SCENARIOS for level in FIELDS)
REAL = (GDIN, OPENSHOE, GDLBIO)
YES, NO = "yes", "no"
SMOOTHED, POLISHED = "smoothed", "polished"
COMPONENTS = ("east", "north", "up", "heading")

BEYOND, FAR_BEYOND = 3.0, 5.0
SHARE_BEYOND, END_RATIO, SHARE_OF_GAPS, INJECTED_M = 1.0, 1.3, 95.0, 0.2
"""Asked: percent of the lines beyond 3 sigmas (and none beyond 5); ratio of the end errors, median; percent of walks
with a gap of 0.1 m at most; m off ten footfalls after one that was false."""

FAR_M = 50.0  # Of path, behind which sigmas that are much too wide count as a fault too.
LATER, FALSE_SAMPLES = 10, 5  # Footfalls after the false one; its length.


@dataclass(frozen=True)
class Told:
    """What was said of one walk: K lines. Sample (K,), t (K,) s, position (K, 3), heading (K,), sigma (K, 4)."""

    sample: Floats
    t: Floats
    position: Floats
    heading: Floats
    sigma: Floats


@dataclass(frozen=True)
class Honesty:
    """Of one walk: see the table above; `ratio` (K, 4) at `t` (K,), NaN where it does not apply."""

    name: str
    ratio: Floats
    t: Floats
    typical: float
    taken_back: int
    end_ratio: float
    end_m: float
    gap: float
    injected_m: tuple[float, float] = (np.nan, np.nan)


def main(arguments: Sequence[str] | None = None) -> None:
    """Walk, compare, print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        sets=option([*REAL, *SIMULATED], "sets of walks: recorded, or 'SCENARIO LEVEL'", nargs="+"),
        walks=None,
        seeds=20,
        first=FIRST_SEED,
        told=option([NO, YES], "whether the heading is given", nargs="+", choices=(NO, YES)),
        against=option(SMOOTHED, "what the lines are compared with", choices=(SMOOTHED, POLISHED)),
        inject=option(False, "add a false footfall to each walk"),
        per_walk=False,
        data=None,
        jobs=1,
        json=None,
    )
    figures: list[Figure] = []
    rows: list[dict[str, object]] = []
    for name in chosen.sets:
        walks = list_walks(name, harness.seeds_of(chosen))
        walks = [walk for walk in walks if chosen.walks is None or f"{name} {walk}" in chosen.walks]
        for told in chosen.told if walks else ():
            tasks = [(name, walk, told, chosen.against, chosen.inject, chosen.data) for walk in walks]
            section = f"{name}, heading {'told' if told == YES else 'not told'}"
            found = harness.map_walks(measure_walk, tasks, chosen.jobs, section)
            figures += print_set(section, found, chosen.per_walk)
            rows += [{"set": name, "told": told, **as_row(one)} for one in found]
    figures += judge_all(rows)
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json, walks=rows)


def list_walks(name: str, seeds: Iterable[int]) -> list[str]:
    """Return the names of the walks of a set."""
    if name == GDIN:
        return [str(number) for number in (*GDIN_WALKS, *RUNNING)]
    if name == GDLBIO:
        return [str(number) for number in GDLBIO_WALKED]
    return list(REAL_WALKS[name]) if name in REAL else [str(seed) for seed in seeds]


def prepare(name: str, walk: str, data: Path | None) -> Walk:
    """Return a walk of a set, calibrated where it is simulated, with the heading at its start where that is known."""
    if name in REAL:
        folder = data_folder(data)
        path = gdlbio_path(folder, int(walk)) if name == GDLBIO else real_path(name, walk, folder)
        return Recorded(path).prepare(LOOP)
    scenario, level = name.rsplit(" ", 1)
    return Simulated(scenario, level, int(walk)).prepare(LOOP)


def measure_walk(task: tuple[str, str, str, str, bool, Path | None]) -> Honesty:
    """Push one walk through, and compare what it told with the end."""
    name, number, told, against, inject, data = task
    walk = prepare(name, number, data)
    heading = find_heading(walk) if told == YES else None
    lines, navigator = push_walk(walk, heading)
    smoothed, polished = navigator.finish(), navigator.polish()
    reference = smoothed if against == SMOOTHED else polished
    ratio = divide_by_sigma(lines, reference)
    far = walked_m(lines) > FAR_M
    end, end_ratio = compare_ends(lines, smoothed, walk.truth)
    return Honesty(
        name=number,
        ratio=ratio,
        t=lines.t,
        typical=float(np.median(ratio[far].max(axis=1))) if far.any() else np.nan,
        taken_back=int((np.abs(smoothed.stances.t[:, None] - lines.t).min(axis=0) > SAME_FOOTFALL_S).sum()),
        end_ratio=end_ratio,
        end_m=end,
        gap=gap_between(smoothed.stances, polished.stances)[0],
        injected_m=inject_footfall(walk, heading, lines) if inject else (np.nan, np.nan),
    )


def find_heading(walk: Walk) -> float:
    """Heading at the start, rad: the true one, or that of the end of a walk that was given none."""
    if walk.options.heading_rad is not None:
        return walk.options.heading_rad
    _, navigator = push_walk(walk, None)
    return float(compute_heading(navigator.finish().stances.nav_R_body[0]))


def push_walk(walk: Walk, heading: float | None, stances: CausalStances | None = None) -> tuple[Told, OnlineNavigator]:
    """Push a walk through in blocks, and keep the lines of its footfalls; further pieces of a standing are none."""
    recording = walk.recording
    navigator = OnlineNavigator(OnlineOptions(heading_rad=heading))
    if stances is not None:
        navigator._stances = stances
    block, lines = max(1, round(BLOCK_S / recording.period_s)), []
    for start in range(0, len(recording), block):
        part = np.s_[start : start + block]
        mag = None if recording.mag is None else recording.mag[part]
        lines += navigator.push(recording.t[part], recording.acc[part], recording.gyr[part], mag)
    lines += navigator.close()
    told = [line for line in lines if isinstance(line, StanceEstimate)]
    new = [line for line in told if not navigator.reported_continues[line.number]]
    return (
        Told(
            sample=np.array([line.sample for line in new]),
            t=np.array([line.t for line in new]),
            position=np.array([line.position for line in new]),
            heading=np.array([line.heading for line in new]),
            sigma=np.sqrt([np.diagonal(line.pose_cov) for line in new]),
        ),
        navigator,
    )


def divide_by_sigma(told: Told, reference: Solution) -> Floats:
    """(K, 4) differences of the lines to a path at their samples, over the sigmas told."""
    off = told.position - reference.position[told.sample]
    turned = wrap_angle(told.heading - compute_heading(reference.nav_R_body[told.sample]))
    return np.abs(np.column_stack([off, turned])) / told.sigma


def walked_m(told: Told) -> Floats:
    """(K,) length of the path to each line."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(told.position[:, :2], axis=0), axis=1)))


def compare_ends(told: Told, smoothed: Solution, truth: Truth | None) -> tuple[float, float]:
    """Distance over the ground of the last line to the true end, m, and its ratio to that of the smoothed walk."""
    if truth is None:
        start = smoothed.stances.position[0]
        off = np.array([told.position[-1] - start, smoothed.stances.position[-1] - start])
    else:
        found = compare_at_footfalls(smoothed, truth, BEST_YAW if isinstance(truth, FootprintTruth) else AS_STARTED)
        last = found.alignment.apply(told.position[[np.abs(told.t - found.t[-1]).argmin()]])
        off = np.array([last[0] - found.truth[-1], found.error[-1]])
    at_moment, at_end = np.linalg.norm(off[:, :2], axis=1)
    return float(at_moment), float(at_moment / at_end)


class WithFalseFootfall(CausalStances):
    """Reports a false footfall in the middle of the swing before the given footfall."""

    def __init__(self, before: int, gyr: Floats) -> None:
        super().__init__()
        self._before, self._gyr = before, gyr
        self._count, self._stop = 0, 0

    def search(self, t: Floats, acc: Floats, gyr: Floats) -> Iterator[Footfall]:
        """Add samples and yield the footfalls that they complete, and the false one."""
        for footfall in super().search(t, acc, gyr):
            if self._count == self._before and not footfall.continues:
                yield self._make_false(int(footfall.start[0]))
            self._count += not footfall.continues
            self._stop = int(footfall.stop[-1])
            yield footfall

    def _make_false(self, until: int) -> Footfall:
        """Where the foot turns least in the middle half of the swing: it moves fastest there, and looks still."""
        quarter = (until - self._stop) // 4
        middle = slice(self._stop + quarter, until - quarter)
        start = middle.start + int(np.linalg.norm(self._gyr[middle], axis=1).argmin()) - FALSE_SAMPLES // 2
        begin, end = np.array([start]), np.array([start + FALSE_SAMPLES])
        return Footfall(begin, end, np.ones(1), start + FALSE_SAMPLES // 2, False)


def inject_footfall(walk: Walk, heading: float | None, undisturbed: Told) -> tuple[float, float]:
    """Distances, m, of the tenth line after a false footfall in the middle of the walk to that without it.

    As it is, and with the map turned back by as much as the heading there differs.
    """
    before = len(undisturbed.t) // 2
    disturbed, _ = push_walk(walk, heading, WithFalseFootfall(before, walk.recording.gyr))
    after = min(before + LATER - 1, len(undisturbed.t) - 1)
    same = np.flatnonzero(disturbed.sample == undisturbed.sample[after])
    if not len(same):
        raise EstimationError(f"the line at {undisturbed.t[after]:.1f} s is missing behind a false footfall.")
    position, known = disturbed.position[same[-1]], undisturbed.position[after]
    turn_back = yaw_rotation(float(disturbed.heading[same[-1]] - undisturbed.heading[after]))
    return float(np.linalg.norm(position - known)), float(np.linalg.norm(turn_back @ position - known))


# --- tables ----------------------------------------------------------------------------------------------------------


def as_row(one: Honesty) -> dict[str, object]:
    """Return the figures of a walk, ready for JSON."""
    worst = one.ratio.max(axis=1)
    line = int(worst.argmax())
    return {
        "walk": one.name,
        "lines": len(worst),
        "worst": {name: float(value) for name, value in zip(COMPONENTS, one.ratio.max(axis=0), strict=True)},
        "worst_of": COMPONENTS[int(one.ratio[line].argmax())],
        "worst_t": float(one.t[line]),
        "beyond_3": int((worst > BEYOND).sum()),
        "beyond_5": int((worst > FAR_BEYOND).sum()),
        "typical": harness.finite(one.typical),
        "taken_back": one.taken_back,
        "end_ratio": harness.finite(one.end_ratio),
        "end_m": one.end_m,
        "gap_m": one.gap,
        "injected_m": harness.finite(one.injected_m[0]),
        "injected_turned_back_m": harness.finite(one.injected_m[1]),
    }


def print_set(section: str, found: Sequence[Honesty], per_walk: bool) -> list[Figure]:
    """Print the table of a set; returns its figures."""
    harness.print_heading(f"{section}: {len(found)} walks")
    headers = ("walk", "lines", "E", "N", "U", "head", "typical", "> 3", "> 5", "at", "end ratio", "gap", "taken back")
    rows = [_cells(one) for one in found] if per_walk else []
    ratio = np.concatenate([one.ratio for one in found])
    worst = ratio.max(axis=1)
    together = [f"{value:.1f}" for value in ratio.max(axis=0)]
    typical, ends, gaps = (np.array([getattr(one, name) for one in found]) for name in ("typical", "end_ratio", "gap"))
    rows.append(
        [
            "all",
            str(len(worst)),
            *together,
            spread(typical[np.isfinite(typical)]),
            f"{100 * (worst > BEYOND).mean():.1f} %",
            f"{100 * (worst > FAR_BEYOND).mean():.1f} %",
            "",
            spread(ends[np.isfinite(ends)]),
            spread(gaps),
            str(sum(one.taken_back for one in found)),
        ]
    )
    harness.print_table(headers, rows)
    injected = np.array([one.injected_m for one in found])
    figures = [
        Figure(section, f"{section}: worst line (sigmas)", "online", float(worst.max()), high=FAR_BEYOND),
        Figure(section, f"{section}: beyond 3 (%)", "online", float(100 * (worst > BEYOND).mean()), high=SHARE_BEYOND),
    ]
    if np.isfinite(injected).any():
        for how, most in zip(("", ", map turned back"), injected.max(axis=0), strict=True):
            name = f"{section}: off after a false footfall{how}, most (m)"
            figures.append(Figure(section, name, "online", float(most), high=INJECTED_M))
    return figures


def _cells(one: Honesty) -> list[str]:
    row, worst = as_row(one), one.ratio.max(axis=1)
    return [
        one.name,
        str(len(worst)),
        *(f"{value:.1f}" for value in one.ratio.max(axis=0)),
        harness.format_number(one.typical) if np.isfinite(one.typical) else "-",
        f"{100 * (worst > BEYOND).mean():.1f} %",
        f"{100 * (worst > FAR_BEYOND).mean():.1f} %",
        f"{row['worst_t']:.1f} {row['worst_of']}",
        f"{one.end_ratio:.2f}",
        f"{one.gap:.2f}",
        str(one.taken_back),
    ]


def judge_all(rows: Sequence[Mapping[str, object]]) -> list[Figure]:
    """Compare gaps and ends of all walks with what is asked."""
    gaps = np.array([row["gap_m"] for row in rows if row["set"] != GDLBIO], dtype=np.float64)
    ends = np.array([row["end_ratio"] for row in rows if row["set"] in REAL and row["end_ratio"]], dtype=np.float64)
    figures = []
    if len(gaps):
        name, share = f"gap of {GAP_BEFORE_M:g} m at most (% of walks)", float(100 * (gaps <= GAP_BEFORE_M).mean())
        figures.append(Figure("all", name, "online", share, low=SHARE_OF_GAPS))
    if len(ends):
        name = "end error over that of the smoothed end, median"
        figures.append(Figure("all", name, "online", float(np.median(ends)), high=END_RATIO))
    return figures


if __name__ == "__main__":
    harness.run(main)
