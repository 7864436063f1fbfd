"""What the smoother believes about sensor, foot and walk.

Noise densities do not depend on the sampling rate: a white error of s a sample at rate f has the density s/sqrt(f).
Process noise is that of a foot, not of a sensor at rest: scale errors, soft mounting, impacts and jitter grow with
the motion, so each density has a floor (stance) and a part relative to the motion (swing).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from fg_nav.detection import RestParameters
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.smoother.field_parameters import FieldParameters
from fg_nav.smoother.walk_parameters import WalkParameters


@dataclass(frozen=True)
class SmootherParameters:
    """Defaults for MEMS sensors on a shoe; `docs/models.md` tells how each was chosen."""

    acc_density: float = 0.005
    """White error of the specific force in stance, m/s^2/sqrt(Hz); data sheets have 0.001, skin and shoe the rest."""
    acc_relative_density: float = 0.01
    """The same per m/s^2 by which |specific force| differs from gravity, 1/sqrt(Hz): shocks, scale, jitter."""
    gyr_density_deg_s: float = 0.015
    """White error of the angular rate in stance, deg/s/sqrt(Hz); data sheets have 0.005 to 0.015."""
    gyr_relative_density: float = 0.001
    """The same per rad/s of rate, 1/sqrt(Hz): scale, misalignment, jitter."""
    choose_swing_noise: bool = True
    """Let the walk tell `gyr_relative_density` (`noise_level`); the value above is for walks too short to tell."""
    saturated_share: float = 0.1
    """What a peak cut at the end of the range may hide, one sigma, as a share of the range."""
    position_density: float = 1e-3
    """White error of velocity, m/s/sqrt(Hz): rounding of a sample's motion; keeps short intervals well conditioned."""

    velocity_sigma: float = 0.004
    """Velocity of a foot that stands and does not turn, m/s (Peruzzi et al. 2011: below 0.011)."""
    roll_sigma_m: float = 0.05
    """How far the point about which the foot turns wanders, m: half the width of a foot."""
    unsteady_s: float = 0.03
    """Time for which an acceleration in stance may already have lasted, s: a footfall's tremble is at 10 Hz."""
    settling_m: float = 0.0015
    """By how much the sole gives way under the load of a stance, m, with as large a sigma: a shoe is soft."""
    settling_sigma_m: float = 0.0015
    """By how much all stances of a walk may do so more, or less, m: on motion-captured walks shoe, gait and mounting
    together are worth 3 to 5 mm of height a stride, one sigma; 1.5 mm in `settling_time_s` make 5."""
    settling_walk_m: float = 2e-5
    """Random walk of that, m/sqrt(s): 1 mm in an hour; a sole gets warm, a lace loose, a carpet begins."""
    settling_time_s: float = 0.3
    """Shortest time in which it does."""
    known_lever: tuple[float, float, float] | None = None
    """Sensor above the rolling point, body frame, m; None: estimated from the recording."""

    node_spacing_s: float = 0.2
    """Distance of the graph's nodes in a stance."""
    long_stance_s: float = 0.5
    """Beyond this length of a stance, nodes stand `rest_spacing_s` apart."""
    rest_spacing_s: float = 0.5
    shortest_interval_s: float = 0.015
    """Nodes are not closer."""
    bias_spacing_s: float = 10.0
    """Footfalls within this time share one bias: its random walk in between is 0.002 deg/s."""

    gyro_bias_sigma_deg_s: float = 0.15
    """Gyro bias of a factory-calibrated sensor before a rest has shown it, deg/s."""
    gyro_bias_walk_deg_s: float = 6e-4
    """Its random walk, deg/s/sqrt(s): 0.04 deg/s in an hour."""
    acc_bias_sigma: float = 0.02
    """Accelerometer bias, m/s^2 (2 mg)."""
    acc_bias_walk: float = 1e-4
    """Its random walk, m/s^2/sqrt(s)."""
    tilt_sigma_deg: float = 1.0
    """Tilt after levelling in the first stance, deg."""
    gauge_sigma: float = 1e-4
    """Position (m) and heading (rad) at the start are known by definition."""
    rest: RestParameters = field(default_factory=RestParameters)
    gravity: float = GRAVITY_M_S2
    """m/s^2."""

    unknown_heading_deg: float = 60.0
    """Sigma of the heading at the start about what the walk's mean field says, where nobody told it."""
    magnetic: FieldParameters = field(default_factory=FieldParameters)
    """The magnetic field."""
    walk: WalkParameters = field(default_factory=WalkParameters)
    """People and buildings."""

    convergence: float = 5e-4
    """The solver stops when the error differs from what the linear model promised by less than this per variable: by
    then the nodes of an hour's walk move by millimetres, at a sigma of metres."""
    largest_steps: int = 25
    """And gives up after so many."""


PLAIN = SmootherParameters(
    roll_sigma_m=0.0, unsteady_s=0.0, settling_m=0.0, settling_sigma_m=1e-6, known_lever=(0.0, 0.0, 0.0)
)
"""Plain zero velocity: every instant of a stance is equally, fully still. For ablation."""
