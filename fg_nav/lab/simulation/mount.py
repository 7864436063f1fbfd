"""Where a sensor sits on the foot (`Mount`), and the shocks that it feels there.

Heel strike, slap and toe-off send bursts through foot and sensor; stance trembles. Each is a shift of the sensor (foot
frame) and a turn of the foot, a quarter of a period apart, so that force and rate peak together. Direction and phase
are those of the mount as drawn (`Mount.shock_seed`), much the same in all its strides and walks; strength scatters, and
grows with the vigour of a stride and with the square of its pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.motion import Bursts
from fg_nav.lab.simulation.person import Shock, draw_usual, to_radians
from fg_nav.lab.simulation.sensors import checks
from fg_nav.lab.simulation.steps import Steps

JITTER = 0.1
"""Scatter of frequency, phase (in turns) and direction from stride to stride: shocks of a foot resemble each other."""

RAREST = 2.5  # Strengths scatter by no more standard deviations than this.
HARDEST = 2.0  # At most this many times the strength of the usual pace.


NO_RINGING = Shock(0.0, 0.0, 40.0, 0.1)


@dataclass(frozen=True)
class Mount:
    """How a sensor sits on the foot.

    Attributes
    ----------
    lever_m, lever_sd_m : from the pivot to the sensor, foot frame, mean and scatter over mountings and feet.
    tilt_rad, tilt_sd_rad : roll, pitch and yaw of the sensor's axes in the foot frame, mean and scatter over mountings.
    shock : strength of the gait's shocks at this place, the instep being 1.
    unrest : how much of what a foot turns and trembles in stance reaches this place, the instep being 1.
    rocking : how much of a foot's rocking to and fro in stance (`fg_nav.lab.simulation.rocking`) reaches this place.
    ringing : of the sensor on its mounting, after each heel strike.
    shock_seed : draws in which direction and phase shocks move this sensor; None before it is mounted.
    """

    lever_m: tuple[float, float, float]
    tilt_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_sd_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shock: float = 1.0
    unrest: float = 1.0
    rocking: float = 0.0
    ringing: Shock = NO_RINGING
    lever_sd_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shock_seed: int | None = None

    def __post_init__(self) -> None:
        checks.not_negative(self, "shock", "unrest", "rocking")
        for name in ("lever_m", "lever_sd_m", "tilt_rad", "tilt_sd_rad"):
            checks.vector(self, name)
        for name in ("lever_sd_m", "tilt_sd_rad"):
            if min(getattr(self, name)) < 0:
                raise SimulationError(f"{name} of a Mount is {getattr(self, name)}: give numbers of 0 or more.")

    def mirror(self) -> Mount:
        """The same place on the left shoe."""
        (x, y, z), (roll, pitch, yaw) = self.lever_m, self.tilt_rad
        return replace(self, lever_m=(x, -y, z), tilt_rad=(-roll, pitch, -yaw))

    def draw(self, rng: np.random.Generator) -> Mount:
        """One mounting: tilt, lever and shocks as they happened to be, and no scatter left."""
        roll, pitch, yaw = (float(x) for x in self.tilt_rad + np.array(self.tilt_sd_rad) * rng.standard_normal(3))
        x, y, z = (m + sd * draw_usual(rng) for m, sd in zip(self.lever_m, self.lever_sd_m, strict=True))
        seed = int(rng.integers(2**32))
        return replace(
            self,
            lever_m=(x, y, z),
            lever_sd_m=(0.0, 0.0, 0.0),
            tilt_rad=(roll, pitch, yaw),
            tilt_sd_rad=(0.0, 0.0, 0.0),
            shock_seed=seed if self.shock_seed is None else self.shock_seed,
        )

    @property
    def foot_R_body(self) -> Floats:
        """How the sensor's axes lie in the foot frame at the mean tilt, (3, 3)."""
        return np.asarray(Rotation.from_euler("ZYX", self.tilt_rad[::-1]).as_matrix(), dtype=np.float64)


INSTEP = Mount(
    lever_m=(-0.02, -0.02, 0.085),
    lever_sd_m=(0.005, 0.005, 0.012),
    tilt_rad=(0.0, to_radians(-25.0), 0.0),
    tilt_sd_rad=(to_radians(8.0), to_radians(6.0), to_radians(8.0)),
    ringing=Shock(2.0, to_radians(20.0), 30.0, 0.14),
)
"""On the laces, its x axis up along the instep (gdin: 10-35 deg). The lever is that of the Vicon trials, but for its
height, which lies between theirs (5 to 11 cm) and what the gdin walks show of themselves (6 to 10 cm, some three
standard deviations)."""

HEEL = Mount(
    lever_m=(-0.13, 0.0, 0.025),
    lever_sd_m=(0.005, 0.005, 0.005),
    tilt_rad=(0.0, to_radians(3.0), 0.0),
    tilt_sd_rad=(to_radians(2.0), to_radians(2.0), to_radians(3.0)),
    shock=1.6,
    unrest=0.15,
    rocking=1.0,
    ringing=Shock(5.0, to_radians(10.0), 55.0, 0.08),
)
"""A module in the heel of the shoe (Ma et al. 2018): low, firmly held, and where the heel hits the ground. In stance
the body's weight stands on it, while the instep goes along with the shin. How much less it turns with the shin
(`unrest`), that it rocks on the heel's pad instead (`rocking`), and `shock` are assumed: there is no recording of a
heel with a truth to measure them on, and the drift in height hangs on the last."""

MOUNTS = {"instep": INSTEP, "heel": HEEL}


def find_mount(name: str) -> Mount:
    """Mount by name; raises `SimulationError` if there is none of that name."""
    if name not in MOUNTS:
        raise SimulationError(f"there is no mount '{name}': choose one of {', '.join(MOUNTS)}.")
    return MOUNTS[name]


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

RINGING = Blow("ringing", 0.85, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))  # Of the sensor on its mounting.

TREMORS = tuple(Blow("tremor", begin, (0.6, 1.0, 0.4), (1.0, 0.6, 0.6)) for begin in (1.02, 1.15, 1.28, 1.41))
"""Four a stance, one after the other."""


def draw_shocks(steps: Steps, mount: Mount, rng: np.random.Generator) -> Bursts:
    """Draw the bursts of all strides: of the sensor's place (3, m, foot frame) and of roll, pitch and yaw (3, rad).

    The mount is one that has been drawn.
    """
    own = np.random.default_rng(mount.shock_seed)
    gaits, hard = steps.person.gaits, _compute_hardness(steps)
    unrest = np.full(len(steps), mount.unrest)
    series = [
        *(
            _draw_series(steps, [getattr(gait, blow.name) for gait in gaits], blow, mount.shock * hard, own, rng)
            for blow in BLOWS
        ),
        _draw_series(steps, [mount.ringing] * len(gaits), RINGING, hard, own, rng),
        *(_draw_series(steps, [gait.tremor for gait in gaits], blow, unrest, own, rng) for blow in TREMORS),
    ]
    return Bursts.of(*(np.concatenate(column) for column in zip(*series, strict=True)))


def _compute_hardness(steps: Steps) -> Floats:
    pace = steps.gait("stride_s") / steps.strides.duration
    return steps.vigour * np.minimum(pace**2, HARDEST)


_Series = tuple[Floats, Floats, Floats, Floats, Floats]
"""start, width, omega, phase (2 K,) and amplitude (2 K, 6)."""


def _draw_series(
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
    amplitude[0, :, :3] = (force * strength / omega**2)[:, None] * _draw_directions(blow.force, len(steps), own, rng)
    amplitude[1, :, 3:] = (rate * strength / omega)[:, None] * _draw_directions(blow.rate, len(steps), own, rng)
    phases = np.concatenate([phase, phase + np.pi / 2])
    return np.tile(begin, 2), np.tile(width, 2), np.tile(omega, 2), phases, amplitude.reshape(-1, 6)


def _draw_directions(
    weight: tuple[float, float, float], count: int, own: np.random.Generator, rng: np.random.Generator
) -> Floats:
    """Directions (K, 3) about one of this mount's own, which is of length 1."""
    usual = np.array(weight) * (own.choice([-1.0, 1.0], 3) + 0.4 * own.standard_normal(3))
    scatter = 2 * JITTER * np.array(weight) * rng.standard_normal((count, 3))
    return np.asarray(usual / np.linalg.norm(usual) + scatter, dtype=np.float64)
