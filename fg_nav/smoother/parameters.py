"""What the smoother assumes about sensor, foot and walk, as far as an ablation or a user varies it."""

from __future__ import annotations

from dataclasses import dataclass, field

from fg_nav.detection import RestParameters
from fg_nav.frames import GRAVITY_M_S2


@dataclass(frozen=True)
class FieldParameters:
    """Defaults for a magnetometer on a shoe; `docs/field.md` says how each was chosen."""

    compass: bool = True  #: Use the direction of the field at each footfall.
    potential: bool = True  #: Use the line integral of the field over the strides.
    differential: bool = True  #: Use what the field shows of the gyro bias while the foot stands.
    rounds: int = 2  #: Of noise and verdicts, taken again from the smoothed walk.
    gate: str = "ma2018"
    """Detector of a quasi-static field (`fg_nav.magnetic.detectors.GATES`) whose statistic weighs the compass of a
    footfall; `none` weighs all alike, `NAME:hard` uses the compass exactly where the detector passes the field."""


@dataclass(frozen=True)
class WalkParameters:
    """Constraints between footfalls (`constraints`)."""

    directions: bool = False
    """Corridors are at right angles to each other (`building`). Off: where they bend by less than a degree over ten
    strides they are taken to be straight, and nothing in the recording can show it."""
    floors: bool = True  #: Footfalls are at one height where the walk shows a level floor (`heights`).
    places: bool = True  #: Footfalls are at one place where the field along the path repeats (`building`).
    barometer: bool = True  #: Footfalls are at the height of the recorded air pressure (`heights`).


@dataclass(frozen=True)
class SmootherParameters:
    """Defaults for MEMS sensors on a shoe; `docs/models.md` says how each was chosen.

    Examples
    --------
    >>> from dataclasses import replace
    >>> parameters = fg_nav.SmootherParameters(gyr_density_deg_s=0.02)
    >>> parameters = replace(parameters, magnetic=replace(parameters.magnetic, compass=False))
    >>> parameters.magnetic.compass, parameters.walk.floors
    (False, True)
    """

    acc_density: float = 0.005  #: White error of the specific force in stance, m/s^2/sqrt(Hz); sheets: 0.001.
    acc_relative_density: float = 0.01  #: Per m/s^2 off gravity in size, 1/sqrt(Hz): shock, scale, jitter.
    gyr_density_deg_s: float = 0.05
    """White error of the angular rate, deg/s/sqrt(Hz); data sheets have 0.005 to 0.015, a shoe that gives under its
    load the rest: what it turns the sensor by is not what it turns the foot by."""
    gyr_relative_density: float = 0.001  #: The same per rad/s of rate, 1/sqrt(Hz): scale, misalignment, jitter.
    choose_swing_noise: bool = True  #: Average the relative density of the rate by the evidence (`problem`).
    saturated_share: float = 0.1  #: What a peak cut at the range may hide, one sigma, as a share of the range.

    roll_sigma_m: float = 0.12  #: Wander of the point about which the foot turns, m: half of heel to toe.
    unsteady_s: float = 0.03  #: How long an acceleration in stance may have lasted, s: footfalls tremble at 10 Hz.
    settling_m: float = 0.0  #: Expected compression of the sole in a stance, m: no recording shows it beforehand.
    settling_sigma_m: float = 0.004
    """By how much all stances of a walk may do so, m, and one stance more or less than the others: with it a stride
    climbs by 0 +- 15 mm, of shoe, gait and mounting together; 4 mm in `SETTLING_TIME_S` make as much."""
    moving_foot: bool = True  #: Count in the sigmas that a foot moves on at its stillest instant (`sensitivity`).
    known_lever: tuple[float, float, float] | None = None  #: Sensor above the rolling point, m, body; None: estimated.

    node_spacing_s: float = 0.2  #: Distance of the graph's nodes in a stance.
    shortest_interval_s: float = 0.015  #: Nodes are not closer.

    gyro_bias_deg_s: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: Before the walk, as of `fg-nav calibrate`, deg/s.
    gyro_bias_sigma_deg_s: float = 0.15
    """Gyro bias of a factory-calibrated sensor before the walk, about that mean, deg/s; a third of it and up to 33
    times as much are weighed by the evidence of the walk (`problem`)."""
    gyro_bias_walk_deg_s: float = 6e-4  #: Random walk of the gyro bias, deg/s/sqrt(s): 0.04 deg/s in an hour.
    choose_bias_walk: bool = True  #: Average the walk of the bias, from that up, by the evidence (`problem`).
    refuse_stances: bool = True  #: Trust stances less in which the foot moves by the rest of the walk (`problem`).
    gyro_scale: bool = True  #: Take off the gyroscope's scale errors that both halves of a walk with a field show.
    tilt_sigma_deg: float = 1.0  #: Tilt after levelling in the first stance, deg.
    rest: RestParameters = field(default_factory=RestParameters)
    gravity: float = GRAVITY_M_S2  #: m/s^2.

    magnetic: FieldParameters = field(default_factory=FieldParameters)  #: The magnetic field.
    walk: WalkParameters = field(default_factory=WalkParameters)  #: People and buildings.


PLAIN = SmootherParameters(
    roll_sigma_m=0.0,
    unsteady_s=0.0,
    settling_m=0.0,
    settling_sigma_m=1e-6,
    walk=WalkParameters(floors=False),
    known_lever=(0.0, 0.0, 0.0),
    refuse_stances=False,
    moving_foot=False,
)
"""Plain zero velocity: every instant of a stance is equally, fully still. For ablation."""
