"""What the estimators make of the walks of Munoz Diaz et al. (2017): orientation, bias, and the way by dead reckoning.

========== =========================================================================================================
as printed the paper's filter, its equations as they stand, misprints and all (`fg_nav.pocket.printed`)
filter     with these corrected; gravity by a mean over two strides
batch      `fg_nav.pocket.smooth_pocket`, the graph of the whole walk: no minutes pass until it knows a bias
online     `fg_nav.pocket.follow_pocket`, the same graph: each estimate is made of what was there until then
========== =========================================================================================================

The graph is told what the filter takes for granted: that the emulated sensor of the first walk has no errors of scale
and axes, and a magnetometer that is off by its white error only. The MTw of the second walk may have them.

The position is that of the thigh's steps (`fg_nav.pocket.dead_reckoning`), the constant of their length calibrated by
the whole walk.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EstimationError
from fg_nav.frames import heading_of
from fg_nav.lab.reproduce.munoz_diaz2017_walks import BATCH, FILTER, FIRST, ONLINE, PRINTED, Case, Setting
from fg_nav.pocket import PRESETS, PocketGraphParameters, PocketTrack, estimate_pocket, level_start
from fg_nav.pocket.dead_reckoning import reckon
from fg_nav.pocket.online import follow_pocket
from fg_nav.pocket.smoother import smooth_pocket
from fg_nav.pocket.step_length import calibrate_step_length
from fg_nav.pocket.steps import find_steps
from fg_nav.pocket.swing_axis import thigh_swing
from fg_nav.recording import Recording, TrajectoryTruth


@dataclass(frozen=True)
class Run:
    """What an estimator made of a walk, once a second (M rows).

    Attributes
    ----------
    minute : (M,) min.
    bias, sigma : (M, 3) deg/s.
    yaw_error : (M,) deg, unwrapped, zero at the start.
    strength : (M,) uT as measured; None without a magnetometer.
    used : (M,) whether the differential field update was used.
    path : (K, 2) m, places after each stride by dead reckoning.
    """

    minute: Floats
    bias: Floats
    sigma: Floats
    yaw_error: Floats
    strength: Floats | None
    used: Bools
    path: Floats


Estimate: TypeAlias = Callable[[Recording, Case, float], PocketTrack]
"""Of a recording, what it is told of it, and the heading at the start."""

GRAPHS = {True: PocketGraphParameters(gyr_scale_sigma=1e-5, mag_left_uT=1e-3), False: PocketGraphParameters()}
"""Parameters of the graph, by whether the sensor is emulated; a thousandth of what a real one has stands for none."""

PRESET_NAMES = {PRINTED: "munoz-diaz2017-printed", FILTER: "munoz-diaz2017"}


def _filtered(preset: str, recording: Recording, case: Case, heading: float) -> PocketTrack:
    parameters = replace(PRESETS[preset], field_gated=case.gated, mag_sigma_uT=case.mag_sigma_uT)
    return estimate_pocket(recording, parameters, level_start(recording, parameters, heading))


def _graph(graph: Callable[..., PocketTrack], recording: Recording, case: Case, heading: float) -> PocketTrack:
    parameters = replace(GRAPHS[case in FIRST], mag_sigma_uT=case.mag_sigma_uT)
    return graph(recording, parameters, level_start(recording, heading=heading))


ESTIMATORS: Mapping[str, Estimate] = MappingProxyType(
    {
        **{name: partial(_filtered, preset) for name, preset in PRESET_NAMES.items()},
        BATCH: partial(_graph, smooth_pocket),
        ONLINE: partial(_graph, follow_pocket),
    }
)


def runs(recording: Recording, case: Case, setting: Setting) -> dict[str, Run | None]:
    """What each estimator of a case makes of a recording; None where it ended."""
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    heading = float(heading_of(truth.nav_R_body[0]))
    found: dict[str, Run | None] = {}
    for name in case.by:
        try:
            track = ESTIMATORS[name](recording, case, heading)
        except EstimationError:
            found[name] = None
        else:
            found[name] = run_of(track, recording, truth.nav_R_body, setting)
    return found


def run_of(track: PocketTrack, recording: Recording, true_R: Floats, setting: Setting) -> Run:
    """Once a second, and the way by dead reckoning."""
    yaw = np.degrees(np.unwrap(heading_of(track.nav_R_body)) - np.unwrap(heading_of(true_R)))
    rows = slice(None, None, 100)
    strength = None if recording.mag is None else np.linalg.norm(recording.mag[rows], axis=1)
    return Run(
        minute=track.t[rows] / 60.0,
        bias=np.degrees(track.gyro_bias[rows]),
        sigma=np.degrees(track.sigma[rows, 3:]),
        yaw_error=yaw[rows] - yaw[0],
        strength=strength,
        used=track.field_used[rows],
        path=dead_reckoned(track, recording, setting),
    )


def dead_reckoned(track: PocketTrack, recording: Recording, setting: Setting) -> Floats:
    """Places (K, 2) m at the end of each stride: steps of the thigh, their length told by that of the whole walk.

    NaN where there is no step to be found.
    """
    try:
        swing = thigh_swing(recording, track)
        steps = find_steps(recording.t, swing.flexion, swing.up_now)
        way = reckon(track, swing, steps, calibrate_step_length(steps.opening, setting.length_m))
    except EstimationError:
        return np.full((len(setting.ends), 2), np.nan)
    return np.stack([np.interp(setting.ends, track.t[way.sample], axis) for axis in way.position.T[:2]], axis=1)
