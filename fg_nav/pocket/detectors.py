"""When gravity is alone, and when the field keeps still: the paper's two detectors (2.1.2).

The paper names them and refers to its reference 26 for how. Ours look at the measurements and at nothing later.

Zero acceleration
    | |a| - g | < limit, and has been for a while. It looks at the strength alone: an acceleration across gravity shows
    in it by its square only, 0.3 m/s^2 for 2.4. Hence the sigma with which the direction is then believed.

Magnetic disturbance
    s, the standard deviation of |B| over the last n samples with a field, against sigma and the change that may pass

        s^2 < sigma^2 chi2_{n-1}(1 - p) / (n - 1) + (drift W)^2 / 12

    p being how often noise alone may fail, and W the window: a steady change spreads by drift W / sqrt(12).
    The strength needs no attitude. A field that turns at the same strength is not seen.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from fg_nav.arrays import Bools, Floats
from fg_nav.pocket.parameters import PocketParameters


def zero_acceleration(t: Floats, acc: Floats, parameters: PocketParameters) -> Bools:
    """(N,) True where the specific force (N, 3) m/s^2 has been gravity's strength for long enough."""
    near = np.abs(np.linalg.norm(acc, axis=1) - parameters.gravity) < parameters.zero_acceleration_m_s2  # not NaN
    rows = np.arange(len(t))
    last_far = np.maximum.accumulate(np.where(near, -1, rows))
    since = t[np.minimum(last_far + 1, len(t) - 1)]
    period = float(np.median(np.diff(t)))
    return np.asarray(near & (t - since + period > parameters.zero_acceleration_s - 1e-9))


def steady_field(t: Floats, mag: Floats, parameters: PocketParameters) -> Bools:
    """(N,) True where there is a field, and the strength of `mag` (N, 3) uT kept still; NaN where there is none."""
    fresh = np.flatnonzero(np.isfinite(mag).all(axis=1))
    steady = np.zeros(len(t), dtype=np.bool_)
    if len(fresh) < 2:
        return steady
    count = max(round(parameters.field_window_s / float(np.median(np.diff(t[fresh])))), 3)
    if len(fresh) >= count:
        spread = _spread_before(np.linalg.norm(mag[fresh], axis=1), count)
        steady[fresh[count - 1 :]] = spread < steady_limit(count, parameters)
    return steady


def steady_limit(count: int, parameters: PocketParameters) -> float:
    """Variance, uT^2, that the strength may have over `count` samples."""
    noise = parameters.mag_sigma_uT**2 * float(chi2.isf(parameters.field_false_alarm, count - 1)) / (count - 1)
    return noise + (parameters.field_drift_uT_s * parameters.field_window_s) ** 2 / 12.0


def _spread_before(strength: Floats, count: int) -> Floats:
    """Variance (N - count + 1,) of the `count` samples up to each."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(strength, count).var(axis=1, ddof=1))
