"""How sharply the field shows where along the path a stretch is.

An alignment (`alignment`) is the best of many, and says nothing of those next to it. On a rough floor half a meter on
or back is far less likely; where the field hardly changes all of two meters are as good, and the best of them is
chance's. So a piece of a stretch is weighed at shifts s of the earlier pass about its alignment. With L(i, j) the log
likelihood ratio of points i and j, between two points by a cubic spline of the features, and all s as likely before,

    p(s) ~ exp(sum over the piece of L(i, j_i + s)),    |s| <= `REACH_M`,

the piece is at the mean of p, and its sigma along the path is that of p: `REACH_M` / sqrt 3 where the field shows
nothing. L counts only as many points as the field's band has independent ones, so p is as wide as they allow.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.places.alignment import MIN_RATIO, RHO, SHARE
from fg_nav.places.recognition import Stretch
from fg_nav.places.signature import SPACING_M
from fg_nav.places.whitening import Features

REACH_M = 2.0
"""By which places differ that are walked as the same one, and the shortest wavelength of the features: beyond it the
next wave fits as well."""

SHIFTS_M = np.linspace(-REACH_M, REACH_M, 33)  # An eighth of a meter apart: a rough floor shows 20 m of a path to 0.1 m


MARGIN = 8  # Points around a piece, beyond which a spline through them is the same.


def weigh_shifts(features: Features, stretch: Stretch) -> Floats:
    """Return sum L (M, S), nats, of each point of a stretch with the earlier pass at `SHIFTS_M` on from its own."""
    from scipy.interpolate import CubicSpline  # loaded where something was recognized

    last = len(features) - 1.0
    other, earlier = (features.reverse(), last - stretch.earlier) if stretch.opposite else (features, stretch.earlier)
    at = np.clip(earlier[:, None] + SHIFTS_M / SPACING_M, 0.0, last)
    # The earlier pass, and what of it is the field's, between its points.
    near = np.arange(max(int(at.min()) - MARGIN, 0), min(int(at.max()) + MARGIN, len(other)))
    y = CubicSpline(near, other.values[near])(at)
    signal = np.stack([np.interp(at, near, column) for column in other.signal[near].T], axis=2)
    later = stretch.later.astype(np.int64)[:, None]
    return _weigh_points(features.values[later], y, RHO * features.signal[later] * signal)


def _weigh_points(x: Floats, y: Floats, r: Floats) -> Floats:
    """L (M, S) of features (M, 1, 3) and (M, S, 3) with correlation r (M, S, 3)."""
    ratio = -0.5 * np.log1p(-(r**2)) - (r**2 * (x**2 + y**2) - 2.0 * r * x * y) / (2.0 * (1.0 - r**2))
    return np.asarray(SHARE * np.maximum(ratio.sum(axis=2), MIN_RATIO))


def find_shift(ratio: Floats) -> tuple[float, float]:
    """Return the shift, m, of a piece whose points have these L (M, S), and its sigma."""
    total = ratio.sum(axis=0)
    p = np.exp(total - total.max())
    p /= p.sum()
    mean = float(p @ SHIFTS_M)
    step = SHIFTS_M[1] - SHIFTS_M[0]
    return mean, float(np.sqrt(p @ (SHIFTS_M - mean) ** 2 + step**2 / 12.0))
