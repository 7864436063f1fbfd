"""A person: how each manner of stride goes, how persons differ, and where on the foot the sensor sits.

Angles are of the foot: x forward, y left, z up from a pivot under the instep, on the floor; positive pitch points the
toe down, positive roll lifts the inner edge of a right foot, positive yaw turns left. Times are in shares of the swing,
from heel-off to foot-flat (`fg_nav.lab.simulation.steps` has the curves).

Where a field says "gdin" it is a round figure inside what ten real walks with an instep sensor show (stride, angles and
heights by strapdown with zero velocity in stance; `scripts/realism.py` prints them side by side); "Vicon" is the same
from motion-captured trials. No figure is fitted to a single walk.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.sensors import checks


def to_radians(degrees: float) -> float:
    """Convert an angle."""
    return float(np.deg2rad(degrees))


def _check_range(owner: object, name: str, low: float, high: float) -> None:
    value = getattr(owner, name)
    if not low <= value <= high:
        raise SimulationError(f"{name} of a {type(owner).__name__} is {value:g}: give {low:.3g} to {high:.3g}.")


@dataclass(frozen=True)
class Shock:
    """A short oscillation of the sensor about where the rigid foot would have it; medians over strides.

    Attributes
    ----------
    force_m_s2 : peak of the specific force it adds.
    rate_rad_s : peak of the angular rate it adds.
    frequency_hz : of the oscillation.
    length_s : from its first movement to its end; it is strongest after a third.
    scatter : standard deviation of the logarithm of its strength, from stride to stride.
    """

    force_m_s2: float
    rate_rad_s: float
    frequency_hz: float
    length_s: float
    scatter: float = 0.3

    def __post_init__(self) -> None:
        checks.not_negative(self, "force_m_s2", "rate_rad_s", "scatter")
        checks.positive_finite(self, "frequency_hz", "length_s")

    def scaled(self, factor: float) -> Shock:
        """So many times as strong."""
        return replace(self, force_m_s2=factor * self.force_m_s2, rate_rad_s=factor * self.rate_rad_s)


@dataclass(frozen=True)
class Variety:
    """How persons differ from each other: standard deviations over persons, each the same in all gaits of one.

    Ten walks span some three standard deviations; of a range of theirs (`scripts/realism.py`, "gdin") about a third is
    given here, less where a stride's own scatter or the pace has a part in it. All are relative but for `swing_share`.

    Attributes
    ----------
    toe_down : pitch after push-off (gdin: 53-70 deg, of which the pace explains a part).
    toe_up : pitch at heel strike (gdin: 27-34 deg).
    inversion : roll (gdin: peak rates of 132-234 deg/s).
    yaw_wobble : yaw (gdin: peak rates of 109-168 deg/s, in which angle and sharpness both have a part; 3-15 deg).
    height : clearance and height of the heel, and again that in mid-swing (gdin: rise of the sensor of 7.6-12 cm, in
        which the mount has a part).
    swing_share : added to it (gdin: 0.22-0.30 of a stride detected as stance, in which the pace has a part).
    turning : pitch, roll and yaw in stance, and of rocking (gdin: 7-18 deg/s at the stillest instant).
    sole : by how much it gives way (Vicon: sinking at 1 to 14 mm/s).
    slip : of its mean, which is anything from 1 - slip to 1 + slip of the gait's (assumed: shoes from none to twice).
    shock : of the logarithm of the strength, of each shock by itself (gdin: peaks of 32-60 m/s^2, half of it by pace).
    stride : length of a stride of walking and running (gdin: 1.20-1.54 m at paces of their own; people of one
        pace differ by leg length, some 3 %).
    """

    toe_down: float = 0.07
    toe_up: float = 0.06
    inversion: float = 0.25
    yaw_wobble: float = 0.30
    height: float = 0.08
    swing_share: float = 0.015
    turning: float = 0.25
    sole: float = 0.25
    slip: float = 1.0
    shock: float = 0.20
    stride: float = 0.03

    def __post_init__(self) -> None:
        for item in fields(self):
            checks.share(self, item.name, 1.0)


_SHARED: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "toe_down": (("toe_down_rad",),),
    "toe_up": (("toe_up_rad",),),
    "inversion": (("inversion_rad",),),
    "yaw_wobble": (("yaw_wobble_rad",),),
    "height": (("clearance_m", "heel_m"), ("midswing_m",)),
    "turning": (("settle_rad", "rollover_rad", "stir_rad"), ("pronation_rad",), ("twist_rad",)),
    "sole": (("sole_m", "sole_sd_m"),),
    "shock": (("strike",), ("crack",), ("slap",), ("toe_off",), ("tremor",)),
    "stride": (("stride_m",),),
}
"""Fields of a gait that a person's factors scale, those of one factor together; on stairs the treads fix the stride."""

_RAREST = 2.5  # No person differs by more standard deviations than this, and no lever.


def draw_usual(rng: np.random.Generator) -> float:
    """Draw from a standard normal distribution that is clipped."""
    return float(np.clip(rng.standard_normal(), -_RAREST, _RAREST))


@dataclass(frozen=True)
class Gait:
    """One manner of stride; the defaults are an adult's walk.

    Attributes
    ----------
    stride_m, stride_s : length and duration of a stride, m and s (Ma et al. 2018: 1018 m in 786 strides, 5 km/h).
    variation : coefficient of variation of length and duration, stride to stride (healthy adults: 0.02-0.03).
    vigour : coefficient of variation of angles and heights (gdin: 0.03-0.06).
    swing_share : part of a stride in which the foot is not flat, from heel-off to foot-flat (gdin).
    rhythm : coefficient of variation of that share (gdin: pitch rates scatter by 50 deg/s about their median curve).
    toe_down_rad, toe_up_rad : pitch after push-off and at heel strike, the latter upward; below zero the toe lands
        first (gdin: 53-71 and 26-35 deg).
    inversion_rad : roll at push-off, two thirds of it again at heel strike (gdin: 5-13 deg).
    yaw_wobble_rad : turn of the toe outward and back at push-off and before heel strike (gdin: 3-15 deg).
    wobble_scatter : coefficient of variation of both (gdin: 0.2-0.5).
    circumduction_m : sideways excursion in mid-swing (gdin: 1-3 cm).
    clearance_m, midswing_m, heel_m : height of the pivot after push-off, in mid-swing, and when the heel comes down
        (gdin: 10-15, 4-6, 8-11 cm).
    climb : shares of the swing between which the foot rises to another height of the floor.
    settle_rad, rollover_rad, stir_rad : forward pitch while the foot is flat: what is left of landing, in mid-stance,
        and up to heel-off (gdin: 5 to 15 deg/s in mid-stance and more at the ends, Vicon: 1 to 5).
    rollover_scatter : coefficient of variation of all three.
    pronation_rad, twist_rad : roll and yaw of the loaded foot in stance, over and back; they scatter by as much again
        (gdin: 5 deg/s about these axes at the stillest instant).
    sole_m, sole_sd_m : by how much the sole gives way under a stance, mean and scatter (Vicon: 2 to 9 mm/s).
    slip_m, slip_sd_m, slip_sideways_m : forward slip of the foot in a stance, its scatter, and the scatter sideways
        (tenths of mm to mm: the sole creeps under braking, the shoe on the foot).
    slip_correlation : of slip from one stride to the next (the same foot and floor).
    strike, crack, slap, toe_off : shocks at heel strike (a soft one and a hard one), when the forefoot comes down, and
        when the toe leaves the ground (gdin: peaks of 3 to 9 g, most of the power below 24 Hz).
    tremor : of muscles and shoe in stance (gdin: 0.4-1.1 deg/s, neighbouring samples correlated as at 10 to 20 Hz).
    """

    stride_m: float = 1.29
    stride_s: float = 0.93
    variation: float = 0.025
    vigour: float = 0.05
    swing_share: float = 0.62
    rhythm: float = 0.05
    toe_down_rad: float = to_radians(60.0)
    toe_up_rad: float = to_radians(27.0)
    inversion_rad: float = to_radians(10.0)
    yaw_wobble_rad: float = to_radians(7.0)
    wobble_scatter: float = 0.25
    circumduction_m: float = 0.02
    clearance_m: float = 0.115
    midswing_m: float = 0.042
    heel_m: float = 0.095
    climb: tuple[float, float] = (0.15, 0.90)
    settle_rad: float = to_radians(1.9)
    rollover_rad: float = to_radians(2.6)
    stir_rad: float = to_radians(3.1)
    rollover_scatter: float = 0.3
    pronation_rad: float = to_radians(-0.8)
    twist_rad: float = to_radians(0.5)
    sole_m: float = 0.0022
    sole_sd_m: float = 0.0006
    slip_m: float = 0.0010
    slip_sd_m: float = 0.0010
    slip_sideways_m: float = 0.0005
    slip_correlation: float = 0.7
    strike: Shock = Shock(15.0, to_radians(80.0), 13.0, 0.18)
    crack: Shock = Shock(5.0, to_radians(50.0), 30.0, 0.08)
    slap: Shock = Shock(8.0, to_radians(60.0), 16.0, 0.16)
    toe_off: Shock = Shock(6.0, to_radians(45.0), 20.0, 0.12)
    tremor: Shock = Shock(0.13, to_radians(2.1), 18.0, 0.20, scatter=0.5)

    def __post_init__(self) -> None:
        checks.positive_finite(self, "stride_s")
        checks.not_negative(self, *_LENGTHS)
        for name in _SCATTERS:
            checks.share(self, name, 0.5)
        for name in _ANGLES:
            _check_range(self, name, -STEEPEST_RAD, STEEPEST_RAD)
        _check_range(self, "swing_share", *SWING_SHARES)
        checks.share(self, "rhythm", 0.07)
        _check_range(self, "slip_correlation", -0.99, 0.99)
        if not 0 <= self.climb[0] < self.climb[1] <= 1:
            raise SimulationError(f"climb of a Gait is {self.climb}: give two rising shares from 0 to 1.")

    def mirror(self) -> Gait:
        """The same gait, for the left foot."""
        return replace(self, **{name: -getattr(self, name) for name in _SIDEWAYS})

    def scaled(self, factors: Mapping[str, float], longer_swing: float = 0.0) -> Gait:
        """Gait with fields times these factors, its swing longer by a share of the stride; no more than can be."""
        changed: dict[str, Any] = {name: _scale(getattr(self, name), by) for name, by in factors.items()}
        for name in changed.keys() & set(_ANGLES):
            changed[name] = float(np.clip(changed[name], -STEEPEST_RAD, STEEPEST_RAD))
        share = float(np.clip(self.swing_share + longer_swing, *SWING_SHARES))
        return replace(self, **changed, swing_share=share)


def _scale(value: float | Shock, factor: float) -> float | Shock:
    return value.scaled(factor) if isinstance(value, Shock) else value * factor


_SIDEWAYS = ("inversion_rad", "yaw_wobble_rad", "circumduction_m", "pronation_rad", "twist_rad")
"""Of a right foot: about its long axis or the vertical, or to its outside."""

_ANY_SIGN = ("circumduction_m", "slip_m")  # The foot may go round to the inside, and slip back.

STEEPEST_RAD = np.pi / 2
SWING_SHARES = 0.3, 0.8  # Of an angle, and of a stride: what a gait may have.


_SCATTERS = ("variation", "vigour", "rollover_scatter", "wobble_scatter")
_ANGLES = tuple(item.name for item in fields(Gait) if item.name.endswith("_rad"))
_LENGTHS = tuple(item.name for item in fields(Gait) if item.name.endswith("_m") and item.name not in _ANY_SIGN)


@dataclass(frozen=True)
class Scatter:
    """How regular a walker is.

    Attributes
    ----------
    footprint_m, heading_rad : white scatter of the footprints about their place and of the feet's direction.
    wander_m, pace : slow wandering of the center off its path, and relative changes of pace: standard deviations.
    """

    footprint_m: float = 0.015
    heading_rad: float = float(np.deg2rad(1.5))
    wander_m: float = 0.05
    pace: float = 0.03


FORWARD_S_M, SIDEWAYS = (0.012, 0.008), 0.010
"""Of moving feet, mean and standard deviation (Vicon, medians of 26 trials at the stillest instant of our stances: 5 to
10 mm/s at 0.8 m/s, 7 to 39 at 1.3, 27 to 59 at 2.0; to the side within 2 % of the speed, in five trials 3 %)."""

MAX_FORWARD_S_M, MAX_SIDEWAYS = 0.1, 0.1  # No foot that is walked on moves faster.


@dataclass(frozen=True)
class Person:
    """Gaits of a person, one a style, and how it stands.

    Attributes
    ----------
    walk, run, stairs_up, stairs_down, turn : by `Style`. Running at 3.2 m/s, stairs of 17 cm and 29 cm two at a stride
        of the foot, as people take them; a stair is met with the forefoot, going down with the toe first.
    sway_rad, sway_s : while standing the shin sways: standard deviation and duration of one sway, as it reaches the
        foot (a loaded foot turns by hundredths of a degree; posturography: sway of 0.3 to 1 Hz).
    rocking_rad_s : rms rate at which a foot that does not come to rest rocks on its sole (assumed; with what it turns
        besides, 4 to 9 deg/s in a heel).
    forward_s_m, sideways : velocity with which a foot that is walked on moves on at its stillest instant: forward by so
        much times the square of the walking speed, to the left by so much of it (none; `with_moving_feet` draws them).
    """

    walk: Gait = Gait()
    run: Gait = Gait(
        stride_m=2.3,
        stride_s=0.72,
        variation=0.03,
        swing_share=0.75,
        toe_down_rad=to_radians(80.0),
        toe_up_rad=to_radians(15.0),
        clearance_m=0.22,
        midswing_m=0.14,
        heel_m=0.08,
        rollover_rad=to_radians(2.0),
        slip_m=0.0015,
        slip_sd_m=0.0015,
        strike=Shock(35.0, to_radians(100.0), 18.0, 0.12),
        crack=Shock(15.0, to_radians(50.0), 36.0, 0.06),
        slap=Shock(15.0, to_radians(60.0), 22.0, 0.10),
        toe_off=Shock(12.0, to_radians(60.0), 30.0, 0.08),
        tremor=Shock(0.4, to_radians(4.0), 14.0, 0.12, scatter=0.5),
    )
    stairs_up: Gait = Gait(
        stride_m=0.58,
        stride_s=1.15,
        variation=0.03,
        swing_share=0.60,
        toe_down_rad=to_radians(45.0),
        toe_up_rad=to_radians(-3.0),
        clearance_m=0.12,
        midswing_m=0.09,
        heel_m=0.05,
        climb=(0.05, 0.65),
        strike=Shock(8.0, to_radians(40.0), 16.0, 0.14),
        crack=Shock(3.0, to_radians(20.0), 30.0, 0.08),
    )
    stairs_down: Gait = Gait(
        stride_m=0.58,
        stride_s=1.05,
        variation=0.03,
        swing_share=0.60,
        toe_down_rad=to_radians(35.0),
        toe_up_rad=to_radians(-18.0),
        clearance_m=0.07,
        midswing_m=0.05,
        heel_m=0.06,
        climb=(0.40, 0.95),
        strike=Shock(15.0, to_radians(60.0), 16.0, 0.14),
        crack=Shock(5.0, to_radians(30.0), 30.0, 0.08),
    )
    turn: Gait = Gait(
        stride_m=0.0,
        stride_s=1.0,
        variation=0.05,
        swing_share=0.55,
        toe_down_rad=to_radians(22.0),
        toe_up_rad=to_radians(4.0),
        inversion_rad=to_radians(4.0),
        yaw_wobble_rad=to_radians(2.0),
        clearance_m=0.06,
        midswing_m=0.04,
        heel_m=0.03,
        settle_rad=to_radians(0.5),
        rollover_rad=to_radians(0.7),
        stir_rad=to_radians(1.0),
        slip_m=0.0,
        strike=Shock(6.0, to_radians(30.0), 16.0, 0.14),
        crack=Shock(2.0, to_radians(10.0), 30.0, 0.08),
        slap=Shock(4.0, to_radians(20.0), 22.0, 0.12),
        toe_off=Shock(3.0, to_radians(15.0), 30.0, 0.08),
    )
    sway_rad: float = to_radians(0.04)
    sway_s: float = 1.5
    rocking_rad_s: float = to_radians(5.5)
    forward_s_m: float = 0.0
    sideways: float = 0.0

    def __post_init__(self) -> None:
        checks.not_negative(self, "sway_rad", "rocking_rad_s")
        _check_range(self, "forward_s_m", -MAX_FORWARD_S_M, MAX_FORWARD_S_M)
        _check_range(self, "sideways", -MAX_SIDEWAYS, MAX_SIDEWAYS)
        checks.positive_finite(self, "sway_s")

    def gait(self, style: Style) -> Gait:
        """Gait of a style."""
        return self.gaits[style]

    @property
    def gaits(self) -> Sequence[Gait]:
        """All gaits, in the order of `Style`."""
        return (self.walk, self.run, self.stairs_up, self.stairs_down, self.turn)

    def mirror(self) -> Person:
        """The same person, for the left foot: what is sideways, and roll and yaw, in the other sense."""
        gaits = {item.name: gait for item in fields(self) if isinstance(gait := getattr(self, item.name), Gait)}
        mirrored: dict[str, Any] = {name: gait.mirror() for name, gait in gaits.items()}
        return replace(self, **mirrored, sideways=-self.sideways)

    def draw(self, rng: np.random.Generator, variety: Variety = Variety()) -> Person:
        """One person drawn around this one, whose factors all of its gaits share."""
        factors, longer_swing = _draw_factors(variety, rng), variety.swing_share * draw_usual(rng)
        trodden = {name: by for name, by in factors.items() if name != "stride_m"}
        walks = {name: getattr(self, name).scaled(factors, longer_swing) for name in ("walk", "run")}
        others = {name: getattr(self, name).scaled(trodden, longer_swing) for name in _PLANNED}
        rocking = self.rocking_rad_s * float(np.exp(variety.turning * draw_usual(rng)))
        return replace(self, **walks, **others, rocking_rad_s=rocking)

    def with_moving_feet(self, rng: np.random.Generator) -> Person:
        """The same person with feet that move on in stance, drawn from what motion capture sees of real ones."""
        forward = FORWARD_S_M[0] + FORWARD_S_M[1] * draw_usual(rng)
        return replace(self, forward_s_m=max(forward, 0.0), sideways=SIDEWAYS * draw_usual(rng))


_PLANNED = ("stairs_up", "stairs_down", "turn")  # Gaits whose strides are as long as treads, or on the spot.


def _draw_factors(variety: Variety, rng: np.random.Generator) -> dict[str, float]:
    """Log-normal, so that all stay positive; that of the slip is uniform, and may be none."""
    drawn: dict[str, float] = {}
    for name, groups in _SHARED.items():
        for group in groups:
            drawn |= dict.fromkeys(group, float(np.exp(getattr(variety, name) * draw_usual(rng))))
    drawn["slip_m"] = float(1 + variety.slip * rng.uniform(-1.0, 1.0))
    return drawn
