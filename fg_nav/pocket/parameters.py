"""Parameters of the pocket's two estimators of orientation, and the filter's presets.

MD prints the noises of its emulated sensor (Table 2) and the form of the equations, but no prior, no figures of the
bias model, none of the accelerometer and no threshold: each value chosen here gives its reason.

The gyroscope's noises are densities, so that results do not depend on the sampling rate; filter and smoother share
them.

====================== ============================================================================================
munoz-diaz2017         MD's filter with its misprints corrected; the default
munoz-diaz2017-printed the equations as printed (`fg_nav.pocket.filter_equations`), and gravity by single samples, with
                       the noise of an accelerometer of 0.003 m/s^2/sqrt(Hz): it does not work, and shows why
====================== ============================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError

GYR_DENSITY_DEG = 0.01  # White error of the rate, deg/s/sqrt(Hz): a MEMS's; MD Table 2, 0.1 deg/s at 100 Hz.
BIAS_INSTABILITY_DEG_H = 10.0  # B of MD (24), deg/h, stationary sigma B / sqrt(2). Not printed: usual for a good MEMS.
BIAS_TIME_S = 200.0  # t_B of MD (25), s, where the Allan deviation is lowest. Not printed: such sensors have 100 to 300
EARTH_RATE_RAD_S = 7.29e-5  # Rotation rate of the Earth, MD (27).


def compute_bias_walk() -> float:
    """Random walk of the bias, rad/s/sqrt(s): sigma_n of MD (24) over the root of a sample's period."""
    return float(np.radians(BIAS_INSTABILITY_DEG_H / 3600.0 / BIAS_TIME_S**0.5))


def compute_bias_decay(returns_to_zero: bool) -> float:
    """Decay rate of the bias, 1/s: that of MD (10), or zero for a random walk."""
    return 1.0 / BIAS_TIME_S if returns_to_zero else 0.0


def compute_earth_rate(latitude_deg: float | None) -> Floats:
    """Rotation rate of the Earth (3,) rad/s in nav, MD (27); zero for None, where it is not removed."""
    if latitude_deg is None:
        return np.zeros(3)
    latitude = np.radians(latitude_deg)
    return EARTH_RATE_RAD_S * np.array([0.0, np.cos(latitude), np.sin(latitude)])


@dataclass(frozen=True)
class PocketParameters:
    """Of the filter of Munoz Diaz et al. (2017).

    Attributes
    ----------
    gyro_bias_sigma_deg_s : prior sigma of the bias. Not printed. It alone sets how soon the z bias is found, as its
        inverse square; with this one the simulated street has the minutes of MD Figure 9. A MEMS has 0.1 to 0.5.
    bias_returns_to_zero : MD (10) as printed, b <- c b with c = exp(-h / t_B); otherwise a random walk, c = 1.
    latitude_deg : north, to remove the Earth's rate, MD (26), (27); None as in MD's filter, which does not.
    gravity_window_s : the specific force is a weighted mean over two strides, used once every half window
        (`average_force`); 0 as in MD, the sample's own, which does not hold the tilt in the simulated pocket.
    acc_sigma_m_s2 : motion left in a specific force that looks like gravity alone, an axis: 0.1 to 0.25, and 0.03 of
        accelerometer. MD uses the accelerometer's noise without its value.
    gravity_update, field_update : whether the updates are used, the latter where there is a magnetometer.
    mag_sigma_uT : white error of the magnetometer, an axis and sample (MD Table 2).
    field_gated : whether the field's needs a field that holds still; MD leaves it on in homogeneous fields.
    shortest_difference_s : between fields that are compared; 0 as in MD, from each sample to the next. The noise of a
        difference does not grow with the time over which the bias turns it: 0.25 s finds z in 1.5 min, not 13.
    difference_as_printed : MD (15) as printed, A mu, where A^T mu must stand.
    arctangent_as_printed : MD (12) as printed, of one argument, which fails for a sensor upside down.
    euler_state : state and covariance in Euler angles as printed, MD (1), which end at a pitch of +-90 deg; otherwise
        the error is a small rotation in nav: the same filter to first order, in any attitude.
    """

    gyro_bias_sigma_deg_s: float = 0.035
    bias_returns_to_zero: bool = False
    latitude_deg: float | None = None
    gravity_window_s: float = 2.0
    acc_sigma_m_s2: float = 0.3
    gravity_update: bool = True
    mag_sigma_uT: float = 0.015
    field_update: bool = True
    field_gated: bool = True
    shortest_difference_s: float = 0.0
    difference_as_printed: bool = False
    arctangent_as_printed: bool = False
    euler_state: bool = False

    def __post_init__(self) -> None:
        for name in ("gyro_bias_sigma_deg_s", "acc_sigma_m_s2", "mag_sigma_uT"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise EstimationError(f"{name} of {getattr(self, name):g} cannot be: give a number above zero.")
        for name in ("gravity_window_s", "shortest_difference_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise EstimationError(f"{name} of {getattr(self, name):g} cannot be: give zero or more.")
        if self.latitude_deg is not None and not abs(self.latitude_deg) <= 90.0:
            raise EstimationError(f"latitude_deg of {self.latitude_deg:g} is none: give -90 to 90, or None.")


@dataclass(frozen=True)
class PocketSmootherParameters:
    """Of `smooth_pocket` and `OnlinePocket`: errors of the sensors, which differ from one to the next.

    Attributes
    ----------
    gyro_bias_sigma_deg_s : prior sigma of the bias: a MEMS sensor's is 0.1 to 0.5.
    gyr_scale_sigma : of scale and misalignment, a fraction of the rate: a sensor calibrated by its maker, 0.1 deg of
        axes. Assumed; chosen with the BROAD trials in view (docs/pocket.md). 0.01 for a bare chip.
    bias_returns_to_zero : AR(1) as in MD (10); otherwise a random walk of the same steps.
    latitude_deg : north, to remove the Earth's rate; None to leave it.
    mag_sigma_uT : white error of the magnetometer, an axis and sample: a MEMS one's at 100 Hz.
    mag_left_uT : error left by its calibration, an axis: 1 % of the field, different at each attitude.
    """

    gyro_bias_sigma_deg_s: float = 0.3
    gyr_scale_sigma: float = 0.002
    bias_returns_to_zero: bool = False
    latitude_deg: float | None = None
    mag_sigma_uT: float = 0.5
    mag_left_uT: float = 0.5


# Of the filter by name, the default first.
PRESETS: Mapping[str, PocketParameters] = MappingProxyType(
    {
        "munoz-diaz2017": PocketParameters(),
        "munoz-diaz2017-printed": PocketParameters(
            bias_returns_to_zero=True,
            gravity_window_s=0.0,
            acc_sigma_m_s2=0.03,
            difference_as_printed=True,
            arctangent_as_printed=True,
            euler_state=True,
        ),
    }
)
