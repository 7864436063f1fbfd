"""What the smoother believes about sensor, foot and walk.

Noise densities do not depend on the sampling rate: a white error of s a sample at rate f has the density s/sqrt(f).
Process noise is that of a foot, not of a sensor at rest: scale errors, soft mounting, impacts and jitter grow with
the motion, so each density has a floor (stance) and a part relative to the motion (swing).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from fg_nav.detection import RestParameters
from fg_nav.factors.floor_height import FloorParameters
from fg_nav.factors.straight_walk import StraightParameters
from fg_nav.frames import GRAVITY_M_S2


@dataclass(frozen=True)
class FieldParameters:
    """Defaults for a magnetometer on a shoe; `docs/magnetic.md` tells how each was chosen."""

    compass: bool = True
    """Use the direction of the field at each footfall."""
    potential: bool = True
    """Use the line integral of the field over the strides."""
    rounds: int = 2
    """How often noise and verdicts are taken anew from the smoothed walk: the first time from a walk without the field,
    whose heading has drifted."""
    first_convergence: float = 0.05
    """How near its minimum the walk without the field has to be to look at the field along it, as `convergence` of the
    smoother: by then it is millimetres and thousandths of a degree a stride from there."""
    gate: str | None = None
    """A detector of a quasi-static field (`fg_nav.magnetic.quasi_static`) that a footfall has to pass; None for the
    walk's own spread alone."""
    outside_gate: float = 3.0
    """By how much larger the compass's noise is where the detector does not pass the field; infinite: not used."""
    outlier_sigmas: float = 5.0
    """A footfall is disturbed where its field is off by more than this many robust sigmas of the walk's own spread: of
    a field with the heavy tails of real ones (kurtosis 6) one in a thousand."""

    reference_sigma_deg: float = 1.0
    """How well compass and given heading have the same north, deg: declination, mounting, soft iron."""
    strength_sigma_uT: float = 5.0
    """Horizontal strength of the field about the walk's median, uT."""
    mean_walk_uT: float = 0.003
    """By how much the building's mean field changes from stride to stride, uT: 0.1 uT over a kilometre and a half."""
    regional_share: float = 3.0
    """What rooms and wings of a building do to the compass, as a share of how the field differs from footfall to
    footfall, before the walk has shown it: wide, for one who is wrong here on a short walk bends it; nothing in a
    homogeneous field."""
    regional_share_of_mean: float = 0.3
    """What of that is left in the mean field of a short walk, from which north is taken where nobody told a heading."""
    regional_length_m: float = 20.0
    """For how long."""
    regional_weight: float = 5.0
    """How many regions' worth of evidence this assumption is: a walk through more of them learns its own value."""
    hard_iron_level_uT: float = 0.3
    """Hard iron left in the stance's level plane after a calibration, uT."""
    hard_iron_up_uT: float = 15.0
    """The same upward: a calibration from footfalls cannot see it, and in a swing it turns forward."""
    hard_iron_walk_uT: float = 5e-3
    """Its random walk from stride to stride, uT: 0.16 uT in a thousand. A tilt that is wrong in every swing looks like
    iron too, and changes with the gait."""

    compass_sigma_uT: float = 0.3
    """Noise of a footfall's mean field, uT: what levelling and a soft sole leave, white from stride to stride."""
    path_sigma_uT_m: float = 0.1
    """Noise of the line integral over a stride, uT m: sampling, and what scale errors leave."""
    potential_least_path_m: float = 300.0
    """Shorter walks do without the line integral: they cannot tell how far the building's potential reaches, and take
    too little for it (ten real walks of 35 to 150 m, `scripts/real_walks.py`)."""
    coarsest_m: float = 0.4
    """Longest move between two samples of the field that a line integral passes over: the floor's steel is as near."""
    least_strength_uT: float = 3.0
    """Horizontal strength below which there is no compass."""


@dataclass(frozen=True)
class WalkParameters:
    """Ties between footfalls (`walk_ties`), and what is needed to use fixes (`walk_fixes`)."""

    straight: bool = False
    """People mostly walk straight on. Off: a corridor that bends by less than a degree over ten strides is believed to
    be straight, and nothing in the recording can tell."""
    straight_walk: StraightParameters = field(default_factory=StraightParameters)
    straight_within_m: float = 0.15
    """Off the line between its ends within which a stretch may be straight: two sigmas of weaving by 7 cm."""

    floors: bool = False
    """All footfalls on one floor are at one height. Off: a ramp looks like drift, and is made level."""
    floor_sigma_m: float = 0.02
    """Height of the sensor in a stance above its floor: mats, thresholds, and how the foot is set down, a centimetre
    each."""
    floor: FloorParameters = field(default_factory=FloorParameters)
    """What is a step, and what is another floor."""

    given_heading_deg: float = 5.0
    """Sigma of the heading at the start that was told, where fixes tell it as well: a compass held by hand, or a line
    on a plan. Fixes tell it once they leave less doubt than this."""
    fix_reach_s: float = 1.5
    """Farther than a stride from any node there is nothing to tie a fix to."""
    fix_speed_m_s: float = 1.4
    """Walking pace: for so much a second between a fix and the node it is tied to its sigma grows."""


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
