"""What a walk gains where it comes back to places that its field shows, and what it loses where it does not.

    python scripts/returning_walks.py [--sections NAME ...] [--seeds N] [--first SEED] [--data DIR] [--jobs N]
                                      [--minutes M ...] [--feet KIND] [--json FILE]

Each walk is smoothed with places (`SmootherParameters.walk.places`) and without, on a magnetometer that was calibrated
on a loop. Simulated walks begin at seed 101; what was tuned was tuned on seeds 1 to 8. The simulator's feet come back
to within 0.07 m of their old line; people do not. So the path itself wanders to the side, by 0.25 m (rms, correlation
length 5 m), independently on each lap: two passes are 0.35 m apart (rms). `--feet moving` lets the feet move on in
stance as real ones do, which is in the sigmas.

======== ============================================================================================================
laps     three laps of the office and of the mall, in smooth and indoor fields, the heading at the start given and not.
         Horizontal error, rms over the footfalls of the first lap and of the last: after the best yaw over the walk,
         and, where the heading is given, as started. error / sigma: of all footfalls (`joint_errors.py`)
ten      the same of ten laps of the office
alone    walks of some 200 m that never return: a part of office-open, corridors 3 m apart, two floors above each other,
         rows of a building that repeats itself every 10 m. Error with places over without; false: footfalls
         that are said to be at the place of one from which they are more than 2 m away
cost     time of the processor with places over without, rounds of one corridor of 77 m
feet     the gdin and openshoe walks: error at footprints (m), or closure (%)
======== ============================================================================================================
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TypeAlias

import harness
import joint_errors
import numpy as np
import walks
from harness import Figure, option, spread
from place_recognition import Repeating, corridors, move_aside
from real_fields import MERITS

from fg_nav.arrays import Floats
from fg_nav.calibration.of_recording import Calibration
from fg_nav.detection import detect_stances
from fg_nav.evaluation.comparison import align, interpolate_truth
from fg_nav.frames import compute_heading
from fg_nav.lab.campaign.walks import RAW, Recorded, simulate_calibration
from fg_nav.lab.landmarks import measure_landmarks
from fg_nav.lab.simulation import Choices, Scenario, SimulatedWalk, routes, scenario, simulate
from fg_nav.lab.simulation.fields import Field, draw_environment
from fg_nav.lab.simulation.path import Path, open_curve, polyline
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, Walk, end_of
from fg_nav.lab.simulation.scenarios import FEET, Feet
from fg_nav.magnetic import average_footfall_field
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters
from fg_nav.smoother.batch import SmoothedWalk, smooth_graph
from fg_nav.solution import StanceTable
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options
from fg_nav.walk import Walk as Prepared

SECTIONS = ("laps", "ten", "alone", "cost", "feet")
LEVELS = ("smooth", "indoor")
HEADINGS = {True: "given", False: "not given"}
PLACES = {True: "with", False: "without"}

WITH, WITHOUT = (
    replace(SmootherParameters(), walk=replace(SmootherParameters().walk, places=places)) for places in (True, False)
)

KNOT_M = 0.5  # Between the points that a wandering path goes through: less than half the radius of a corner.
FALSE_M = 2.0  # So far apart are the footfalls of a false tie.

GROWTH, LANDMARK_MEAN_M, LANDMARK_MAX_M = 1.2, 0.75, 2.0
"""Asked of the last lap's error over the first one's, and of the errors at the mall's landmarks."""

WORSE, COST = 1.03, 1.5  # Asked of a walk that does not return, and of 30 minutes.


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        sections=option(SECTIONS, "which", nargs="+", choices=SECTIONS),
        seeds=20,
        first=harness.FIRST_SEED,
        data=None,
        jobs=1,
        minutes=option([10.0, 30.0, 60.0, 120.0], "of the walks of `cost`", type=float, nargs="+", metavar="M"),
        feet=option("still", "of the simulated walks", choices=FEET),
        json=None,
    )
    figures = [figure for name in chosen.sections for figure in MEASURE[name](chosen)]
    harness.print_verdict(figures, chosen.json)


# --- walks ------------------------------------------------------------------------------------------------------------

Surround: TypeAlias = Callable[[str, SimulatedWalk, np.random.Generator], Field]
"""Draws the field of a level about a walk."""


@dataclass(frozen=True)
class Course:
    """A walk to be simulated, and what draws its field where that is not the scenario's own."""

    name: str
    scenario: Scenario
    laps: int = 1
    surround: Surround | None = None
    feet: Feet | None = None

    def draw(self, level: str, seed: int) -> tuple[SimulatedWalk, Prepared]:
        """Return the walk and what the smoother gets of it, with its true heading at the start."""
        plain = "homogeneous" if self.surround else level
        walk = simulate(self.scenario, seed, Choices(field=plain, feet=self.feet))
        recording, truth = walk.recording, find_truth(walk)
        assert recording.mag is not None
        assert truth.nav_R_body is not None
        if self.surround:
            field = self.surround(level, walk, np.random.default_rng([seed, 9]))
            place = truth.position + walk.origin
            change = field.at(place) - walk.earth.at(place)
            recording = replace(recording, mag=recording.mag + np.einsum("nji,nj->ni", truth.nav_R_body, change))
        options = Options(heading_deg=float(np.degrees(compute_heading(truth.nav_R_body[0]))))
        return walk, prepare_walk(Prepared.of(recording, options, calibrate(seed)))


@cache
def calibrate(seed: int) -> Calibration:
    """Calibrate the shoe and sensor of a seed, which are those of all these walks, on a loop."""
    return simulate_calibration("office", seed)


def find_truth(walk: SimulatedWalk) -> TrajectoryTruth:
    """Where the sensor was."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    return truth


def walk_laps(name: str, laps: int) -> Course:
    """So many laps of a scenario that has three, each of them a little aside of the others."""
    base = scenario(name)

    def route(rng: np.random.Generator) -> list[Section]:
        begin, walk, end = base.route(rng)
        assert isinstance(walk, Walk)
        lap = walk.path.part(0.0, walk.path.length_m / 3)
        strides = None if walk.strides is None else walk.strides * laps // 3
        wander = int(rng.integers(2**31))
        return [begin, replace(walk, path=move_path(lap.repeat(laps), wander), strides=strides), end]

    return Course(f"{name}, {laps} laps", replace(base, name=f"{name}-{laps}", route=route), laps)


def move_path(path: Path, seed: int) -> Path:
    """Let a path wander to its sides (`place_recognition.move_aside`); landmarks stay where they are along it."""
    arc = np.linspace(0.0, path.length_m, round(path.length_m / KNOT_M) + 1)
    place = path.at(arc)[0]
    aside = move_aside(place, seed)
    fade = np.minimum(1.0, np.minimum(arc, arc[-1] - arc) / 5.0)
    moved = open_curve(place + fade[:, None] * aside)
    chord = np.linalg.norm(np.diff(place + fade[:, None] * aside, axis=0)[:, :2], axis=1)
    walked = np.concatenate([[0.0], np.cumsum(chord)]) * moved.length_m / chord.sum()
    marks = np.interp([mark.arc for mark in path.landmarks], arc, walked)
    return moved.with_landmarks(marks, [mark.name for mark in path.landmarks])


OFFICE, MALL, TEN = walk_laps("office", 3), walk_laps("mall", 3), walk_laps("office", 10)


# --- walks that do not return -----------------------------------------------------------------------------------------

CORRIDOR_M, SHORT_M = 32.0, 220.0
ROWS_M = 10.0  # By which the repeating building repeats itself.
FLOOR_M = 19 * 0.17  # Between two floors: as many stairs.


def walk_serpentine(corners: Floats) -> list[Section]:
    """Along corners, with a rest at both ends."""
    return [Stand(5.0), Walk(polyline(corners, routes.CORNER_M)), Stand(5.0)]


def walk_floors() -> list[Section]:
    """Three corridors, the stairs, and round to the same three a floor higher."""
    first = corridors(3, 8.0, CORRIDOR_M)
    below, stairs = Walk(polyline(first, routes.CORNER_M)), Stairs(19)
    east, north, up = end_of(stairs, end_of(below, below.path.start)).position
    corners = [(east, north), (east + 6.0, north), (east + 6.0, 0.0), (0.0, 0.0), (0.0, 8.0)]
    corners += [(CORRIDOR_M, 8.0), (CORRIDOR_M, 16.0), (0.0, 16.0)]
    above = Walk(polyline([(*corner, up) for corner in corners], routes.CORNER_M))
    return [Stand(5.0), below, stairs, above, Stand(5.0)]


@dataclass(frozen=True)
class Floors:
    """The field of two floors, each with its own; half and half in the middle of the stairs."""

    below: Field
    above: Field

    def at(self, place: Floats) -> Floats:
        """(N, 3) uT."""
        share = np.clip(place[:, 2:] / FLOOR_M * 2.0 - 0.5, 0.0, 1.0)
        return np.asarray((1.0 - share) * self.below.at(place) + share * self.above.at(place))


def surround_rows(level: str, walk: SimulatedWalk, rng: np.random.Generator) -> Field:
    """Draw the first row of a building, of which all others are copies."""
    foot = walk.strides.footprint
    first = foot[foot[:, 1] < 0.5 * ROWS_M]
    return Repeating(draw_environment(level, walk.earth, first, rng), ROWS_M)


def surround_floors(level: str, walk: SimulatedWalk, rng: np.random.Generator) -> Field:
    """Draw a floor, and another one above it."""
    foot = walk.strides.footprint
    upper = foot[:, 2] > 0.5 * FLOOR_M
    parts = [foot[~upper] * [1.0, 1.0, 0.0], foot[upper] * [1.0, 1.0, 0.0] + [0.0, 0.0, FLOOR_M]]
    return Floors(*(draw_environment(level, walk.earth, part, rng) for part in parts))


def shorten_open(rng: np.random.Generator) -> list[Section]:
    """The first part of office-open."""
    begin, walk, end = routes.office_open(rng)
    assert isinstance(walk, Walk)
    return [begin, replace(walk, path=walk.path.part(0.0, SHORT_M), strides=None), end]


def _make_alone(name: str, route: Callable[[np.random.Generator], list[Section]], surround: Surround | None) -> Course:
    return Course(name, replace(scenario("office-open"), name=name, route=route), surround=surround)


ALONE = (
    _make_alone("open", shorten_open, None),
    _make_alone("parallel", lambda _: walk_serpentine(corridors(6, 3.0, CORRIDOR_M)), None),
    _make_alone("floors", lambda _: walk_floors(), surround_floors),
    _make_alone("repeating", lambda _: walk_serpentine(corridors(5, ROWS_M, CORRIDOR_M)), surround_rows),
)


# --- errors -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Errors:
    """Errors of one smoothed walk.

    Attributes
    ----------
    laps : (L,) m, rms over the ground of the footfalls of each lap after the best yaw.
    started : (L,) the same as started.
    ratio : error over sigma over the ground, rms.
    ties, false : footfalls that are said to be at an earlier place, and those that are not.
    landmark_m : error at each crossing of a landmark.
    """

    laps: Floats
    started: Floats
    ratio: float
    ties: int
    false: int
    landmark_m: Floats

    @property
    def all_m(self) -> float:
        """Of the walk: laps are equally long."""
        return float(np.sqrt(np.mean(self.laps**2)))


def measure_errors(walk: SimulatedWalk, smoothed: SmoothedWalk, laps: int, is_given: bool) -> Errors:
    """Measure a solution against the truth."""
    solution, truth = smoothed.solution, find_truth(walk)
    assert truth.nav_R_body is not None
    table = solution.stances
    row, place = interpolate_truth(truth, table.t)
    assert len(row) == len(table)
    lap = np.minimum(find_walked(place) * laps, laps - 1e-9).astype(int)
    found = {}
    for mode in ("yaw", "origin"):
        error = np.linalg.norm((align(table.position, place, mode).apply(table.position) - place)[:, :2], axis=1)
        found[mode] = np.sqrt([np.mean(error[lap == k] ** 2) for k in range(laps)])
    seen = joint_errors.Seen(row, place, 0.001, True, truth.nav_R_body[table.sample], is_aligned=is_given)
    ratio = joint_errors.measure_errors(table, smoothed.joint, seen)["horizontal"].ratio
    at_landmarks = np.zeros(0)
    if walk.landmarks:
        names, times, places = zip(*((p.landmark, p.time_s, p.position) for p in walk.landmarks), strict=True)
        aligned = align(table.position, place, "yaw")
        at_landmarks = measure_landmarks(solution, names, np.array(times), np.array(places), aligned).error_m
    return Errors(found["yaw"], found["origin"], ratio, *count_ties(table, place), at_landmarks)


def find_walked(place: Floats) -> Floats:
    """Share (F,) of the path that was walked at each footfall."""
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1))])
    return np.asarray(walked / walked[-1])


def count_ties(table: StanceTable, place: Floats) -> tuple[int, int]:
    """Footfalls that are said to be at the place of an earlier one, and how many of them are not."""
    if table.same_place is None:
        return 0, 0
    later = np.flatnonzero(table.same_place >= 0)
    apart = np.linalg.norm(place[later] - place[table.same_place[later]], axis=1)
    return len(later), int(np.sum(apart > FALSE_M))


Case: TypeAlias = tuple[bool, bool]
"""Whether the heading was given, and whether with places."""


def measure_walk(course: Course, level: str, seed: int) -> dict[Case, Errors]:
    """Smooth one walk in all cases."""
    walk, prepared = course.draw(level, seed)
    found = {}
    for is_given in HEADINGS:
        heading = prepared.options.heading_rad if is_given else None
        for places, parameters in ((True, WITH), (False, WITHOUT)):
            smoothed = smooth_graph(prepared.recording, prepared.stances, parameters, heading, field=prepared.field)
            found[is_given, places] = measure_errors(walk, smoothed, course.laps, is_given)
    return found


def measure_courses(
    chosen: argparse.Namespace, courses: Sequence[Course]
) -> dict[tuple[str, str], list[dict[Case, Errors]]]:
    """Measure all seeds of courses in both fields."""
    return {
        (course.name, level): harness.map_walks(
            partial(measure_walk, replace(course, feet=chosen.feet), level),
            harness.seeds_of(chosen),
            chosen.jobs,
            f"{course.name}, {level}",
        )
        for course in courses
        for level in LEVELS
    }


# --- laps -------------------------------------------------------------------------------------------------------------


def measure_laps(chosen: argparse.Namespace) -> list[Figure]:
    """Three laps."""
    return print_laps(f"Three laps, {chosen.seeds} seeds", measure_courses(chosen, (OFFICE, MALL)))


def measure_ten(chosen: argparse.Namespace) -> list[Figure]:
    """Ten laps."""
    return print_laps(f"Ten laps, {chosen.seeds} seeds", measure_courses(chosen, (TEN,)))


def print_laps(title: str, found: Mapping[tuple[str, str], Sequence[Mapping[Case, Errors]]]) -> list[Figure]:
    """One row a walk, field, heading and smoother."""
    rows, figures, landmarks = [], [], []
    for (name, level), seen in found.items():
        for is_given, heading in HEADINGS.items():
            words = f"{name}, {level}, {heading}"
            for places, of in PLACES.items():
                some = [one[is_given, places] for one in seen]
                growth = [one.laps[-1] / one.laps[0] for one in some]
                started = [spread([one.started[k] for one in some]) if is_given else "-" for k in (0, -1)]
                rows.append(
                    [
                        words,
                        of,
                        *(spread([one.laps[k] for one in some]) for k in (0, -1)),
                        spread(growth),
                        *started,
                        spread([one.ratio for one in some]),
                        f"{sum(one.false for one in some)} of {sum(one.ties for one in some)}",
                    ]
                )
                if some[0].landmark_m.size:
                    mean, most = ([float(of_one(one.landmark_m)) for one in some] for of_one in (np.mean, np.max))
                    landmarks.append([words, of, spread(mean), spread(most)])
                    if places:
                        figures += [
                            Figure(words, f"landmarks, {what} (m), median", of, float(np.median(values)), high=high)
                            for what, values, high in (
                                ("mean", mean, LANDMARK_MEAN_M),
                                ("largest", most, LANDMARK_MAX_M),
                            )
                        ]
                if places:
                    figures.append(Figure(words, "last lap over first", of, float(np.median(growth)), high=GROWTH))
    harness.print_heading(title)
    heads = ["walk, field, heading", "places", "lap 1 (m)", "last lap (m)", "last / 1", "lap 1 as started (m)",
             "last lap as started (m)", "error / sigma", "false"]  # fmt: skip
    harness.print_table(heads, rows)
    if landmarks:
        harness.print_table(["at the landmarks", "places", "mean (m)", "max (m)"], landmarks)
    return figures


# --- alone ------------------------------------------------------------------------------------------------------------


def measure_alone(chosen: argparse.Namespace) -> list[Figure]:
    """Walks that do not return."""
    found = measure_courses(chosen, ALONE)
    rows, figures = [], []
    for (name, level), seen in found.items():
        for is_given, heading in HEADINGS.items():
            words = f"{name}, {level}, {heading}"
            pairs = [(one[is_given, True], one[is_given, False]) for one in seen]
            ratio = [a.all_m / b.all_m for a, b in pairs]
            tied, false = (sum(getattr(a, what) for a, _ in pairs) for what in ("ties", "false"))
            wrong = sum(a.false > 0 for a, _ in pairs)
            rows.append(
                [words, f"{len(pairs)}", spread([b.all_m for _, b in pairs]), spread(ratio), f"{max(ratio):.3f}",
                 f"{sum(a.ties > 0 for a, _ in pairs)}", f"{wrong}", f"{false} of {tied}"]
            )  # fmt: skip
            figures += [
                Figure(words, "worst error over that without", "with", max(ratio), high=WORSE),
                Figure(words, "walks with false ties", "with", wrong, high=0, pattern="{:.0f}"),
            ]
    harness.print_heading(f"Walks that do not return, {chosen.seeds} seeds")
    heads = ["walk, field, heading", "walks", "without (m)", "with / without", "worst", "with ties", "with false ones",
             "false footfalls"]  # fmt: skip
    harness.print_table(heads, rows)
    return figures


# --- cost -------------------------------------------------------------------------------------------------------------


def measure_cost(chosen: argparse.Namespace) -> list[Figure]:
    """Time of the processor by the length of the walk."""
    whole = walks.simulate_long_walk(max(chosen.minutes), chosen.first, field="indoor")
    rows, figures, before = [], [], (0.0, 0.0)
    for minutes in sorted(chosen.minutes):
        recording = whole.slice(0, min(round(60.0 * minutes / whole.period_s), len(whole)))
        seconds = [measure_seconds(recording, parameters) for parameters in (WITHOUT, WITH)]
        more = seconds[1] - seconds[0]
        doubling = f"{more / before[1]:.1f} for {minutes / before[0]:.1f}" if before[0] else "-"
        before = minutes, more
        ratio = seconds[1] / seconds[0]
        rows.append([f"{minutes:g}", *(f"{s:.1f}" for s in seconds), f"{ratio:.2f}", f"{more:.1f}", doubling])
        high = COST if minutes == 30.0 else np.inf
        figures.append(Figure("cost", f"with over without, {minutes:g} min", "with", ratio, high=high))
    harness.print_heading("Time of the processor, rounds of one corridor")
    harness.print_table(["minutes", "without (s)", "with (s)", "with / without", "more (s)", "more, growth"], rows)
    return figures


def measure_seconds(recording: Recording, parameters: SmootherParameters) -> float:
    """Time of the processor that the smoother takes."""
    stances = detect_stances(recording)
    field = average_footfall_field(recording, stances)
    return harness.measure_time(lambda: smooth_graph(recording, stances, parameters, 0.0, field=field))[0].cpu


# --- real feet --------------------------------------------------------------------------------------------------------


def measure_feet(chosen: argparse.Namespace) -> list[Figure]:
    """The real walks with a magnetometer."""
    data, rows, figures = walks.data_folder(chosen.data), [], []
    for group, names in walks.REAL_WALKS.items():
        found = []
        for name in names:
            walk = Recorded(walks.real_path(group, name, data)).prepare(RAW)
            values, ties = [], []
            for places in (False, True):
                changed = replace(walk.options, changes=(("smoother.walk.places", places),))
                outcome = run_method(replace(walk, options=changed), "smoother")
                metrics = outcome.metrics
                value = metrics.closure_percent if walk.truth is None else metrics.rmse_2d_m
                values.append(float("inf") if value is None else value)
                ties = [one.length_m for one in outcome.solution.returns]
            found.append(values)
            many = f"{len(ties)}, {sum(ties):.0f} m" if ties else "none"
            rows.append([f"{group} {name}", *(f"{v:.3f}" for v in values), f"{values[1] / values[0]:.3f}", many])
        without, with_places = np.mean(found, axis=0)
        rows.append([f"{group}, mean: {MERITS[group]}", f"{without:.3f}", f"{with_places:.3f}", "", ""])
        figures.append(Figure("feet", f"{group}, mean over that without", "with", with_places / without))
    harness.print_heading("Real feet")
    harness.print_table(["walk", "without", "with", "ratio", "returns"], rows)
    return figures


MEASURE: Mapping[str, Callable[[argparse.Namespace], list[Figure]]] = {
    "laps": measure_laps,
    "ten": measure_ten,
    "alone": measure_alone,
    "cost": measure_cost,
    "feet": measure_feet,
}

if __name__ == "__main__":
    harness.run(main)
