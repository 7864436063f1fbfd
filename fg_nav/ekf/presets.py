"""The filters of the papers, each in several presets: as printed, physical, tuned (docs/filters.md#presets).

Sigma of a heading as printed: Ma's 0.067 rad is that of the detector's changes, and he gives none of the compass; 8 deg
is our choice by his other figures. AIEZ gives none: 5 deg for the compass, 1 deg for HDR within 5 deg of five strides,
and 1 deg for roll and pitch are our choice.

Tuned: by `scripts/tune_filters.py` on simulated walks that are not reported, smooth and rough fields alike. What is not
named is as in the preset `physical`. Detectors keep their shape: an `allowance` multiplies sigma and least change that
matters of each channel; they are the smoother's gates too (`fg_nav.magnetic.detectors.TUNED`). On the smooth field
alone Ma's physical gate is best, with 7 to 10 deg; on the rough one it passes nothing, and a filter that uses nearly
every compass with 20 to 30 deg halves the error of the IEZ. So the tuned gates reject the wildest changes only.

`MATCHED` is the fair opponent of the factor graph: IEZ and gated compass with the smoother's model of sensor, foot and
walk. It has the values of `fg_nav.smoother.parameters.SmootherParameters` (a test compares them), in the units of a
filter that updates at every sample:

=================================== ===============================================================================
density of the force                its relative part is per m/s^2 of | |f| - g | there and of the acceleration |a|
                                    here; in a swing the first is 0.75 of the second (rms, simulated walks)
velocity in stance                  a velocity factor each 0.08 s there (nodes of walking stances, mean), so that its
                                    sigma is here a density of sigma sqrt(0.08 s)
rolling lever                       estimated from the recording by the same function, in the body frame
rest                                both start from the gyro bias of the first one; later ones only the graph uses
rate of a swing                     its relative density is estimated from the walk: `fg_nav.estimators` passes it
settling of the sole, rounding      left out: 3 mm/s downward in stance, 1 mm in a second
=================================== ===============================================================================

Its compass is that of Ma 2018, tuned where that is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import TypeAlias

from fg_nav.detection.rest import estimate_lever
from fg_nav.detection.stance import Stances
from fg_nav.ekf.compass import AiezParameters, GatedCompassParameters, run_with_compass
from fg_nav.ekf.core import OPENSHOE, STANCE_CORRELATION_S, IezParameters, run_iez
from fg_nav.errors import EstimationError
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.detectors import AGREEING, DETECTORS
from fg_nav.magnetic.detectors import TUNED as TUNED_DETECTORS
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.text import Changes, change_parameters

FACTOR_SPACING_S = 2 * STANCE_CORRELATION_S
FORCE_SHARE = 0.75

MATCHED = IezParameters(  # Sensor and foot; the lever is estimated from the recording.
    acc_density=0.005,
    acc_relative_density=FORCE_SHARE * 0.01,
    gyr_density_deg=0.05,
    gyr_relative_density=0.001,
    saturated_share=0.1,
    zero_velocity_density=0.004 * FACTOR_SPACING_S**0.5,
    roll_height_m=0.0,
    roll_sigma_m=0.12,
    unsteady_s=0.03,
    gyro_bias_sigma_deg_s=0.15,
    gyro_bias_walk_deg_s=6e-4,
    tilt_sigma_rest_deg=1.0,
    tilt_sigma_deg=1.0,
)


@dataclass(frozen=True)
class MatchedParameters(GatedCompassParameters):
    """As of the gated compass, with the matched core."""

    inertial: IezParameters = MATCHED  #: Sensor and foot, the lever estimated where none is given.


def match_compass(compass: GatedCompassParameters) -> MatchedParameters:
    """Return the filter with the compass of another one: its detector and its sigmas."""
    kept = {item.name: getattr(compass, item.name) for item in fields(compass) if item.name != "inertial"}
    return MatchedParameters(**kept)


Parameters: TypeAlias = IezParameters | GatedCompassParameters  # Of any filter here.

AS_PRINTED, PHYSICAL, TUNED = "as-printed", "physical", "tuned"
PRESETS = (TUNED, PHYSICAL, AS_PRINTED)  # Their names, the default first.
GATED = ("qsf", "iqsf", "ma2018", "qsf-stance")  # Gated by the detector of the same name; the last one is Zhang's QMD.
_MA_SIGMA_DEG = 8.0  # Not printed. Of 4 to 30 deg it gives most of his figures together, on seeds 51 to 59.


_PRINTED_GATE = GatedCompassParameters(
    DETECTORS["qsf-stance"], compass_sigma_deg=_MA_SIGMA_DEG, levelled_by_force=True, inertial=OPENSHOE
)

_AS_PRINTED: Mapping[str, Parameters] = {
    "iez": OPENSHOE,
    **{method: replace(_PRINTED_GATE, detector=DETECTORS[f"{method}-printed"]) for method in ("qsf", "iqsf", "ma2018")},
    "qsf-stance": _PRINTED_GATE,
    "aiez": AiezParameters(
        DETECTORS["aiez-printed"],
        compass_sigma_deg=5.0,
        levelled_by_force=True,
        inertial=OPENSHOE,
        tilt_sigma_deg=1.0,
        course_sigma_deg=1.0,
        course_limit_deg=5.0,
        hdr_as_printed=True,
    ),
}

_PHYSICAL: Mapping[str, Parameters] = {
    "iez": IezParameters(),
    **{method: GatedCompassParameters(DETECTORS[method]) for method in GATED},
    "aiez": AiezParameters(AGREEING, start_sigma_deg=10.0),  # its test counts this variance
    "matched": match_compass(GatedCompassParameters(DETECTORS["ma2018"])),
}


# The preset `tuned`, by method.
TUNED_PARAMETERS: Mapping[str, GatedCompassParameters] = MappingProxyType(
    {
        **{method: GatedCompassParameters(TUNED_DETECTORS[method], compass_sigma_deg=30.0) for method in GATED},
        "aiez": AiezParameters(
            TUNED_DETECTORS["aiez"], compass_sigma_deg=20.0, start_sigma_deg=20.0, course_sigma_deg=16.0
        ),
    }
)

_SETS: Mapping[str, Mapping[str, Parameters]] = MappingProxyType(
    {
        AS_PRINTED: _AS_PRINTED,
        PHYSICAL: _PHYSICAL,
        TUNED: {**_PHYSICAL, "matched": match_compass(TUNED_PARAMETERS["ma2018"]), **TUNED_PARAMETERS},
    }
)

# What breaks a filter as printed (docs/equations.md) and is run as corrected, in that preset too.
NOT_RUN: Mapping[str, str] = MappingProxyType(
    {
        "ma2018": "not run as printed: the sign of the heading, Ma (1), H on the gyro bias (36), attitude (38), (39)",
        "aiez": "not run as printed: heading without its sign, AIEZ (25), Euler angles for rotations (29)",
    }
)

RTS = "-rts"  # After the name of any filter: smoothed backward over its pass (`fg_nav.ekf.rts`).


def find_parameters(method: str, preset: str = TUNED) -> Parameters:
    """Return the parameters of a filter in a preset.

    Raises `EstimationError` if there is no such preset, or no filter of this name.
    """
    check_preset(preset)
    name = method.removesuffix(RTS)
    if name not in _SETS[preset]:
        raise EstimationError(f"there is no preset '{preset}' of '{method}': only of {', '.join(_SETS[preset])}.")
    parameters = _SETS[preset][name]
    if name == method:
        return parameters
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
    """Run a filter in a preset, with `changes` of its parameters.

    `heading` is rad clockwise from north, of the body's x axis at the start, None for zero or that of the compass;
    `swing_density`, 1/sqrt(Hz), that of the rate in a swing as the smoother estimates it, for `matched` alone.

    Raises `EstimationError` for names that are none, and where the filter cannot solve this walk.
    """
    parameters = change_parameters(find_parameters(method, preset), changes)
    # swing and rolling lever of this walk
    if isinstance(parameters, MatchedParameters):
        core = parameters.inertial
        if swing_density is not None:
            core = replace(core, gyr_relative_density=swing_density)
        if core.rolling_lever_m is None:
            x, y, z = estimate_lever(recording, stances).lever.tolist()
            core = replace(core, rolling_lever_m=(x, y, z))
        parameters = replace(parameters, inertial=core)
    # pass
    if isinstance(parameters, GatedCompassParameters):
        solution = run_with_compass(recording, stances, field, parameters, heading, method)
    else:
        solution = run_iez(recording, stances, parameters, heading or 0.0)
    # notes on the preset
    name, notes = method.removesuffix(RTS), list(solution.notes)
    if preset != TUNED or name in TUNED_PARAMETERS:
        notes.append(f"preset {preset}")
    if preset == AS_PRINTED and name in NOT_RUN:
        notes.append(NOT_RUN[name])
    return replace(solution, method=method, notes=tuple(notes))
