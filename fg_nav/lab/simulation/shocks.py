"""Shocks of a foot: bursts that heel strike, slap and toe-off send through foot and sensor, and the tremor of stance.

Each is a shift of the sensor (foot frame) and a turn of the foot, a quarter of a period apart, so that force and rate
peak together. Direction and phase are those of the mount as drawn (`Mount.shock_seed`), much the same in all its
strides and walks; strength scatters, and grows with the vigour of a stride and with the square of its pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.motion import Bursts
from fg_nav.lab.simulation.person import Mount, Shock
from fg_nav.lab.simulation.steps import Steps

JITTER = 0.1
"""Scatter of frequency, phase (in turns) and direction from stride to stride: shocks of a foot resemble each other."""

RAREST = 2.5
"""Strengths scatter by no more standard deviations than this."""

HARDEST = 2.0
"""At most this many times the strength of the usual pace."""


class Blow(NamedTuple):
    """When a shock begins, in shares of the swing, and weights of its force and its rate along (x, y, z)."""

    name: str
    begin: float
    force: tuple[float, float, float]
    rate: tuple[float, float, float]


BLOWS = (
    Blow("strike", 0.82, (1.0, 0.3, 0.7), (1.0, 0.6, 0.8)),
    Blow("crack", 0.85, (0.8, 0.4, 1.0), (0.6, 1.0, 0.6)),
    Blow("slap", 0.95, (0.6, 0.3, 1.0), (0.6, 0.8, 0.8)),
    Blow("toe_off", 0.26, (0.8, 0.3, 1.0), (1.0, 0.5, 0.8)),
)
"""Of the gait. At heel strike the foot is braked, at toe-off pushed, and both rock it sideways most easily."""

RINGING = Blow("ringing", 0.85, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
"""Of the sensor on its mounting."""

TREMORS = tuple(Blow("tremor", begin, (0.6, 1.0, 0.4), (1.0, 0.6, 0.6)) for begin in (1.02, 1.15, 1.28, 1.41))
"""Four a stance, one after the other."""


def shocks(steps: Steps, mount: Mount, rng: np.random.Generator) -> Bursts:
    """Draw the bursts of all strides: of the sensor's place (3, m, foot frame) and of roll, pitch and yaw (3, rad).

    The mount is one that has been drawn.
    """
    own = np.random.default_rng(mount.shock_seed)
    gaits, hard = steps.person.gaits, _hardness(steps)
    unrest = np.full(len(steps), mount.unrest)
    series = [
        *(
            _series(steps, [getattr(gait, blow.name) for gait in gaits], blow, mount.shock * hard, own, rng)
            for blow in BLOWS
        ),
        _series(steps, [mount.ringing] * len(gaits), RINGING, hard, own, rng),
        *(_series(steps, [gait.tremor for gait in gaits], blow, unrest, own, rng) for blow in TREMORS),
    ]
    return Bursts.of(*(np.concatenate(column) for column in zip(*series, strict=True)))


def _hardness(steps: Steps) -> Floats:
    pace = steps.gait("stride_s") / steps.strides.duration
    return steps.vigour * np.minimum(pace**2, HARDEST)


_Series = tuple[Floats, Floats, Floats, Floats, Floats]
"""start, width, omega, phase (2 K,) and amplitude (2 K, 6)."""


def _series(
    steps: Steps,
    shock: Sequence[Shock],
    blow: Blow,
    hardness: Floats,
    own: np.random.Generator,
    rng: np.random.Generator,
) -> _Series:
    """One shock a stride, from those of each style; `own` draws what lasts, `rng` what varies."""
    table = np.array([(s.force_m_s2, s.rate_rad_s, s.frequency_hz, s.length_s, s.scatter) for s in shock])
    force, rate, frequency, width, scatter = table[steps.strides.style].T
    vary = JITTER * rng.standard_normal((3, len(steps)))
    omega = 2 * np.pi * frequency * (1 + vary[0])
    strength = hardness * np.exp(scatter * np.clip(rng.standard_normal(len(steps)), -RAREST, RAREST))
    phase = 2 * np.pi * (own.random() + vary[1])
    begin = steps.strides.start + (blow.begin + 0.1 * vary[2]) * steps.swing_s
    amplitude = np.zeros((2, len(steps), 6))
    amplitude[0, :, :3] = (force * strength / omega**2)[:, None] * _directions(blow.force, len(steps), own, rng)
    amplitude[1, :, 3:] = (rate * strength / omega)[:, None] * _directions(blow.rate, len(steps), own, rng)
    phases = np.concatenate([phase, phase + np.pi / 2])
    return np.tile(begin, 2), np.tile(width, 2), np.tile(omega, 2), phases, amplitude.reshape(-1, 6)


def _directions(
    weight: tuple[float, float, float], count: int, own: np.random.Generator, rng: np.random.Generator
) -> Floats:
    """Directions (K, 3) about one of this mount's own, which is of length 1."""
    usual = np.array(weight) * (own.choice([-1.0, 1.0], 3) + 0.4 * own.standard_normal(3))
    scatter = 2 * JITTER * np.array(weight) * rng.standard_normal((count, 3))
    return np.asarray(usual / np.linalg.norm(usual) + scatter, dtype=np.float64)
