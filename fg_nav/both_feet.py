"""Two recordings of one walk, of a sensor on each foot, navigated as one.

    prepare_walk    each recording: all that is checked and corrected of one foot's         (`fg_nav.pipeline`)
    align_clocks    the second recording's clock set to the first one's                     (`fg_nav.feet.clocks`)
    headings        of both sensors at their starts, by the directions of the steps         (`fg_nav.feet.steps`)
    smooth_feet     both feet in one graph                                                  (`fg_nav.smoother.feet`)
    sides           which recording is of which foot: by the user, or by the width between
    FeetResult      each foot and the person, measured and judged

A foot whose recording cannot be navigated leaves the other as it is alone, and feet that nothing ties are two walks
with a remark: `_go_alone`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from fg_nav.errors import DetectionError, EstimationError, FgNavError
from fg_nav.estimators import Progress, blaming_changes, check_use, choose_parameters, estimate, find_method
from fg_nav.feet import SIDES, Side
from fg_nav.feet.clocks import ClockOffset, align_clocks
from fg_nav.feet.person import FeetSolution, trace_person
from fg_nav.feet.steps import Footfalls, keep_longest_part, keep_walked_parts, measure_relative_heading
from fg_nav.feet_result import FeetResult, Known, Pairing
from fg_nav.io import Reading
from fg_nav.pipeline import Result, prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.samples.gaps import find_holes, list_bridged
from fg_nav.solution import Solution
from fg_nav.text import format_count
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth
from fg_nav.walk import Options, Walk, add_known, check_known, evaluate_solution, measure_field, read_walk

Order: TypeAlias = Literal["left,right", "right,left"]
"""Feet of the first and of the second recording."""

MIN_FOOTFALLS = 4  # Of a foot that walked: three strides or fewer are no walk (`fg_nav.verdict`).
LOST_SHARE = 0.5  # Of the other foot's footfalls: a foot with fewer recorded for less than half of the walk.
MAX_GAP_S = 3600.0  # Parts of a recording stay, as the other foot goes on between; more is a clock that was set.
CLEAR_SIGMAS = 3.0  # From zero, at which the width shows which foot is which.


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
    first, second : Recording, path or Walk
        What the sensors recorded, as `navigate` takes it.
    method : str
        `smoother` or `inertial`.
    heading_deg : float
        Of the left sensor's x axis at the start, deg clockwise from north; without it that of the options, from the
        field, or zero.
    truth : two of truth or path
        Of each recording, in one frame.
    options : Options
        All else that can be chosen, for both recordings.
    clock_offset_s : float
        To add to the stamps of the second recording; without it as the signals of both show.
    sides : "left,right" or "right,left"
        Feet of the recordings; without it as the steps show, else left and right.
    progress
        Called from time to time with the fraction of the work that is done.

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
    reading, walks = Reading(longest_gap_s=MAX_GAP_S), list[Walk]()
    for given, of_one in zip((first, second), truth, strict=True):
        walk = given if isinstance(given, Walk) else read_walk(given, options or Options(), reading)
        walks.append(add_known(walk, None, of_one))
    if clock_offset_s is not None:
        if not np.isfinite(clock_offset_s):
            raise EstimationError(f"a clock offset of {clock_offset_s} s is no time: give a number.")
        walks[1] = _shift_clock(walks[1], ClockOffset(clock_offset_s))
    if any(walk.fixes or walk.places is not None or walk.extra is not None for walk in walks):
        raise EstimationError("fixes, places and factors of your own are for one foot: leave them out for two.")
    headings = (heading_deg, *(walk.options.heading_deg for walk in walks))
    heading_deg = next((one for one in headings if one is not None), None)
    request = _Request(method, heading_deg, sides, clock_offset_s, progress)
    # each recording as one of a foot alone: checked, corrected, its stances and its field
    prepared, lost = _prepare_both(walks)
    if lost:
        return _go_alone(request, prepared, lost)
    # the two together, or each by itself where nothing ties them
    try:
        return _navigate_both(request, prepared)
    except FgNavError as error:
        lost = {number: f"{words} ({error})" for number, words in _find_lost(prepared, method).items()}
        return _go_alone(request, prepared, lost, str(error))


@dataclass(frozen=True)
class _Request:
    """What `navigate_feet` was asked for."""

    method: str
    heading_deg: float | None
    sides: Order | None
    clock_offset_s: float | None
    progress: Progress | None

    @property
    def uses_field(self) -> bool:
        """Whether the method makes use of the magnetic field."""
        return find_method(self.method).uses_field

    @property
    def order(self) -> tuple[Side, Side]:
        """Feet of the recordings as they were named, else as they are assumed."""
        return SIDES[::-1] if self.sides == "right,left" else SIDES

    @property
    def known(self) -> Known:
        """How these are known before the feet are solved."""
        return "assumed" if self.sides is None else "named"


def _name(walk: Walk, number: int) -> str:
    path = walk.recording.provenance.path
    return ("the first recording", "the second recording")[number] if path is None else path.name


def _prepare_both(walks: Sequence[Walk]) -> tuple[list[Walk], dict[int, str]]:
    """Return both walks prepared, and by index the reason for each that has too few footfalls to be navigated.

    Raises any other fault of a recording, with its name.
    """
    prepared, lost = [], dict[int, str]()
    for number, walk in enumerate(walks):
        # The given heading is the left foot's: neither walk has it until the sides are known.
        alone, name = replace(walk, options=replace(walk.options, heading_deg=None, mount="foot")), _name(walk, number)
        try:
            # drop the parts of an interrupted recording that have no footfalls to tie them to the rest
            whole = alone.recording
            alone = _prepare(alone, whole)
            if (parts := keep_walked_parts(whole, alone.stances)) is not whole:
                alone = _prepare(alone, parts)
            if alone.stances.n_footfalls >= MIN_FOOTFALLS:
                check_known(alone)
        except DetectionError as error:
            lost[number] = f"{name}: {error}"
        except FgNavError as error:
            raise error if name in str(error) else type(error)(f"{name}: {error}") from None
        else:
            count = alone.stances.n_footfalls
            if count < MIN_FOOTFALLS:
                lost[number] = f"{name} has {format_count(count, 'footfall')}"
        prepared.append(alone)
    if len(lost) == len(walks):
        raise DetectionError(f"neither foot can be navigated: {' '.join(lost.values())}")
    return prepared, lost


def _prepare(walk: Walk, recording: Recording) -> Walk:
    """Prepare a walk of this recording; a sensor that failed is no fault of its truth, which is checked afterwards."""
    return replace(prepare_walk(replace(walk, recording=recording, truth=None)), truth=walk.truth)


def _find_lost(walks: Sequence[Walk], method: str) -> dict[int, str]:
    """Return by index why one walk is unusable: not solvable, or far fewer footfalls; empty if both fail or neither."""
    counts = [walk.stances.n_footfalls for walk in walks]
    few = int(np.argmin(counts))
    if counts[few] < LOST_SHARE * counts[1 - few]:
        found = format_count(counts[few], "footfall")
        return {few: f"{_name(walks[few], few)} has {found}, and the other foot {counts[1 - few]}"}
    failed = {}
    for number, walk in enumerate(walks):
        try:
            estimate(walk, method)
        except FgNavError as error:
            failed[number] = f"{_name(walk, number)}: {error}"
    return failed if len(failed) == 1 else {}


def _go_alone(request: _Request, prepared: Sequence[Walk], lost: Mapping[int, str], untied: str = "") -> FeetResult:
    """Navigate each usable foot alone; the person's path is the left foot's, or that of the only usable one.

    `lost` has the reason for each unusable foot by its index; `untied`, why two usable feet cannot be solved as one.
    """
    feet, notes = dict[str, Result](), list[str]()
    for side in SIDES:
        number = request.order.index(side)
        if number in lost:
            continue
        walk = prepared[number]
        whole = keep_longest_part(walk.recording)
        if whole is not walk.recording:
            walk = _prepare(walk, whole)
        if request.heading_deg is not None:
            if side == "left":
                walk = measure_field(_turn(walk, np.deg2rad(request.heading_deg)))
            else:
                notes.append("the heading was that of the left foot, and left out: it is zero, or that of the field")
        feet[side] = Result.of(walk, run_method(walk, request.method, request.progress))
    first: Side = "left" if "left" in feet else "right"
    if lost:
        ((missing, why),) = lost.items()
        doubt = f"the {request.order[missing]} foot is missing: {why.rstrip('.')}; the {first} foot alone is the "
        doubt += "person's path."
    else:
        doubt = f"the feet are solved as two walks, and the {first} one is the person's path: {untied}"
    person = trace_person(feet[first], feet[first], np.zeros(1), np.zeros((1, 4, 4)))
    heading_deg = request.heading_deg if first == "left" else None
    offset_s, given = request.clock_offset_s or 0.0, request.clock_offset_s is not None
    pairing = Pairing(request.order, request.known, offset_s, given, heading_deg=heading_deg, doubts=(doubt,))
    return FeetResult.of(feet, person, pairing, tuple(notes))


def _navigate_both(request: _Request, walks: Sequence[Walk]) -> FeetResult:
    """Solve two prepared walks in one graph; return both feet, the person and how the feet were paired."""
    first, second = walks
    clocks = ClockOffset(request.clock_offset_s or 0.0)
    if request.clock_offset_s is None:
        clocks = align_clocks(first.recording, first.stances, second.recording, second.stances)
        second = _shift_clock(second, clocks)
    notes = [clocks.note] if clocks.note else []
    first, second = replace(first, beside=second.recording.t), replace(second, beside=first.recording.t)
    # which foot is which: as named, else as the steps show
    order, known = request.order, request.known
    left, right, solution = _solve(request, *((first, second) if order == SIDES else (second, first)))
    if known == "assumed" and shows_sides(solution):
        known = "shown"
        if solution.width_m < 0.0:  # frame and heading are the left foot's: solve again in its own
            order, (left, right, solution) = order[::-1], _solve(request, right, left)
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
    feet = dict[str, Result]()
    for side, walk in zip(SIDES, (left, right), strict=True):
        found: Solution = replace(getattr(solution, side), method=request.method, uses_field=request.uses_field)
        found = found.widen(walk.recording.provenance.rate_sigma)
        feet[side] = Result.of(walk, evaluate_solution(walk, found))
    pairing = Pairing(
        order, known, clocks.offset_s, request.clock_offset_s is not None, clocks.drift, solution.width_m,
        solution.width_sigma_m, solution.cells, solution.beyond_reach, request.heading_deg, doubts,
    )  # fmt: skip
    notes += _describe_cover(left, right)
    return FeetResult.of(feet, solution.person, pairing, tuple(notes))


def shows_sides(solution: FeetSolution) -> bool:
    """Whether the steps, without the prior of the width, show a width that is clearly not zero."""
    from fg_nav.smoother.feet import WIDTH_M, WIDTH_SIGMA_M

    information = solution.width_sigma_m**-2 - WIDTH_SIGMA_M**-2
    if information <= 0.0:
        return False
    by_steps = solution.width_m * solution.width_sigma_m**-2 - WIDTH_M * WIDTH_SIGMA_M**-2
    return bool(abs(by_steps) > CLEAR_SIGMAS * information**0.5 and by_steps * solution.width_m > 0.0)


def _solve(request: _Request, left: Walk, right: Walk) -> tuple[Walk, Walk, FeetSolution]:
    """Set initial headings and solve both feet in one graph; return the left and the right walk with the solution."""
    from fg_nav.smoother.batch import WalkInput
    from fg_nav.smoother.feet import smooth_feet

    if not request.uses_field:
        left, right = (replace(walk, field=None) for walk in (left, right))
    # initial headings, the right foot's from the steps; with a field and none given, the field determines both
    if request.heading_deg is not None or left.field is None:
        start = Options(heading_deg=request.heading_deg or 0.0).heading_rad or 0.0
        relative = measure_relative_heading(_find_footfalls(right), _find_footfalls(left))
        left, right = _turn(left, start), _turn(right, start + relative)
        if request.uses_field:
            left, right = (walk if walk.field is None else measure_field(walk) for walk in (left, right))
    with blaming_changes(request.method, left.options):
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
        return left, right, smooth_feet(of_right, of_left, request.progress)


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


def _describe_cover(left: Walk, right: Walk) -> list[str]:
    """Return notes on the times (s) in which only one foot was recorded."""
    found = []
    for side, other, one, two in (("left", "right", left, right), ("right", "left", right, left)):
        t, of_other = one.recording.t, two.recording.t
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
