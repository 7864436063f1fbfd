"""Channels: the signals, one value a footfall, by which a detector judges the field.

Two kinds. A *value* is whatever it is, and its changes from footfall to footfall are judged; a *zero* should be zero
at every footfall and is judged as it stands.

====================== ===== ===== ==========================================================================
signal                 kind  unit  what it is
====================== ===== ===== ==========================================================================
strength               value uT    |B|                                                         (Ma s^B, QSF)
inclination            value rad   of the field below the horizon                              (Ma s^I)
magnetic heading       value rad   of the body, by the compass                                 (iQSF)
gyro heading           value rad   of the body, by the gyroscope                               (iQSF)
heading difference     value rad   compass minus gyroscope                                     (Ma s^theta)
heading offset         zero  rad   compass minus inertial heading, that one laid on the compass (AIEZ Eq. 9)
strength rate          zero  uT/s  slope of |B| within the stance                               (AIEZ Eq. 9, QSF)
====================== ===== ===== ==========================================================================

Ma's text wants the *change* of the heading difference, his equation after (13) the difference itself: the one is
`heading difference`, the other `heading offset`. AIEZ prints the norm of the rate of the field *vector*, which is that
of any turn of the sensor; the slope of its norm is none of that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import MagneticError
from fg_nav.magnetic.footfall_field import FootfallField

OFFSET = "heading offset"
"""The one signal that depends on what was trusted before."""


@dataclass(frozen=True)
class Signal:
    """What a channel looks at: `of` a footfall field (F,), its `unit` for people and how many of these a unit is."""

    of: Callable[[FootfallField], Floats]
    unit: str
    scale: float
    angle: bool
    value: bool


def _angle(of: Callable[[FootfallField], Floats], value: bool = True) -> Signal:
    return Signal(of, "deg", float(np.degrees(1.0)), True, value)


SIGNALS: Mapping[str, Signal] = {
    "strength": Signal(lambda field: field.strength, "uT", 1.0, False, True),
    "inclination": _angle(lambda field: field.inclination),
    "magnetic heading": _angle(lambda field: field.magnetic_heading),
    "gyro heading": _angle(lambda field: field.gyro_heading),
    "heading difference": _angle(lambda field: field.heading_difference),
    OFFSET: _angle(lambda field: field.heading_difference, value=False),
    "strength rate": Signal(lambda field: field.strength_rate, "uT/s", 1.0, False, False),
}
"""All signals by name."""


@dataclass(frozen=True)
class Channel:
    """A signal and what is expected of it.

    Attributes
    ----------
    name : of the signal, one of `SIGNALS`.
    sigma : rad, uT or uT/s; of one footfall's value, or, in a form as printed, of what that form squares. To a strength
        rate the standard error of each slope is added, as variances add.
    matters : rad, uT or uT/s, the least change over the window (of a zero: the least lasting value) that a detector is
        to reject; only needed for a threshold from a false-alarm rate.
    """

    name: str
    sigma: float
    matters: float = float("nan")

    def __post_init__(self) -> None:
        if self.name not in SIGNALS:
            raise MagneticError(f"there is no channel '{self.name}': choose one of {', '.join(SIGNALS)}.")
        if not self.sigma > 0.0 or not np.isfinite(self.sigma):
            raise MagneticError(f"the sigma of channel '{self.name}' must be positive, not {self.sigma}.")

    @property
    def signal(self) -> Signal:
        """What it looks at."""
        return SIGNALS[self.name]

    def values(self, field: FootfallField) -> Floats:
        """(F,) rad, uT or uT/s; NaN where there was no field. Angles are not unwrapped."""
        value = self.signal.of(field)
        return np.asarray(np.where(np.isfinite(field.strength), value, np.nan))

    def sigmas(self, field: FootfallField) -> Floats:
        """(F,) standard deviation of each value; NaN where it cannot be told."""
        if self.name != "strength rate":
            return np.full(len(field), self.sigma)
        return np.asarray(np.hypot(self.sigma, field.strength_rate_sigma))
