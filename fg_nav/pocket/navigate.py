"""From a recording in a trouser pocket to a `Solution`: orientation, steps, their length, dead reckoning.

A row of its table is the beginning of a stride (`fg_nav.pocket.steps`), that is of a swing of the leg that wears the
sensor, and one more the end of the last: rows less one are strides, as on a foot. In between, the position moves evenly
along each step.

================ =====================================================================
pocket           orientation by the iterated Kalman smoother (`iterated_smoother`); the default
munoz-diaz2017   orientation by MD's filter (`filter`), its misprints corrected
================ =====================================================================

With MD's filter the heading is that of the compass at the start, and the white error of the magnetometer, on which it
depends most, is estimated from the recording (`track`); without a magnetometer the heading is 0.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import TurnSigns, refuse_foot
from fg_nav.errors import EstimationError
from fg_nav.magnetic.detectors import DISTURBED, QUASI_STATIC, UNKNOWN
from fg_nav.pocket.dead_reckoning import (
    StepLength,
    SteppedPath,
    calibrate_step_length,
    estimate_directions,
    lay_on_fixes,
    reckon_path,
    use_step_constant,
)
from fg_nav.pocket.filter import PocketParameters, estimate_field_noise_uT, estimate_pocket
from fg_nav.pocket.steps import MIN_OPENING_DEG, Steps, ThighSwing, estimate_swing, find_all_steps
from fg_nav.pocket.track import PocketTrack, choose_start, measure_turn
from fg_nav.recording import Recording
from fg_nav.samples.readings import find_saturated
from fg_nav.solution import Solution, StanceTable
from fg_nav.text import format_count
from fg_nav.truth import Gnss, describe_fixes

Progress: TypeAlias = Callable[[float], None]

METHODS = ("pocket", "munoz-diaz2017")  # By name, the default first.
MAX_SLIPPED_DEG = 15.0  # A pelvis that turns, and a leg that abducts, turn the axis of a walk's halves by a few deg.
MIN_CLIPPED_PERCENT = 0.5  # A peak of a stride is some samples of a hundred.
MIN_USED = 0.05  # Of the strides; in fewer the field is practically unused.
GIVEN_HEADING_DEG = 10.0  # sigma of a heading that was given, where fixes show it too
DECLINATION_DEG = 10.0  # sigma of magnetic north from true north, below the polar circles
FIRST_STEPS = 4  # Two strides, so that the pelvis's turning to and fro cancels.


def navigate_pocket(
    recording: Recording,
    method: str = "pocket",
    heading: float | None = None,
    step_constant_m: float | None = None,
    known_distance_m: float | None = None,
    progress: Progress | None = None,
    gnss: Gnss | None = None,
) -> Solution:
    """Estimate the path of a person with a sensor in a trouser pocket.

    Parameters
    ----------
    heading : rad clockwise from north, of the first two strides; None if unknown.
    step_constant_m : of the person, from an earlier calibration (`fg_nav.pocket.dead_reckoning`).
    known_distance_m : meters walked along the path in this recording, to calibrate the constant by.
    gnss : a receiver's fixes: heading, step constant and path by them too.

    Raises `EstimationError` if there is no such method, the heading is no number, both a constant and a distance are
    given, the sensor was on a foot, or there is no step.
    """
    began = time.perf_counter()
    if step_constant_m is not None and known_distance_m is not None:
        raise EstimationError("a step constant and a known distance both give the length of a step: give one of them.")
    if heading is not None and not np.isfinite(heading):
        raise EstimationError(f"a heading of {heading:g} is none: give an angle, or leave it out.")
    # orientation
    signs = refuse_foot(recording)
    start, start_notes = choose_start(recording, heading)
    if method not in METHODS:
        raise EstimationError(f"there is no method '{method}' for the pocket: choose one of {', '.join(METHODS)}.")
    heading_sigma = None if heading is None else float(np.radians(GIVEN_HEADING_DEG))
    if method == METHODS[0]:
        from fg_nav.pocket.iterated_smoother import smooth_pocket

        track = smooth_pocket(recording, start=start, progress=progress)
        turn = measure_turn(recording, track)
        track = track if turn is None else turn.apply(track)
        if turn is not None and heading is None:
            sigma = turn.sigma_at_start
            heading_sigma = float(np.hypot(sigma, np.radians(DECLINATION_DEG)))
            start_notes = [
                "the heading is the compass's over all of the walk, from magnetic north: "
                f"{np.degrees(sigma):.0f} deg at the start"
            ]
    else:
        noise = PocketParameters(mag_sigma_uT=estimate_field_noise_uT(recording))
        track = estimate_pocket(recording, noise, start)
    # steps of the thigh, and their length
    swing = estimate_swing(recording, track)
    steps = find_all_steps(recording, track, swing)
    require_steps(steps)
    if known_distance_m is not None:
        step_length = calibrate_step_length(steps, known_distance_m)
    else:
        step_length = StepLength() if step_constant_m is None else use_step_constant(step_constant_m)
    # the given heading is that of the first strides
    if heading is not None:
        track = track.rotate(heading - measure_first_heading(estimate_directions(track, swing, steps)))
    # dead reckoning, and fixes
    path = reckon_path(track, swing, steps, step_length)
    on_earth: dict[str, float] = {}
    if gnss is not None:
        known_sigma = heading_sigma if swing.is_forward_known else None
        track, path, step_length, on_earth = lay_on_fixes(track, path, gnss, known_sigma, step_length)
        start_notes = [describe_fixes(on_earth)]
    notes = (*start_notes, *describe_steps(steps, step_length, swing.is_forward_known or gnss is not None))
    solution = assemble_solution(recording, track, steps, path, step_length)
    return replace(
        solution,
        parameters={**solution.parameters, **({"gnss_start": on_earth} if on_earth else {})},
        method=method,
        runtime_s=time.perf_counter() - began,
        notes=(*notes, *_warn(recording, signs, swing, solution.stances.field)),
    )


def require_steps(steps: Steps) -> None:
    """Raise `EstimationError` if there is no step."""
    if not len(steps):
        raise EstimationError(
            f"no step was found: neither does the thigh swing to and fro by {MIN_OPENING_DEG:g} deg or more, three "
            "times in a row, nor does the body bounce; was it walked with, in a trouser pocket?"
        )


def assemble_solution(
    recording: Recording, track: PocketTrack, steps: Steps, path: SteppedPath, step_length: StepLength
) -> Solution:
    """Return the solution, without notes; position is interpolated linearly between the ends of each step."""
    t = recording.t
    at, first = np.unique(t[path.sample], return_index=True)
    position = np.stack([np.interp(t, at, axis) for axis in path.position[first].T], axis=1)
    # rows where strides begin, and at the end of the last
    rows = np.append(2 * steps.strides, 2 * len(steps) - 1)
    sample = path.sample[rows]
    # whether the field was used in the stride up to each row
    verdicts, reasons = (UNKNOWN,) * len(sample), ("no magnetometer",) * len(sample)
    if recording.mag is not None:
        used = np.concatenate([[0], np.cumsum(track.field_used)])
        fresh = np.concatenate([[0], np.cumsum(np.isfinite(recording.mag).all(axis=1))])
        before = np.append(0, sample[:-1])
        counts = list(zip(used[sample + 1] - used[before], fresh[sample + 1] - fresh[before], strict=True))
        verdicts = tuple(QUASI_STATIC if c else DISTURBED if whole else UNKNOWN for c, whole in counts)
        reasons = tuple(f"{c} of {whole} samples used" for c, whole in counts)
    table = StanceTable(
        sample=sample,
        t=t[sample],
        position=path.position[rows],
        nav_R_body=track.nav_R_body[sample],
        gyro_bias=track.gyro_bias[sample],
        position_cov=path.covariance[rows],
        heading_sigma=track.sigma[sample, 2],
        gyro_bias_sigma=track.sigma[sample, 3:],
        field=verdicts,
        field_reason=reasons,
    )
    return Solution(
        method=METHODS[0],
        t=t,
        position=position,
        velocity=np.gradient(position, t, axis=0),
        nav_R_body=track.nav_R_body,
        stances=table,
        runtime_s=0.0,
        parameters={"step_length": asdict(step_length)},
    )


def measure_first_heading(forward: Floats) -> float:
    """Heading of the first strides, rad clockwise from north, by the directions (S, 2) of all steps."""
    east, north = forward[:FIRST_STEPS].sum(axis=0)
    return float(np.arctan2(east, north))


def describe_steps(steps: Steps, step_length: StepLength, is_forward_known: bool) -> list[str]:
    """Return notes on number of steps, step constant and its source, and an ambiguous forward direction."""
    bouts = int(steps.bout[-1]) + 1
    pauses = f", in {bouts} stretches" if bouts > 1 else ""
    notes = [f"{format_count(len(steps), 'step')} of both legs{pauses}; height is not estimated"]
    if step_length.source == "default":
        notes.append(
            f"step constant {step_length.constant_m:.2f} m by default, good to {100 * step_length.sigma:.0f} % "
            "(one sigma): calibrate it once with --known-distance"
        )
    else:
        notes.append(
            f"step constant {step_length.constant_m:.4g} m ({step_length.source}), "
            f"sigma {step_length.constant_m * step_length.sigma:.2g} m"
        )
    if not is_forward_known:
        notes.append("the swing hardly distinguishes forward from backward: the path may be turned by 180 deg")
    return notes


def _warn(recording: Recording, signs: TurnSigns, swing: ThighSwing, verdicts: tuple[str, ...]) -> list[str]:
    """Return warnings on field, sampling, swing and shifts of the sensor."""
    notes = []
    if signs.wearing is None:
        notes.append("the sensor turns neither as on a thigh nor as on a foot: was it in a trouser pocket?")
    if swing.slipped_deg > MAX_SLIPPED_DEG:
        notes.append(
            f"the axis of the swing turns by {swing.slipped_deg:.0f} deg from one half of the walk to the other, so "
            "the sensor turned in the pocket and the path is bent: wear it tighter"
        )
    clipped = 100.0 * float(find_saturated(recording.gyr, recording.clipping[1]).any(axis=1).mean())
    if clipped >= MIN_CLIPPED_PERCENT:
        notes.append(f"the gyroscope is clipped in {clipped:.2g} % of the samples: openings and lengths are too small")
    strides = np.array(verdicts) == QUASI_STATIC
    if recording.mag is not None and strides.mean() < MIN_USED:
        notes.append(
            f"the field was used in {int(strides.sum())} of {format_count(len(strides), 'stride')}: calibrate the "
            "magnetometer, as iron about the sensor turns with it"
        )
    return notes
