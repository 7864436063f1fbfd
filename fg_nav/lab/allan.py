"""Allan deviation of a reading at rest, and the noise that it shows.

    AVAR(tau) = N^2 / tau  +  (2 ln 2 / pi) B^2  +  K^2 tau / 3

======= ============ ==========================================================================================
symbol  unit (of u)  meaning
======= ============ ==========================================================================================
u                    of the reading: rad/s, m/s^2 or uT
tau     s            averaging time
N       u/sqrt(Hz)   white noise: one of sigma a sample at a rate f has N = sigma / sqrt(f)
B       u            flicker: spectral density B^2 / (2 pi |f|). The curve's floor is sqrt(2 ln 2 / pi) B = 0.664 B
K       u/sqrt(s)    random walk: after t seconds its standard deviation is K sqrt(t)
======= ============ ==========================================================================================

Densities are two-sided (IEEE Std 952-1997, annex C): a sheet with one-sided ones prints sqrt(2) N. Bias instability on
sheets is mostly the lowest point of the curve; it stands next to B.

The deviation is the overlapping one (Riley, NIST SP 1065, 2008, Eq. 11). The fit is least squares on AVAR, no part
below zero, each averaging time weighted by its variance under the fitted model, and no better than `MODEL_SHARE`, the
model error of the three laws. A part less than `MIN_SIGMAS` above zero is not significant; the fit is repeated without
it, and `limit` bounds it. Filters and held values bend the short end of a curve, a magnetometer's above all: the fit
begins where the laws hold.

AVAR of n readings averaged over m is about chi-square, with the equivalent degrees of freedom of its noise type, for
n + 1 points of phase (Riley, table 5, whose N is n + 1 here):

    white noise   (3 n / (2 m) - 2 (n - 1) / (n + 1)) 4 m^2 / (4 m^2 + 5)
    flicker       5 (n + 1)^2 / (4 m (n + 1 + 3 m)),    m = 1: 2 (n - 1)^2 / (2.3 (n + 1) - 4.9)
    random walk   (n - 1) / m (n^2 - 3 m n + 4 m^2) / (n - 2)^2

The standard deviation of mixed noise is the sum of those of its parts, at most some per cent too large. Neighbouring
averaging times share readings: sigmas of N, B and K are `SHARED` times those of independent ones.

A recording's noise is that of its longest stillness, by the sensor's own noise and not a foot's rest
(`fg_nav.detection.rest`): a block of one second is quiet if its scatter is about that of the quietest blocks, and two
neighbouring quiet blocks belong together if their means agree within noise. Any motion, even a step on the floor
nearby, ends the stretch. A magnetometer with a rate of its own is evaluated at its own rows; lost samples are
interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.stats import chi2

from fg_nav.arrays import Floats, Ints, find_runs
from fg_nav.errors import CalibrationError
from fg_nav.recording import Recording

FLOOR = float(np.sqrt(2 * np.log(2) / np.pi))  # Deviation of flicker with B = 1.
ONE_SIDED_95 = 1.645  # Sigmas that a normal error exceeds in one of twenty.
MIN_READINGS = 40  # Of a curve of a decade.
PER_DECADE = 8  # Averaging times.
MAX_SHARE = 0.25  # Of the record, the longest averaging time.
MODEL_SHARE = 0.03  # Of AVAR: model error of the three laws (assumed; filters and quantization bend the short end).
MIN_SIGMAS = 2.0  # Of a significant part above zero.
MAX_MISFIT = 2.0  # Above it the curve is bent, by a filter, held values or the mains: its short end is left out.
START_COUNT = 4  # Averaging times at which the fit begins, judged on their own: a filter bends them.
START_SHARE = 0.015  # Of AVAR: their rms misfit besides twice their statistical sigma; half of `MODEL_SHARE`.
MIN_TIMES = 8  # Averaging times of a fit, a decade.
CONFIDENCE = 0.68  # Of the band about the deviation.
MIN_VARIANCE = 1e-12  # Of the largest variance: coarse steps can hide all noise at one averaging time.
ROUNDS = 12  # Of the weights by the model, which converge to a thousandth after six.
SHARED = 2.2  # Of sigmas, at `PER_DECADE` averaging times a decade: found on simulated records of all mixtures.
BLOCK_S = 1.0  # Of stillness: averages noise, resolves a touch.
QUIETEST_PERCENT = 10.0  # Blocks whose scatter is the sensor's noise.
MAX_SCATTER = 1.5  # Of a quiet block over the noise; that of a hundred samples is off by 7 per cent.
MAX_GYR_DEG_S, MAX_ACC_M_S2 = 2.0, 0.5  # Largest scatter of a resting sensor: no part is noisier, feet are.
GYR_STEP_DEG_S, ACC_STEP_M_S2 = 0.2, 0.03  # Change of the means between blocks besides noise: a touch; 0.2 deg of tilt.
STEP_SIGMAS = 6.0  # Noise of a block's mean on top, for an hour of blocks.
MIN_S = 30.0  # Thirty averages of a second show N to some per cent.


@dataclass(frozen=True)
class AllanCurve:
    """Overlapping Allan deviation."""

    tau_s: Floats  # (F,) averaging times,
    factors: Ints  # and the same in samples.
    deviation: Floats  # (F,) in the unit of the reading.
    count: int  # Readings that it was made of,
    period_s: float  # and the time between two.


@dataclass(frozen=True)
class NoisePart:
    """N, B or K: `value` and its `sigma` where significant (`seen`), else zero; `limit` is the 95 % upper bound."""

    value: float
    sigma: float
    limit: float
    seen: bool


@dataclass(frozen=True)
class NoiseFit:
    """What a curve shows."""

    white: NoisePart  # N, B and K in the units above.
    flicker: NoisePart
    walk: NoisePart
    low: Floats  # (F,) band about the measured deviation, of `CONFIDENCE`.
    high: Floats
    lowest: float  # The curve's lowest point, the bias instability of sheets,
    lowest_tau_s: float  # and where it lies.
    fitted_from_s: float  # Averaging time at which the fit begins.
    misfit: float  # Mean square of the residuals in their sigmas, 1 or less where the three laws hold.

    def laws_at(self, tau_s: Floats) -> Floats:
        """Deviation (3, ...) by N, B and K alone at averaging times (...,) s; their root sum of squares is the fit."""
        N, B, K = self.white.value, self.flicker.value, self.walk.value
        return np.stack([N / np.sqrt(tau_s), np.full_like(tau_s, FLOOR * B), K * np.sqrt(tau_s / 3)])


def choose_averaging_factors(count: int) -> Ints:
    """Averaging times (F,) in samples, evenly spaced on a logarithmic scale where that leaves whole numbers."""
    longest = max(1.0, MAX_SHARE * count)
    steps = 1 + int(np.log10(longest) * PER_DECADE)
    return np.unique(np.round(np.geomspace(1.0, longest, max(2, steps)))).astype(np.int64)


def compute_allan_curve(readings: Floats, period_s: float, factors: Ints | None = None) -> AllanCurve:
    """Overlapping Allan deviation of evenly sampled readings (n,), in time linear in n for each averaging time.

    Raises `CalibrationError` for too few readings, missing ones, or averaging times that they do not hold twice.
    """
    n = len(readings)
    if not np.isfinite(readings).all():
        raise CalibrationError("readings are missing or not finite: give a stretch without gaps to an Allan deviation.")
    if n < MIN_READINGS:
        raise CalibrationError(f"{n} readings make no Allan deviation: record at least {MIN_READINGS}.")
    chosen = choose_averaging_factors(n) if factors is None else np.asarray(factors, dtype=np.int64)
    if chosen.min() < 1 or 2 * chosen.max() > n:
        raise CalibrationError(f"averages of {chosen.max()} samples do not fit into {n} twice: choose shorter ones.")
    whole = np.concatenate([[0.0], np.cumsum(readings - readings.mean())])
    variance = [np.mean((whole[2 * m :] - 2 * whole[m:-m] + whole[: -2 * m]) ** 2) / (2.0 * m**2) for m in chosen]
    return AllanCurve(np.asarray(chosen * period_s), chosen, np.sqrt(np.array(variance)), n, period_s)


def fit_noise(curve: AllanCurve) -> NoiseFit:
    """Fit white noise N, flicker B and random walk K to a curve, from the shortest averaging time at which they fit."""
    observed = curve.deviation**2
    if not observed.any():  # a reading that never changes
        nothing, none, first_s = NoisePart(0.0, 0.0, 0.0, False), curve.deviation, float(curve.tau_s[0])
        return NoiseFit(nothing, nothing, nothing, none, none, 0.0, first_s, first_s, misfit=0.0)
    scale, m = float(observed.max()), curve.factors.astype(np.float64)
    laws = np.column_stack([1 / m, np.full(len(m), FLOOR**2), m / 3])  # for a sampling period of 1
    scatter = laws * np.sqrt(2 / compute_freedom(curve.count, curve.factors))

    def fit(first: int, parts: Sequence[int]) -> _Squares:
        return _fit_squares(observed[first:] / scale, laws[first:], scatter[first:], parts)

    # the first averaging time from which the laws fit, or the best where none does
    tried: list[_Squares] = []
    for first in range(max(1, len(observed) - MIN_TIMES)):
        tried.append(fit(first, (0, 1, 2)))
        if tried[-1].misfit < MAX_MISFIT and tried[-1].starts_straight:
            break
    else:
        first = int(np.argmin([one.misfit for one in tried]))
    found = all_three = tried[first]
    # without the parts that are not significant, the least first
    parts = [0, 1, 2]
    while len(parts) > 1:
        significance = found.value[parts] / np.maximum(found.sigma[parts], 1e-300)
        if significance.min() >= MIN_SIGMAS:
            break
        del parts[int(np.argmin(significance))]
        found = fit(first, parts)
    # N, B and K from their squares; the bound of an insignificant one from the fit of all three
    bound = all_three.value + ONE_SIDED_95 * all_three.sigma
    to_si = scale * np.array([curve.period_s, 1.0, 1.0 / curve.period_s])
    noises = []
    for k in range(3):
        square, sigma = float(found.value[k] * to_si[k]), float(found.sigma[k] * to_si[k])
        if k in parts and square > 0.0:
            value, limit = float(np.sqrt(square)), float(np.sqrt(square + ONE_SIDED_95 * sigma))
            noises.append(NoisePart(value, sigma / (2 * value), limit, True))
        else:
            noises.append(NoisePart(0.0, 0.0, float(np.sqrt(max(bound[k] * to_si[k], 0.0))), False))
    # AVAR is about chi-square with the degrees of freedom of its variance
    freedom = 2 * (laws @ found.value / (scatter @ found.value)) ** 2
    high, low = (chi2.ppf(p, freedom) for p in ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    low, high = curve.deviation * np.sqrt(freedom / low), curve.deviation * np.sqrt(freedom / high)
    k = int(np.argmin(curve.deviation))
    lowest, lowest_s, from_s = float(curve.deviation[k]), float(curve.tau_s[k]), float(curve.tau_s[first])
    white, flicker, walk = noises
    return NoiseFit(white, flicker, walk, low, high, lowest, lowest_s, from_s, found.misfit)


@dataclass(frozen=True)
class _Squares:
    """N^2, B^2, K^2 for a sampling period of 1: `value` and `sigma` (3,), zero but for the parts that were fitted."""

    value: Floats
    sigma: Floats
    misfit: float
    starts_straight: bool


def _fit_squares(observed: Floats, laws: Floats, scatter: Floats, parts: Sequence[int]) -> _Squares:
    """Non-negative least squares of some laws, weighted by the modelled variance, which depends on the fit.

    Variances (F,) at their averaging times, the three laws there (F, 3), and the standard deviations of each (F, 3).
    """
    chosen, value, sigma = list(parts), np.zeros(3), np.zeros(3)
    X, weight = laws[:, chosen], 1 / np.maximum(observed, MIN_VARIANCE)
    for _ in range(ROUNDS):
        value[chosen], _ = nnls(weight[:, None] * X, weight * observed)
        model, deviation = laws @ value, scatter @ value
        weight = 1 / np.hypot(deviation, MODEL_SHARE * model)
    residual = weight * (observed - model)
    misfit = float(residual @ residual / max(1, len(observed) - len(chosen)))
    inverse = np.linalg.pinv(weight[:, None] * X) * weight
    sigma[chosen] = SHARED * np.sqrt(max(1.0, misfit)) * np.linalg.norm(inverse * deviation, axis=1)
    start = slice(0, START_COUNT)
    allowed = (START_SHARE * model) ** 2 + 4 * deviation**2
    straight = bool(((observed - model)[start] ** 2 / allowed[start]).mean() < 1.0)
    return _Squares(value, sigma, misfit, straight)


def compute_freedom(count: int, factors: Ints) -> Floats:
    """Equivalent degrees of freedom (F, 3) of the Allan variances of `count` readings, by noise type."""
    n, m = float(count), factors.astype(np.float64)
    white = (3 * n / (2 * m) - 2 * (n - 1) / (n + 1)) * 4 * m**2 / (4 * m**2 + 5)
    first = 2 * (n - 1) ** 2 / (2.3 * (n + 1) - 4.9)
    flicker = np.where(m == 1, first, 5 * (n + 1) ** 2 / (4 * m * (n + 1 + 3 * m)))
    walk = (n - 1) / m * (n**2 - 3 * m * n + 4 * m**2) / (n - 2) ** 2
    return np.stack([white, flicker, walk], axis=1)


@dataclass(frozen=True)
class SensorNoise:
    """Allan deviation of a sensor (`gyr`, `acc` or `mag`), one curve and fit an axis; its rate in Hz."""

    sensor: str
    rate_hz: float
    curves: tuple[AllanCurve, ...]
    fits: tuple[NoiseFit, ...]


@dataclass(frozen=True)
class RecordingNoise:
    """Noise of the sensors of a recording, over `seconds` from `start_s` on, on the recording's clock."""

    start_s: float
    seconds: float
    sensors: tuple[SensorNoise, ...]


def measure_recording_noise(recording: Recording) -> RecordingNoise:
    """Allan deviations over the longest stretch at rest.

    Raises `CalibrationError` if the sensor does not lie still, or not for long enough.
    """
    start, stop = find_longest_stillness(recording)
    seconds = (stop - start) * recording.period_s
    if seconds < MIN_S * (1 - 1e-3):
        raise CalibrationError(
            f"the sensor lies still for {seconds:.0f} s at most, which is too short for an Allan deviation: record it "
            f"lying untouched, for {MIN_S:.0f} s at least and for hours to see its bias instability."
        )
    rest = recording.slice(start, stop)
    read = [("gyr", rest.t, rest.gyr), ("acc", rest.t, rest.acc)]
    if rest.mag is not None:
        fresh = ~np.isnan(rest.mag).any(axis=1)
        if np.count_nonzero(fresh) >= MIN_READINGS:
            read.append(("mag", rest.t[fresh], rest.mag[fresh]))
    sensors = []
    for name, t, readings in read:
        # a row for every sample, lost ones interpolated
        place = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(np.diff(t) / np.median(np.diff(t)))))])
        period_s, axes = float((t[-1] - t[0]) / place[-1]), list(readings.T)
        if place[-1] != len(t) - 1:
            axes = [np.interp(np.arange(int(place[-1]) + 1), place, axis) for axis in axes]
        factors = choose_averaging_factors(len(axes[0]))
        curves = tuple(compute_allan_curve(axis, period_s, factors) for axis in axes)
        sensors.append(SensorNoise(name, 1 / period_s, curves, tuple(fit_noise(curve) for curve in curves)))
    return RecordingNoise(float(rest.t[0]), seconds, tuple(sensors))


def find_longest_stillness(recording: Recording) -> tuple[int, int]:
    """Return start and stop of the longest stretch at rest, start <= i < stop; 0, 0 if there is none."""
    block = max(2, round(BLOCK_S / recording.period_s))
    count = len(recording) // block
    if not count:
        return 0, 0
    # blocks that are quiet, and those that agree with the next
    quiet, together = np.ones(count, dtype=np.bool_), np.ones(max(0, count - 1), dtype=np.bool_)
    for samples, most, step in (
        (recording.gyr, np.radians(MAX_GYR_DEG_S), np.radians(GYR_STEP_DEG_S)),
        (recording.acc, MAX_ACC_M_S2, ACC_STEP_M_S2),
    ):
        blocks = samples[: count * block].reshape(count, block, 3)
        scatter, mean = blocks.std(axis=1), blocks.mean(axis=1)
        noise = np.percentile(scatter, QUIETEST_PERCENT, axis=0)
        quiet &= (scatter <= np.minimum(most, MAX_SCATTER * noise + 1e-12)).all(axis=1)
        allowed = step + STEP_SIGMAS * np.sqrt(2 / block) * noise
        together &= (np.abs(np.diff(mean, axis=0)) < allowed).all(axis=1)
    if not quiet.any():
        return 0, 0
    # the longest run of them
    first, last = find_runs(quiet[1:] & quiet[:-1] & together)
    if not len(first):
        return 0, block
    longest = int(np.argmax(last - first))
    return int(first[longest]) * block, (int(last[longest]) + 1) * block
