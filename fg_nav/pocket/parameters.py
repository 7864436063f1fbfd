"""What the pocket's filter believes of sensor and leg.

The paper prints the noises of its emulated sensor (Table 2) and the form of everything, but no prior, no figures of
the bias model, none of the accelerometer, and no threshold: what is chosen here says why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fg_nav.errors import EstimationError
from fg_nav.frames import GRAVITY_M_S2

_ABOVE_ZERO = (
    "gyro_bias_sigma_deg_s", "bias_time_s", "acc_sigma_m_s2", "zero_acceleration_m_s2", "gravity",
    "mag_sigma_uT", "field_window_s", "field_false_alarm", "longest_difference_s", "still_s",
)  # fmt: skip
_NOT_BELOW_ZERO = (
    "gyr_density_deg", "bias_instability_deg_h", "gravity_window_s", "zero_acceleration_s",
    "shortest_difference_s", "field_drift_uT_s", "tilt_sigma_deg",
)  # fmt: skip


@dataclass(frozen=True)
class PocketParameters:
    """Of the filter of Munoz Diaz et al. (2017); `fg_nav.pocket.presets` has them by name.

    Noises of the gyroscope are densities, so that the result does not hang on the sampling rate.
    """

    gyr_density_deg: float = 0.01
    """White error of the rate, deg/s/sqrt(Hz): Table 2, 0.1 deg/s a sample, taken to be at 100 Hz."""
    gyro_bias_sigma_deg_s: float = 0.035
    """Bias before anything is known, deg/s. Not printed. It alone sets how soon the z bias is found, as its inverse
    square; with this one the simulated street has the minutes of Figure 9. A MEMS sensor's own is 0.1 to 0.5."""
    bias_instability_deg_h: float = 10.0
    """B of Eq. 24, deg/h; its stationary standard deviation is B / sqrt(2). Not printed: usual for a good MEMS."""
    bias_time_s: float = 200.0
    """t_B of Eq. 25, s, where the Allan deviation is lowest. Not printed: of such sensors 100 to 300."""
    bias_returns_to_zero: bool = False
    """Eq. 10 as printed, b <- c b with c = exp(-h / t_B). Otherwise c = 1, a random walk of the same steps."""
    latitude_deg: float | None = None
    """Latitude, deg north, to take the Earth's rate off (Eq. 26-27); None as in the paper's filter, which does not."""
    gravity_window_s: float = 2.0
    """Specific force is a weighted mean over so long, two strides, taken in every half of it (`fg_nav.pocket.gravity`);
    0 as in the paper, the sample's own. Not printed; in the simulated pocket the paper's way does not hold the tilt."""
    acc_sigma_m_s2: float = 0.3
    """What a specific force that looks like gravity alone still has of motion, m/s^2 an axis: 0.1 to 0.25, and 0.03 of
    accelerometer. The paper says the accelerometer's noise, and not how much it is."""
    zero_acceleration_m_s2: float = 0.3
    """Zero-acceleration detector: how far the strength of the specific force may be off gravity, m/s^2. Not printed."""
    zero_acceleration_s: float = 0.05
    """... and for how long it must have been so, s. Not printed."""
    gravity: float = GRAVITY_M_S2
    """m/s^2 (2.1.3 has 9.8)."""
    gravity_update: bool = True
    """Whether the absolute gravity update is used."""
    mag_sigma_uT: float = 0.015
    """White error of the magnetometer, uT an axis and sample (Table 2)."""
    field_update: bool = True
    """Whether the differential magnetic field update is used, where there is a magnetometer."""
    field_gated: bool = True
    """Whether it waits for the disturbance detector; the paper leaves it on in homogeneous fields."""
    field_window_s: float = 0.5
    """Disturbance detector: over how long the strength must keep still, s: half a stride. Not printed."""
    field_drift_uT_s: float = 0.5
    """... and the steady change of it that may pass, uT/s. Not printed: it may turn the field by some 1 deg/s."""
    field_false_alarm: float = 0.01
    """... and how often noise alone may fail."""
    shortest_difference_s: float = 0.0
    """Fields at least so far apart are compared, s; 0 as in the paper, from each sample to the next. The noise of a
    difference does not grow with the time that the bias had to turn it: 0.25 s finds the z bias in 1.5 min, not 13."""
    longest_difference_s: float = 0.25
    """... but none that are farther apart than the shortest and this, s: a gap in the magnetometer."""
    difference_as_printed: bool = False
    """Eq. 15 as printed, A mu, where A^T mu must stand."""
    arctangent_as_printed: bool = False
    """Eq. 12 as printed: the arctangent of one argument, which knows no sensor upside down."""
    euler_state: bool = False
    """State and covariance in Euler angles as printed (Eq. 1), which end at a pitch of +-90 deg. Otherwise the error is
    a small rotation in nav: the same filter to first order, in any position."""
    still_s: float = 1.0
    """The attitude at the start is levelled by the mean over this, s (2.1)."""
    tilt_sigma_deg: float = 0.5
    """Tilt after levelling at rest, deg: a MEMS accelerometer's bias. Not printed."""

    def __post_init__(self) -> None:
        for name in _ABOVE_ZERO:
            if not 0.0 < getattr(self, name) < math.inf:
                raise EstimationError(f"{name} of {getattr(self, name):g} cannot be: give a number above zero.")
        for name in _NOT_BELOW_ZERO:
            if not 0.0 <= getattr(self, name) < math.inf:
                raise EstimationError(f"{name} of {getattr(self, name):g} cannot be: give zero or more.")
        if not self.field_false_alarm < 1.0:
            raise EstimationError(f"field_false_alarm of {self.field_false_alarm:g} is no share: give one below 1.")
        if self.latitude_deg is not None and not abs(self.latitude_deg) <= 90.0:
            raise EstimationError(f"latitude_deg of {self.latitude_deg:g} is none: give -90 to 90, or None.")

    @property
    def bias_walk_deg_s(self) -> float:
        """Random walk of the bias, deg/s/sqrt(s): sigma_n of Eq. 24 over the root of a sample's period."""
        return float(self.bias_instability_deg_h / 3600.0 / self.bias_time_s**0.5)
