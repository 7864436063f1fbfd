"""Units of stamps and readings, removed gravity and mirrored axes, by physics.

A sensor on a person cannot help measuring some known things:

* time: inertial sensors deliver 10 to 5000 samples a second;
* force: in its stillest moments the accelerometer measures gravity, 9.8 m/s^2 and not 1 g, 1000 mg or 0;
* rate: a limb turns at 1 to 20 rad/s, never at 40 rad/s for a hundredth of the time;
* both: while the sensor turns without much acceleration, gravity turns in the body at the rate of the gyroscope,
  da/dt = -k w x a, with k = 1. k = pi/180 is a gyroscope in deg/s, k = -1 a mirrored set of axes;
* field: the Earth's field is 25-65 uT, buildings and shoes make 10-200 uT of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.samples.readings import find_outliers

_END_OF_TIME = 1e20  # No stamp in any unit is beyond this: nanoseconds since 1970 are 2e18.
LIMIT_M_S2 = 5000.0  # No accelerometer worn by a person reads more (500 g).
LIMIT_RAD_S = 350.0  # No gyroscope worn by a person reads more (20 000 deg/s).
LIMIT_UT = 1e5  # No magnetometer that is still of use reads more (0.1 T).
LATEST = 1e100  # Of a stamp in any unit, so that differences are numbers too.
AIR_PA = (3e4, 1.2e5)  # Pressure of the air, from above the highest mountains to below the deepest mines.
MAX_JUDGED, BLOCK = 2_000_000, 20_000  # Samples by which units are judged, hours, and of a block, more than a minute.

_SLOWEST_PERIOD_S, _MAX_PERIOD_S = 0.1, 2e-4
_TIME_UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
_USUAL_PERIOD_S = (4e-4, 0.1)
_CLOCK_UNITS = {
    "s": 1.0, **{unit: 1.0 / per_s for unit, per_s in _TIME_UNITS.items()},
    "0.1 ms": 1e-4, "10 ms": 1e-2, "10 us": 1e-5, "100 ns": 1e-7, "0.1 s": 0.1,
}  # fmt: skip
_WINDOWS = (3, 4, 6, 9, 13, 19, 28, 40, 57, 80, 113, 160)  # samples, half of those in which gravity turns
_MIN_WINDOWS, _MIN_CORRELATION, _SURE = 40, 0.45, 0.7
_NEAR = 1.8  # within this much of the period with which gravity turns a unit that is no usual one is taken
_STRIDE_S = 1.15  # of one who walks 1, of one who runs 0.7, of one who dawdles 1.6
_FAR = 5.0  # times as long or short is no period as gravity turns, which shows it to a factor of two on real walks

_ACC_UNITS = {"g": GRAVITY_M_S2, "ft/s^2": 0.3048, "mg": 1e-3 * GRAVITY_M_S2}
_GRAVITY_RANGE = (0.7, 1.3)  # of g: any m/s^2 accelerometer, even in a loaded stance
_ACC_UNIT_RANGE = (0.85, 1.15)
_NO_GRAVITY_M_S2 = 3.0  # what is left of gravity where an attitude filter has removed it, at its worst
_SPREAD = 2.5  # with gravity in it, half of the samples are below this multiple of rest
MIN_TURNING_WINDOWS = 100  # Stretches in which gravity turns, without which units are not set against each other.
_TURNING_M_S3 = 0.1  # gravity that turns by 0.6 deg/s; a sensor at rest shows nothing, for however long
TOO_FAST_RAD_S = 40.0  # no limb turns so fast, one sample in a hundred
TOO_SLOW_RAD_S, LIVELY_M_S2 = 0.3, 2.0
_MAX_DEG_S = 4100.0  # the largest range of such gyroscopes is 4000 deg/s; more are counts, or mdeg/s
_SAME_GAIN = (0.3, 3.0)  # rad/s and deg/s are 57 apart

_FIELD_RANGE_UT = (5.0, 200.0)
_FIELD_UNITS = {
    "nT": (1e-3, (1e4, 1.2e5)),
    "mG": (0.1, (200.0, 2000.0)),
    "gauss": (100.0, (0.1, 0.75)),
    "T": (1e6, (1e-5, 2e-4)),
}
_SAME_FIELD = 1.6  # times stronger or weaker is the field in another unit than before it changed


@dataclass(frozen=True)
class GravityTransport:
    """How well gravity turns in the body at the rate of the gyroscope."""

    gain: float  # k in da/dt = -k w x a.
    correlation: float  # Of both sides.
    n_windows: int  # Stretches in which gravity turns.

    @property
    def is_telling(self) -> bool:
        """Whether there was enough quiet turning to decide."""
        return self.n_windows >= MIN_TURNING_WINDOWS and abs(self.correlation) > 0.4

    @property
    def is_mirrored(self) -> bool:
        """Whether gravity surely turns the other way: real, right-handed data stay above -0.03."""
        return self.n_windows >= 300 and self.correlation < -0.5 and self.gain < -0.3


def find_unit_problems(t: Floats, acc: Floats, gyr: Floats, mag: Floats | None) -> tuple[str, ...]:
    """Name everything whose unit is wrong, with what to do about it; empty if all is plausible.

    `t` (N,) s, `acc` (N, 3) m/s^2, `gyr` (N, 3) rad/s, `mag` (N, 3) uT or None, as claimed; NaN is ignored.
    """
    period, known = median_period_s(t), t[np.abs(t) < LATEST]
    # all samples, or blocks of them spread evenly over a long recording
    if len(t) > MAX_JUDGED:
        starts = np.linspace(0, len(t) - BLOCK, MAX_JUDGED // BLOCK).astype(np.int64)
        judged = (starts[:, None] + np.arange(BLOCK)).ravel()
        acc, gyr, mag = acc[judged], gyr[judged], None if mag is None else mag[judged]
    stamps, force = find_stamp_problem(period), find_acc_problem(acc, period)
    # gravity turns at the right rate only if both its unit and that of time are right, and the stamps are a clock
    if not (stamps or force) and 0.5 < (known[-1] - known[0]) / (period * len(known)) < 2.0:
        stamps = find_clock_problem(acc, gyr, period)
    rate = find_gyr_problem(acc, gyr, np.nan if stamps or force else period)
    field = None if mag is None else find_mag_problem(mag)
    return tuple(problem for problem in (stamps, force, rate, field) if problem is not None)


def find_lasting_problems(t: Floats, acc: Floats, gyr: Floats, mag: Floats | None, usable: Bools) -> tuple[str, ...]:
    """Name what is wrong as `find_unit_problems`, and still is without the bad ones of the samples `usable` (N,)."""
    problems = find_unit_problems(t, acc, gyr, mag)
    if not problems:
        return problems
    # a bad sample of 300 rad/s, with which gravity does not turn, looks like a wrong unit
    kept, period = np.flatnonzero(usable), median_period_s(t)
    if 2 * len(kept) < len(t):
        return problems  # most are beyond what any sensor reads: that is no bad sample
    even = np.arange(len(kept), dtype=np.float64) * _assume_period(period)
    kept = kept[find_outliers(even, acc[kept], gyr[kept]) == 0]
    if 2 * len(kept) < len(t):
        return problems
    return find_unit_problems(t[kept], acc[kept], gyr[kept], None if mag is None else mag[kept])


def median_period_s(t: Floats) -> float:
    """Median of the positive steps between stamps; NaN if there is none."""
    steps = np.diff(t[np.abs(t) < LATEST])
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else np.nan


def find_stamp_problem(period_s: float) -> str | None:
    """Say what is wrong with stamps of this median period, if anything."""
    if np.isnan(period_s):
        return "the stamps do not advance: export the recording again with its time column"
    if _MAX_PERIOD_S <= period_s < _SLOWEST_PERIOD_S:
        return None
    for unit, per_second in _TIME_UNITS.items():
        if _USUAL_PERIOD_S[0] <= period_s / per_second <= _USUAL_PERIOD_S[1]:
            return f"the stamps seem to be in {unit} (step {period_s:.6g}), not s: divide by {per_second:g}"
    return f"the stamps step by {period_s:.3g} s, no inertial sensor's rate: write them in s"


def find_acc_unit(acc: Floats, period_s: float) -> str | None:
    """Find the unit in which acc (N, 3) is gravity at rest: m/s^2, g, ft/s^2 or mg; None if it is none of them."""
    rest = measure_rest_acc(acc, period_s)
    (usable,) = _usable(acc, limit=1e6)
    if np.isnan(rest) or not float(np.median(np.linalg.norm(usable, axis=1))) < _SPREAD * rest:
        return None
    low, high = _ACC_UNIT_RANGE
    units = {"m/s^2": 1.0, **_ACC_UNITS}
    return next((unit for unit, scale in units.items() if low < rest * scale / GRAVITY_M_S2 < high), None)


def find_acc_problem(acc: Floats, period_s: float) -> str | None:
    """Say what is wrong with the unit or gravity of acc (N, 3), if anything."""
    rest = measure_rest_acc(acc, period_s)
    if np.isnan(rest) or _GRAVITY_RANGE[0] < rest / GRAVITY_M_S2 < _GRAVITY_RANGE[1]:
        return None
    unit = find_acc_unit(acc, period_s)
    if unit is not None:
        return f"acc seems to be in {unit} ({rest:.3g} at rest), not m/s^2: multiply it by {_ACC_UNITS[unit]:.6g}"
    if rest < _NO_GRAVITY_M_S2:
        return (
            f"acc seems to have had gravity removed ({rest:.2f} m/s^2 at rest, not {GRAVITY_M_S2:.2f}): "
            f"export the acceleration with gravity in it"
        )
    return f"acc measures {rest:.4g} m/s^2 at rest where gravity is {GRAVITY_M_S2:.2f}: check its unit"


def find_gyr_unit(acc: Floats, gyr: Floats, period_s: float) -> str | None:
    """Find the unit of gyr (N, 3) where physics decides, rad/s or deg/s; None where it does not. acc is in m/s^2."""
    acc, gyr = _usable(acc, gyr)
    if not len(gyr):
        return None
    peak = float(np.quantile(np.abs(gyr).max(axis=1), 0.999))
    transport = measure_gravity_transport(acc, gyr, period_s)
    gain = transport.gain if transport.is_telling and transport.correlation > 0.0 else np.nan
    fast = float(np.quantile(np.linalg.norm(gyr, axis=1), 0.99))
    is_too_slow_in_degrees = np.radians(fast) < TOO_SLOW_RAD_S < fast and _is_lively(acc)
    if peak <= TOO_FAST_RAD_S and (_SAME_GAIN[0] < gain < _SAME_GAIN[1] or is_too_slow_in_degrees):
        return "rad/s"
    is_degrees = peak > TOO_FAST_RAD_S or _SAME_GAIN[0] < gain * 180.0 / np.pi < _SAME_GAIN[1]
    return "deg/s" if is_degrees and peak <= _MAX_DEG_S else None


def find_mag_unit(mag: Floats) -> str | None:
    """Find the unit in which mag (N, 3) is a field on Earth; None if there is no such unit, or more than one."""
    median = find_median_strength(mag)
    if is_field_on_earth(median):
        return "uT"
    # From 200 on, what reads as mG can as well be uT with the iron of a telephone in it.
    return next((u for u, (_, (low, high)) in _FIELD_UNITS.items() if u != "mG" and low < median < high), None)


def find_time_unit(step: float, turning_s: float = np.nan) -> str | None:
    """Find the unit in which stamps of this step are those of an inertial sensor, None if in none.

    Usual units, s to ns, go first. If gravity turns as with a period of `turning_s`, the step must agree with it within
    a factor of 3, or 1.8 for an unusual unit such as 0.1 ms.
    """
    low, high = _USUAL_PERIOD_S
    fitting = {u: step * size for u, size in _CLOCK_UNITS.items() if low <= step * size <= high}
    if np.isnan(turning_s):
        return next((u for u in ("s", *_TIME_UNITS) if u in fitting), None)
    off = {u: abs(np.log(period_s / turning_s)) for u, period_s in fitting.items()}
    usual = [u for u in ("s", *_TIME_UNITS) if off.get(u, np.inf) < 0.5 * np.log(10.0)]
    return usual[0] if usual else min((u for u in off if off[u] < np.log(_NEAR)), key=lambda u: off[u], default=None)


def measure_turning_period(acc: Floats, gyr: Floats, least_correlation: float = _MIN_CORRELATION) -> float:
    """Sample period, s, with which gravity turns in the body as the gyroscope (rad/s) says; NaN where too little does.

    Over two halves of n samples with | |acc| / rest - 1 | < 0.06, the change between their means is -T n w x a. The n
    of highest correlation is used. No clock is needed.
    """
    acc, gyr = _usable(acc, gyr)
    rest = measure_rest_acc(acc, np.nan)
    if not rest > 0:
        return np.nan
    loud = np.concatenate(([0], np.cumsum(np.abs(np.linalg.norm(acc, axis=1) / rest - 1.0) > 0.06)))
    best, period_s = least_correlation, np.nan
    for half in _WINDOWS:
        n_windows = len(acc) - 2 * half
        if n_windows < _MIN_WINDOWS:
            break
        quiet = loud[2 * half :][:n_windows] == loud[:n_windows]
        change, expected = _compare_turning(acc, gyr, half, quiet)
        if np.count_nonzero(np.abs(change).max(axis=1) > 0.02 * rest) < _MIN_WINDOWS:
            continue
        product, power = float(np.sum(expected * change)), float(np.sum(expected**2))
        correlation = product / max(np.sqrt(power * float(np.sum(change**2))), 1e-300)
        if correlation > best:
            best, period_s = correlation, product / power / half
    return period_s


def measure_gait_period(gyr: Floats) -> float:
    """Sample period, s, for which the autocorrelation of gyr (N, 3) peaks at `_STRIDE_S`; NaN without a peak."""
    rate = np.linalg.norm(_usable(gyr)[0], axis=1)[:MAX_JUDGED]
    if len(rate) < 200 or not np.ptp(rate) > 0:
        return np.nan
    spectrum = np.abs(np.fft.rfft(rate - rate.mean(), 2 * len(rate))) ** 2
    alike = np.fft.irfft(spectrum)[: len(rate) // 3] / len(rate)
    alike /= alike[0]
    first = int(np.argmax(alike < 0.1))
    if not first or alike[first:].max(initial=0.0) < 0.35:
        return np.nan
    lags = first + np.flatnonzero(alike[first:] > 0.85 * alike[first:].max())
    return float(_STRIDE_S / (lags[0] + np.argmax(alike[lags[0] : lags[0] + max(1, lags[0] // 4)])))


def find_clock_problem(acc: Floats, gyr: Floats, period_s: float) -> str | None:
    """Say by which factor stamps of this period are off, if gravity turns by one of 10 or more against the gyroscope.

    `acc` (N, 3) is in m/s^2, `gyr` (N, 3) in rad/s; a gyroscope in another unit is off by 57.
    """
    turning_s = measure_turning_period(acc, gyr, _SURE)
    decades = np.log10(period_s / turning_s)
    if not abs(decades) > np.log10(_FAR) or abs(abs(decades) - np.log10(180.0 / np.pi)) < 0.15:
        return None
    fast = float(np.quantile(np.linalg.norm(_usable(gyr)[0], axis=1), 0.99))
    if not TOO_SLOW_RAD_S < fast < TOO_FAST_RAD_S:
        return None
    factor = 10.0 ** max(1.0, round(abs(decades)))
    way = f"divide them by {factor:g}" if decades > 0 else f"multiply them by {factor:g}"
    return (
        f"the stamps seem to be in another unit: they step by {1e3 * period_s:.4g} ms, and gravity turns against the "
        f"gyroscope as with {1e3 * turning_s:.2g} ms: {way}"
    )


def find_gyr_problem(acc: Floats, gyr: Floats, period_s: float) -> str | None:
    """Say what is wrong with the unit or the axes of gyr (N, 3), if anything.

    Without a period (NaN) only the size of gyr is looked at: acc or time is known to be wrong.
    """
    acc, gyr = _usable(acc, gyr)
    if not len(gyr):
        return None
    fast = float(np.quantile(np.linalg.norm(gyr, axis=1), 0.99))
    transport = measure_gravity_transport(acc, gyr, period_s)
    too_weak = transport.is_telling and 0.0 < transport.gain < 0.1
    if fast > TOO_FAST_RAD_S or too_weak:
        return (
            f"gyr seems to be in deg/s (one sample in a hundred is above {fast:.3g}), not rad/s: "
            f"multiply it by {np.pi / 180:.7f}"
        )
    lively = period_s > 0 and _is_lively(acc)
    too_strong = transport.is_telling and transport.gain > 10.0
    if too_strong or (fast < TOO_SLOW_RAD_S and lively):
        return (
            f"gyr is far too small for this motion (one sample in a hundred is above {fast:.2g} rad/s): "
            f"multiply it by {180 / np.pi:.4f} if it was taken for deg/s"
        )
    if transport.is_mirrored:
        return (
            "gravity turns against the gyroscope: the axes are left-handed or a sign is wrong; "
            "swap or negate axes until they are right-handed"
        )
    return None


def find_mag_problem(mag: Floats, usual_uT: float = np.nan) -> str | None:
    """Say what is wrong with the unit of mag (N, 3), if anything.

    Where its strength was `usual_uT` before, a unit is named if it makes that of it: iron reads like a field in mG.
    """
    median = find_median_strength(mag)
    if np.isnan(median) or is_field_on_earth(median):
        return None
    for unit, (scale, (low, high)) in _FIELD_UNITS.items():
        ratio = median * scale / usual_uT
        if low < median < high if np.isnan(ratio) else 1.0 / _SAME_FIELD < ratio < _SAME_FIELD:
            return (
                f"mag seems to be in {unit} (median strength {median:.3g}), not uT: "
                f"multiply it by {scale:g}, or leave its columns out"
            )
    cause = "check its unit, or leave it out" if np.isnan(usual_uT) else "strong iron, or a magnetometer that fails"
    return f"mag has a median strength of {median:.3g} uT, no field on Earth: {cause}"


def is_field_on_earth(strength_uT: Floats | float) -> Bools:
    """Whether a field of this strength exists on Earth, beside iron and in shoes too; NaN does not."""
    return np.asarray((strength_uT > _FIELD_RANGE_UT[0]) & (strength_uT < _FIELD_RANGE_UT[1]))


def measure_field_strength(mag: Floats) -> Floats:
    """Strength (N,) of mag (N, 3) in its unit; NaN where there is no sample or a senseless one."""
    sensible = np.isfinite(mag).all(axis=1) & (np.abs(np.nan_to_num(mag)) < 1e6).all(axis=1)
    strength = np.full(len(mag), np.nan)
    strength[sensible] = np.linalg.norm(mag[sensible], axis=1)
    return strength


def find_median_strength(mag: Floats) -> float:
    """Median strength of mag (N, 3) in its unit; NaN without a sample."""
    strength = measure_field_strength(mag)
    known = strength[np.isfinite(strength)]
    return float(np.median(known)) if known.size else np.nan


def measure_rest_acc(acc: Floats, period_s: float) -> float:
    """Median strength of acc (N, 3), in its unit, over the stillest twentieth of all 0.1 s; NaN of too few samples."""
    (acc,) = _usable(acc, limit=1e6)
    length = max(3, round(0.1 / _assume_period(period_s)))
    if len(acc) < 2 * length:
        return np.nan
    mean = _moving_mean(acc, length)
    variance = (_moving_mean(acc**2, length) - mean**2).sum(axis=1)
    still = variance <= np.quantile(variance, 0.05)
    return float(np.median(np.linalg.norm(mean[still], axis=1)))


def measure_gravity_transport(acc: Floats, gyr: Floats, period_s: float) -> GravityTransport:
    """Test whether gravity turns in the body at the rate of the gyroscope.

    Over 0.4 s in which | |acc| - g | stays below 0.6 m/s^2, the change between the means of its halves is set
    against the mean of -w x a between their middles; the gain is that of least squares.
    """
    acc, gyr = _usable(acc, gyr)
    half = max(3, round(0.2 / _assume_period(period_s)))
    n_windows, unseen = len(acc) - 2 * half, GravityTransport(np.nan, np.nan, 0)
    if not period_s > 0 or n_windows <= 0:
        return unseen
    loud = np.abs(np.linalg.norm(acc, axis=1) - GRAVITY_M_S2) > 0.6
    before = np.concatenate(([0], np.cumsum(loud)))
    quiet = before[2 * half :][:n_windows] == before[:n_windows]
    change, expected = _compare_turning(acc, gyr, half, quiet)
    change /= half * period_s
    turning = np.maximum(np.abs(change), np.abs(expected)).max(axis=1) > _TURNING_M_S3
    product, power = float(np.sum(expected * change)), float(np.sum(expected**2))
    scale = np.sqrt(power * float(np.sum(change**2)))
    if not scale > 0:
        return unseen
    return GravityTransport(product / power, product / float(scale), int(np.count_nonzero(turning)))


def _compare_turning(acc: Floats, gyr: Floats, half: int, quiet: Bools) -> tuple[Floats, Floats]:
    """Change (Q, 3) of acc between the means of both halves of windows that are `quiet` (W,), and the mean -w x a."""
    mean_acc, mean_gyr = _moving_mean(acc, half), _moving_mean(gyr, half)
    first, second = mean_acc[: len(quiet)][quiet], mean_acc[half:][: len(quiet)][quiet]
    return second - first, -np.cross(mean_gyr[half // 2 :][: len(quiet)][quiet], (first + second) / 2)


def _is_lively(acc: Floats) -> bool:
    """Whether acc (N, 3) m/s^2 is that of a sensor on somebody who walks."""
    return float(np.std(np.linalg.norm(acc, axis=1))) > LIVELY_M_S2


def _usable(*vectors: Floats, limit: float = 1e5) -> tuple[Floats, ...]:
    """Rows (., 3) that are finite, and small enough to be squared, in all of the arrays."""
    usable = np.logical_and.reduce([find_squarable(v, limit) for v in vectors])
    return tuple(v[usable] for v in vectors)


def find_usable_samples(t: Floats, acc: Floats, gyr: Floats) -> Bools:
    """(N,) True where stamp, acc and gyr are finite and within what any sensor can read."""
    # A specific force of exactly zero on all axes is a logger's way to say that there was no sample.
    is_known = acc.any(axis=1) & (np.abs(t) < _END_OF_TIME)
    return np.asarray(is_known & find_squarable(acc, LIMIT_M_S2) & find_squarable(gyr, LIMIT_RAD_S))


def find_squarable(vectors: Floats, limit: float = 1e6) -> Bools:
    """Rows (N,) of vectors (N, M) that are finite, and small enough to be squared; what is in mm/s^2 is."""
    return np.asarray((np.abs(vectors) < limit).all(axis=1))


def _assume_period(period_s: float) -> float:
    """Return a period as it is where a sensor can have it, else that of 200 Hz."""
    return period_s if _MAX_PERIOD_S <= period_s < _SLOWEST_PERIOD_S else 0.005


def _moving_mean(vectors: Floats, length: int) -> Floats:
    """Average (N, 3) over `length` neighbours: (N - length + 1, 3)."""
    sums = np.concatenate([np.zeros((1, vectors.shape[1])), np.cumsum(vectors, axis=0)])
    return np.asarray((sums[length:] - sums[:-length]) / length)


def keep_air(pressure: Floats) -> Floats | None:
    """Return pressure (N,) Pa, NaN where it is none of air; None where it is nowhere."""
    is_air = (pressure > AIR_PA[0]) & (pressure < AIR_PA[1])
    return np.where(is_air, pressure, np.nan) if is_air.any() else None


def find_field_samples(mag: Floats) -> Bools:
    """(N,) True where mag (N, 3) uT is a sample: no bad axis, and not zeros, which say that there was none."""
    return np.asarray((np.abs(mag) < LIMIT_UT).all(axis=1) & mag.any(axis=1))
