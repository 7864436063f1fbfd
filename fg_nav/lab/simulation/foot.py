"""The motion of a foot and of the sensor on it, from strides.

Model
-----
The foot turns about a *pivot* on the floor, and the sensor sits on it at a lever r (foot frame, m), softly:

    p = pivot + nav_R_foot (r + d),    nav_R_foot = Rz(yaw) Ry(pitch) Rx(roll),    nav_R_body = nav_R_foot foot_R_body,

with x forward, y left, z up; d is how far shocks move the sensor from its place. With w the rate of the foot in its own
frame and s = r + d, the derivatives by time are exact:

    v = pivot' + nav_R_foot (w x s + d'),
    f = nav_R_foot^T (pivot'' + g up) + w' x s + w x (w x s) + 2 w x d' + d''.

Pivot and angles are sums of ramps, their shocks bursts (`fg_nav.lab.simulation.motion`): a table of phases for each
(`fg_nav.lab.simulation.steps`), as large as the person's gait (`fg_nav.lab.simulation.person`) makes them. In stance

* the foot rolls slowly forward about the pivot, so that the sensor moves by w x r and does not stand still;
* the sole gives way under the load and springs back in the next push-off; a foot that stands on stays pressed;
* the foot slips a little, mostly forward, in one stride much as in the last; the next swing makes up for it;
* it moves on where the person's feet never stand still (`Person.with_moving_feet`), slowest in mid-stance;
* a sensor in the heel rocks on it to and fro (`fg_nav.lab.simulation.rocking`).

Between strides the foot stands and sways, or rocks on. Every stride differs in vigour; short strides are gentler, fast
ones hit harder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.motion import Bursts, Kinematics, Ramps, Strides, average_over_period
from fg_nav.lab.simulation.mount import Mount, draw_shocks
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.rocking import draw_rocking
from fg_nav.lab.simulation.steps import (
    ASIDE,
    DROP,
    FALL,
    FORWARD,
    INVERT_OFF,
    INVERT_ON,
    LAND,
    LEAN,
    LIFT,
    MOVE_ON,
    PRESS,
    PUSH,
    RAISE,
    ROLL_OVER,
    SET_DOWN,
    SETTLE,
    SLIP,
    SPRING,
    STIR,
    TOE_IN,
    TOE_OUT,
    TURN,
    Moves,
    Steps,
    compute_lift_rises,
    compute_pitch_rises,
    draw_steps,
    join_moves,
    rotate_to_level,
)
from fg_nav.system.compiled import njit

NODE_S = 3e-3
"""A node of quadrature for each of these in a sample period, and one more: errors stay below 1e-4 of an 80 Hz burst."""

Track: TypeAlias = tuple[float, Sequence[Moves]]
"""Where a coordinate begins, and its moves."""


@dataclass(frozen=True)
class FootMotion:
    """A sensor on a foot.

    Attributes
    ----------
    east, north, up : of the pivot, m.
    roll, pitch, yaw : of the foot, rad.
    bursts : of d (3, m, foot frame) and of roll, pitch and yaw (3, rad).
    lever_m : (3,) from the pivot to the sensor, foot frame.
    foot_R_body : (3, 3).
    flat : (K + 1, 2) s, the truth of stance: from when the last ramp of landing has ended to when the first of the next
        push begins. In between the loaded foot rolls on by degrees a second, sinks and slips; slap and tremor die out.
    """

    east: Ramps
    north: Ramps
    up: Ramps
    roll: Ramps
    pitch: Ramps
    yaw: Ramps
    bursts: Bursts
    lever_m: Floats
    foot_R_body: Floats
    flat: Floats

    def at(self, t: Floats) -> Kinematics:
        """Exact state at rising instants `t` (N,) s."""
        moved = (self.east, self.north, self.up, self.roll, self.pitch, self.yaw)
        coordinates = np.stack([ramps.at(t) for ramps in moved], axis=2)
        return Kinematics(*_compute_kinematics(coordinates, self.bursts.at(t), self.lever_m, self.foot_R_body))

    def pivot_at(self, t: Floats) -> tuple[Floats, Floats]:
        """Place (N, 3) m of the pivot in nav, and yaw (N,) rad of the foot, at rising instants `t` (N,) s."""
        place = [ramps.at(t)[0] for ramps in (self.east, self.north, self.up)]
        return np.stack(place, axis=1), self.yaw.at(t)[0]

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period].

        By quadrature with as many nodes as the shocks ask for.
        """
        return average_over_period(self, t, period_s, nodes=int(np.ceil(1 + period_s / NODE_S)))


def build_foot_motion(
    strides: Strides, person: Person, mount: Mount, rng: np.random.Generator, restless: bool = False
) -> FootMotion:
    """Motion of a sensor on the foot that makes these strides.

    Parameters
    ----------
    strides : when and where to.
    person : how.
    mount : where the sensor sits; drawn here where it still has scatter.
    rng : draws what varies from stride to stride.
    restless : the foot rocks in standing as it walks, wherever the sensor is.

    Raises `SimulationError` if strides overlap, last no time, or are not finite.
    """
    drawn = mount.draw(rng)
    steps = draw_steps(strides, person, drawn.unrest, rng)
    leans = drawn.unrest * (1 + rng.standard_normal((2, len(steps))))
    east, north = _move_level(steps)
    tracks: dict[str, Track] = {
        "east": east,
        "north": north,
        "up": _move_up(steps),
        "roll": _move_roll(steps, leans[0], rng),
        "pitch": _move_pitch(steps, rng),
        "yaw": _move_yaw(steps, leans[1], rng),
    }
    bursts = draw_shocks(steps, drawn, rng)
    rate, standing = person.rocking_rad_s, float(restless)
    rocking = draw_rocking(steps, drawn.rocking * rate, standing * rate, drawn.lever_m[:2], rng)
    return FootMotion(
        **{name: _make_ramps((begun, [*moves, rocking[name]])) for name, (begun, moves) in tracks.items()},
        bursts=bursts,
        lever_m=np.array(drawn.lever_m),
        foot_R_body=drawn.foot_R_body,
        flat=steps.flat,
    )


def _make_ramps(track: Track) -> Ramps:
    begun, moves = track
    return Ramps.of(*join_moves(moves), begun_at=begun)


def _move_level(steps: Steps) -> tuple[Track, Track]:
    """East and north. What the foot slips and moves on is made up for in the swing before: it ends on its footprint."""
    heading, footprint = steps.strides.heading[1:], steps.strides.footprint
    step = np.diff(footprint[:, :2], axis=0) - steps.slip - steps.moved_on
    aside = rotate_to_level(heading, np.zeros(len(steps)), -steps.gait("circumduction_m") * steps.vigour)
    east, north = (
        [
            steps.swing(FORWARD, step[:, axis]),
            steps.swing(ASIDE, aside[:, axis]),
            steps.stance(SLIP, steps.slip[:, axis]),
            steps.stance(MOVE_ON, steps.moved_on[:, axis]),
        ]
        for axis in (0, 1)
    )
    return (float(footprint[0, 0]), east), (float(footprint[0, 1]), north)


def _move_up(steps: Steps) -> Track:
    floor = steps.strides.footprint[:, 2]
    heights = (steps.gait(name) * steps.vigour for name in ("clearance_m", "midswing_m", "heel_m"))
    lift, again, set_down, drop = compute_lift_rises(*heights)
    climb = steps.gait("climb")
    return float(floor[0]), [
        steps.swing(LIFT, lift),
        steps.swing(DROP, drop),
        steps.swing(RAISE, again),
        steps.swing(SET_DOWN, set_down),
        steps.between(climb[:, 0], climb[:, 1], np.diff(floor)),
        steps.swing(SPRING, np.roll(steps.pressed, 1)),  # the foot begins as pressed as it ends
        steps.swing(PRESS, -steps.pressed),
    ]


def _move_pitch(steps: Steps, rng: np.random.Generator) -> Track:
    toe_down, toe_up = steps.gait("toe_down_rad") * steps.vigour, steps.gait("toe_up_rad") * steps.vigour
    push, land, fall = compute_pitch_rises(toe_down, toe_up)
    begun = np.concatenate([[0.0], steps.settled + steps.rolled])[: len(steps)]  # by the stance before
    return 0.0, [
        steps.swing(STIR, steps.stirred),
        steps.swing(PUSH, push - steps.stirred - begun),
        steps.swing(FALL, fall),
        steps.swing(LAND, land),
        steps.swing(SETTLE, steps.settled),
        steps.stance(ROLL_OVER, steps.rolled),
        _draw_sways(steps, rng),
    ]


def _move_roll(steps: Steps, lean: Floats, rng: np.random.Generator) -> Track:
    inversion = steps.gait("inversion_rad") * _draw_wobble(steps, rng)
    return 0.0, [
        steps.swing(INVERT_OFF, inversion[0]),
        steps.swing(INVERT_ON, inversion[1]),
        steps.stance(LEAN, steps.gait("pronation_rad") * lean),
        _draw_sways(steps, rng),
    ]


def _move_yaw(steps: Steps, lean: Floats, rng: np.random.Generator) -> Track:
    heading = steps.strides.heading
    wobble = steps.gait("yaw_wobble_rad") * _draw_wobble(steps, rng)
    return np.pi / 2 - float(heading[0]), [
        steps.swing(TOE_OUT, wobble[0]),
        steps.swing(TOE_IN, wobble[1]),
        steps.stance(LEAN, steps.gait("twist_rad") * lean),
        steps.swing(TURN, -np.diff(heading)),
    ]


def _draw_wobble(steps: Steps, rng: np.random.Generator) -> Floats:
    """Size (2, K) of what is drawn for every stride."""
    return steps.vigour * (1 + steps.gait("wobble_scatter") * rng.standard_normal((2, len(steps))))


def _draw_sways(steps: Steps, rng: np.random.Generator) -> Moves:
    """An angle that wanders in every pause, and is back at its end."""
    person = steps.person
    long = [(begin, end) for begin, end in steps.pauses if end - begin > 2 * person.sway_s]
    return join_moves([_draw_sway(person, begin, end, rng) for begin, end in long])


def _draw_sway(person: Person, begin: float, end: float, rng: np.random.Generator) -> Moves:
    count = int((end - begin) / person.sway_s)
    angle = person.sway_rad * np.concatenate([[0.0], rng.standard_normal(count - 1), [0.0]])
    edge = np.linspace(begin, end, count + 1)
    return Moves(edge[:-1], np.diff(edge), np.diff(angle))


Vector: TypeAlias = tuple[float, float, float]
"""A vector in compiled code: no array to make for each."""


@njit(cache=True)
def _compute_kinematics(
    moved: Floats, burst: Floats, lever: Floats, foot_R_body: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Position, velocity, attitude, rate and force from coordinates and bursts (3, N, 6), each with two derivatives."""
    count = moved.shape[1]
    position, velocity = np.empty((count, 3)), np.empty((count, 3))
    rate, force = np.empty((count, 3)), np.empty((count, 3))
    nav_R_body, R = np.empty((count, 3, 3)), np.empty((3, 3))
    up = (0.0, 0.0, GRAVITY_M_S2)
    for n in range(count):
        angles = [_sum(_vector(moved[d, n, 3:]), _vector(burst[d, n, 3:])) for d in range(3)]
        w, dw = _compute_rate(angles[0], angles[1], angles[2], R)
        s, ds = _sum(_vector(lever), _vector(burst[0, n])), _vector(burst[1, n])
        ws = _cross(w, s)
        _put(position[n], _sum(_vector(moved[0, n]), _from(R, s)))
        _put(velocity[n], _sum(_vector(moved[1, n]), _from(R, _sum(ws, ds))))
        felt = _sum(_to(R, _sum(_vector(moved[2, n]), up)), _vector(burst[2, n]))
        felt = _sum(felt, _sum(_cross(dw, s), _cross(w, _sum(ws, _sum(ds, ds)))))
        _put(force[n], _to(foot_R_body, felt))
        _put(rate[n], _to(foot_R_body, w))
        for i in range(3):
            _put(nav_R_body[n, i], _to(foot_R_body, _vector(R[i])))
    return position, velocity, nav_R_body, rate, force


@njit(cache=True)
def _compute_rate(angle: Vector, first: Vector, second: Vector, R: Floats) -> tuple[Vector, Vector]:
    """Rate and its derivative in the foot frame from roll, pitch, yaw and their derivatives; writes the attitude R."""
    sr, sp, sy = np.sin(angle[0]), np.sin(angle[1]), np.sin(angle[2])
    cr, cp, cy = np.cos(angle[0]), np.cos(angle[1]), np.cos(angle[2])
    r, p, y = first
    rr, pp, yy = second
    _put(R[0], (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr))
    _put(R[1], (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr))
    _put(R[2], (-sp, cp * sr, cp * cr))
    rate = (r - y * sp, p * cr + y * cp * sr, -p * sr + y * cp * cr)
    change = (
        rr - yy * sp - y * p * cp,
        pp * cr - p * r * sr + yy * cp * sr - y * p * sp * sr + y * r * cp * cr,
        -pp * sr - p * r * cr + yy * cp * cr - y * p * sp * cr - y * r * cp * sr,
    )
    return rate, change


@njit(cache=True)
def _vector(a: Floats) -> Vector:
    return a[0], a[1], a[2]


@njit(cache=True)
def _put(into: Floats, a: Vector) -> None:
    into[0], into[1], into[2] = a


@njit(cache=True)
def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _dot(a: Floats, b: Vector) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(cache=True)
def _from(R: Floats, v: Vector) -> Vector:
    """R v: from the frame on its right to the one on its left."""
    return _dot(R[0], v), _dot(R[1], v), _dot(R[2], v)


@njit(cache=True)
def _to(R: Floats, v: Vector) -> Vector:
    """R^T v: from the frame on its left to the one on its right."""
    return _dot(R[:, 0], v), _dot(R[:, 1], v), _dot(R[:, 2], v)
