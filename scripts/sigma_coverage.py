"""Whether the smoother's sigmas hold 95 % of the errors: real walks, and simulated ways that do not come back.

    python scripts/sigma_coverage.py [--data DIR] [--only SET ...] [--seeds N] [--first SEED] [--length M] [--feet KIND]
                                     [--jobs N] [--per-walk] [--json FILE]

=========== ==========================================================================================================
vicon       28 trials with motion capture, own stances
gdin        10 indoor walks with surveyed footprints, without their magnetometer and with it as recorded
gdlbio      11 indoor walks with every footprint surveyed
simulated   ways of 700 m that end far from where they began, legs of 50 to 120 m within 60 degrees of one direction, a
            sensor in the heel; without a magnetometer, and with one in smooth and indoor fields; heading at the start
            given and not given. Feet that move on in stance as real ones do (`--feet still`: that do not)
=========== ==========================================================================================================

Of every walk: the share of footfalls whose error lies in the region of 95 %, after the gauge that the walk leaves open
(`joint_errors.py`: what is measured, and how the fit of the yaw is counted). A set's share is the mean over its walks.
`ends` is the share of walks whose last footfall is inside, `error / sigma` the root mean square over the footfalls of
a walk, the median over walks: 1 for true sigmas, above 1 for too small ones. Asked: 88 to 99 % of each.

True places are taken to be good to 1 mm (motion capture), surveyed footprints to 1 cm.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import TypeAlias

import harness
import joint_errors
import magnetic_walks
import numpy as np
import walks
from harness import Figure, option
from joint_errors import FEWEST, FREEDOM, Measured, Seen

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.errors import EvaluationError, FgNavError
from fg_nav.evaluation.comparison import interpolate_truth, match_footprints
from fg_nav.io import read
from fg_nav.lab.simulation import Choices, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Section, Stand
from fg_nav.lab.simulation.plan import Walk as Walking
from fg_nav.lab.simulation.scenarios import FEET, Feet
from fg_nav.pipeline import prepare_walk
from fg_nav.smoother.batch import smooth_graph
from fg_nav.solution import Solution
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth
from fg_nav.walk import Options, Walk

ASKED = 0.88, 0.99

FOOTPRINT_SIGMA_M, CAPTURE_SIGMA_M = 0.01, 0.001  # A foot on a mark on the floor, and a marker on a shoe.
FIRST_SEED = 401  # Of ways that no estimator was tuned on.

LEGS_M, TURNED_DEG, CORNER_M = (50.0, 120.0), 60.0, 1.2
REST_S = 5.0
FIELDS = (None, "smooth", "indoor")

WITHIN_S = 0.3  # A footprint is that of the stance so near to its instant; else its stance was not found.


@dataclass(frozen=True)
class Row:
    """What a walk of a section shows; `failure` in its place where it could not be measured."""

    section: str
    walk: str
    found: Mapping[str, Measured]
    failure: str = ""

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        parts = {
            name: {"inside": round(one.inside, 4), "end": one.ends_inside, "ratio": round(one.ratio, 3)}
            for name, one in self.found.items()
        }
        return {"section": self.section, "walk": self.walk, "failure": self.failure, **parts}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, judge."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        only=option(list(SETS), "sets of walks", nargs="+", choices=tuple(SETS)),
        seeds=20,
        first=FIRST_SEED,
        length=option(700.0, "of the simulated ways", metavar="M"),
        feet=option("moving", "of the simulated ways", choices=FEET),
        jobs=1,
        per_walk=False,
        json=None,
    )
    rows = [row for name in chosen.only for row in SETS[name](chosen)]
    if chosen.per_walk:
        print_walks(rows)
    figures = judge(rows)
    made = date.today().isoformat()
    harness.print_verdict(figures, chosen.json, made=made, walks=[row.as_dict() for row in rows])


# --- real walks ------------------------------------------------------------------------------------------------------

Chosen: TypeAlias = Namespace


def measure_vicon(chosen: Chosen) -> list[Row]:
    """Measure the motion-captured trials."""
    return _measure_recorded("vicon", walks.read_vicon_detected(walks.data_folder(chosen.data)), chosen.jobs)


def measure_gdin(chosen: Chosen) -> list[Row]:
    """Measure the surveyed walks without the magnetometer and with it."""
    data = walks.data_folder(chosen.data)
    rows = _measure_recorded("gdin", walks.read_gdin(data), chosen.jobs)
    with_field = partial(measure_with_field, data)
    return rows + harness.map_walks(with_field, walks.GDIN_WALKS, chosen.jobs, "gdin, magnetometer")


def measure_gdlbio(chosen: Chosen) -> list[Row]:
    """Measure the walks of which each footprint has its instant."""
    return _measure_recorded("gdlbio", walks.read_gdlbio(walks.data_folder(chosen.data)), chosen.jobs)


def _measure_recorded(section: str, chosen: Sequence[walks.Walk], jobs: int) -> list[Row]:
    return harness.map_walks(partial(measure_recorded, section), chosen, jobs, section)


def measure_recorded(section: str, walk: walks.Walk) -> Row:
    """Measure one real walk by its inertial sensor."""
    prepared = Walk(walk.recording, walk.stances, walk.recording.truth)
    return measure_walk(section, walk.name, prepared, 0.0, find_seen)


def measure_with_field(data: Path, number: int) -> Row:
    """Measure one indoor walk with its magnetometer, the heading at the start not given."""
    prepared = prepare_walk(Walk.of(read(walks.gdin_path(data, number)), Options()))
    return measure_walk("gdin, magnetometer", f"gdin {number}", prepared, None, find_seen)


See: TypeAlias = Callable[[Solution, Stances, Truth], Seen]
"""Finds the footfalls that a truth saw."""


def measure_walk(section: str, name: str, walk: Walk, heading: float | None, see: See) -> Row:
    """Smooth a walk, and measure it in the frame of its truth."""
    try:
        smoothed = smooth_graph(walk.recording, walk.stances, heading=heading, field=walk.field)
        solution, joint = smoothed.solution, smoothed.joint
        truth = walk.recording.truth if walk.truth is None else walk.truth
        assert truth is not None
        seen = see(solution, walk.stances, truth)
        return Row(section, name, joint_errors.measure_errors(solution.stances, joint, seen))
    except FgNavError as error:
        return Row(section, name, {}, str(error))


def find_seen(solution: Solution, stances: Stances, truth: Truth) -> Seen:
    """Footfalls that a truth in a frame of its own saw.

    Raises `EvaluationError` where they are fewer than `FEWEST`.
    """
    if isinstance(truth, FootprintTruth):
        row, place = _find_footprints(solution, stances, truth)
        place, sigma = np.column_stack([place, np.zeros(len(place))]), FOOTPRINT_SIGMA_M
    else:
        row, place = interpolate_truth(truth, solution.stances.t)
        sigma = CAPTURE_SIGMA_M
    if len(row) < FEWEST:
        raise EvaluationError(f"the truth saw {len(row)} footfalls: {FEWEST} are needed.")
    return Seen(row, place, sigma, isinstance(truth, TrajectoryTruth), None, is_aligned=False)


def _find_footprints(solution: Solution, stances: Stances, truth: FootprintTruth) -> tuple[Ints, Floats]:
    """Rows of the stance table that have a footprint, and these (M, 2) m."""
    if truth.t is None:
        match = match_footprints(solution.stances.position[:, :2], truth)
        return match.stance[match.found], truth.xy[match.found]
    instant = truth.t[:, None]
    outside = np.maximum(solution.t[stances.start] - instant, instant - solution.t[stances.stop - 1])
    nearest = outside.argmin(axis=1)
    found = outside.min(axis=1) < WITHIN_S
    row, first = np.unique(stances.footfall[nearest[found]], return_index=True)
    return row, truth.xy[found][first]


# --- simulated ways --------------------------------------------------------------------------------------------------


def measure_simulated(chosen: Chosen) -> list[Row]:
    """Measure ways that do not come back, in each field, with the heading at the start given and not."""
    tasks = [(field, seed) for field in FIELDS for seed in harness.seeds_of(chosen)]
    return [
        row
        for rows in harness.map_walks(partial(measure_way, chosen.length, chosen.feet), tasks, chosen.jobs, "ways")
        for row in rows
    ]


def measure_way(length_m: float, feet: Feet, task: tuple[str | None, int]) -> list[Row]:
    """Measure one way with its heading given and not.

    Without a field the two differ in what is open, not in the solution.
    """
    field, seed = task
    walk = make_way(length_m, feet, field, seed)
    rows = []
    for is_given in (True, False):
        section = f"simulated, {field or 'no magnetometer'}, heading {'given' if is_given else 'not given'}"
        prepared = magnetic_walks.prepare(walk, is_given or field is None)
        see = partial(find_simulated, is_aligned=field is not None or is_given)
        rows.append(measure_walk(section, f"{seed}", prepared, prepared.options.heading_rad, see))
    return rows


def make_way(length_m: float, feet: Feet, field: str | None, seed: int) -> SimulatedWalk:
    """Simulate a way."""
    sensor = magnetic_walks.make_sensor()
    base = replace(
        scenario("demo"),
        name=f"way of {length_m:g} m",
        route=partial(draw_route, length_m),
        worn="heel",
        sensor=sensor if field else replace(sensor, mag=None),
    )
    return simulate(base, seed, Choices(field=field or "homogeneous", feet=feet))


def draw_route(length_m: float, rng: np.random.Generator) -> list[Section]:
    """Draw a way of straight legs, standing before and after."""
    legs = max(round(length_m / np.mean(LEGS_M)), 1)
    heading = np.deg2rad(rng.uniform(-TURNED_DEG, TURNED_DEG, legs))
    moves = rng.uniform(*LEGS_M, legs)[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    path = polyline(np.vstack([np.zeros(2), np.cumsum(moves, axis=0)]), CORNER_M).scale_to(length_m)
    return [Stand(REST_S), Walking(path), Stand(REST_S)]


def find_simulated(solution: Solution, stances: Stances, truth: Truth, is_aligned: bool) -> Seen:
    """Footfalls that a simulated truth saw: all, with their attitudes."""
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    row, place = interpolate_truth(truth, solution.stances.t)
    return Seen(row, place, 0.0, True, truth.nav_R_body[solution.stances.sample[row]], is_aligned)


SETS: Mapping[str, Callable[[Chosen], list[Row]]] = {
    "vicon": measure_vicon,
    "gdin": measure_gdin,
    "gdlbio": measure_gdlbio,
    "simulated": measure_simulated,
}


# --- tables ----------------------------------------------------------------------------------------------------------


def judge(rows: Sequence[Row]) -> list[Figure]:
    """Print one table a section, and return the shares."""
    figures = []
    for section in dict.fromkeys(row.section for row in rows):
        some = [row for row in rows if row.section == section]
        harness.print_heading(f"{section}: {len(some)} walks")
        cells, failed = [], sum(bool(row.failure) for row in some)
        for name in FREEDOM:
            measured = [row.found[name] for row in some if name in row.found]
            # A walk that could not be measured has nothing inside; a set without heights has none to measure.
            count = len(measured) + failed
            if not count:
                continue
            inside, ends = (
                sum(values) / count for values in ([m.inside for m in measured], [m.ends_inside for m in measured])
            )
            figure = Figure(section, name, "smoother", inside, *ASKED, pattern="{:.2f}")
            figures.append(figure)
            ratio = harness.spread([one.ratio for one in measured], "{:.2f}")
            cells.append((name, f"{inside:.0%}", f"{ends:.0%}", ratio, figure.mark))
        harness.print_table(("95 % region", "footfalls inside", "ends inside", "error / sigma", "88 to 99 %"), cells)
    return figures


def print_walks(rows: Sequence[Row]) -> None:
    """Print one row a walk: shares inside, and error over sigma."""
    cells = [
        (
            row.section,
            row.walk,
            *(
                f"{row.found[name].inside:.0%} {row.found[name].ratio:.1f}" if name in row.found else "-"
                for name in FREEDOM
            ),
            row.failure,
        )
        for row in rows
    ]
    harness.print_table(("section", "walk", *FREEDOM, ""), cells)


if __name__ == "__main__":
    harness.run(main)
