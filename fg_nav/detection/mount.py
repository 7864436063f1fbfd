"""Mount of the sensor, foot or trouser pocket, by its angular rate.

A foot stands in every stride: it hardly turns for a third of the time (a fifth where it runs), and in between it turns
at 300 to 600 deg/s. A thigh that walks never rests: its rate is zero only where it turns back, and peaks at 150 to 350.
In windows of some strides, of the slow rate (below 6 Hz):

* rest share   share of the time in which the rate is below 15 % of the window's peak
* peak         the highest rate
* rhythm       autocorrelation of the rate about its principal axis at one stride
* impact       the highest specific force: a walker's sensor is hit at every footfall

====================================== ========== ========== ========= ============
medians over the windows that turn     rest share peak deg/s rhythm    impact m/s^2
====================================== ========== ========== ========= ============
real feet (gdin, openshoe, vicon, xio) 0.27-0.55  140-630    0.56-0.99 20 and more
... of those, that run throughout      0.12-0.17  320-570    0.92-0.98 50 and more
real thighs (qmt_fullbody)             0.05, 0.10 290, 360   0.94      71, 47
simulated feet                         0.36-0.44  440-560    0.88-0.95 50 and more
simulated thighs                       0.06-0.08  240-260    0.96-0.99 45 to 60
moved by hand, hand that swings        0.00-0.14  150-770    0.32-0.97 12 to 30
====================================== ========== ========== ========= ============

In between, without rhythm, or without impact, the mount is neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.linalg.lapack import dtbtrs

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.recording import Recording

Wearing: TypeAlias = Literal["foot", "pocket"]

SLOW_HZ = 6.0  # A thigh's swing has one to three cycles a stride; ringing after a footfall is at 8 Hz and more.
WINDOW_S = 4.0  # Three or four strides.
MOVING_DEG_S = 80.0  # A window with a lower peak is one of standing or sitting.
MIN_WINDOWS = 3  # For a decision.
RESTING_PART = 0.15  # Of the peak; below it the sensor rests.
MIN_RHYTHM = 0.6  # A correlation below this is no gait.
FOOT_SHARE = 0.2  # A rest share above this is that of a foot.
RUNNING_SHARE, RUNNING_DEG_S = 0.115, 430.0  # Rest share and peaks above these are those of a foot that runs.
POCKET_SHARE, POCKET_DEG_S, POCKET_M_S2 = 0.105, 450.0, 20.0  # Shares and peaks below, impacts above: a thigh.
STRIDE_S = (0.25, 1.8)  # Lags of the rhythm: half of the quickest stride, and the slowest.
WINDOWS = 256  # Evaluated at once.


@dataclass(frozen=True)
class TurnSigns:
    """Signs of the mount: medians over `windows` windows in which the sensor turns; NaN without one."""

    windows: int
    rest_share: float
    peak_deg_s: float
    rhythm: float
    impact_m_s2: float

    @property
    def wearing(self) -> Wearing | None:
        """Mount of the sensor; None where it is not clear."""
        if self.windows < MIN_WINDOWS or not self.rhythm > MIN_RHYTHM:
            return None
        running = self.rest_share > RUNNING_SHARE and self.peak_deg_s > RUNNING_DEG_S
        if self.rest_share > FOOT_SHARE or running:
            return "foot"
        swings = self.rest_share < POCKET_SHARE and self.peak_deg_s < POCKET_DEG_S
        return "pocket" if swings and self.impact_m_s2 > POCKET_M_S2 else None

    @property
    def words(self) -> str:
        """Part of a sentence."""
        return f"{100 * self.rest_share:.0f} % of the time at rest between turns of {self.peak_deg_s:.0f} deg/s"


def measure_turning(recording: Recording) -> TurnSigns:
    """Measure the signs of the mount, medians over the windows in which the sensor turns."""
    rate = np.column_stack([remove_fast(axis - np.median(axis), recording.period_s) for axis in recording.gyr.T])
    count = round(WINDOW_S / recording.period_s)
    whole = len(rate) // count if count > 1 else 0
    windows, force = (one[: whole * count].reshape(whole, max(count, 1), 3) for one in (rate, recording.acc))
    found = [
        _measure_windows(windows[first : first + WINDOWS], force[first : first + WINDOWS], recording.period_s)
        for first in range(0, whole, WINDOWS)
    ]
    signs = np.concatenate(found) if found else np.zeros((0, 5))
    if not len(signs):
        return TurnSigns(0, np.nan, np.nan, np.nan, np.nan)
    pauses = signs[:, 4] > 0  # a thigh rests as a foot does: left out unless all windows pause
    rest_share, peak, rhythm, impact = np.median(signs[pauses == pauses.all(), :4], axis=0).tolist()
    return TurnSigns(len(signs), rest_share, float(np.degrees(peak)), rhythm, impact)


def _measure_windows(rate: Floats, force: Floats, period_s: float) -> Floats:
    """Rest share, peak rad/s, rhythm, impact m/s^2 and whether it pauses (M, 5), of the windows (W, n, 3) that turn."""
    size = np.linalg.norm(rate, axis=2)
    peak = size.max(axis=1)
    moving = peak > np.radians(MOVING_DEG_S)
    size, peak = size[moving], peak[moving]
    rest_share = (size < RESTING_PART * peak[:, None]).mean(axis=1)
    impact = np.linalg.norm(force[moving], axis=2).max(axis=1)
    thirds = np.array([part.max(axis=1) for part in np.array_split(size, 3, axis=1)])
    pauses = (thirds < np.radians(MOVING_DEG_S)).any(axis=0)
    return np.column_stack([rest_share, peak, _measure_rhythm(rate[moving], period_s), impact, pauses])


def remove_fast(values: Floats, period_s: float, below_hz: float = SLOW_HZ) -> Floats:
    """Low-pass values (N, ...) without delay: a second-order Butterworth filter, both ways.

    The ends are continued point-symmetrically for three periods. (`scipy.signal` takes half a second to load.)
    """
    share = min(below_hz * period_s, 0.45)
    more = min(3 * round(1 / share), len(values) - 1)
    before, after = 2 * values[0] - values[more:0:-1], 2 * values[-1] - values[-2 : -more - 2 : -1]
    long = np.concatenate([before, values, after])
    both_ways = _filter_forward(_filter_forward(long, share)[::-1], share)[::-1]
    return both_ways[more : more + len(values)]


def _filter_forward(x: Floats, share: float) -> Floats:
    """Filter (N, ...) by a second-order low pass, settled on the first value: y'' + a_1 y' + a_2 y = b (x'' + 2x' + x).

    The edge frequency is `share` of the sampling frequency. The recursion is a banded triangular system.
    """
    k = np.tan(np.pi * share)
    scale = 1 + np.sqrt(2) * k + k * k
    a_1, a_2 = 2 * (k * k - 1) / scale, (1 - np.sqrt(2) * k + k * k) / scale
    push = np.concatenate([np.zeros((2, *x.shape[1:])), x - x[0]])
    right, band = k * k / scale * (push[2:] + 2 * push[1:-1] + push[:-2]), np.ones((3, len(x))) * [[1.0], [a_1], [a_2]]
    y, _ = dtbtrs(band, right, uplo="L", diag="U")
    return np.asarray(y + x[0])


def refuse_foot(recording: Recording) -> TurnSigns:
    """Return the signs of a pocket's recording; raises `EstimationError` if it is clearly a foot's."""
    signs = measure_turning(recording)
    if signs.wearing == "foot":
        raise EstimationError(f"the sensor was on a foot, not in a pocket ({signs.words}): leave --mount pocket out.")
    return signs


def refuse_pocket(recording: Recording) -> None:
    """Raise `EstimationError` if a foot's recording is clearly that of a thigh."""
    signs = measure_turning(recording)
    if signs.wearing == "pocket":
        raise EstimationError(
            f"the sensor was in a trouser pocket, not on a foot (only {signs.words}): try `fg-nav run --mount pocket`."
        )


def _measure_rhythm(windows: Floats, period_s: float) -> Floats:
    """Highest autocorrelation (W,) of the rate (W, n, 3) about its principal axis, after it has fallen below half.

    A rate that only varies slowly does not return within `STRIDE_S`.
    """
    axes = np.linalg.eigh(np.einsum("wni,wnj->wij", windows, windows))[1][:, :, 2]
    about = np.einsum("wni,wi->wn", windows, axes)
    lags = np.unique(np.round(np.arange(*STRIDE_S, 0.025) / period_s).astype(int))
    lags = lags[(lags > 0) & (lags < about.shape[1])]
    if not lags.size:
        return np.zeros(len(windows))
    found = np.empty((len(lags), len(windows)))
    for k, lag in enumerate(lags):
        a, b = about[:, lag:], about[:, :-lag]
        scale = np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1))
        found[k] = (a * b).sum(axis=1) / np.maximum(scale, 1e-12)
    back = np.logical_or.accumulate(found < 0.5, axis=0)
    return np.asarray(np.where(back, found, -1.0).max(axis=0))
