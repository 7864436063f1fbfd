"""A sensor that lies on a table: constant pose, the truth of an Allan deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.footsteps import Strides
from fg_nav.lab.simulation.motion import Kinematics
from fg_nav.lab.simulation.plan import Section, Stand

TABLE_TILT_RAD = 0.01
"""About each axis, standard deviation: tables and cases are level to half a degree (assumed)."""


@dataclass(frozen=True)
class Lying:
    """Motion of a sensor that does not move, at the origin in the attitude `nav_R_body` (3, 3)."""

    nav_R_body: Floats

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Lying:
        """Draw a table that is not quite level."""
        return cls(Rotation.from_rotvec(rng.normal(0.0, TABLE_TILT_RAD, 3)).as_matrix())

    def at(self, t: Floats) -> Kinematics:
        """Exact state at instants `t` (N,) s."""
        nothing, force = np.zeros((len(t), 3)), np.tile(GRAVITY_M_S2 * self.nav_R_body[2], (len(t), 1))
        return Kinematics(nothing, nothing.copy(), np.tile(self.nav_R_body, (len(t), 1, 1)), nothing.copy(), force)

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period]."""
        state = self.at(t)
        return state.rate, state.force


def no_strides(sections: Sequence[Section]) -> Strides:
    """Strides of nobody, for as long as the sections last; raises `SimulationError` if one of them goes anywhere."""
    seconds = [section.seconds for section in sections if isinstance(section, Stand)]
    if len(seconds) < len(sections):
        raise SimulationError("a sensor on a table goes nowhere: wear it, or choose a course without strides.")
    none = np.zeros(0)
    return Strides(none, none, np.zeros((1, 3)), np.zeros(1), none.astype(np.int64), float(sum(seconds)))
