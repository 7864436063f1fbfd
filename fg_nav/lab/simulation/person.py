"""A person: how each manner of stride goes, how persons differ, and where on the foot the sensor sits.

Angles are of the foot: x forward, y left, z up from a pivot under the instep, on the floor; positive pitch points the
toe down, positive roll lifts the inner edge of a right foot, positive yaw turns left. Times are in shares of the swing,
from heel-off to foot-flat (`fg_nav.lab.simulation.foot` has the curves).

Where a field says "gdin" it is a round figure inside what ten real walks with an instep sensor show (stride, angles and
heights by strapdown with zero velocity in stance; `scripts/realism.py` prints them side by side); "Vicon" is the same
from motion-captured trials. No figure is fitted to a single walk. A gait has what an estimator feels, found by leaving
out one thing after another: slip, roll and yaw of the swing, and rocking in the plane; the sole for the height.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.checks import Checked, Finite, NotNegative, Positive, Share, Spread, Triple
from fg_nav.lab.simulation.motion import Style

DEG = float(np.deg2rad(1.0))
STEEPEST_RAD = 90.0 * DEG
SWING_SHARES = 0.3, 0.8  # Of an angle, and of a stride: what a gait may have.

Angle: TypeAlias = Annotated[float, Field(ge=-STEEPEST_RAD, le=STEEPEST_RAD)]
Climb: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]
SwingShare: TypeAlias = Annotated[float, Field(ge=SWING_SHARES[0], le=SWING_SHARES[1])]


@dataclass(frozen=True)
class Gait(Checked):
    """One manner of stride; the defaults are an adult's walk."""

    stride_m: NotNegative = 1.29  # Length and duration of a stride (Ma et al. 2018: 1018 m in 786 strides, 5 km/h).
    stride_s: Positive = 0.93
    variation: Share = 0.025  # Coefficient of variation of both, from stride to stride (healthy adults: 0.02-0.03).
    swing_share: SwingShare = 0.62  # Part of a stride in which the foot is not flat, from heel-off to foot-flat (gdin).
    toe_down_rad: Angle = 60.0 * DEG  # Pitch after push-off (gdin: 53-71 deg).
    toe_up_rad: Angle = 27.0 * DEG  # Upward pitch at heel strike; below zero the toe lands first (gdin: 26-35 deg).
    inversion_rad: Angle = 10.0 * DEG  # Roll at push-off, two thirds of it again at heel strike (gdin: 5-13 deg).
    yaw_wobble_rad: Angle = 7.0 * DEG  # Turn of the toe at push-off and before heel strike (gdin: 3-15 deg).
    clearance_m: NotNegative = 0.115  # Height of the pivot after push-off (gdin: 10-15 cm).
    midswing_m: NotNegative = 0.042  # Its height in mid-swing (gdin: 4-6 cm).
    heel_m: NotNegative = 0.095  # Its height when the heel comes down (gdin: 8-11 cm).
    climb: tuple[Climb, Climb] = (0.15, 0.90)  # Shares of the swing between which the foot rises to another floor.
    rollover_rad: Angle = 2.6 * DEG  # Forward pitch in mid-stance (gdin: 5 to 15 deg/s there, Vicon: 1 to 5).
    sole_m: NotNegative = 0.0022  # By how much the sole gives way under a stance (Vicon: 2 to 9 mm/s).
    slip_m: Finite = 0.0010  # Forward slip in a stance (tenths of mm to mm: the sole creeps, the shoe on the foot).
    slip_sd_m: NotNegative = 0.0010  # Its scatter.
    shock_m_s2: NotNegative = 18.0  # Specific force that the heel strike adds at its peak (gdin: peaks of 3 to 9 g).
    shock_rad_s: NotNegative = 90.0 * DEG  # Rate that it adds (gdin: most of the power below 24 Hz).

    def scaled(self, factors: Mapping[str, float], longer_swing: float) -> Gait:
        """Gait with fields times these factors, its swing longer by a share of the stride; no more than can be."""
        changed: dict[str, Any] = {name: by * getattr(self, name) for name, by in factors.items()}
        for name in changed:
            if name.endswith("_rad"):
                changed[name] = float(np.clip(changed[name], -STEEPEST_RAD, STEEPEST_RAD))
        return replace(self, **changed, swing_share=float(np.clip(self.swing_share + longer_swing, *SWING_SHARES)))


_OTHERS: Mapping[str, tuple[float, float, float, float]] = {
    # running, upstairs, downstairs, turning on the spot
    "stride_m": (2.3, 0.58, 0.58, 0.0),
    "stride_s": (0.72, 1.15, 1.05, 1.0),
    "variation": (0.03, 0.03, 0.03, 0.05),
    "swing_share": (0.75, 0.60, 0.60, 0.55),
    "toe_down_rad": (80.0 * DEG, 45.0 * DEG, 35.0 * DEG, 22.0 * DEG),
    "toe_up_rad": (15.0 * DEG, -3.0 * DEG, -18.0 * DEG, 4.0 * DEG),
    "inversion_rad": (10.0 * DEG, 10.0 * DEG, 10.0 * DEG, 4.0 * DEG),
    "yaw_wobble_rad": (7.0 * DEG, 7.0 * DEG, 7.0 * DEG, 2.0 * DEG),
    "clearance_m": (0.22, 0.12, 0.07, 0.06),
    "midswing_m": (0.14, 0.09, 0.05, 0.04),
    "heel_m": (0.08, 0.05, 0.06, 0.03),
    "rollover_rad": (2.0 * DEG, 2.6 * DEG, 2.6 * DEG, 0.7 * DEG),
    "slip_m": (0.0015, 0.0010, 0.0010, 0.0),
    "slip_sd_m": (0.0015, 0.0010, 0.0010, 0.0010),
    "shock_m_s2": (45.0, 9.0, 18.0, 7.0),
    "shock_rad_s": (110.0 * DEG, 45.0 * DEG, 70.0 * DEG, 35.0 * DEG),
}
"""What is otherwise than in walking. Running at 3.2 m/s, stairs of 17 cm and 29 cm two at a stride of the foot, as
people take them; a stair is met with the forefoot, going down with the toe first."""

_CLIMBS = (0.15, 0.90), (0.05, 0.65), (0.40, 0.95), (0.15, 0.90)

_RUN, _STAIRS_UP, _STAIRS_DOWN, _TURN = (
    Gait(climb=climb, **{name: values[column] for name, values in _OTHERS.items()})
    for column, climb in enumerate(_CLIMBS)
)


VARIETY: Mapping[tuple[str, ...], float] = {
    ("toe_down_rad",): 0.07,  # gdin: 53-70 deg, of which the pace explains a part
    ("toe_up_rad",): 0.06,  # gdin: 27-34 deg
    ("inversion_rad",): 0.25,  # gdin: peak rates of 132-234 deg/s
    ("yaw_wobble_rad",): 0.30,  # gdin: peak rates of 109-168 deg/s, in which angle and sharpness both have a part
    ("clearance_m", "heel_m"): 0.08,  # gdin: rise of the sensor of 7.6-12 cm, in which the mount has a part
    ("midswing_m",): 0.08,
    ("rollover_rad",): 0.25,  # gdin: 7-18 deg/s at the stillest instant
    ("sole_m",): 0.25,  # Vicon: sinking at 1 to 14 mm/s
    ("shock_m_s2", "shock_rad_s"): 0.20,  # gdin: peaks of 32-60 m/s^2, half of it by pace
    ("stride_m",): 0.03,  # gdin: 1.20-1.54 m at paces of their own; people of one pace differ by leg length
}
"""How persons differ: standard deviations of the logarithm of factors on a gait's fields, the same in all gaits of one.
Ten walks span some three standard deviations: a third of their range ("gdin"), less where a stride's own scatter or the
pace has a part in it. Slip is anything from none to twice the gait's (assumed)."""

SWING_SHARE_SD = 0.015  # Added to that of all gaits (gdin: 0.22-0.30 of a stride detected as stance).
ROCKING_SD = 0.25  # Of the logarithm of the rate.

_RAREST = 2.5  # No person differs by more standard deviations than this, and no lever.


def draw_usual(rng: np.random.Generator) -> float:
    """Draw from a standard normal distribution that is clipped."""
    return float(np.clip(rng.standard_normal(), -_RAREST, _RAREST))


@dataclass(frozen=True)
class Scatter:
    """How regular a walker is."""

    footprint_m: float = 0.015  # White scatter of the footprints about their place.
    heading_rad: float = 1.5 * DEG  # White scatter of the feet's direction.
    wander_m: float = 0.05  # Slow wandering of the center off its path, standard deviation.
    pace: float = 0.03  # Slow relative changes of pace, standard deviation.


FORWARD_S_M, SIDEWAYS = (0.012, 0.008), 0.010
"""Of moving feet, mean and standard deviation (Vicon, medians of 26 trials at the stillest instant of our stances: 5 to
10 mm/s at 0.8 m/s, 7 to 39 at 1.3, 27 to 59 at 2.0; to the side within 2 % of the speed, in five trials 3 %)."""

MoveShare: TypeAlias = Annotated[float, Field(ge=-0.1, le=0.1)]  # No foot that is walked on moves faster.


@dataclass(frozen=True)
class Person(Checked):
    """Gaits of a person, one a style, and how it stands."""

    walk: Gait = Gait()  # By `Style`.
    run: Gait = _RUN
    stairs_up: Gait = _STAIRS_UP
    stairs_down: Gait = _STAIRS_DOWN
    turn: Gait = _TURN
    rocking_rad_s: NotNegative = 5.5 * DEG  # Rms rate of a sole that does not come to rest (assumed).
    forward_s_m: MoveShare = 0.0  # Times the squared walking speed: how a loaded foot moves on at its stillest instant.
    sideways: MoveShare = 0.0  # Times the walking speed: likewise, outward (none; `with_moving_feet` draws both).
    side: float = 1.0  # 1 of a right foot, -1 of a left one: what is outward, and roll and yaw, in the other sense.

    def gait(self, style: Style) -> Gait:
        """Gait of a style."""
        return self.gaits[style]

    @property
    def gaits(self) -> Sequence[Gait]:
        """All gaits, in the order of `Style`."""
        return (self.walk, self.run, self.stairs_up, self.stairs_down, self.turn)

    def mirror(self) -> Person:
        """The same person, for the other foot."""
        return replace(self, side=-self.side)

    def draw(self, rng: np.random.Generator) -> Person:
        """One person drawn around this one, whose factors all of its gaits share; treads fix the stride on stairs."""
        factors: dict[str, float] = {}
        for names, sd in VARIETY.items():
            factors |= dict.fromkeys(names, float(np.exp(sd * draw_usual(rng))))
        factors["slip_m"] = float(rng.uniform(0.0, 2.0))
        longer_swing = SWING_SHARE_SD * draw_usual(rng)
        changed: dict[str, Any] = {"rocking_rad_s": self.rocking_rad_s * float(np.exp(ROCKING_SD * draw_usual(rng)))}
        for item in fields(self):
            gait = getattr(self, item.name)
            if isinstance(gait, Gait):
                own = factors if item.name in ("walk", "run") else {**factors, "stride_m": 1.0}
                changed[item.name] = gait.scaled(own, longer_swing)
        return replace(self, **changed)

    def with_moving_feet(self, rng: np.random.Generator) -> Person:
        """The same person with feet that move on in stance, drawn from what motion capture sees of real ones."""
        forward = FORWARD_S_M[0] + FORWARD_S_M[1] * draw_usual(rng)
        return replace(self, forward_s_m=max(forward, 0.0), sideways=SIDEWAYS * draw_usual(rng))


@dataclass(frozen=True)
class Mount(Checked):
    """How a sensor sits on the foot."""

    lever_m: Triple  # From the pivot to the sensor, foot frame, mean and scatter over mountings and feet.
    tilt_rad: Triple = (0.0, 0.0, 0.0)  # Roll, pitch, yaw of its axes in the foot frame, mean and scatter.
    tilt_sd_rad: Spread = (0.0, 0.0, 0.0)
    shock: NotNegative = 1.0  # Strength of the gait's shock at this place, the instep being 1.
    unrest: NotNegative = 1.0  # How much of what a foot turns in stance reaches this place, the instep being 1.
    rocking: NotNegative = 0.0  # How much of a foot's rocking to and fro in stance reaches this place.
    lever_sd_m: Spread = (0.0, 0.0, 0.0)

    def mirror(self) -> Mount:
        """The same place on the left shoe."""
        (x, y, z), (roll, pitch, yaw) = self.lever_m, self.tilt_rad
        return replace(self, lever_m=(x, -y, z), tilt_rad=(-roll, pitch, -yaw))

    def draw(self, rng: np.random.Generator) -> Mount:
        """One mounting: tilt and lever as they happened to be, and no scatter left."""
        roll, pitch, yaw = (m + sd * draw_usual(rng) for m, sd in zip(self.tilt_rad, self.tilt_sd_rad, strict=True))
        x, y, z = (m + sd * draw_usual(rng) for m, sd in zip(self.lever_m, self.lever_sd_m, strict=True))
        none = (0.0, 0.0, 0.0)
        return replace(self, lever_m=(x, y, z), lever_sd_m=none, tilt_rad=(roll, pitch, yaw), tilt_sd_rad=none)

    @property
    def foot_R_body(self) -> Floats:
        """How the sensor's axes lie in the foot frame at the mean tilt, (3, 3)."""
        return np.asarray(Rotation.from_euler("ZYX", self.tilt_rad[::-1]).as_matrix(), dtype=np.float64)


INSTEP = Mount(
    lever_m=(-0.02, -0.02, 0.08),
    lever_sd_m=(0.005, 0.005, 0.012),
    tilt_rad=(0.0, -25.0 * DEG, 0.0),
    tilt_sd_rad=(8.0 * DEG, 6.0 * DEG, 8.0 * DEG),
)
"""On the laces, its x axis up along the instep (gdin: 10-35 deg). The lever is that of the Vicon trials, but for its
height, which lies between theirs (5 to 11 cm) and what the gdin walks show of themselves (6 to 10 cm, some three
standard deviations)."""

HEEL = Mount(
    lever_m=(-0.13, 0.0, 0.025),
    lever_sd_m=(0.005, 0.005, 0.005),
    tilt_rad=(0.0, 3.0 * DEG, 0.0),
    tilt_sd_rad=(2.0 * DEG, 2.0 * DEG, 3.0 * DEG),
    shock=1.6,
    unrest=0.15,
    rocking=1.0,
)
"""A module in the heel of the shoe (Ma et al. 2018): low, firmly held, and where the heel hits the ground. In stance
the body's weight stands on it, while the instep goes along with the shin. How much less it turns with the shin
(`unrest`), that it rocks on the heel's pad instead (`rocking`), and `shock` are assumed: there is no recording of a
heel with a truth to measure them on, and the drift in height hangs on the last."""

MOUNTS: Mapping[str, Mount] = {"instep": INSTEP, "heel": HEEL}
