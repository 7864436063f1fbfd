"""The filters of the papers, each in several presets.

=========== ===========================================================================================================
as-printed  the papers' detectors and values, and constant noise where they print none (OpenShoe's); the field levelled
            by the accelerometer; in a curve HDR takes zero for measured. What breaks the filter is not run: `NOT_RUN`
physical    misprints corrected, detectors and noises as physics has them
tuned       of the physical one the noises chosen on walks that are not reported; where there is none, the physical one
=========== ===========================================================================================================

In all of them a footfall is one measurement, where the papers take in each sample of a stance.

A heading's sigma as printed: Ma's 0.067 rad of a step's change, his only figure; Zhang gives none: 5 deg for the
compass, 1 deg for HDR within 5 deg of five strides, and 1 deg for roll and pitch are our choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from fg_nav.changes import Changes, changed
from fg_nav.ekf import tuned
from fg_nav.ekf.aiez import AGREEING, AiezParameters, run_aiez
from fg_nav.ekf.gated_compass import GatedCompassParameters, run_gated_compass
from fg_nav.ekf.iez import run_iez
from fg_nav.ekf.matched import MatchedParameters, matched_with, run_matched
from fg_nav.ekf.parameters import OPENSHOE, IezParameters
from fg_nav.errors import EstimationError
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.presets import MA_SIGMA_HEADING
from fg_nav.magnetic.quasi_static import DETECTORS
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances

Parameters: TypeAlias = IezParameters | GatedCompassParameters
"""Of any filter here."""

AS_PRINTED, PHYSICAL, TUNED = "as-printed", "physical", "tuned"
PRESETS = (TUNED, PHYSICAL, AS_PRINTED)
"""Their names, the default first."""

GATED = ("qsf", "iqsf", "ma2018", "qsf-stance")
"""Filters whose compass is gated by the detector of the same name; `qsf-stance` is Zhang's "IEZ + classical QMD"."""

_MA_SIGMA_DEG = float(np.degrees(MA_SIGMA_HEADING))


def _gated_as_printed(detector: str) -> GatedCompassParameters:
    return GatedCompassParameters(
        DETECTORS[detector], compass_sigma_deg=_MA_SIGMA_DEG, levelled_by_force=True, inertial=OPENSHOE
    )


_AS_PRINTED: Mapping[str, Parameters] = {
    "iez": OPENSHOE,
    "qsf": _gated_as_printed("qsf-printed"),
    "iqsf": _gated_as_printed("iqsf-printed"),
    "ma2018": _gated_as_printed("ma2018-printed"),
    "qsf-stance": _gated_as_printed("qsf-stance"),
    "aiez": AiezParameters(
        DETECTORS["aiez-printed"],
        compass_sigma_deg=5.0,
        levelled_by_force=True,
        inertial=OPENSHOE,
        tilt_sigma_deg=1.0,
        course_sigma_deg=1.0,
        course_limit_deg=5.0,
        course_strides=5,
        course_by_path=False,
        curve_is_zero=True,
    ),
}

_PHYSICAL: Mapping[str, Parameters] = {
    "iez": IezParameters(),
    **{method: GatedCompassParameters(DETECTORS[method]) for method in GATED},
    "aiez": AiezParameters(AGREEING, start_sigma_deg=10.0),  # it tests by its doubt: as sure of one compass as of all
    "matched": matched_with(GatedCompassParameters(DETECTORS["ma2018"])),
}

_SETS: Mapping[str, Mapping[str, Parameters]] = MappingProxyType(
    {
        AS_PRINTED: _AS_PRINTED,
        PHYSICAL: _PHYSICAL,
        TUNED: {**_PHYSICAL, "matched": matched_with(tuned.TUNED["ma2018"]), **tuned.TUNED},
    }
)

NOT_RUN: Mapping[str, str] = MappingProxyType(
    {
        "ma2018": "not run as printed: the sign of the heading (Eq. 1), H on the gyro bias (36), attitude (38, 39)",
        "aiez": "not run as printed: heading without its sign (Eq. 25), Euler angles for rotations (29)",
    }
)
"""What breaks a filter as printed (`fg_nav.ekf.printed`) and is run as corrected, in that preset too."""


RTS = "-rts"
"""After the name of any filter: with the way back over its pass (`fg_nav.ekf.rts`)."""


def parameters_of(method: str, preset: str = TUNED) -> Parameters:
    """Return the parameters of a filter in a preset.

    Raises
    ------
    EstimationError
        If there is no such preset, or no filter of this name.
    """
    check_preset(preset)
    name = method.removesuffix(RTS)
    if name not in _SETS[preset]:
        raise EstimationError(f"there is no preset '{preset}' of '{method}': only of {', '.join(_SETS[preset])}.")
    parameters = _SETS[preset][name]
    return parameters if name == method else _with_the_way_back(parameters)


def _with_the_way_back(parameters: Parameters) -> Parameters:
    if isinstance(parameters, IezParameters):
        return replace(parameters, smoothed=True)
    return replace(parameters, inertial=replace(parameters.inertial, smoothed=True))


def check_preset(preset: str) -> None:
    """Raise `EstimationError` if there is no preset of this name."""
    if preset not in PRESETS:
        raise EstimationError(f"there is no preset '{preset}': choose one of {', '.join(PRESETS)}.")


def run_filter(
    method: str,
    preset: str,
    recording: Recording,
    stances: Stances,
    field: FootfallField | None,
    heading: float | None,
    swing_density: float | None = None,
    changes: Changes = (),
) -> Solution:
    """Run a filter in a preset.

    Parameters
    ----------
    method, preset : names.
    recording, stances : of one walk.
    field : at its footfalls; None where it is unknown.
    heading : rad clockwise from north, of the body's x axis at the start; None for zero, or what the compass says.
    swing_density : of the rate in a swing, 1/sqrt(Hz), as the smoother finds it, for `matched` alone; None for its own.
    changes : of the preset's parameters.

    Raises
    ------
    EstimationError
        For names that are none, and where the filter cannot solve this walk.
    """
    parameters = changed(parameters_of(method, preset), changes)
    if isinstance(parameters, AiezParameters):
        solution = run_aiez(recording, stances, field, parameters, heading, method)
    elif isinstance(parameters, MatchedParameters):
        if swing_density is not None:
            core = replace(parameters.inertial, gyr_relative_density=swing_density)
            parameters = replace(parameters, inertial=core)
        solution = run_matched(recording, stances, field, parameters, heading, method)
    elif isinstance(parameters, GatedCompassParameters):
        solution = run_gated_compass(recording, stances, field, parameters, heading, method)
    else:
        solution = run_iez(recording, stances, parameters, heading or 0.0)
    return replace(solution, method=method, notes=(*solution.notes, *preset_notes(method.removesuffix(RTS), preset)))


def preset_notes(method: str, preset: str) -> tuple[str, ...]:
    """What is told the user of a preset."""
    if preset == TUNED and method not in tuned.TUNED:
        return ()
    left_out = (NOT_RUN[method],) if preset == AS_PRINTED and method in NOT_RUN else ()
    return (f"preset {preset}", *left_out)
