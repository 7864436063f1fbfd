"""How the foot's coordinates move through a stride: the curves that all strides of a manner share.

Each coordinate is a sum of ramps. A *phase* is a set of ramps (begin, end, weight) in shares of the swing, 0 at
heel-off and 1 at foot-flat; its weights sum to 1 (to 0 where it comes back). A share below 0 or above 1 reaches into
the stance before or after: foot-flat is nominal, and what is true is from `LANDED_AT` to `LEAVES_AT`. The tables are
round figures for the median curve of ten real walks with a sensor on the instep; scaled by duration, length and angles,
those walks lie on one curve within a few per cent.

=========== ======== ==================================================================================================
PUSH        pitch    heel-off: slowly at first, then the toe points down
FALL        pitch    the toe comes up again, through the whole swing
LAND        pitch    from heel strike to foot-flat, fast at first
LIFT        height   up with the heel
DROP        height   down to where the foot passes the other leg
RAISE       height   up again with the toe
SET_DOWN    height   to the floor
FORWARD     place    a slight roll back on the toe, then the swing to the next footprint
ASIDE       place    outward, round the other leg, and back
INVERT_OFF  roll     the sole turns inward at push-off
INVERT_ON   roll     and again as the heel comes down
TOE_OUT     yaw      the toe turns outward at push-off, and back through the swing
TOE_IN      yaw      the toe turns to and fro at heel strike
TURN        yaw      into the next direction
PRESS       height   the load of the body presses the sole together
SPRING      height   the sole springs back as the foot unloads
SETTLE      pitch    what is left of landing, slowly
ROLL_OVER   pitch    the foot rolls forward in stance (in shares of the stance)
STIR        pitch    slowly up to heel-off
LEAN        roll,yaw the loaded foot leans over and back (in shares of the stance)
SLIP        place    the foot slips in stance, mostly early (in shares of the stance)
MOVE_ON     place    a foot that never stands still moves on, slowest in mid-stance (in shares of the stance)
=========== ======== ==================================================================================================

A person executes strides with durations of swing and stance, vigour and slip of their own (`draw_steps`). Every stride
differs in vigour; a short one is gentler. In stance the foot rolls on, presses its sole and slips, each by an amount of
its own; slip is correlated from stride to stride, for foot and floor are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.motion import Strides
from fg_nav.lab.simulation.person import Person

Phase: TypeAlias = tuple[tuple[float, float, float], ...]
"""Ramps as (begin, end, weight)."""

PUSH: Phase = ((-0.08, 0.29, 0.12), (0.00, 0.39, 0.36), (0.09, 0.38, 0.52))
FALL: Phase = ((0.26, 0.55, 0.11), (0.36, 0.73, 0.38), (0.52, 0.89, 0.34), (0.56, 0.99, 0.17))
LAND: Phase = ((0.80, 1.04, 0.60), (0.84, 1.13, 0.40))

LIFT: Phase = ((0.03, 0.53, 0.61), (0.17, 0.41, 0.39))
DROP: Phase = ((0.31, 0.75, 1.00),)
RAISE: Phase = ((0.60, 0.91, 0.67), (0.70, 0.85, 0.33))
SET_DOWN: Phase = ((0.74, 1.14, 0.66), (0.83, 1.01, 0.34))

FORWARD: Phase = (
    (-0.01, 0.29, -0.01),
    (0.19, 0.49, 0.115),
    (0.27, 0.73, 0.38),
    (0.44, 0.95, 0.48),
    (0.57, 1.09, 0.035),
)
ASIDE: Phase = ((0.00, 0.35, -0.22), (0.41, 0.77, 1.00), (0.66, 1.07, -0.78))

INVERT_OFF: Phase = ((-0.04, 0.23, 0.40), (0.07, 0.30, 0.60), (0.24, 0.42, -1.00))
INVERT_ON: Phase = ((0.58, 0.92, 0.20), (0.76, 0.88, 0.46), (0.83, 1.00, -0.66))
TOE_OUT: Phase = ((0.27, 0.40, -1.00), (0.30, 0.63, 0.45), (0.62, 0.87, 0.55))
TOE_IN: Phase = ((0.64, 0.84, 0.45), (0.77, 0.89, -0.75), (0.90, 1.00, 0.30))
TURN: Phase = ((0.15, 0.90, 1.00),)

PRESS: Phase = ((0.80, 1.71, 1.00),)
SPRING: Phase = ((0.10, 0.35, 1.00),)

SETTLE: Phase = ((0.90, 1.44, 1.00),)
STIR: Phase = ((-0.36, 0.24, 1.00),)
ROLL_OVER: Phase = ((-0.40, 0.80, 0.50), (0.20, 1.40, 0.50))
LEAN: Phase = ((-0.30, 0.50, 1.00), (0.30, 1.30, -1.00))
SLIP: Phase = ((-0.10, 0.70, 1.00),)
MOVE_ON: Phase = ROLL_OVER

SLOWEST = 0.769
"""Velocity of `MOVE_ON` in mid-stance over its mean, all of the move in the time of the stance: 0.923 / 1.2."""

_SWINGING = (
    PUSH,
    FALL,
    LAND,
    LIFT,
    DROP,
    RAISE,
    SET_DOWN,
    FORWARD,
    ASIDE,
    INVERT_OFF,
    INVERT_ON,
    TOE_OUT,
    TOE_IN,
    TURN,
)
"""All but those of the loaded foot, which rolls on, leans, slips and sinks while it is flat."""

LEAVES_AT = min(begin for phase in _SWINGING for begin, _, _ in phase)
LANDED_AT = max(end for phase in _SWINGING for _, end, _ in phase)
"""Where the first of these begins and the last one ends: the foot is flat from landing to the next leaving."""

TOE_DOWN_AT, HEEL_STRIKE_AT = 0.33, 0.86  # When the pitch is greatest, and when it is least.

CLEAR_AT, PASSING_AT, HIGH_HEEL_AT = 0.41, 0.66, 0.84
"""When the pivot is highest, lowest in mid-swing, and highest again."""


def compute_progress(phase: Phase, share: Floats) -> Floats:
    """What a phase has moved by (N,) at shares of the swing (N,)."""
    begin, end, weight = np.array(phase).T
    u = np.clip((share[:, None] - begin) / (end - begin), 0.0, 1.0)
    step = u**4 * (35 - u * (84 - u * (70 - 20 * u)))
    return np.asarray(step @ weight)


def solve_rises(phases: Sequence[Phase], closing: Phase, at: Sequence[float], values: Floats) -> Floats:
    """Rises (P + 1, K) of the phases and of a closing one that takes all back, so that the sum passes through `values`.

    The sum is `values` (P, K) at the P shares `at`: phases overlap, and a rise alone is not what is reached.
    """
    shares = np.array(at)
    back = compute_progress(closing, shares)
    matrix = np.stack([compute_progress(phase, shares) - back for phase in phases], axis=1)
    free = np.linalg.solve(matrix, values)
    return np.vstack([free, -free.sum(axis=0)])


def compute_pitch_rises(toe_down: Floats, toe_up: Floats) -> Floats:
    """Rises (3, K) of PUSH, LAND and FALL for the pitch (K,) rad after push-off and, upward, at heel strike."""
    return solve_rises((PUSH, LAND), FALL, (TOE_DOWN_AT, HEEL_STRIKE_AT), np.stack([toe_down, -toe_up]))


def compute_lift_rises(clearance: Floats, midswing: Floats, heel: Floats) -> Floats:
    """Rises (4, K) of LIFT, RAISE, SET_DOWN and DROP for the heights (K,) m at the instants above."""
    heights = np.stack([clearance, midswing, heel])
    return solve_rises((LIFT, RAISE, SET_DOWN), DROP, (CLEAR_AT, PASSING_AT, HIGH_HEEL_AT), heights)


MIN_EFFORT = 0.4  # Angles and heights of a stride on the spot, in those of a full one; they grow with its length.
LONGEST = 1.3  # Longer strides than this many usual ones take no more effort.
RAREST = 3.0  # No rhythm is further off than this many standard deviations: a swing that outlasts its stride is none.

MIN_FLAT_S = 0.01
"""A foot that pushes off before it has landed, as runners may, counts as flat for so long in the middle of the two."""

PAUSE_S = 0.02  # A foot that stays for longer than this after a stride stands.


class Moves(NamedTuple):
    """Ramps of one coordinate: `start`, `width` (M,) s, `rise` (M,)."""

    start: Floats
    width: Floats
    rise: Floats


def join_moves(moves: Sequence[Moves]) -> Moves:
    """All of them, maybe none."""
    nothing = Moves(np.zeros(0), np.zeros(0), np.zeros(0))
    return Moves(*(np.concatenate(column) for column in zip(nothing, *moves, strict=True)))


@dataclass(frozen=True)
class Steps:
    """Strides as a person makes them.

    Attributes
    ----------
    strides, person : whose.
    swing_s : (K,) s from heel-off to foot-flat, the scale of all phases; some reach a little beyond (`flat`).
    vigour : (K,) of angles and heights, in those of the gait.
    stirred : (K,) rad, forward pitch up to heel-off.
    settled, rolled, pressed, slip : in the stance after each stride: forward pitch as the foot settles, and as it rolls
        over, (K,) rad; by how much the sole gives way, (K,) m; and slip, (K, 2) m in nav.
    moved_on : likewise, by how much a foot that never stands still moves on, (K, 2) m in nav.
    """

    strides: Strides
    person: Person
    swing_s: Floats
    vigour: Floats
    stirred: Floats
    settled: Floats
    rolled: Floats
    pressed: Floats
    slip: Floats
    moved_on: Floats

    def __len__(self) -> int:
        return len(self.strides)

    def gait(self, name: str) -> Floats:
        """Value of a gait's field for each stride, (K,) or (K, n)."""
        return np.array([getattr(gait, name) for gait in self.person.gaits], dtype=np.float64)[self.strides.style]

    def swing(self, phase: Phase, rise: Floats) -> Moves:
        """Move by `rise` (K,) as the phase says, in shares of the swing."""
        return join_moves([self.between(begin, end, weight * rise) for begin, end, weight in phase])

    def between(self, begin: float | Floats, end: float | Floats, rise: Floats) -> Moves:
        """Move by `rise` (K,) between two shares of the swing."""
        return Moves(self.strides.start + begin * self.swing_s, (end - begin) * self.swing_s, rise)

    def stance(self, phase: Phase, rise: Floats) -> Moves:
        """Move by `rise` (K,) as the phase says, in shares of the stance."""
        flat, stance_s = self.strides.start + self.swing_s, self.strides.duration - self.swing_s
        return join_moves([Moves(flat + b * stance_s, (e - b) * stance_s, w * rise) for b, e, w in phase])

    @property
    def flat(self) -> Floats:
        """(K + 1, 2) s, from when to when no ramp of a swing moves the foot: flat on the floor."""
        landed = np.concatenate([[0.0], self.strides.start + LANDED_AT * self.swing_s])
        leaves = np.append(self.strides.start + LEAVES_AT * self.swing_s, self.strides.end_s)
        middle, half = (landed + leaves) / 2, np.maximum(leaves - landed, MIN_FLAT_S) / 2
        flat: Floats = np.stack([middle - half, middle + half], axis=1)
        return np.clip(flat, 0.0, self.strides.end_s)

    @property
    def pauses(self) -> Floats:
        """(K + 1, 2) s, from when to when the foot does not stride; most are empty."""
        begin = np.concatenate([[0.0], self.strides.start + self.strides.duration])
        return np.stack([begin, np.append(self.strides.start, self.strides.end_s)], axis=1)


def draw_steps(strides: Strides, person: Person, unrest: float, rng: np.random.Generator) -> Steps:
    """Draw what varies from stride to stride, with so much of a foot's turning in stance (`Mount.unrest`).

    Raises `SimulationError` if strides overlap, last no time, or are not finite.
    """
    _check(strides)
    nothing = np.zeros(len(strides))
    steps = Steps(strides, person, *(nothing,) * 6, *(np.zeros((len(strides), 2)),) * 2)
    white = rng.standard_normal((6, len(strides)))
    turning = unrest * (1 + steps.gait("rollover_scatter") * white[1])
    steps = replace(steps, swing_s=_draw_swing_share(steps, white[3]) * strides.duration)
    return replace(
        steps,
        vigour=_compute_effort(steps) * (1 + steps.gait("vigour") * white[0]),
        stirred=steps.gait("stir_rad") * turning,
        settled=steps.gait("settle_rad") * turning,
        rolled=np.where(_walks_on(strides), steps.gait("rollover_rad") * turning, 0.0),  # or it stands
        pressed=np.maximum(steps.gait("sole_m") + steps.gait("sole_sd_m") * white[2], 0.0),
        slip=_draw_slip(steps, white[4:]),
        moved_on=_compute_moves_on(steps),
    )


def rotate_to_level(heading: Floats, forward: Floats, left: Floats) -> Floats:
    """(K, 2) m east and north of what is forward and left of a heading (K,) rad."""
    sine, cosine = np.sin(heading), np.cos(heading)
    return np.stack([sine * forward - cosine * left, cosine * forward + sine * left], axis=1)


def _draw_swing_share(steps: Steps, white: Floats) -> Floats:
    return steps.gait("swing_share") * (1 + steps.gait("rhythm") * np.clip(white, -RAREST, RAREST))


def _compute_effort(steps: Steps) -> Floats:
    usual = steps.gait("stride_m")
    length = np.linalg.norm(np.diff(steps.strides.footprint[:, :2], axis=0), axis=1)
    share: Floats = np.divide(length, usual, out=np.ones_like(usual), where=usual > 0)
    return MIN_EFFORT + (1 - MIN_EFFORT) * np.minimum(share, LONGEST)


def _walks_on(strides: Strides) -> Bools:
    """(K,) True where the next stride begins when this one ends."""
    pause = strides.start[1:] - (strides.start + strides.duration)[:-1]
    return np.append(pause < PAUSE_S, False)[: len(strides)]


def _draw_slip(steps: Steps, white: Floats) -> Floats:
    """(K, 2) m in nav from white numbers (2, K)."""
    forward, left = _correlate(steps.gait("slip_correlation"), white)
    return rotate_to_level(
        steps.strides.heading[1:],
        steps.gait("slip_m") + steps.gait("slip_sd_m") * forward,
        steps.gait("slip_sideways_m") * left,
    )


def _compute_moves_on(steps: Steps) -> Floats:
    """(K, 2) m in nav by which the foot moves on in each stance that it is walked on, by the person's shares."""
    strides, person = steps.strides, steps.person
    length = np.linalg.norm(np.diff(strides.footprint[:, :2], axis=0), axis=1)
    speed = np.where(_walks_on(strides), length / strides.duration, 0.0)
    stance_s = (strides.duration - steps.swing_s) / SLOWEST
    return rotate_to_level(
        strides.heading[1:], person.forward_s_m * speed**2 * stance_s, person.sideways * speed * stance_s
    )


def _correlate(rho: Floats, white: Floats) -> Floats:
    """First-order autoregression (2, K) of unit variance."""
    values = white.copy()
    for k in range(1, len(rho)):
        values[:, k] = rho[k] * values[:, k - 1] + np.sqrt(1 - rho[k] ** 2) * white[:, k]
    return values


def _check(strides: Strides) -> None:
    count = len(strides)
    shapes = [np.shape(x) for x in (strides.duration, strides.style, strides.footprint, strides.heading)]
    if shapes != [(count,), (count,), (count + 1, 3), (count + 1,)]:
        raise SimulationError(f"{count} strides have arrays of shapes {shapes}: give one footprint more than strides.")
    for name in ("start", "duration", "footprint", "heading", "end_s"):
        if not np.isfinite(getattr(strides, name)).all():
            raise SimulationError(f"the {name} of the strides is not finite: check the path.")
    _check_times(strides)


def _check_times(strides: Strides) -> None:
    end = strides.start + strides.duration
    bad = (strides.duration <= 0) | (strides.start < 0) | (end > np.append(strides.start[1:], strides.end_s) + 1e-6)
    if bad.any():
        k = int(np.argmax(bad))
        raise SimulationError(
            f"stride {k}, {strides.duration[k]:.3f} s from {strides.start[k]:.3f} s on, begins before 0, lasts no time "
            "or reaches into the next: check its times."
        )
