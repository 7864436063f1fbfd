"""Do gyroscope and accelerometer have the same, right-handed axes? What strides show, in two of them or more.

Between two moments in which the sensor stands, strapdown from rest must end at rest, and with gravity where the
accelerometer reads it. With wrong axes of the gyroscope it ends at metres a second. So each of the 48 matrices M that
take axes for one another, with a sign, is tried as "the rate is M y_w":

    z_k(M) = (|v_k| / s_v)^2 + (tilt_k / s_t)^2            of stride k, v and tilt at its end
    l_k(M) = log(exp(-2.5 log(1 + z_k / 4)) + exp(-C))     a Student t; a stride that is none weighs the same for all
    L(M)   = sum_k l_k(M) - l_k(I)                         log of the odds of M over the axes that were given

M = -I is a gyroscope that is negated, and just so a left-handed set of axes in both sensors: in its mirror image a rate
turns the other way. One negated axis of the accelerometer looks like the two other axes of the gyroscope negated.

Moments are found by what no M changes: the least SHOE statistic within `APART_S` on either side, of samples whose
strides have a swing between them. A hand or thigh that never stands makes strides that are none, of which some
fit other axes by chance; wrong axes show in nearly all strides: M is believed only if most of them speak for it.

Of 2058 pieces of 4 to 40 s of 62 real walks, and 4 simulated ones, none with its own axes has L above 4.3, and none
of 6 s and more above 1.6 (`scripts/plausible_solutions.py` counts them through the whole way of a recording).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import TypeAlias

import numpy as np
from scipy.ndimage import minimum_filter1d

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.footfalls import MAX_LEVEL, MAX_LINK_S, SWING_RATE_RAD_S
from fg_nav.detection.rest import remove_large_bias
from fg_nav.detection.stance import WINDOW_S, shoe
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2, level_attitude
from fg_nav.mechanisation import integrate_strides
from fg_nav.recording import MAX_GAP_S, Recording
from fg_nav.samples.saturation import rebuild_peaks
from fg_nav.stances import Stances
from fg_nav.text import format_count

APART_S = 0.35
"""From mid-swing, which can be still too, it is less to the stance next to it; from stance to stance it is more."""

VELOCITY_M_S, TILT_RAD = 0.3, np.radians(3.0)
"""s_v and s_t: what ordinary strides leave, by the foot's rolling, clipped peaks and a gyroscope bias of some deg/s."""

NO_STRIDE = 6.0  # C: strides that leave 5 sigmas say nothing, so that a single one never decides.
DECISIVE = 7.0  # L from which on other axes are taken for certain: odds of 1000, and more than one stride can give.
SUSPECT = 3.0  # L from which on other axes are named: half a stride.
MAX_STRIDES = 40  # That are looked at, evenly over the recording.
LOOKED_S = 600.0  # From the first sample on: axes do not change in a recording.
MAX_STRIDE_S = 2.5  # Between stances that are further apart the foot stood, or some were missed.

AXES = np.array(
    [np.diag(sign)[list(order)] for sign in product((1.0, -1.0), repeat=3) for order in permutations(range(3))]
)
"""(48, 3, 3): M; the first is I."""


@dataclass(frozen=True)
class AxesEvidence:
    """What strides say of the axes.

    Attributes
    ----------
    scores : (K, 48) l of each stride with each of `AXES`.
    gravity : (K,) m/s^2, the mean force along the vertical in each stride, with the axes given.
    """

    scores: Floats
    gravity: Floats

    def __add__(self, other: AxesEvidence) -> AxesEvidence:
        """Join the strides of two parts."""
        gravity = np.concatenate([self.gravity, other.gravity])
        return replace(self, scores=np.concatenate([self.scores, other.scores]), gravity=gravity)

    @property
    def strides(self) -> int:
        """How many there were."""
        return len(self.scores)

    @property
    def log_odds(self) -> Floats:
        """(48,) L of each of `AXES`."""
        return np.asarray((self.scores - self.scores[:, :1]).sum(axis=0))

    @property
    def best(self) -> Floats:
        """M (3, 3) that is the likeliest."""
        return np.asarray(AXES[int(np.argmax(self.log_odds))])

    @property
    def against(self) -> float:
        """Log of the odds of the likeliest axes over those given; 0 unless most strides say so."""
        return float(self.log_odds.max()) if 2 * self.speaking > self.strides else 0.0

    @property
    def speaking(self) -> int:
        """How many strides speak for the likeliest axes."""
        gain = self.scores[:, int(np.argmax(self.log_odds))] - self.scores[:, 0]
        return int((gain > 1.0).sum())

    @property
    def problem(self) -> str:
        """What speaks against the axes, in words, and what to try."""
        strides = f"{self.speaking} of {format_count(self.strides, 'stride')}"
        return f"gravity turns against the gyroscope in {strides}: {_describe_axes(self.best)}"


NO_EVIDENCE = AxesEvidence(np.zeros((0, len(AXES))), np.zeros(0))

MeasureAxes: TypeAlias = Callable[[Floats, Floats, Floats], AxesEvidence]
"""Of stamps, force and rate."""


def measure_axes(t: Floats, acc: Floats, gyr: Floats) -> AxesEvidence:
    """Compare the axes of acc (N, 3) m/s^2 and gyr (N, 3) rad/s, at stamps (N,) s, stride by stride."""
    looked = np.s_[: int(np.searchsorted(t, t[0] + LOOKED_S))]
    t, acc, gyr = t[looked], acc[looked], gyr[looked]
    period_s = float(np.median(np.diff(t)))
    start, stop = find_strides_of(t, acc, gyr)
    if not len(start):
        return NO_EVIDENCE
    acc, gyr = (rebuild_peaks(samples, period_s).whole for samples in (acc, gyr))
    gyr = remove_large_bias(t, acc, gyr)
    attitude = level_attitude(measure_up(t, acc, start))
    up = measure_up(t, acc, stop)
    h = np.diff(t, append=2 * t[-1] - t[-2])
    velocity, tilt = zip(*(_integrate(h, acc, gyr @ M.T, start, stop, attitude, up) for M in AXES), strict=True)
    z = (np.array(velocity) ** 2).sum(axis=2) / VELOCITY_M_S**2 + (np.array(tilt) / TILT_RAD) ** 2
    return AxesEvidence(score_strides(z.T), GRAVITY_M_S2 + velocity[0][:, 2] / (t[stop] - t[start]))


def score_strides(z: Floats) -> Floats:
    """Return l (K, 48) of strides by how far each ends from where it must, squared, in sigmas."""
    return np.asarray(np.logaddexp(-2.5 * np.log1p(z / 4), -NO_STRIDE))


def refuse_wrong_axes(recording: Recording, measure: MeasureAxes = measure_axes) -> None:
    """Raise `RecordingError` if strides, as `measure` sees them, surely show other axes than those given."""
    found = measure(recording.t, recording.acc, recording.gyr)
    if found.against > DECISIVE:
        path = recording.provenance.path
        raise RecordingError(f"{path.name + ': ' if path else ''}{found.problem}.")


def find_strides_of(t: Floats, acc: Floats, gyr: Floats) -> tuple[Ints, Ints]:
    """First and last sample (K,) of strides from standing to standing, at most `MAX_STRIDES`."""
    return _find_strides(t, acc, gyr, _find_still_moments(acc, gyr, float(np.median(np.diff(t)))))


def _find_still_moments(acc: Floats, gyr: Floats, period_s: float) -> Ints:
    """Samples (F,) at which the sensor is stillest for `APART_S` before and behind."""
    level = np.log10(shoe(acc, gyr, max(3, round(WINDOW_S / period_s))) + 1e-3)
    reach = max(round(APART_S / period_s), 1)
    low = (level == minimum_filter1d(level, 2 * reach + 1)) & (level < MAX_LEVEL)
    moments = np.flatnonzero(low)
    # a run of equal samples is one moment; at both ends there is no window around
    apart = np.diff(moments, prepend=-2 * reach) > reach
    inside = (moments >= reach // 7) & (moments < len(level) - reach // 7)
    return np.asarray(moments[apart & inside])


def _find_strides(t: Floats, acc: Floats, gyr: Floats, moments: Ints) -> tuple[Ints, Ints]:
    """First and last sample (K,) of strides with a swing and without a gap, at most `MAX_STRIDES`."""
    start, stop = moments[:-1], moments[1:]
    if not len(start):
        return start, stop
    between = np.stack([start, stop], axis=1).ravel()
    peak = np.maximum.reduceat(np.linalg.norm(gyr, axis=1), between)[::2]
    gap = np.maximum.reduceat(np.diff(t, append=t[-1]), between)[::2]
    kept = np.flatnonzero((peak > SWING_RATE_RAD_S) & (gap < MAX_GAP_S) & (t[stop] - t[start] < MAX_LINK_S))
    kept = kept[np.unique(np.linspace(0, len(kept) - 1, MAX_STRIDES).round().astype(int))] if len(kept) else kept
    return start[kept], stop[kept]


def _integrate(
    h: Floats, acc: Floats, gyr: Floats, start: Ints, stop: Ints, start_R_body: Floats, stop_up: Floats
) -> tuple[Floats, Floats]:
    """Velocity (K, 3) m/s and error of the vertical (K,) rad at the end of strides with this rate, steps h (N,) s."""
    attitude = start_R_body.copy()
    velocity = integrate_strides(acc, gyr, h, start, stop, attitude, np.zeros((len(start), 3)), GRAVITY_M_S2)
    tilt = np.arccos(np.clip((attitude[:, 2] * stop_up).sum(axis=1), -1.0, 1.0))
    return velocity, tilt


def find_stance_strides(recording: Recording, stances: Stances) -> tuple[Ints, Ints]:
    """First and last sample (K,) of the strides in `LOOKED_S`, from stillest sample to stillest, without pauses."""
    foot = stances.stillest(recording.gyr) if len(stances) else np.zeros(0, dtype=np.int64)
    foot = foot[foot < np.searchsorted(recording.t, recording.t[0] + LOOKED_S)]
    near = np.flatnonzero(np.diff(recording.t[foot]) < MAX_STRIDE_S)
    return foot[near], foot[near + 1]


def measure_up(t: Floats, acc: Floats, sample: Ints) -> Floats:
    """Direction of up (K, 3) in the body about samples, over `WINDOW_S`."""
    mean = average_force(t, acc, sample)
    return np.asarray(mean / np.linalg.norm(mean, axis=1)[:, None])


def average_force(t: Floats, acc: Floats, sample: Ints) -> Floats:
    """Mean specific force (K, 3) m/s^2 about samples, over `WINDOW_S`."""
    sums = np.vstack([np.zeros(3), np.cumsum(acc, axis=0)])
    first, last = (np.searchsorted(t, t[sample] + side * WINDOW_S / 2) for side in (-1, 1))
    last = np.minimum(np.maximum(last, first + 1), len(acc))
    return np.asarray((sums[last] - sums[first]) / (last - first)[:, None])


def _describe_axes(M: Floats) -> str:
    """Say which axes fit, and what to try."""
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
