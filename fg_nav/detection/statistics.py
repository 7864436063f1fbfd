"""Four statistics of stillness over a sliding window, small where the foot stands.

Over a window of W samples, with y_a the specific force, y_w the angular rate and a bar for the window's mean:

==== ===================================================== ==================
SHOE (1/W) sum |y_a - g ybar_a/|ybar_a||^2/s_a^2 + |y_w|^2/s_w^2    6 W - 2
ARE  (1/W) sum |y_w|^2 / s_w^2                                        3 W
MV   (1/W) sum |y_a - ybar_a|^2 / s_a^2                               3 W - 3
MAG  (1/W) sum (|y_a| - g)^2 / s_a^2                                  W
==== ===================================================== ==================

The last column is the number of degrees of freedom f: for a sensor at perfect rest with white noise s_a
(m/s^2) and s_w (rad/s), W times the statistic is chi-square with f. So a threshold has a meaning: the rate at
which it would call a sensor at rest a moving one (`threshold_at_rest`). A foot in stance is not at rest, it rolls
and trembles far above sensor noise: its threshold comes from the walk itself (`fg_nav.detection.footfalls`).

Source: Skog, Handel, Nilsson, Rantakokko (2010), "Zero-velocity detection - an algorithm evaluation", IEEE TBME.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2


@dataclass(frozen=True)
class StillnessNoise:
    """Scale of the statistics: the noise of a sensor at rest, and gravity."""

    acc_m_s2: float = 0.02
    """Of the specific force, per sample; data sheets and the recordings at rest have 0.01 to 0.03."""
    gyr_deg_s: float = 0.2
    """Of the angular rate, per sample; data sheets and the recordings at rest have 0.1 to 0.4."""
    gravity_m_s2: float = GRAVITY_M_S2


def shoe(acc: Floats, gyr: Floats, window: int, noise: StillnessNoise = StillnessNoise()) -> Floats:
    """Stance hypothesis optimal estimation (the GLRT): (N,) from `acc` (N, 3) m/s^2 and `gyr` (N, 3) rad/s."""
    strength = np.linalg.norm(_mean(acc, window), axis=1)
    g = noise.gravity_m_s2
    # sum |y - g ybar/|ybar||^2 = sum |y|^2 - 2 g W |ybar| + g^2 W, and rounding must not make it negative
    off_gravity: Floats = np.maximum(_mean((acc**2).sum(axis=1), window) - 2 * g * strength + g * g, 0.0)
    return off_gravity / noise.acc_m_s2**2 + are(acc, gyr, window, noise)


def are(acc: Floats, gyr: Floats, window: int, noise: StillnessNoise = StillnessNoise()) -> Floats:
    """Angular rate energy (N,); `acc` is not used."""
    return _mean((gyr**2).sum(axis=1), window) / float(np.radians(noise.gyr_deg_s)) ** 2


def mv(acc: Floats, gyr: Floats, window: int, noise: StillnessNoise = StillnessNoise()) -> Floats:
    """Moving variance of the specific force (N,); `gyr` is not used."""
    spread: Floats = np.maximum(_mean((acc**2).sum(axis=1), window) - (_mean(acc, window) ** 2).sum(axis=1), 0.0)
    return spread / noise.acc_m_s2**2


def mag(acc: Floats, gyr: Floats, window: int, noise: StillnessNoise = StillnessNoise()) -> Floats:
    """Magnitude of the specific force against gravity (N,); `gyr` is not used."""
    off_gravity = np.linalg.norm(acc, axis=1) - noise.gravity_m_s2
    return _mean(off_gravity**2, window) / noise.acc_m_s2**2


Statistic = Callable[[Floats, Floats, int, StillnessNoise], Floats]

STATISTICS: dict[str, Statistic] = {"shoe": shoe, "are": are, "mv": mv, "mag": mag}

_DEGREES_OF_FREEDOM: dict[str, Callable[[int], int]] = {
    "shoe": lambda window: 6 * window - 2,
    "are": lambda window: 3 * window,
    "mv": lambda window: 3 * window - 3,
    "mag": lambda window: window,
}


def threshold_at_rest(detector: str, window: int, false_alarm_rate: float) -> float:
    """Threshold which a sensor at perfect rest exceeds with this probability a sample."""
    return float(chi2.isf(false_alarm_rate, _DEGREES_OF_FREEDOM[detector](window)) / window)


def _mean(samples: Floats, window: int) -> Floats:
    """Centred sliding mean along the first axis; the ends repeat the outermost sample."""
    return np.asarray(uniform_filter1d(samples, window, axis=0, mode="nearest"))
