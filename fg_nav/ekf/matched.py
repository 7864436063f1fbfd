"""The fair opponent of the factor graph: IEZ and gated compass with the smoother's model of sensor, foot and walk.

`MATCHED` has the values of `fg_nav.smoother.parameters.SmootherParameters` (a test compares them), in the units of a
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

Its compass is that of Ma 2018, tuned where that is. With the backward pass (`-rts`) it uses as much of the walk as the
graph does: the remaining differences are the linearization, the nodes, and the graph's model of the field.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from fg_nav.detection.rolling_lever import estimate_lever
from fg_nav.ekf.gated_compass import GatedCompassParameters, run_gated_compass
from fg_nav.ekf.parameters import STANCE_CORRELATION_S, IezParameters
from fg_nav.magnetic import FootfallField
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances

FACTOR_SPACING_S = 2 * STANCE_CORRELATION_S
FORCE_SHARE = 0.75

MATCHED = IezParameters(
    acc_density=0.005,
    acc_relative_density=FORCE_SHARE * 0.01,
    gyr_density_deg=0.015,
    gyr_relative_density=0.001,
    saturated_share=0.1,
    zero_velocity_density=0.004 * FACTOR_SPACING_S**0.5,
    roll_height_m=0.0,
    roll_sigma_m=0.05,
    unsteady_s=0.03,
    gyro_bias_sigma_deg_s=0.15,
    gyro_bias_walk_deg_s=6e-4,
    tilt_sigma_rest_deg=1.0,
    tilt_sigma_deg=1.0,
)
"""The core; the lever is estimated from the recording."""


@dataclass(frozen=True)
class MatchedParameters(GatedCompassParameters):
    """As of the gated compass, with the matched core."""

    inertial: IezParameters = MATCHED
    """The core, its lever estimated where none is given."""


def match_compass(compass: GatedCompassParameters) -> MatchedParameters:
    """Return the filter with the compass of another one: its detector and its sigmas."""
    kept = {item.name: getattr(compass, item.name) for item in fields(compass) if item.name != "inertial"}
    return MatchedParameters(**kept)


def run_matched(
    recording: Recording,
    stances: Stances,
    field: FootfallField | None,
    parameters: MatchedParameters,
    heading: float | None = None,
    method: str = "matched",
) -> Solution:
    """Estimate the lever, and navigate a walk as `fg_nav.ekf.gated_compass.run_gated_compass` does."""
    core = parameters.inertial
    if core.rolling_lever_m is None:
        x, y, z = estimate_lever(recording, stances).lever.tolist()
        core = replace(core, rolling_lever_m=(x, y, z))
    return run_gated_compass(recording, stances, field, replace(parameters, inertial=core), heading, method)
