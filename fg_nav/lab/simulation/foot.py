"""The motion of a foot and of the sensor on it, from strides.

The foot turns about a *pivot* on the floor, and the sensor sits on it at a lever (`motion.compute_kinematics`; foot
frame: x forward, y left, z up). Pivot and angles are sums of ramps (`motion.Ramps`), as large as the person's gait
(`fg_nav.lab.simulation.person`) makes them.

A *phase* is a set of ramps (begin, end, weight) in shares of the swing, 0 at heel-off and 1 at foot-flat, or of the
stance; its weights sum to 1 (to 0 where it comes back). A share below 0 or above 1 reaches into the stance before or
after: foot-flat is nominal, and what is true is from `LANDED_AT` to `LEAVES_AT`. The tables are round figures for the
median curve of ten real walks with a sensor on the instep; scaled by duration, length and angles, those walks lie on
one curve within a few per cent.

=========== ======== ==================================================================================================
PUSH        pitch    heel-off: slowly at first, then the toe points down
FALL        pitch    the toe comes up again, through the whole swing
LAND        pitch    from heel strike to foot-flat, fast at first
LIFT        height   up with the heel
DROP        height   down to where the foot passes the other leg
RAISE       height   up again with the toe
SET_DOWN    height   to the floor
FORWARD     place    a slight roll back on the toe, then the swing to the next footprint
INVERT_OFF  roll     the sole turns inward at push-off
INVERT_ON   roll     and again as the heel comes down
TOE_OUT     yaw      the toe turns outward at push-off, and back through the swing
TOE_IN      yaw      the toe turns to and fro at heel strike
TURN        yaw      into the next direction
PRESS       height   the load of the body presses the sole together
SPRING      height   the sole springs back as the foot unloads
SETTLE      pitch    what is left of landing, slowly
STIR        pitch    slowly up to heel-off
ROLL_OVER   pitch    the foot rolls forward in stance; the sensor moves by w x r and does not stand still (stance)
LEAN        roll,yaw the loaded foot leans over and back (stance)
SLIP        place    the foot slips, in one stride much as in the last; the next swing makes up for it (stance)
MOVE_ON     place    a foot that never stands still moves on, slowest in mid-stance (stance)
=========== ======== ==================================================================================================

Every stride differs in vigour; short ones are gentler. The heel strike is one shock, to and fro by the squared width of
its ramps in place and by the width in angle; its direction is the walk's own, and fast strides hit harder.

Rocking. A loaded foot rocks on its sole about the point q of the floor beneath the sensor (foot frame, m, from the
pivot). In a stance, or while a person stands and shifts his weight, roll, pitch and yaw pass by ramps through angles

    theta_j ~ N(0, (c w rate)^2),    j = 1, 2, ...,    theta_0 = 0,

c for each axis, w the mean length of a ramp. They turn at instants of their own, the first of which lies before the
stance, so that the foot is hardly ever still about all three. What is left at the end is taken back in the next swing.
The pivot moves by -theta x q, which leaves q in place up to |q| theta^2 / 2, some 0.01 mm. Feet turn at 7 to 18 deg/s
at their stillest instant with a sensor on the instep, which goes along with the shin (gdin). That a module in the heel
rocks by what the lower end of that range leaves is assumed. Of one who stands nothing is left but a sway.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.lab.simulation.motion import Kinematics, Ramps, Strides, average_over_period, compute_kinematics
from fg_nav.lab.simulation.person import DEG, Mount, Person

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

INVERT_OFF: Phase = ((-0.04, 0.23, 0.40), (0.07, 0.30, 0.60), (0.24, 0.42, -1.00))
INVERT_ON: Phase = ((0.58, 0.92, 0.20), (0.76, 0.88, 0.46), (0.83, 1.00, -0.66))
TOE_OUT: Phase = ((0.27, 0.40, -1.00), (0.30, 0.63, 0.45), (0.62, 0.87, 0.55))
TOE_IN: Phase = ((0.64, 0.84, 0.45), (0.77, 0.89, -0.75), (0.90, 1.00, 0.30))
TURN: Phase = ((0.15, 0.90, 1.00),)

LEAVES_AT, LANDED_AT = -0.08, 1.14
"""Where the first of these ramps begins and the last one ends: the foot is flat from landing to the next leaving."""

PRESS: Phase = ((0.80, 1.71, 1.00),)
SPRING: Phase = ((0.10, 0.35, 1.00),)
SETTLE: Phase = ((0.90, 1.44, 1.00),)
STIR: Phase = ((-0.36, 0.24, 1.00),)
ROLL_OVER: Phase = ((-0.40, 0.80, 0.50), (0.20, 1.40, 0.50))
LEAN: Phase = ((-0.30, 0.50, 1.00), (0.30, 1.30, -1.00))
SLIP: Phase = ((-0.10, 0.70, 1.00),)
MOVE_ON: Phase = ROLL_OVER

SETTLES, STIRS = 0.73, 1.19  # Of a gait's pitch in mid-stance: what is left of landing, and what comes before heel-off.
PRONATES, TWISTS = -0.31, 0.19  # Roll and yaw of the loaded foot in that (gdin: 5 deg/s at the stillest instant).
SLOWEST = 0.769  # Velocity of `MOVE_ON` in mid-stance over its mean, all of the move in the stance: 0.923 / 1.2.

VIGOUR = 0.05  # Coefficient of variation of angles and heights (gdin: 0.03-0.06).
RHYTHM = 0.05  # Of the swing's share (gdin: pitch rates scatter by 50 deg/s about their median curve).
WOBBLE = 0.25  # Of roll and yaw in the swing (gdin: 0.2-0.5).
TURNING = 0.3  # Of what the foot turns in stance.
SLIP_SIDEWAYS, SLIP_CORRELATION = 0.5, 0.7  # Scatter over that forward, and from one stride to the next.

TOE_DOWN_AT, HEEL_STRIKE_AT = 0.33, 0.86  # When the pitch is greatest, and when it is least.
CLEAR_AT, PASSING_AT, HIGH_HEEL_AT = 0.41, 0.66, 0.84  # When the pivot is highest, lowest in mid-swing, high again.

MIN_EFFORT = 0.4  # Angles and heights of a stride on the spot, in those of a full one; they grow with its length.
LONGEST = 1.3  # Longer strides than this many usual ones take no more effort.
RAREST = 3.0  # No rhythm is further off than this many standard deviations: a swing that outlasts its stride is none.
MIN_FLAT_S = 0.01  # Who pushes off before the foot has landed, as runners may, is flat for so long between the two.
PAUSE_S = 0.02  # A foot that stays for longer than this after a stride stands.

SHOCK_AT, SHOCK_S, SHOCK_SCATTER = 0.83, 0.07, 0.3  # Share of the swing, width of a ramp, and scatter of ln strength.
SHOCK_FORCE, SHOCK_RATE = (0.8, 0.25, 0.55), (0.7, 0.45, 0.55)  # Weights along x, y and z.
RAMP_FORCE, RAMP_RATE = 15.0, 2.19  # Peaks of a ramp up and, half a width later, down: rise / width^2, rise / width.
HARDEST = 2.0  # At most this many times the strength of the usual pace.

PIECE_S = 0.18  # From one turning point of rocking to the next: to and fro in a third of a second (gdin: 2 to 4 Hz).
RAMP_SLOPE = 1.28  # Rms slope of a ramp over its mean slope: 140 sqrt(B(7, 7)).
ROCKING = 0.65, 0.65, 0.4  # Of roll, pitch and yaw in the rate: the loaded sole turns least about the vertical.
JITTER = 0.25  # Ramps of rocking are shorter or longer by up to this share.
BACK = 0.10, 0.60  # Shares of the next swing between which the angle that is left of rocking is taken back.
SWAY_RAD_S = 0.04 * DEG  # Of a foot that stands: the shin sways, the foot by hundredths of a degree.

NODE_S = 3e-3  # A node of quadrature for each of these in a sample period, and one more.


@dataclass(frozen=True)
class FootMotion:
    """A sensor on a foot."""

    east: Ramps  # Of the pivot, m.
    north: Ramps
    up: Ramps
    roll: Ramps  # Of the foot, rad.
    pitch: Ramps
    yaw: Ramps
    lever_m: Floats  # (3,) from the pivot to the sensor, foot frame.
    foot_R_body: Floats  # (3, 3).
    flat: Floats  # (K + 1, 2) s: from the end of the last ramp of landing to the begin of the first of the next push.

    def at(self, t: Floats) -> Kinematics:
        """Exact state at rising instants `t` (N,) s."""
        moved = (self.east, self.north, self.up, self.roll, self.pitch, self.yaw)
        return compute_kinematics(np.stack([ramps.at(t) for ramps in moved], axis=2), self.lever_m, self.foot_R_body)

    def pivot_at(self, t: Floats) -> tuple[Floats, Floats]:
        """Place (N, 3) m of the pivot in nav, and yaw (N,) rad of the foot, at rising instants `t` (N,) s."""
        place = [ramps.at(t)[0] for ramps in (self.east, self.north, self.up)]
        return np.stack(place, axis=1), self.yaw.at(t)[0]

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period], by quadrature."""
        return average_over_period(self, t, period_s, nodes=int(np.ceil(1 + period_s / NODE_S)))


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
    """Strides as a person makes them."""

    strides: Strides  # Whose.
    person: Person
    swing_s: Floats  # (K,) s from heel-off to foot-flat, the scale of all phases; some reach a little beyond (`flat`).
    vigour: Floats  # (K,) of angles and heights, in those of the gait.
    turning: Floats  # (K,) of what the foot turns in stance, in that of the gait.
    slip: Floats  # In the stance after each stride, (K, 2) m in nav.
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
    def length_m(self) -> Floats:
        """(K,) m, as on a map."""
        return np.asarray(np.linalg.norm(np.diff(self.strides.footprint[:, :2], axis=0), axis=1))

    @property
    def walks_on(self) -> Bools:
        """(K,) True where the next stride begins when this one ends."""
        pause = self.strides.start[1:] - (self.strides.start + self.strides.duration)[:-1]
        return np.append(pause < PAUSE_S, False)[: len(self)]


def build_foot_motion(
    strides: Strides, person: Person, mount: Mount, rng: np.random.Generator, restless: bool = False
) -> FootMotion:
    """Motion of a sensor on the foot that makes these strides; a restless one rocks in standing as it walks.

    The mount is drawn here where it still has scatter.
    """
    drawn = mount.draw(rng)
    steps = draw_steps(strides, person, drawn.unrest, rng)
    rate = person.rocking_rad_s
    rocking = _draw_rocking(steps, drawn.rocking * rate, rate if restless else SWAY_RAD_S, drawn.lever_m[:2], rng)
    shocks = _draw_shocks(steps, drawn.shock, rng)
    moves = {"up": _move_up(steps), "pitch": _move_pitch(steps), **_move_level(steps), **_move_sideways(steps, rng)}
    place, yaw = strides.footprint[0], np.pi / 2 - float(strides.heading[0])
    begun = {"east": float(place[0]), "north": float(place[1]), "up": float(place[2]), "yaw": yaw}
    ramps = {
        name: Ramps.of(*join_moves([*moves[name], rocking[name], shocks[name]]), begun_at=begun.get(name, 0.0))
        for name in ("east", "north", "up", "roll", "pitch", "yaw")
    }
    return FootMotion(**ramps, lever_m=np.array(drawn.lever_m), foot_R_body=drawn.foot_R_body, flat=steps.flat)


def draw_steps(strides: Strides, person: Person, unrest: float, rng: np.random.Generator) -> Steps:
    """Draw what varies from stride to stride, with so much of a foot's turning in stance (`Mount.unrest`)."""
    nothing = np.zeros(len(strides))
    steps = Steps(strides, person, nothing, nothing, nothing, nothing, nothing)
    white = rng.standard_normal((5, len(strides)))
    steps = replace(
        steps,
        swing_s=steps.gait("swing_share") * (1 + RHYTHM * np.clip(white[0], -RAREST, RAREST)) * strides.duration,
        turning=unrest * (1 + TURNING * white[1]),
    )
    # effort: angles and heights grow with the length of a stride
    usual, length = steps.gait("stride_m"), steps.length_m
    share = np.divide(length, usual, out=np.ones_like(usual), where=usual > 0)
    effort = MIN_EFFORT + (1 - MIN_EFFORT) * np.minimum(share, LONGEST)
    # slip: a first-order autoregression of strides
    slip = white[3:].copy()
    for k in range(1, len(strides)):
        slip[:, k] = SLIP_CORRELATION * slip[:, k - 1] + np.sqrt(1 - SLIP_CORRELATION**2) * slip[:, k]
    slip *= steps.gait("slip_sd_m")
    # moving on: of feet that never stand still
    speed = np.where(steps.walks_on, length / strides.duration, 0.0)
    stance_s = (strides.duration - steps.swing_s) / SLOWEST
    sideways = person.side * person.sideways
    heading = strides.heading[1:]
    return replace(
        steps,
        vigour=effort * (1 + VIGOUR * white[2]),
        slip=rotate_to_level(heading, steps.gait("slip_m") + slip[0], SLIP_SIDEWAYS * slip[1]),
        moved_on=rotate_to_level(heading, person.forward_s_m * speed**2 * stance_s, sideways * speed * stance_s),
    )


def rotate_to_level(heading: Floats, forward: Floats, left: Floats) -> Floats:
    """(K, 2) m east and north of what is forward and left of a heading (K,) rad."""
    sine, cosine = np.sin(heading), np.cos(heading)
    return np.stack([sine * forward - cosine * left, cosine * forward + sine * left], axis=1)


def _move_level(steps: Steps) -> Mapping[str, list[Moves]]:
    """East and north. What the foot slips and moves on is made up for in the swing before: it ends on its footprint."""
    step = np.diff(steps.strides.footprint[:, :2], axis=0) - steps.slip - steps.moved_on
    return {
        name: [
            steps.swing(FORWARD, step[:, axis]),
            steps.stance(SLIP, steps.slip[:, axis]),
            steps.stance(MOVE_ON, steps.moved_on[:, axis]),
        ]
        for axis, name in enumerate(("east", "north"))
    }


def _move_up(steps: Steps) -> list[Moves]:
    heights = [steps.gait(name) * steps.vigour for name in ("clearance_m", "midswing_m", "heel_m")]
    lift, again, set_down, drop = solve_rises(
        (LIFT, RAISE, SET_DOWN), DROP, (CLEAR_AT, PASSING_AT, HIGH_HEEL_AT), np.stack(heights)
    )
    climb, pressed = steps.gait("climb"), steps.gait("sole_m")
    return [
        steps.swing(LIFT, lift),
        steps.swing(DROP, drop),
        steps.swing(RAISE, again),
        steps.swing(SET_DOWN, set_down),
        steps.between(climb[:, 0], climb[:, 1], np.diff(steps.strides.footprint[:, 2])),
        steps.swing(SPRING, np.roll(pressed, 1)),  # the foot begins as pressed as it ends
        steps.swing(PRESS, -pressed),
    ]


def _move_pitch(steps: Steps) -> list[Moves]:
    toe_down, toe_up = steps.gait("toe_down_rad") * steps.vigour, steps.gait("toe_up_rad") * steps.vigour
    push, land, fall = solve_rises((PUSH, LAND), FALL, (TOE_DOWN_AT, HEEL_STRIKE_AT), np.stack([toe_down, -toe_up]))
    turned = steps.gait("rollover_rad") * steps.turning
    rolled = np.where(steps.walks_on, turned, 0.0)  # or it stands
    begun = np.concatenate([[0.0], SETTLES * turned + rolled])[: len(steps)]  # by the stance before
    return [
        steps.swing(STIR, STIRS * turned),
        steps.swing(PUSH, push - STIRS * turned - begun),
        steps.swing(FALL, fall),
        steps.swing(LAND, land),
        steps.swing(SETTLE, SETTLES * turned),
        steps.stance(ROLL_OVER, rolled),
    ]


def _move_sideways(steps: Steps, rng: np.random.Generator) -> Mapping[str, list[Moves]]:
    """Roll and yaw."""
    white = rng.standard_normal((6, len(steps)))
    wobble = steps.person.side * steps.vigour * (1 + WOBBLE * white[:4])
    lean = steps.person.side * steps.gait("rollover_rad") * steps.turning * (1 + white[4:])
    inversion, yaw = steps.gait("inversion_rad") * wobble[:2], steps.gait("yaw_wobble_rad") * wobble[2:]
    return {
        "roll": [
            steps.swing(INVERT_OFF, inversion[0]),
            steps.swing(INVERT_ON, inversion[1]),
            steps.stance(LEAN, PRONATES * lean[0]),
        ],
        "yaw": [
            steps.swing(TOE_OUT, yaw[0]),
            steps.swing(TOE_IN, yaw[1]),
            steps.stance(LEAN, TWISTS * lean[1]),
            steps.swing(TURN, -np.diff(steps.strides.heading)),
        ],
    }


def solve_rises(phases: Sequence[Phase], closing: Phase, at: Sequence[float], values: Floats) -> Floats:
    """Rises (P + 1, K) of the phases and of a closing one that takes all back, so that the sum passes through `values`.

    The sum is `values` (P, K) at the P shares `at`: phases overlap, and a rise alone is not what is reached.
    """
    shares = np.array(at)
    back = _compute_progress(closing, shares)
    matrix = np.stack([_compute_progress(phase, shares) - back for phase in phases], axis=1)
    free = np.linalg.solve(matrix, values)
    return np.vstack([free, -free.sum(axis=0)])


def _compute_progress(phase: Phase, share: Floats) -> Floats:
    """What a phase has moved by (N,) at shares of the swing (N,)."""
    ramps = [Ramps.of(np.array([b]), np.array([e - b]), np.array([weight])) for b, e, weight in phase]
    return np.asarray(sum(ramp.at(share)[0] for ramp in ramps))


def _draw_shocks(steps: Steps, strength: float, rng: np.random.Generator) -> Mapping[str, Moves]:
    """Moves of all coordinates by which the heel strike shakes the foot; its direction is that of this walk."""
    scatter = np.exp(SHOCK_SCATTER * np.clip(rng.standard_normal(len(steps)), -2.0, 2.0))
    pace = steps.gait("stride_s") / steps.strides.duration
    hit = strength * steps.vigour * np.minimum(pace**2, HARDEST) * scatter
    shift = steps.gait("shock_m_s2") * hit * SHOCK_S**2 / RAMP_FORCE
    turn = steps.gait("shock_rad_s") * hit * SHOCK_S / RAMP_RATE
    ahead, left, up, *angles = [*SHOCK_FORCE, *SHOCK_RATE] * rng.choice([-1.0, 1.0], 6)
    east, north = rotate_to_level(steps.strides.heading[1:], ahead * shift, left * shift).T
    start = steps.strides.start + (SHOCK_AT + 0.01 * rng.standard_normal(len(steps))) * steps.swing_s
    rises = [east, north, up * shift, *(angle * turn for angle in angles)]
    begin, width = np.concatenate([start, start + SHOCK_S / 2]), np.full(2 * len(steps), SHOCK_S)
    names = ("east", "north", "up", "roll", "pitch", "yaw")
    return {name: Moves(begin, width, np.concatenate([rise, -rise])) for name, rise in zip(names, rises, strict=True)}


def _draw_rocking(
    steps: Steps, stance_rad_s: float, standing_rad_s: float, beneath_m: Sequence[float], rng: np.random.Generator
) -> Mapping[str, Moves]:
    """Moves of all coordinates by which the foot rocks about the point `beneath_m` (2,).

    At rms rates over all axes in the stances between strides, and in longer ones.
    """
    begin = np.concatenate([[0.0], steps.strides.start + steps.strides.duration])
    loaded = np.stack([begin, np.append(steps.strides.start, steps.strides.end_s)], axis=1)
    rate = np.where(loaded[:, 1] - loaded[:, 0] < PAUSE_S, stance_rad_s, standing_rad_s)
    loaded[1:, 0] = steps.strides.start + steps.swing_s
    rocks = np.flatnonzero((loaded[:, 1] > loaded[:, 0]) & (rate > 0))
    drawn = [_rock_once(steps, k, loaded[k], rate[k], rng) for k in map(int, rocks)]
    roll, pitch, yaw = (join_moves([moves[axis] for moves in drawn]) for axis in range(3))
    heading = np.repeat(steps.strides.heading[rocks], [len(moves[2].rise) for moves in drawn])
    x, y = beneath_m
    level = rotate_to_level(heading, y * yaw.rise, -x * yaw.rise)
    return {
        "east": yaw._replace(rise=level[:, 0]),
        "north": yaw._replace(rise=level[:, 1]),
        "up": join_moves([pitch._replace(rise=x * pitch.rise), roll._replace(rise=-y * roll.rise)]),
        "roll": roll,
        "pitch": pitch,
        "yaw": yaw,
    }


def _rock_once(steps: Steps, index: int, span: Floats, rate_rad_s: float, rng: np.random.Generator) -> Sequence[Moves]:
    """Roll, pitch and yaw of one stance (2,) s, and the way back in the swing after it, if there is one."""
    moves = []
    for share in ROCKING:
        width = PIECE_S * rng.uniform(1 - JITTER, 1 + JITTER, 2 + int((span[1] - span[0]) / (PIECE_S * (1 - JITTER))))
        start = span[0] - rng.random() * width[0] + np.cumsum(width) - width
        angle = share * rate_rad_s * PIECE_S / (np.sqrt(2) * RAMP_SLOPE) * rng.standard_normal(len(width))
        inside = start < span[1]
        start, width, rise = start[inside], width[inside], np.diff(angle[inside], prepend=0.0)
        if index < len(steps):
            leave, land = span[1] + np.array(BACK) * steps.swing_s[index]
            start, width, rise = np.append(start, leave), np.append(width, land - leave), np.append(rise, -rise.sum())
        moves.append(Moves(start, width, rise))
    return moves
