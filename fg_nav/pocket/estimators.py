"""From a recording in a trouser pocket to a `Solution`: orientation, steps, their length, dead reckoning.

A row of its table is the beginning of a stride (`fg_nav.pocket.steps`), that is of a swing of the leg that wears the
sensor, and one more the end of the last: rows less one are strides, as on a foot. In between, the position goes evenly
along each step.

================ =====================================================================
pocket           orientation by the graph (`fg_nav.pocket.smoother`); the default
munoz-diaz2017   orientation by the paper's filter, its misprints corrected
================ =====================================================================

A heading is that of the way: of the first two strides. Without one, the compass tells the attitude at the start;
without a magnetometer the sensor begins with heading 0. The white error of the magnetometer, of which all hangs in the
paper's filter, is that of the recording (`fg_nav.pocket.start`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.mount import TurnSigns, refuse_foot
from fg_nav.errors import EstimationError
from fg_nav.magnetic.quasi_static import DISTURBED, QUASI_STATIC, UNKNOWN
from fg_nav.pocket.dead_reckoning import ReckoningParameters, Way, directions, reckon
from fg_nav.pocket.ekf import estimate_pocket
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.pocket.start import PocketStart, compass_start, field_noise_uT, level_start
from fg_nav.pocket.step_length import StepLength, calibrate_step_length, given_step_length
from fg_nav.pocket.steps import StepParameters, Steps, find_steps
from fg_nav.pocket.swing_axis import ThighSwing, thigh_swing
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording
from fg_nav.samples.saturation import saturated
from fg_nav.solution import Solution, StanceTable
from fg_nav.wording import counted

Progress: TypeAlias = Callable[[float], None]

METHODS = ("pocket", "munoz-diaz2017")
"""By name, the default first."""

MOST_SLIPPED_DEG = 15.0
"""A pelvis that turns, and a leg that abducts, turn the axis of a walk's halves by a few deg."""

LEAST_CLIPPED_PERCENT = 0.5
"""A peak of a stride is some samples of a hundred."""

LEAST_USED = 0.05
"""Of the strides; in fewer the field is as good as not used."""

FIRST_STEPS = 4
"""Two strides, so that the pelvis's turning to and fro leaves nothing."""


def navigate_pocket(
    recording: Recording,
    method: str = "pocket",
    heading: float | None = None,
    step_constant_m: float | None = None,
    known_distance_m: float | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Find the way of somebody with a sensor in a trouser pocket.

    Parameters
    ----------
    recording : Recording
    method : one of `METHODS`.
    heading : rad clockwise from north, of the first two strides; None where it is unknown.
    step_constant_m : of the person, from an earlier calibration (`fg_nav.pocket.step_length`).
    known_distance_m : metres walked along the way in this recording, to calibrate the constant by.
    progress : is told the fraction done.

    Raises
    ------
    EstimationError
        If there is no such method, the heading is no number, both a constant and a distance are given, the sensor was
        on a foot, or there is no step.
    """
    began = time.perf_counter()
    if step_constant_m is not None and known_distance_m is not None:
        raise EstimationError("a step constant and a known distance both tell the length of a step: give one of them.")
    if heading is not None and not np.isfinite(heading):
        raise EstimationError(f"a heading of {heading:g} is none: give an angle, or leave it out.")
    signs = refuse_foot(recording)
    start, headed = _start(recording, heading)
    track = _track(recording, method, start, progress)
    swing = thigh_swing(recording, track)
    steps = find_steps(recording.t, swing.flexion, swing.up_now)
    if not len(steps):
        raise EstimationError(
            f"no step was found: the thigh does not swing to and fro by {StepParameters().least_opening_deg:g} deg or "
            "more, three times in a row; was it walked with, in a trouser pocket?"
        )
    law = _law(steps, step_constant_m, known_distance_m)
    if heading is not None:
        track = track.turned(heading - _first_heading(track, swing, steps))
    way = reckon(track, swing, steps, law)
    position, velocity = _between(recording.t, way)
    table = _table(recording, track, steps, way)
    notes = (*headed, *_remarks(swing, steps, law), *_doubts(recording, signs, swing, table.field))
    return Solution(
        method=method,
        t=recording.t,
        position=position,
        velocity=velocity,
        nav_R_body=track.nav_R_body,
        stances=table,
        runtime_s=time.perf_counter() - began,
        parameters=_parameters(law),
        notes=notes,
    )


def _start(recording: Recording, heading: float | None) -> tuple[PocketStart, list[str]]:
    if heading is not None:
        return level_start(recording), []
    try:
        return compass_start(recording), ["the heading at the start is the compass's, from magnetic north"]
    except EstimationError:
        start = level_start(recording)  # without gravity this says so
    return start, ["the heading at the start is unknown and set to 0: give it with --heading"]


def _first_heading(track: PocketTrack, swing: ThighSwing, steps: Steps) -> float:
    """Direction of the first strides, rad clockwise from north."""
    east, north = directions(track, swing, steps)[:FIRST_STEPS].sum(axis=0)
    return float(np.arctan2(east, north))


def _track(recording: Recording, method: str, start: PocketStart, progress: Progress | None) -> PocketTrack:
    if method not in METHODS:
        raise EstimationError(f"there is no method '{method}' for the pocket: choose one of {', '.join(METHODS)}.")
    if method == METHODS[0]:
        from fg_nav.pocket.smoother import smooth_pocket

        return smooth_pocket(recording, start=start, progress=progress)
    return estimate_pocket(recording, PocketParameters(mag_sigma_uT=field_noise_uT(recording)), start)


def _law(steps: Steps, constant_m: float | None, distance_m: float | None) -> StepLength:
    if distance_m is not None:
        return calibrate_step_length(steps.opening, distance_m)
    return StepLength() if constant_m is None else given_step_length(constant_m)


def _remarks(swing: ThighSwing, steps: Steps, law: StepLength) -> list[str]:
    bouts = int(steps.bout[-1]) + 1
    pauses = f", in {bouts} stretches" if bouts > 1 else ""
    said = [f"{counted(len(steps), 'step')} of both legs{pauses}; height is not estimated"]
    if law.source == "default":
        said.append(
            f"step constant {law.constant_m:.2f} m by default, good to {100 * law.sigma:.0f} % (one sigma): "
            "calibrate it once with --known-distance"
        )
    else:
        said.append(f"step constant {law.constant_m:.4g} m ({law.source})")
    if not swing.is_forward_known:
        said.append("the swing hardly tells forward from backward: the way may be turned by 180 deg")
    return said


def _doubts(recording: Recording, signs: TurnSigns, swing: ThighSwing, words: tuple[str, ...]) -> list[str]:
    """What the recording says against itself."""
    said = []
    if signs.wearing is None:
        said.append("the sensor turns neither as on a thigh nor as on a foot: was it in a trouser pocket?")
    if swing.slipped_deg > MOST_SLIPPED_DEG:
        said.append(
            f"the axis of the swing turns by {swing.slipped_deg:.0f} deg from one half of the walk to the other, so "
            "the sensor turned in the pocket and the way is bent: wear it tighter"
        )
    clipped = 100.0 * float(saturated(recording.gyr, recording.clipping[1]).any(axis=1).mean())
    if clipped >= LEAST_CLIPPED_PERCENT:
        said.append(f"the gyroscope is clipped in {clipped:.2g} % of the samples: openings and lengths are too small")
    strides = np.array(words) == QUASI_STATIC
    if recording.mag is not None and strides.mean() < LEAST_USED:
        said.append(
            f"the field was used in {int(strides.sum())} of {counted(len(strides), 'stride')}: calibrate the "
            "magnetometer, as iron about the sensor turns with it"
        )
    return said


def _parameters(law: StepLength) -> dict[str, object]:
    return {
        "step_length": asdict(law),
        "steps": asdict(StepParameters()),
        "dead_reckoning": asdict(ReckoningParameters()),
    }


def _between(t: Floats, way: Way) -> tuple[Floats, Floats]:
    """Position and velocity (N, 3) at all samples, even along each step."""
    at, first = np.unique(t[way.sample], return_index=True)
    position = np.stack([np.interp(t, at, axis) for axis in way.position[first].T], axis=1)
    return position, np.gradient(position, t, axis=0)


def _rows(steps: Steps) -> Ints:
    """Rows (K + 1,) of a way at which the strides begin, and its last."""
    return np.append(2 * steps.strides, 2 * len(steps) - 1)


def _table(recording: Recording, track: PocketTrack, steps: Steps, way: Way) -> StanceTable:
    rows = _rows(steps)
    sample = way.sample[rows]
    words, reasons = _field(recording, track, sample)
    return StanceTable(
        sample=sample,
        t=recording.t[sample],
        position=way.position[rows],
        nav_R_body=track.nav_R_body[sample],
        gyro_bias=track.gyro_bias[sample],
        position_cov=way.covariance[rows],
        heading_sigma=track.sigma[sample, 2],
        gyro_bias_sigma=track.sigma[sample, 3:],
        field=words,
        field_reason=reasons,
    )


def _field(recording: Recording, track: PocketTrack, sample: Ints) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Whether the field was used in the stride up to each row, in words."""
    if recording.mag is None:
        return (UNKNOWN,) * len(sample), ("no magnetometer",) * len(sample)
    used = np.concatenate([[0], np.cumsum(track.field_used)])
    fresh = np.concatenate([[0], np.cumsum(np.isfinite(recording.mag).all(axis=1))])
    before = np.append(0, sample[:-1])
    count, whole = used[sample + 1] - used[before], fresh[sample + 1] - fresh[before]
    words = tuple(QUASI_STATIC if c else DISTURBED if w else UNKNOWN for c, w in zip(count, whole, strict=True))
    return words, tuple(f"{c} of {w} samples used" for c, w in zip(count, whole, strict=True))
