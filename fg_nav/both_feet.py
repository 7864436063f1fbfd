"""Two recordings of one walk, of a sensor on each foot, navigated as one.

    prepare_walk    each recording: all that is checked and corrected of one foot's         (`fg_nav.pipeline`)
    match_swings    the second recording's clock set to the first one's                     (`fg_nav.feet.clocks`)
    headings        of both sensors at their starts, by the directions of the steps         (`fg_nav.feet.steps`)
    smooth_feet     both feet in one graph                                                  (`fg_nav.smoother.feet`)
    sides           which recording is of which foot: by the user, or by the width between
    FeetResult      each foot and the person, measured and judged

The person is the middle of both sensors (`fg_nav.feet.person`). A foot whose recording cannot be navigated leaves the
other as it is alone, and the person is where that one is; feet that nothing ties are two walks with a remark, and the
person is where the left one is.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from fg_nav.errors import DetectionError, EstimationError, EvaluationError, FgNavError
from fg_nav.estimators import Progress, blaming_changes, check_use, choose_parameters, estimate, find_method
from fg_nav.evaluation.comparison import compare, interpolate_truth
from fg_nav.evaluation.metrics import Metrics, evaluate
from fg_nav.feet import SIDES, Side
from fg_nav.feet.clocks import ClockOffset, list_swings, match_swings
from fg_nav.feet.person import FeetSolution, trace_person
from fg_nav.feet.steps import Footfalls, keep_longest_part, keep_walked_parts, measure_relative_heading
from fg_nav.gait import tabulate_gait
from fg_nav.io import Reading
from fg_nav.pipeline import Result, prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.samples.gaps import find_holes, list_bridged
from fg_nav.solution import Rows, Solution
from fg_nav.text import format_count
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth
from fg_nav.verdict import UNUSABLE, Verdict, Word
from fg_nav.walk import Options, Outcome, Walk, add_known, check_known, evaluate_solution, measure_field, read_walk

if TYPE_CHECKING:
    import pandas as pd

Order: TypeAlias = Literal["left,right", "right,left"]
"""Feet of the first and of the second recording."""

Known: TypeAlias = Literal["named", "shown", "assumed"]
"""How it is known which recording is of which foot: by the user, by the steps, or not."""

MIN_FOOTFALLS = 4  # Of a foot that walked: three strides or fewer are no walk (`fg_nav.verdict`).
LOST_SHARE = 0.5  # Of the other foot's footfalls: a foot with fewer recorded for less than half of the walk.
MAX_GAP_S = 3600.0  # Parts of a recording stay, as the other foot goes on between; more is a clock that was set.
CLEAR_SIGMAS = 3.0  # From zero, at which the width shows which foot is which.
WORDS: tuple[Word, ...] = ("trusted", "doubtful", UNUSABLE)  # From the best to the worst.

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Pairing:
    """How two recordings were put together."""

    order: tuple[Side, Side]  # feet of the first and of the second recording, and `sides` how that is known
    sides: Known
    # was added to the second recording's stamps; `clock_given` by the user, else by the signals
    clock_offset_s: float = 0.0
    clock_given: bool = False
    clock_drift: float = 0.0  # by how much more with each second since its start, s/s
    # between the sensors, across the way; None where one foot is missing, or nothing ties them
    width_m: float | None = None
    width_sigma_m: float | None = None
    cells: int = 0  # of steps that tie the feet
    beyond_reach: int = 0  # pairs of footfalls that were out of reach of each other before they were tied
    heading_deg: float | None = None  # of the left sensor at its start, as it was given; None where it was not
    doubts: tuple[str, ...] = ()  # sentences that make the result doubtful


@dataclass(frozen=True, repr=False)
class FeetResult(Solution):
    """The person's path as a `Solution`, and both feet: what `fg_nav.navigate_feet` returns.

    Attributes
    ----------
    feet : the `Result` of each foot that was navigated, by its side; stamps are of the first recording's clock.
    pairing : how the recordings were put together: width, clocks, which is which foot.
    outcome : of the person, against the middle of both feet's truths where they have one.
    truth : of the person.

    Examples
    --------
    >>> result = fg_nav.navigate_feet("left.csv", "right.csv", "inertial")
    >>> sorted(result.feet), result.position.shape == (len(result.t), 3)  # m, between the feet
    (['left', 'right'], True)
    >>> result.stances.position_sigma.shape == (len(result.stances), 3)  # m, a row a footfall of the left foot
    True
    """

    feet: Mapping[Side, Result] = field(kw_only=True)
    pairing: Pairing = field(kw_only=True)
    outcome: Outcome = field(kw_only=True)
    truth: TrajectoryTruth | None = field(kw_only=True, default=None)

    @classmethod
    def of(
        cls,
        feet: Mapping[Side, Result],
        solved: FeetSolution | None,
        pairing: Pairing,
        notes: tuple[str, ...] = (),
        lost: Mapping[Side, str] = {},
        untied: str = "",
    ) -> FeetResult:
        """Join the results of the feet, and evaluate the person's path against the mean of both true paths.

        `solved` are both as they were solved together. Without it the person's path is the left foot's, or that of the
        only usable one: `lost` has the reason for the other, `untied`, why two usable feet cannot be solved as one.
        """
        side = next(iter(feet))
        first, usable, doubts = feet[side], feet, pairing.doubts
        # the person's path, and what is doubtful in it
        if solved is not None:
            person = solved.person
            pairing = replace(
                pairing, width_m=solved.width_m, width_sigma_m=solved.width_sigma_m, cells=solved.cells,
                beyond_reach=solved.beyond_reach,
            )  # fmt: skip
        else:
            person, usable = trace_person(first, first, np.zeros(1), np.zeros((1, 4, 4))), {side: first}
            doubt = f"the feet are solved as two walks, and the {side} one is the person's path: {untied}"
            for missing, why in lost.items():
                doubt = f"the {missing} foot is missing: {why.rstrip('.')}; the {side} foot alone is the person's path."
            doubts = (*doubts, doubt)
            pairing = replace(pairing, doubts=doubts, heading_deg=pairing.heading_deg if side == "left" else None)
        solution = replace(
            person, method=first.method, parameters=first.parameters, notes=(*doubts, *notes),
            runtime_s=max(foot.runtime_s for foot in feet.values()),
        ).widen(max(foot.walk.recording.provenance.rate_sigma for foot in feet.values()))  # fmt: skip
        for words in solution.notes:
            LOG.info(words)
        # errors, where the truths can be used
        metrics, truth, comparison = evaluate(solution), None, None
        try:
            truth = _find_truth(usable)
            if truth is not None:
                comparison = compare(solution, truth, first.walk.options.alignment)
                metrics = evaluate(solution, truth, comparison=comparison)
        except EvaluationError as error:
            truth, metrics = None, replace(metrics, notes=(f"the person's truth left out: {error}",))
        known = {item.name: getattr(solution, item.name) for item in fields(Solution)}
        return cls(**known, feet=feet, pairing=pairing, outcome=Outcome(solution, metrics, comparison), truth=truth)

    @property
    def left(self) -> Result | None:
        """The left foot; None where its recording could not be navigated."""
        return self.feet.get("left")

    @property
    def right(self) -> Result | None:
        """The right foot, likewise."""
        return self.feet.get("right")

    @property
    def width_m(self) -> float | None:
        """Between the sensors, across the way, m; None where one foot is missing, or nothing ties them.

        Examples
        --------
        >>> 0.0 < fg_nav.navigate_feet("left.csv", "right.csv", "inertial").width_m < 0.5
        True
        """
        return self.pairing.width_m

    @property
    def metrics(self) -> Metrics:
        """Distance and closure of the person, and errors where both feet have a true path; those of a foot are its own.

        Examples
        --------
        >>> result = fg_nav.navigate_feet("left.csv", "right.csv", "inertial", sides="left,right")
        >>> result.metrics.distance_m < result.left.metrics.distance_m + 1.0
        True
        """
        return self.outcome.metrics

    def to_dataframe(self, rows: Rows = "samples") -> pd.DataFrame:
        """Return the person's path as a table; as `strides` those of both feet, with their steps.

        Examples
        --------
        >>> result = fg_nav.navigate_feet("left.csv", "right.csv", "inertial", sides="left,right")
        >>> sorted(set(result.to_dataframe("strides").foot))
        ['left', 'right']
        """
        if rows == "strides":
            return tabulate_gait(self.feet, beside=self.width_m is not None)
        return super().to_dataframe(rows)

    @cached_property
    def verdict(self) -> Verdict:
        """The worse of both feet's verdicts, with all reasons; doubtful at least where one foot is missing.

        Examples
        --------
        >>> fg_nav.navigate_feet("left.csv", "right.csv", "inertial").verdict.word
        'trusted'
        """
        found = {side: foot.verdict for side, foot in self.feet.items()}
        words: list[Word] = [one.word for one in found.values()]
        if self.pairing.doubts:
            words.append("doubtful")
        reasons = tuple(f"{side} foot: {reason}" for side, one in found.items() for reason in one.reasons)
        return Verdict(max(words, key=WORDS.index), (*self.pairing.doubts, *reasons))


def _find_truth(feet: Mapping[Side, Result]) -> TrajectoryTruth | None:
    """Return the mean of both feet's true paths (of one foot, its own); None if one of them has no usable one."""
    truths = [foot.walk.truth for foot in feet.values() if foot.outcome.comparison is not None]
    paths = [truth for truth in truths if isinstance(truth, TrajectoryTruth)]
    if len(paths) < len(feet):
        return None
    if len(paths) == 1:
        return replace(paths[0], nav_R_body=None)
    row, other = interpolate_truth(paths[1], paths[0].t)
    return TrajectoryTruth(paths[0].t[row], 0.5 * (paths[0].position[row] + other))


def navigate_feet(
    first: Recording | Path | str | Walk,
    second: Recording | Path | str | Walk,
    method: str = "smoother",
    *,
    heading_deg: float | None = None,
    truth: tuple[Truth | Path | str | None, Truth | Path | str | None] = (None, None),
    options: Options | None = None,
    clock_offset_s: float | None = None,
    sides: Order | None = None,
    progress: Progress | None = None,
) -> FeetResult:
    """Turn two recordings of one walk, of a sensor on each foot, into the path of the person.

    Parameters
    ----------
    first, second, options, progress
        As of `navigate`; the options are for both recordings.
    method : str
        `smoother` or `inertial`.
    heading_deg : float
        Of the left sensor's x axis at the start, deg clockwise from north; without it that of the options, from the
        field, or zero.
    truth : two of truth or path
        Of each recording, in one frame.
    clock_offset_s : float
        To add to the stamps of the second recording; without it as the signals of both show.
    sides : "left,right" or "right,left"
        Feet of the recordings; without it as the steps show, else left and right.

    Returns
    -------
    FeetResult
        The person's path as a `Solution`, with the `Result` of each foot, `metrics` and `verdict`.

    Raises
    ------
    FgNavError
        In one sentence: what is wrong, where, and what to try.

    Examples
    --------
    >>> result = fg_nav.navigate_feet("left.csv", "right.csv", heading_deg=0.0, sides="left,right")
    >>> result.pairing.sides, result.pairing.cells > 1
    ('named', True)
    >>> bool(result.stances.position_sigma[-1, 0] < 0.5)  # m
    True
    """
    check_use(find_method(method), "feet")
    if sides not in (None, "left,right", "right,left"):
        raise EstimationError(f"sides '{sides}' are none: name them left,right or right,left, as the recordings are.")
    if not isinstance(truth, tuple | list) or len(truth) != len(SIDES):
        raise EstimationError("give a truth for each recording, in their order, or None: (left, right).")
    if clock_offset_s is not None and not np.isfinite(clock_offset_s):
        raise EstimationError(f"a clock offset of {clock_offset_s} s is no time: give a number.")
    # read; the recordings by side, as they are named, else as they are assumed
    reading, walks = Reading(longest_gap_s=MAX_GAP_S), list[Walk]()
    for given, of_one in zip((first, second), truth, strict=True):
        walk = given if isinstance(given, Walk) else read_walk(given, options or Options(), reading)
        walks.append(add_known(walk, None, of_one))
    if any(walk.fixes or walk.places is not None or walk.extra is not None for walk in walks):
        raise EstimationError("fixes, places and factors of your own are for one foot: leave them out for two.")
    if clock_offset_s is not None:
        walks[1] = _shift_clock(walks[1], ClockOffset(clock_offset_s))
    headings = (heading_deg, *(walk.options.heading_deg for walk in walks))
    pairing = Pairing(
        SIDES[::-1] if sides == "right,left" else SIDES,
        "assumed" if sides is None else "named",
        clock_offset_s or 0.0,
        clock_offset_s is not None,
        heading_deg=next((one for one in headings if one is not None), None),
    )
    feet = dict(zip(pairing.order, walks, strict=True))
    # each as of a foot alone: checked, corrected, its stances and its field
    feet, lost = _prepare_feet(feet)
    if lost:
        return _go_alone(feet, pairing, method, progress, lost)
    # the two together, or each by itself where nothing ties them
    try:
        return _navigate_both(feet, pairing, method, progress)
    except FgNavError as error:
        lost = {side: f"{words} ({error})" for side, words in _find_lost(feet, method).items()}
        return _go_alone(feet, pairing, method, progress, lost, str(error))


def _name(feet: Mapping[Side, Walk], side: Side) -> str:
    """Return the name of a foot's recording; `feet` are in the order of the recordings."""
    path = feet[side].recording.provenance.path
    return f"the {'first' if side == next(iter(feet)) else 'second'} recording" if path is None else path.name


def _prepare_feet(feet: Mapping[Side, Walk]) -> tuple[dict[Side, Walk], dict[Side, str]]:
    """Return both walks prepared, and the reason for each that has too few footfalls to be navigated."""
    prepared, lost = dict[Side, Walk](), dict[Side, str]()
    for side, walk in feet.items():
        # The given heading is the left foot's: neither walk has it until the sides are known.
        alone, name = replace(walk, options=replace(walk.options, heading_deg=None, mount="foot")), _name(feet, side)
        try:
            # drop the parts of an interrupted recording that have no footfalls to tie them to the rest
            whole = alone.recording
            alone = _prepare(alone, whole)
            if (parts := keep_walked_parts(whole, alone.stances)) is not whole:
                alone = _prepare(alone, parts)
            if (count := alone.stances.n_footfalls) < MIN_FOOTFALLS:
                lost[side] = f"{name} has {format_count(count, 'footfall')}"
            else:
                check_known(alone)
        except DetectionError as error:
            lost[side] = f"{name}: {error}"
        except FgNavError as error:
            raise error if name in str(error) else type(error)(f"{name}: {error}") from None
        prepared[side] = alone
    if len(lost) == len(feet):
        raise DetectionError(f"neither foot can be navigated: {' '.join(lost.values())}")
    return prepared, lost


def _prepare(walk: Walk, recording: Recording) -> Walk:
    """Prepare a walk of this recording; a sensor that failed is no fault of its truth, which is checked afterwards."""
    return replace(prepare_walk(replace(walk, recording=recording, truth=None)), truth=walk.truth)


def _find_lost(feet: Mapping[Side, Walk], method: str) -> dict[Side, str]:
    """Return why one walk is unusable: not solvable, or far fewer footfalls; empty if both fail or neither."""
    counts = {side: walk.stances.n_footfalls for side, walk in feet.items()}
    few, most = sorted(counts, key=lambda side: counts[side])
    if counts[few] < LOST_SHARE * counts[most]:
        found = format_count(counts[few], "footfall")
        return {few: f"{_name(feet, few)} has {found}, and the other foot {counts[most]}"}
    failed = {}
    for side, walk in feet.items():
        try:
            estimate(walk, method)
        except FgNavError as error:
            failed[side] = f"{_name(feet, side)}: {error}"
    return failed if len(failed) == 1 else {}


def _go_alone(
    feet: Mapping[Side, Walk],
    pairing: Pairing,
    method: str,
    progress: Progress | None,
    lost: Mapping[Side, str],
    untied: str = "",
) -> FeetResult:
    """Navigate each usable foot alone; `lost` and `untied` as of `FeetResult.of`."""
    results, notes = dict[Side, Result](), list[str]()
    for side in (one for one in SIDES if one not in lost):
        walk = feet[side]
        whole = keep_longest_part(walk.recording)
        if whole is not walk.recording:
            walk = _prepare(walk, whole)
        if pairing.heading_deg is not None:
            if side == "left":
                walk = measure_field(_turn(walk, np.deg2rad(pairing.heading_deg)))
            else:
                notes.append("the heading was that of the left foot, and left out: it is zero, or that of the field")
        results[side] = Result.of(walk, run_method(walk, method, progress))
    return FeetResult.of(results, None, pairing, tuple(notes), lost, untied)


def _navigate_both(feet: Mapping[Side, Walk], pairing: Pairing, method: str, progress: Progress | None) -> FeetResult:
    """Solve two prepared walks in one graph."""
    order, known = pairing.order, pairing.sides
    first, second, notes = feet[order[0]], feet[order[1]], list[str]()
    if not pairing.clock_given:
        clocks = match_swings(*(list_swings(walk.recording, walk.stances) for walk in (first, second)))
        second, notes = _shift_clock(second, clocks), [clocks.note] * bool(clocks.note)
        pairing = replace(pairing, clock_offset_s=clocks.offset_s, clock_drift=clocks.drift)
    walks = replace(first, beside=second.recording.t), replace(second, beside=first.recording.t)
    # which foot is which: as named, else as the steps show
    feet, solution = _solve(dict(zip(order, walks, strict=True)), pairing, method, progress)
    if known == "assumed" and shows_sides(solution):
        known = "shown"
        if solution.width_m < 0.0:  # frame and heading are the left foot's: solve again in its own
            order, swapped = order[::-1], dict(zip(SIDES, (feet["right"], feet["left"]), strict=True))
            feet, solution = _solve(swapped, pairing, method, progress)
    # doubts about it, and remarks on it
    doubts = tuple[str, ...]()
    width = f"{solution.width_m:.2f} m within {solution.width_sigma_m:.2f} m"
    if known == "named" and shows_sides(solution) and solution.width_m < 0.0:
        doubts = (f"the feet look swapped: the one named right is on the left, by {width}; see --sides.",)
    if known == "shown" and order != SIDES:
        notes.append(f"the first recording is of the right foot, as the steps show: the feet are {width} apart")
    if known == "assumed":
        words = "the first recording was taken for the left foot's: the steps do not show which is which; see --sides"
        notes.append(words)
    results, uses_field = dict[Side, Result](), find_method(method).uses_field
    for side in SIDES:
        walk, found = feet[side], getattr(solution, side)
        found = replace(found, method=method, uses_field=uses_field).widen(walk.recording.provenance.rate_sigma)
        results[side] = Result.of(walk, evaluate_solution(walk, found))
    pairing = replace(pairing, order=order, sides=known, doubts=doubts)
    return FeetResult.of(results, solution, pairing, (*notes, *_describe_cover(feet)))


def shows_sides(solution: FeetSolution) -> bool:
    """Whether the steps, without the prior of the width, show a width that is clearly not zero."""
    from fg_nav.smoother.feet import WIDTH_M, WIDTH_SIGMA_M

    information = solution.width_sigma_m**-2 - WIDTH_SIGMA_M**-2
    if information <= 0.0:
        return False
    by_steps = solution.width_m * solution.width_sigma_m**-2 - WIDTH_M * WIDTH_SIGMA_M**-2
    return bool(abs(by_steps) > CLEAR_SIGMAS * information**0.5 and by_steps * solution.width_m > 0.0)


def _solve(
    feet: Mapping[Side, Walk], pairing: Pairing, method: str, progress: Progress | None
) -> tuple[dict[Side, Walk], FeetSolution]:
    """Set initial headings and solve both feet in one graph; return the walks with the solution."""
    from fg_nav.smoother.batch import WalkInput
    from fg_nav.smoother.feet import smooth_feet

    uses_field = find_method(method).uses_field
    left, right = (feet[side] if uses_field else replace(feet[side], field=None) for side in SIDES)
    # initial headings, the right foot's from the steps; with a field and none given, the field determines both
    if pairing.heading_deg is not None or left.field is None:
        start = Options(heading_deg=pairing.heading_deg or 0.0).heading_rad or 0.0
        relative = measure_relative_heading(_find_footfalls(right), _find_footfalls(left))
        left, right = _turn(left, start), _turn(right, start + relative)
        if uses_field:
            left, right = (walk if walk.field is None else measure_field(walk) for walk in (left, right))
    with blaming_changes(method, left.options):
        of_right, of_left = (
            WalkInput(
                one.recording,
                one.stances,
                one.options.heading_rad,
                one.field,
                choose_parameters(one.options, one.calibration),
            )
            for one in (right, left)
        )
        return {"left": left, "right": right}, smooth_feet(of_right, of_left, progress)


def _turn(walk: Walk, heading_rad: float) -> Walk:
    return replace(walk, options=replace(walk.options, heading_deg=float(np.rad2deg(heading_rad))))


def _find_footfalls(walk: Walk) -> Footfalls:
    """Footfalls of a foot by the plain filter, from heading zero."""
    table, t = estimate(_turn(walk, 0.0), "iez").stances, walk.recording.t
    return Footfalls(table.t, table.position, t[find_holes(t)])


def _shift_clock(walk: Walk, clocks: ClockOffset) -> Walk:
    """Add the clock offset to the stamps of samples, truth and field."""
    if not clocks.offset_s and not clocks.drift:
        return walk
    move, recording, truth = clocks.shift, walk.recording, walk.truth
    if isinstance(truth, TrajectoryTruth) or (isinstance(truth, FootprintTruth) and truth.t is not None):
        assert truth.t is not None
        truth = replace(truth, t=move(truth.t))
    recording = replace(recording, t=move(recording.t), truth=truth)
    field = None if walk.field is None else replace(walk.field, t=move(walk.field.t))
    return replace(walk, recording=recording, truth=truth, field=field)


def _describe_cover(feet: Mapping[Side, Walk]) -> list[str]:
    """Return notes on the times (s) in which only one foot was recorded."""
    found = []
    for side, other in (SIDES, SIDES[::-1]):
        t, of_other = feet[side].recording.t, feet[other].recording.t
        if t[0] < of_other[0] - 1.0 or t[-1] > of_other[-1] + 1.0:
            found.append(
                f"the {side} foot was recorded from {t[0]:.1f} to {t[-1]:.1f} s, the {other} one from "
                f"{of_other[0]:.1f} to {of_other[-1]:.1f} s: where there is one, the person goes as it does"
            )
        found += [
            f"the {side} foot was not recorded from {begin:.1f} to {end:.1f} s: the person goes as the {other} one does"
            for begin, end in list_bridged(t, of_other)
        ]
    return found
