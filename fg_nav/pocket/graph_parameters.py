"""What the pocket's graph believes of sensor, leg and field."""

from __future__ import annotations

from dataclasses import dataclass

from fg_nav.frames import GRAVITY_M_S2


@dataclass(frozen=True)
class PocketGraphParameters:
    """Of `smooth_pocket` and `OnlinePocket`. Noises of samples that depend on the rate are densities."""

    node_s: float = 0.5
    """From node to node, s: a bias of 1 deg/s is off by 0.5 deg then, and a walker goes 0.6 m."""
    gyr_density_deg: float = 0.01
    """White error of the rate, deg/s/sqrt(Hz): a MEMS sensor's; Table 2 of the paper at 100 Hz."""
    gyro_bias_sigma_deg_s: float = 0.3
    """Bias before anything is known, deg/s: a MEMS sensor's is 0.1 to 0.5."""
    bias_instability_deg_h: float = 10.0
    """B of Eq. 24 of the paper, deg/h: usual for a good MEMS."""
    bias_time_s: float = 200.0
    """t_B of Eq. 25, s, where the Allan deviation is lowest."""
    bias_returns_to_zero: bool = False
    """AR(1) as in Eq. 10 of the paper; otherwise a random walk of the same steps."""
    latitude_deg: float | None = None
    """Latitude, deg north, to take the Earth's rate off; None to leave it."""
    gyr_scale_sigma: float = 0.002
    """Scale and misalignment before anything is known, a part of the rate: a sensor calibrated by its maker, 0.1 deg of
    axes. Assumed; chosen with the BROAD trials in view (docs/pocket.md). 0.01 for a bare chip."""
    rest_rate_deg_s: float = 2.0
    """A mean rate above this about any axis is none of a rest, but for a worse sensor, deg/s."""
    rest_spread_deg_s: float = 1.0
    """Nor is a spread of the rate above this, deg/s: ten times the noise of Table 2."""
    rest_spread_m_s2: float = 0.25
    """Nor one of the force above this, m/s^2: that of a MEMS sensor is 0.02 to 0.1."""
    rest_apart_deg_s: float = 0.05
    """Nor are means over half a second that are so far apart, deg/s, root mean square of an axis: white noise of 0.1
    deg/s at 100 Hz leaves 0.014, a thigh that stands 0.2."""
    rest_sigma_deg_s: float = 0.03
    """How far such a mean may be off the bias, deg/s."""
    rest_sigma_m_s: float = 0.05
    """How fast a sensor at rest may still be, m/s."""
    acc_density_m_s2: float = 0.05
    """Error of the force, m/s^2/sqrt(Hz): white noise of 0.002, and a bias of 0.05 that the body turns in a second."""
    pace_m_s: float = 1.4
    """How fast the body goes, m/s an axis: a walker."""
    pace_walk_m_s: float = 0.05
    """How its velocity walks where it keeps its pace, m/s/sqrt(s): simulated walkers', by the NEES of the tilt."""
    pace_freedom: float = 2.0
    """Degrees of freedom of the t-distribution of such a change: seldom and sudden."""
    swing_m: float = 0.3
    """How far the sensor swings from its place on the body, m an axis: a thigh 0.2, an arm 0.4."""
    swing_freedom: float = 5.0
    """Degrees of freedom of its t-distribution."""
    gravity: float = GRAVITY_M_S2
    """m/s^2."""
    mag_sigma_uT: float = 0.5
    """White error of the magnetometer, uT an axis and sample: a MEMS one's at 100 Hz."""
    mag_left_uT: float = 0.5
    """What a calibration of the magnetometer leaves, uT an axis: 1 % of the field, other at each attitude."""
    field_walk_uT: float = 0.03
    """Random walk of the local field where it seems to keep still, uT/sqrt(s): 0.2 uT in 40 s, or 50 m. The same over
    the strength of the field across, 0.1 deg/sqrt(s), is the walk of heading that a bias is told from."""
    field_freedom: float = 2.0
    """Degrees of freedom of the t-distribution of a step of the field: low, for iron comes suddenly."""
    field_window_s: float = 3.0
    """The strength's spread over so long tells where the field does not keep still, s."""
    field_false_alarm: float = 0.01
    """How often noise alone may seem to be such a spread."""
    field_deviation_uT: float = 0.3
    """How far the local field is from that of the region, uT an axis: outdoors, some metres from iron."""
    field_place_s: float = 10.0
    """So long it is one and the same deviation, s: as many metres. Nodes within it are not independent witnesses."""
    field_prior_uT: float = 60.0
    """How far the local field may be from anything at first, uT an axis: more than the Earth's."""
    gap_turn_deg_s: float = 100.0
    """Where samples are missing, a thigh may have turned at so much, deg/s: the rms of its swing ..."""
    gap_tilt_deg: float = 30.0
    """... but its tilt by no more than this, half of a swing, deg ..."""
    gap_turn_deg: float = 100.0
    """... and its heading by no more than this, deg: about the sigma of one that nobody knows."""
    iterations: int = 20
    """Most rounds of the batch solution, each with new weights."""
    enough_deg_s: float = 1e-4
    """... which end when no bias moves by more, deg/s."""
    lag_s: float = 10.0
    """Online: so long a past is still weighed anew, s."""
    rounds: int = 1
    """Online: rounds for each estimate; weights go on from the last one."""
    push_s: float = 1.0
    """Online: estimates are made so often, s."""

    @property
    def bias_walk_deg_s(self) -> float:
        """Random walk of the bias, deg/s/sqrt(s), as in `PocketParameters`."""
        return float(self.bias_instability_deg_h / 3600.0 / self.bias_time_s**0.5)
