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
    gravity_window_s: float = 2.0
    """Specific force is a mean over so long, two strides, taken in every half of it (`fg_nav.pocket.gravity`)."""
    acc_sigma_m_s2: float = 0.3
    """What such a mean still has of motion, m/s^2 an axis."""
    zero_acceleration_m_s2: float = 0.3
    """How far the strength of the mean may be off gravity, m/s^2."""
    gravity: float = GRAVITY_M_S2
    """m/s^2."""
    gravity_freedom: float = 5.0
    """Degrees of freedom of the t-distribution of a mean force: a start, a stop or a turn is no steady gait."""
    mag_sigma_uT: float = 0.5
    """White error of the magnetometer, uT an axis and sample: a MEMS one's at 100 Hz."""
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
