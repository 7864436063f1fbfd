"""What a person makes of strides: durations of swing and stance, vigour, slip; and moves of a coordinate in their time.

Every stride differs in vigour; a short one is gentler. In stance the foot rolls on, presses its sole and slips, each by
an amount of its own; slip is correlated from stride to stride, for foot and floor are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.footsteps import Strides
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.phases import LANDED_AT, LEAVES_AT, Phase

LEAST_EFFORT = 0.4
"""Angles and heights of a stride on the spot, in those of a full one; they grow with its length."""

LONGEST = 1.3
"""Longer strides than this many usual ones take no more effort."""

RAREST = 3.0
"""No rhythm is further off than this many standard deviations: a swing that outlasts its stride is none."""

LEAST_FLAT_S = 0.01
"""A foot that pushes off before it has landed, as runners may, counts as flat for so long in the middle of the two."""

PAUSE_S = 0.02
"""A foot that stays for longer than this after a stride stands."""


class Moves(NamedTuple):
    """Ramps of one coordinate: `start`, `width` (M,) s, `rise` (M,)."""

    start: Floats
    width: Floats
    rise: Floats


def joined(moves: Sequence[Moves]) -> Moves:
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

    def __len__(self) -> int:
        return len(self.strides)

    def gait(self, name: str) -> Floats:
        """Value of a gait's field for each stride, (K,) or (K, n)."""
        return np.array([getattr(gait, name) for gait in self.person.gaits], dtype=np.float64)[self.strides.style]

    def swing(self, phase: Phase, rise: Floats) -> Moves:
        """Move by `rise` (K,) as the phase says, in shares of the swing."""
        return joined([self.between(begin, end, weight * rise) for begin, end, weight in phase])

    def between(self, begin: float | Floats, end: float | Floats, rise: Floats) -> Moves:
        """Move by `rise` (K,) between two shares of the swing."""
        return Moves(self.strides.start + begin * self.swing_s, (end - begin) * self.swing_s, rise)

    def stance(self, phase: Phase, rise: Floats) -> Moves:
        """Move by `rise` (K,) as the phase says, in shares of the stance."""
        flat, stance_s = self.strides.start + self.swing_s, self.strides.duration - self.swing_s
        return joined([Moves(flat + b * stance_s, (e - b) * stance_s, w * rise) for b, e, w in phase])

    @property
    def flat(self) -> Floats:
        """(K + 1, 2) s, from when to when no ramp of a swing moves the foot: flat on the floor."""
        landed = np.concatenate([[0.0], self.strides.start + LANDED_AT * self.swing_s])
        leaves = np.append(self.strides.start + LEAVES_AT * self.swing_s, self.strides.end_s)
        middle, half = (landed + leaves) / 2, np.maximum(leaves - landed, LEAST_FLAT_S) / 2
        flat: Floats = np.stack([middle - half, middle + half], axis=1)
        return np.clip(flat, 0.0, self.strides.end_s)

    @property
    def pauses(self) -> Floats:
        """(K + 1, 2) s, from when to when the foot does not stride; most are empty."""
        begin = np.concatenate([[0.0], self.strides.start + self.strides.duration])
        return np.stack([begin, np.append(self.strides.start, self.strides.end_s)], axis=1)


def draw_steps(strides: Strides, person: Person, unrest: float, rng: np.random.Generator) -> Steps:
    """Draw what varies from stride to stride, with so much of a foot's turning in stance (`Mount.unrest`).

    Raises
    ------
    SimulationError
        If strides overlap, last no time, or are not finite.
    """
    _check(strides)
    nothing = np.zeros(len(strides))
    steps = Steps(strides, person, *(nothing,) * 6, np.zeros((len(strides), 2)))
    white = rng.standard_normal((6, len(strides)))
    turning = unrest * (1 + steps.gait("rollover_scatter") * white[1])
    return replace(
        steps,
        vigour=_effort(steps) * (1 + steps.gait("vigour") * white[0]),
        stirred=steps.gait("stir_rad") * turning,
        settled=steps.gait("settle_rad") * turning,
        rolled=np.where(_walks_on(strides), steps.gait("rollover_rad") * turning, 0.0),  # or it stands
        pressed=np.maximum(steps.gait("sole_m") + steps.gait("sole_sd_m") * white[2], 0.0),
        swing_s=_swing_share(steps, white[3]) * strides.duration,
        slip=_slip(steps, white[4:]),
    )


def on_level(heading: Floats, forward: Floats, left: Floats) -> Floats:
    """(K, 2) m east and north of what is forward and left of a heading (K,) rad."""
    sine, cosine = np.sin(heading), np.cos(heading)
    return np.stack([sine * forward - cosine * left, cosine * forward + sine * left], axis=1)


def _swing_share(steps: Steps, white: Floats) -> Floats:
    return steps.gait("swing_share") * (1 + steps.gait("rhythm") * np.clip(white, -RAREST, RAREST))


def _effort(steps: Steps) -> Floats:
    usual = steps.gait("stride_m")
    length = np.linalg.norm(np.diff(steps.strides.footprint[:, :2], axis=0), axis=1)
    share: Floats = np.divide(length, usual, out=np.ones_like(usual), where=usual > 0)
    return LEAST_EFFORT + (1 - LEAST_EFFORT) * np.minimum(share, LONGEST)


def _walks_on(strides: Strides) -> Bools:
    """(K,) True where the next stride begins when this one ends."""
    pause = strides.start[1:] - (strides.start + strides.duration)[:-1]
    return np.append(pause < PAUSE_S, False)[: len(strides)]


def _slip(steps: Steps, white: Floats) -> Floats:
    """(K, 2) m in nav from white numbers (2, K)."""
    forward, left = _correlated(steps.gait("slip_correlation"), white)
    return on_level(
        steps.strides.heading[1:],
        steps.gait("slip_m") + steps.gait("slip_sd_m") * forward,
        steps.gait("slip_sideways_m") * left,
    )


def _correlated(rho: Floats, white: Floats) -> Floats:
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
