"""Sensor and foot as every filter models them; what it makes of the field is its own parameter.

All noises are densities: a white error of s a sample at rate f has the density s / sqrt(f), and the result
does not depend on the sampling rate.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from fg_nav.detection import RestParameters
from fg_nav.frames import GRAVITY_M_S2

STANCE_CORRELATION_S = 0.04
"""Time over which the rolling lever, and a velocity from a force that is not gravity, stay the same: part of a stance.
It equals half the spacing of the smoother's velocity factors (`fg_nav.ekf.presets`)."""

ACC_BIAS_SIGMA = 0.02  # Accelerometer bias, m/s^2 (2 mg).
ACC_BIAS_WALK = 1e-4  # Its random walk, m/s^2/sqrt(s).
VELOCITY_SIGMA = 0.01  # Velocity at the start, in stance, m/s.


@dataclass(frozen=True)
class IezParameters:
    """Noises of sensor and foot; `OPENSHOE` has the values of the literature."""

    acc_density: float = 0.02
    """White error of the specific force, m/s^2/sqrt(Hz). Sheets say 0.001; impacts ring on."""
    acc_relative_density: float = 0.007
    """The same per m/s^2 of acceleration, sqrt(s): 2 %, correlated over 60 ms."""
    gyr_density_deg: float = 0.015
    """White error of the angular rate, deg/s/sqrt(Hz). Sheets of MEMS gyroscopes: 0.005 to 0.015."""
    gyr_relative_density: float = 5e-4
    """The same per rad/s of rate, sqrt(s): 0.15 %, correlated over 60 ms."""
    saturated_share: float = 0.3
    """What a peak cut at the end of the range may hide, as a share of the range."""
    zero_velocity_density: float = 1e-3
    """Velocity of a foot that stands and does not turn, m/s/sqrt(Hz): 5 mm/s, correlated over 20 ms."""
    roll_height_m: float = 0.06
    """Height of the sensor above the point about which the foot rolls, m; 0 for plain zero velocity."""
    rolling_lever_m: tuple[float, float, float] | None = None
    """From the point about which the foot rolls to the sensor, body frame, m; None for the height straight up."""
    roll_sigma_m: float = 0.05
    """Uncertainty of that lever, in any direction, m."""
    unsteady_s: float = 0.0
    """Time for which a specific force that is not gravity may already have lasted in stance, s; 0 to leave it out."""
    gyro_bias_sigma_deg_s: float = 0.2
    """Gyro bias of a calibrated sensor, deg/s, before a rest has measured it."""
    gyro_bias_walk_deg_s: float = 1e-4
    """Its random walk, deg/s/sqrt(s): 0.004 deg/s in half an hour."""
    tilt_sigma_rest_deg: float = 0.3
    """Tilt after levelling at rest, deg: the accelerometer bias, with a margin."""
    tilt_sigma_deg: float = 2.0
    """Tilt after levelling in a stance that is no rest, deg: 0.3 m/s^2 of motion is taken for gravity."""
    gravity: float = GRAVITY_M_S2
    """m/s^2."""
    rest: RestParameters = field(default_factory=RestParameters)
    """When the first stance is a rest."""
    smoothed: bool = False
    """Smooth backward over the pass, so that every state uses the whole walk (`fg_nav.ekf.rts`)."""


OPENSHOE = IezParameters(
    acc_density=0.5 / 200.0**0.5,
    acc_relative_density=0.0,
    gyr_density_deg=0.5 / 200.0**0.5,
    gyr_relative_density=0.0,
    saturated_share=0.0,
    zero_velocity_density=0.01 / 200.0**0.5,
    roll_height_m=0.0,
    roll_sigma_m=0.0,
    gyro_bias_sigma_deg_s=0.05,
)
"""Constant noise and a foot that does not roll: 0.5 m/s^2, 0.5 deg/s and 0.01 m/s a sample at 200 Hz (Nilsson
et al. 2012, "Foot-mounted INS for everybody"; PyShoe has the same). Here the biases are estimated; there they are not.
"""
