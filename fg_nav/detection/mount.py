"""Mount of the sensor, foot or trouser pocket, by its angular rate; and its axes, by strides.

Mount. A foot stands in every stride: it hardly turns for a third of the time (a fifth where it runs), and in between it
turns at 300 to 600 deg/s. A thigh that walks never rests: its rate is zero only where it turns back, and peaks at 150
to 350. In windows of some strides, of the slow rate (below 6 Hz):

* rest share   share of the time in which the rate is below 15 % of the window's peak
* peak         the highest rate
* rhythm       autocorrelation of the rate about its principal axis at one stride
* impact       the highest specific force: a walker's sensor is hit at every footfall

In between, without rhythm, or without impact, the mount is neither.

Axes of gyroscope and accelerometer, by strides of a foot or of a thigh.

Foot. Between two instants in which the sensor stands, strapdown from rest must end at rest, and with gravity as the
accelerometer measures it. With wrong axes of the gyroscope it ends at metres a second. So each of the 48 signed
permutations M is tried as "the rate is M y_w":

    z_k(M) = (|v_k| / s_v)^2 + (tilt_k / s_t)^2            of stride k, v and tilt at its end
    l_k(M) = log(exp(-2.5 log(1 + z_k / 4)) + exp(-C))     a Student t; a stride that is none weighs the same for all
    L(M)   = sum_k l_k(M) - l_k(I)                         log odds of M over the given axes

M = -I is a negated gyroscope, or equally a left-handed set of axes in both sensors: in its mirror image a rate turns
the other way. One negated axis of the accelerometer looks like the two other axes of the gyroscope negated. A hand or
thigh that never stands makes strides that are none, of which some fit other axes by chance: M is accepted only if most
strides favour it. Of 2058 pieces of 4 to 40 s of 62 real walks none with its own axes has L above 4.3.

Thigh. It never stands. But over a stride, of period T, a person's velocity changes little: the mean of the specific
force, each sample rotated into the axes at the start of the stride, is gravity,

    f_k(M) = | 1/T int R_M(t) y_a dt |,    R_M the integral of the rate M y_w,        of stride k
    l_k(M) = -1/2 ((f_k - g) / s_g)^2
    L(M)   = median_k (l_k(M) - l_k(I))

Scale and bias of the accelerometer are the same in every stride, and so is the effect of wrong axes on an even gait:
many strides are one observation, L is their median and does not grow with their number (limits: docs/pocket.md). A
stride is the period of the rate about its main axis, by its autocorrelation in windows of `SWINGS_S`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Literal, TypeAlias

import numpy as np
from scipy.linalg.lapack import dtbtrs
from scipy.ndimage import minimum_filter1d

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.footfalls import MAX_LEVEL, MAX_LINK_S, SWING_RATE_RAD_S
from fg_nav.detection.rest import remove_large_bias
from fg_nav.detection.stance import WINDOW_S, Stances, shoe
from fg_nav.errors import EstimationError, RecordingError
from fg_nav.frames import GRAVITY_M_S2, level_attitude
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import Recording
from fg_nav.samples.readings import rebuild_peaks
from fg_nav.samples.stamps import MAX_GAP_S
from fg_nav.text import format_count

Wearing: TypeAlias = Literal["foot", "pocket"]

SLOW_HZ = 6.0  # A thigh's swing has one to three cycles a stride; ringing after a footfall is at 8 Hz and more.
TURNING_S = 4.0  # Three or four strides.
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
    count = round(TURNING_S / recording.period_s)
    whole = len(rate) // count if count > 1 else 0
    windows, force = (one[: whole * count].reshape(whole, max(count, 1), 3) for one in (rate, recording.acc))
    found = [np.zeros((0, 5))]
    for some in (slice(first, first + WINDOWS) for first in range(0, whole, WINDOWS)):
        # rest share, peak, rhythm, impact, and whether it pauses, of the windows that turn
        size = np.linalg.norm(windows[some], axis=2)
        peak = size.max(axis=1)
        moving = peak > np.radians(MOVING_DEG_S)
        size, peak = size[moving], peak[moving]
        rest_share = (size < RESTING_PART * peak[:, None]).mean(axis=1)
        impact = np.linalg.norm(force[some][moving], axis=2).max(axis=1)
        thirds = np.array([part.max(axis=1) for part in np.array_split(size, 3, axis=1)])
        pauses = (thirds < np.radians(MOVING_DEG_S)).any(axis=0)
        rhythm = _measure_rhythm(windows[some][moving], recording.period_s)
        found.append(np.column_stack([rest_share, peak, rhythm, impact, pauses]))
    signs = np.concatenate(found)
    if not len(signs):
        return TurnSigns(0, np.nan, np.nan, np.nan, np.nan)
    pauses = signs[:, 4] > 0  # a thigh rests as a foot does: left out unless all windows pause
    share, peak_rad_s, correlation, hit_m_s2 = np.median(signs[pauses == pauses.all(), :4], axis=0).tolist()
    return TurnSigns(len(signs), share, float(np.degrees(peak_rad_s)), correlation, hit_m_s2)


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
            f"the sensor was in a trouser pocket, not on a foot (only {signs.words}): try `fg-nav run RECORDING "
            "--mount pocket`."
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


# axes

APART_S = 0.35  # From a still mid-swing to the next stance it is less; from stance to stance more.
VELOCITY_M_S, TILT_RAD = 0.3, np.radians(3.0)  # s_v and s_t: rolling, clipped peaks, a gyroscope bias of some deg/s.
NO_STRIDE = 6.0  # C: a stride beyond 5 sigmas carries no information, so that a single one never decides.
DECISIVE = 7.0  # L of certainly wrong axes: odds of 1000, and more than one stride can give.
SUSPECT = 3.0  # L of suspected axes: half a stride.
MAX_STRIDES = 40  # Evenly over the recording.
LOOKED_S = 600.0  # From the first sample on: axes do not change in a recording.
MAX_STRIDE_S = 2.5  # Between stances that are further apart the foot stood, or some were missed.
SWINGS_S = 6.0  # Window of a thigh's period: five strides.
THIGH_STRIDE_S = 0.8, 1.6  # From a fast walk to a slow one; no thigh of a runner (0.65 to 0.75 s) was available.
MIN_RAD_S = 0.5  # Standard deviation of the rate about the main axis: a swing by 7 deg to either side in 1.1 s.
REGULAR = 0.45  # Autocorrelation at a period: an even gait has the overlap, 0.87 at 0.8 s and 0.73 at 1.6; half of it.
FORCE_M_S2 = 0.03 * GRAVITY_M_S2  # s_g: an accelerometer's scale of 3 %, or its bias.
MIN_THIGH_STRIDES = 10  # Walkers change their speed by 0.3 m/s in a stride: of ten, 0.1 m/s^2 is left.

AXES = np.array(
    [np.diag(sign)[list(order)] for sign in product((1.0, -1.0), repeat=3) for order in permutations(range(3))]
)  # M (48, 3, 3); the first is I.


@dataclass(frozen=True)
class AxesEvidence:
    """Evidence of a foot's strides on the axes."""

    scores: Floats  # (K, 48) l of each stride with each of `AXES`.
    gravity: Floats  # (K,) m/s^2, the mean force along the vertical in each stride, with the axes given.

    def __add__(self, other: AxesEvidence) -> AxesEvidence:
        """Join the strides of two parts."""
        gravity = np.concatenate([self.gravity, other.gravity])
        return replace(self, scores=np.concatenate([self.scores, other.scores]), gravity=gravity)

    @property
    def strides(self) -> int:
        """Their number."""
        return len(self.scores)

    @property
    def log_odds(self) -> Floats:
        """(48,) L of each of `AXES`."""
        return np.asarray((self.scores - self.scores[:, :1]).sum(axis=0))

    @property
    def best(self) -> Floats:
        """The most likely M (3, 3)."""
        return np.asarray(AXES[int(np.argmax(self.log_odds))])

    @property
    def against(self) -> float:
        """Log odds of the likeliest axes over those given; 0 unless most strides favour them."""
        return float(self.log_odds.max()) if 2 * self.speaking > self.strides else 0.0

    @property
    def speaking(self) -> int:
        """Number of strides that favour the likeliest axes."""
        gain = self.scores[:, int(np.argmax(self.log_odds))] - self.scores[:, 0]
        return int((gain > 1.0).sum())

    @property
    def problem(self) -> str:
        """Remark for the user, with the axes to try."""
        strides = f"{self.speaking} of {format_count(self.strides, 'stride')}"
        return f"gravity turns against the gyroscope in {strides}: {_describe_axes(self.best)}"


NO_EVIDENCE = AxesEvidence(np.zeros((0, len(AXES))), np.zeros(0))

MeasureAxes: TypeAlias = Callable[[Floats, Floats, Floats], AxesEvidence]  # Of stamps, force and rate.


def measure_axes(t: Floats, acc: Floats, gyr: Floats) -> AxesEvidence:
    """Score the 48 signed permutations of gyr (N, 3) rad/s against acc (N, 3) m/s^2 at t (N,) s, by foot strides."""
    looked = np.s_[: int(np.searchsorted(t, t[0] + LOOKED_S))]
    t, acc, gyr = t[looked], acc[looked], gyr[looked]
    period_s = float(np.median(np.diff(t)))
    start, stop = find_strides_of(t, acc, gyr)
    if not len(start):
        return NO_EVIDENCE
    acc, gyr = (rebuild_peaks(samples, period_s).whole for samples in (acc, gyr))
    gyr = remove_large_bias(t, acc, gyr)
    up_start, up = (average_force(t, acc, sample) for sample in (start, stop))
    up_start, up = (force / np.linalg.norm(force, axis=1)[:, None] for force in (up_start, up))
    h, no_bias = np.diff(t, append=2 * t[-1] - t[-2]), np.zeros((len(start), 3))
    # velocity and error of the vertical at the end of each stride, with each of the axes
    velocity, z = [], []
    for M in AXES:
        attitude = level_attitude(up_start)
        velocity.append(integrate_strides(acc, gyr @ M.T, h, start, stop, attitude, no_bias, GRAVITY_M_S2))
        tilt = np.arccos(np.clip((attitude[:, 2] * up).sum(axis=1), -1.0, 1.0))
        z.append((velocity[-1] ** 2).sum(axis=1) / VELOCITY_M_S**2 + (tilt / TILT_RAD) ** 2)
    scores = np.logaddexp(-2.5 * np.log1p(np.stack(z, axis=1) / 4), -NO_STRIDE)
    return AxesEvidence(scores, GRAVITY_M_S2 + velocity[0][:, 2] / (t[stop] - t[start]))


def refuse_wrong_axes(recording: Recording, measure: MeasureAxes = measure_axes) -> None:
    """Raise `RecordingError` if strides clearly show other axes than those given."""
    found = measure(recording.t, recording.acc, recording.gyr)
    if found.against > DECISIVE:
        path = recording.provenance.path
        raise RecordingError(f"{path.name + ': ' if path else ''}{found.problem}.")


def find_strides_of(t: Floats, acc: Floats, gyr: Floats) -> tuple[Ints, Ints]:
    """First and last sample (K,) of strides from standing to standing, at most `MAX_STRIDES`."""
    # samples at which the sensor is stillest for `APART_S` before and behind
    period_s = float(np.median(np.diff(t)))
    level = np.log10(shoe(acc, gyr, max(3, round(WINDOW_S / period_s))) + 1e-3)
    reach = max(round(APART_S / period_s), 1)
    low = (level == minimum_filter1d(level, 2 * reach + 1)) & (level < MAX_LEVEL)
    moments = np.flatnonzero(low)
    # a run of equal samples is one moment; at both ends there is no window around
    apart = np.diff(moments, prepend=-2 * reach) > reach
    inside = (moments >= reach // 7) & (moments < len(level) - reach // 7)
    moments = np.asarray(moments[apart & inside])
    # strides between them with a swing and without a gap
    start, stop = moments[:-1], moments[1:]
    if not len(start):
        return start, stop
    between = np.stack([start, stop], axis=1).ravel()
    peak = np.maximum.reduceat(np.linalg.norm(gyr, axis=1), between)[::2]
    gap = np.maximum.reduceat(np.diff(t, append=t[-1]), between)[::2]
    kept = np.flatnonzero((peak > SWING_RATE_RAD_S) & (gap < MAX_GAP_S) & (t[stop] - t[start] < MAX_LINK_S))
    kept = kept[np.unique(np.linspace(0, len(kept) - 1, MAX_STRIDES).round().astype(int))] if len(kept) else kept
    return start[kept], stop[kept]


def find_stance_strides(recording: Recording, stances: Stances) -> tuple[Ints, Ints]:
    """First and last sample (K,) of the strides in `LOOKED_S`, from stillest sample to stillest, without pauses."""
    foot = stances.stillest(recording.gyr) if len(stances) else np.zeros(0, dtype=np.int64)
    foot = foot[foot < np.searchsorted(recording.t, recording.t[0] + LOOKED_S)]
    near = np.flatnonzero(np.diff(recording.t[foot]) < MAX_STRIDE_S)
    return foot[near], foot[near + 1]


def average_force(t: Floats, acc: Floats, sample: Ints) -> Floats:
    """Mean specific force (K, 3) m/s^2 about the samples (K,), over `WINDOW_S`."""
    sums = np.vstack([np.zeros(3), np.cumsum(acc, axis=0)])
    first, last = (np.searchsorted(t, t[sample] + side * WINDOW_S / 2) for side in (-1, 1))
    last = np.minimum(np.maximum(last, first + 1), len(acc))
    return np.asarray((sums[last] - sums[first]) / (last - first)[:, None])


def _describe_axes(M: Floats) -> str:
    """Words for the user: the fault that the likeliest axes M (3, 3) show, and the axes to negate."""
    axes = np.array(list("xyz"))
    negated = axes[np.diagonal(M) < 0]
    if len(negated) == 3:
        return "the axes are left-handed, or the rates have the wrong sign; negate gyr, or one axis of acc and gyr both"
    if len(negated) == 1 and np.diagonal(M).prod() != 0:
        return f"the rate about {negated[0]} has the wrong sign; negate gyr {negated[0]}"
    if len(negated) == 2 and np.diagonal(M).prod() != 0:
        rest = axes[np.diagonal(M) > 0][0]
        return f"signs differ between the sensors; negate acc {rest}, or gyr {negated[0]} and {negated[1]}"
    taken = ", ".join(f"{'-' if row.sum() < 0 else ''}{axes[int(np.argmax(np.abs(row)))]}" for row in M)
    return f"the sensors' axes are not the same; the rates about x, y, z seem to be those called {taken}"


@dataclass(frozen=True)
class SwingEvidence(AxesEvidence):
    """Evidence of a thigh's strides on the axes: all together one observation of the accelerometer."""

    @property
    def log_odds(self) -> Floats:
        """(48,) L of each of `AXES`; 0 of fewer than `MIN_THIGH_STRIDES`."""
        if self.strides < MIN_THIGH_STRIDES:
            return np.zeros(len(AXES))
        return np.asarray(np.median(self.scores - self.scores[:, :1], axis=0))

    @property
    def problem(self) -> str:
        """Remark for the user."""
        force = np.median(self.gravity) if self.strides else np.nan
        strides = f"{self.speaking} of {format_count(self.strides, 'stride')}"
        return (
            f"gravity turns against the gyroscope in {strides}, the mean force is {force:.1f} m/s^2: "
            "gyroscope and accelerometer do not belong together (mirrored or exchanged axes), or a scale is wrong"
        )


NO_SWINGS = SwingEvidence(np.zeros((0, len(AXES))), np.zeros(0))


def measure_swing_axes(t: Floats, acc: Floats, gyr: Floats) -> SwingEvidence:
    """Score the 48 signed permutations of gyr (N, 3) rad/s against acc (N, 3) m/s^2 at t (N,) s, by thigh strides."""
    looked = np.s_[: int(np.searchsorted(t, t[0] + LOOKED_S))]
    t, acc, gyr = t[looked], acc[looked], gyr[looked]
    start, stop = _cut_strides(t, gyr)
    if not len(start):
        return NO_SWINGS
    h, took = np.diff(t, append=2 * t[-1] - t[-2]), (t[stop] - t[start])[:, None]
    no_bias, force = np.zeros((len(start), 3)), np.empty((len(start), len(AXES)))
    for k, M in enumerate(AXES):
        attitude = np.tile(np.eye(3), (len(start), 1, 1))
        whole = integrate_strides(acc, gyr @ M.T, h, start, stop, attitude, no_bias, 0.0)
        force[:, k] = np.linalg.norm(whole, axis=1)
    force /= took
    return SwingEvidence(-0.5 * ((force - GRAVITY_M_S2) / FORCE_M_S2) ** 2, force[:, 0])


def _cut_strides(t: Floats, gyr: Floats) -> tuple[Ints, Ints]:
    """Cut each evenly walked window into strides of its own period: first sample (K,) of each, and of the next.

    Where in the gait a stride begins does not matter. At most `MAX_STRIDES`, spread evenly over the recording.
    """
    period_s = float(np.median(np.diff(t)))
    edges = [np.zeros((0, 2), dtype=np.int64)]
    for begin in np.arange(t[0], t[-1] + 1.5 * period_s - SWINGS_S, SWINGS_S):
        part = slice(*np.searchsorted(t, [begin, begin + SWINGS_S]))
        stride_s = _find_period(t[part], gyr[part], period_s)
        if stride_s:
            bounds = np.arange(begin, min(begin + SWINGS_S, t[-1]), stride_s)
            at = np.searchsorted(t, bounds - 0.5 * period_s)  # stamps are rounded
            edges.append(np.column_stack([at[:-1], at[1:]]))
    found = np.concatenate(edges)
    found = found[found[:, 0] < found[:, 1]]  # drop strides without samples, in a gap at the edge of a window
    kept = np.unique(np.linspace(0, len(found) - 1, min(MAX_STRIDES, len(found))).round().astype(int))
    return found[kept, 0].copy(), found[kept, 1].copy()


def _find_period(t: Floats, gyr: Floats, period_s: float) -> float:
    """Period of the strides in a window, s; 0 where nobody walks evenly, or samples are missing for long."""
    if len(t) < 2 or np.diff(t).max() > MAX_GAP_S:
        return 0.0
    swing = gyr - gyr.mean(axis=0)
    swing = swing @ np.linalg.eigh(swing.T @ swing)[1][:, -1]
    swing = np.interp(np.arange(t[0], t[-1] + 0.5 * period_s, period_s), t, swing)  # lost samples shift nothing
    power = float(swing @ swing)
    lags = np.arange(*(round(limit / period_s) for limit in THIGH_STRIDE_S))
    lags = lags[lags < len(swing)]
    if not len(lags) or power < MIN_RAD_S**2 * len(swing):
        return 0.0
    alike = np.array([swing[lag:] @ swing[:-lag] for lag in lags]) / power
    return float(lags[alike.argmax()] * period_s) if alike.max() > REGULAR else 0.0
