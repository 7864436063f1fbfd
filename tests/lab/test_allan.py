"""Allan deviation: against published values and another implementation, and noise that is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import fftconvolve

from fg_nav.errors import CalibrationError
from fg_nav.lab.allan import (
    compute_allan_curve,
    compute_freedom,
    find_longest_stillness,
    fit_noise,
    measure_recording_noise,
)
from fg_nav.lab.simulation import SCENARIOS, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.recording import Recording

PERIOD_S = 0.01
COUNT = 20_000
KINDS = ("white", "flicker", "walk")


def published_set():
    """The 1000 readings of the test suite in NIST SP 1065: Lehmer's generator, scaled to 0 to 1."""
    state, found = 1234567890, []
    for _ in range(1000):
        found.append(state / 2147483647)
        state = 16807 * state % 2147483647
    return np.array(found)


def flicker_noise(count, rng):
    """White noise through the half-integrator of Kasdin and Walter (1992): density 1 / (2 pi |f|) a sample."""
    k = np.arange(1, 2 * count)
    response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    return fftconvolve(rng.normal(size=2 * count), response)[count : 2 * count]


def noise(N, B, K, seed, count=COUNT):
    rng = np.random.default_rng(seed)
    white, walk = rng.normal(size=(2, count))
    readings = N / np.sqrt(PERIOD_S) * white + K * np.sqrt(PERIOD_S) * np.cumsum(walk)
    return readings + B * flicker_noise(count, rng) if B else readings


@cache
def fits(N, B, K, seeds=60):
    return [fit_noise(compute_allan_curve(noise(N, B, K, seed), PERIOD_S)) for seed in range(seeds)]


def test_published_deviations():
    """Riley, NIST SP 1065 (2008): mean, scatter and overlapping Allan deviations of the 1000 readings."""
    readings = published_set()
    assert readings.mean() == pytest.approx(4.897745e-01, abs=1e-7)
    assert readings.std(ddof=1) == pytest.approx(2.884664e-01, abs=1e-7)
    found = compute_allan_curve(readings, 1.0, np.array([1, 10, 100])).deviation
    np.testing.assert_allclose(found, [2.922319e-01, 9.159953e-02, 3.241343e-02], rtol=2e-7)


def test_variances_scatter_with_their_equivalent_degrees_of_freedom():
    """Of each noise alone, over 1500 records of 400 readings."""
    rng, factors, count = np.random.default_rng(0), np.array([1, 3, 10, 30, 100]), 400
    records = rng.normal(size=(1500, count)), [flicker_noise(count, rng) for _ in range(1500)]
    for of_kind, kind in zip((*records, np.cumsum(records[0], axis=1)), range(3), strict=True):
        found = np.array([compute_allan_curve(one, 1.0, factors).deviation ** 2 for one in of_kind])
        freedom = 2 * (found.mean(axis=0) / found.std(axis=0)) ** 2
        np.testing.assert_allclose(freedom, compute_freedom(count, factors)[:, kind], rtol=0.2)


@pytest.mark.parametrize(("N", "B", "K"), [(0.01, 0.0, 0.0), (0.01, 0.02, 0.0), (0.01, 0.0, 0.02), (0.01, 0.03, 0.02)])
def test_what_is_there_is_found_within_its_sigmas_and_what_is_not_is_not_seen(N, B, K):
    found = fits(N, B, K)
    for kind, true in zip(KINDS, (N, B, K), strict=True):
        parts = [getattr(fit, kind) for fit in found]
        seen = [part for part in parts if part.seen]
        if true:
            errors = np.array([(part.value - true) / part.sigma for part in seen])
            assert len(errors) >= 0.9 * len(found)
            assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.4
            assert abs(np.mean(errors)) < 0.6
        else:
            assert len(seen) < 0.1 * len(found)


def test_a_record_too_short_for_a_part_does_not_see_it_and_its_limit_holds():
    """Twenty seconds of what shows in two hundred."""
    short = [fit_noise(compute_allan_curve(noise(0.01, 0.004, 0.004, seed, 2000), PERIOD_S)) for seed in range(40)]
    for kind in ("flicker", "walk"):
        parts = [getattr(fit, kind) for fit in short]
        assert np.mean([part.seen for part in parts]) < 0.2
        assert np.mean([part.limit >= 0.004 for part in parts]) > 0.85


def test_the_band_holds_the_true_deviation_as_often_as_it_says():
    inside = []
    for seed in range(60):
        curve = compute_allan_curve(noise(0.01, 0.0, 0.02, seed), PERIOD_S)
        fit, true = fits(0.01, 0.0, 0.02)[seed], np.sqrt(1e-4 / curve.tau_s + 4e-4 * curve.tau_s / 3)
        inside.append((fit.low < true) & (true < fit.high))
    assert 0.6 < np.mean(inside) < 0.76


def test_a_bent_short_end_is_left_out():
    """Values held for four samples, or averaged over ten: N is that of the long end, to what bend is left there.

    Ten averaged samples still bend a curve by a tenth at three times their length.
    """
    whites = [noise(0.01, 0.0, 0.0, seed) for seed in range(20)]
    held = [np.repeat(white[::4], 4) / 2 for white in whites]
    filtered = [np.convolve(white, np.full(10, 0.1), "valid") for white in whites]
    for bent in (held, filtered):
        found = [fit_noise(compute_allan_curve(readings, PERIOD_S)) for readings in bent]
        assert min(fit.fitted_from_s for fit in found) > 1.5 * PERIOD_S
        assert np.median([fit.white.value for fit in found]) == pytest.approx(0.01, rel=0.08)
        assert np.mean([fit.flicker.seen or fit.walk.seen for fit in found]) < 0.2


def test_a_mean_and_a_constant_reading_are_no_noise_and_what_makes_no_curve_is_refused():
    readings = noise(0.01, 0.0, 0.0, 0)
    curve, raised = compute_allan_curve(readings, PERIOD_S), compute_allan_curve(readings + 1e6, PERIOD_S)
    np.testing.assert_allclose(raised.deviation, curve.deviation, rtol=1e-6)
    constant = fit_noise(compute_allan_curve(np.full(1000, 3.0), PERIOD_S))
    assert not any(getattr(constant, kind).seen for kind in KINDS)
    assert constant.white.limit == 0.0
    for count, factors in ((10, None), (100, np.array([60])), (100, np.array([0]))):
        with pytest.raises(CalibrationError, match=r"readings make no|do not fit"):
            compute_allan_curve(np.arange(float(count)), PERIOD_S, factors)
    with pytest.raises(CalibrationError, match="missing or not finite"):
        compute_allan_curve(np.array([*range(50), np.nan]), PERIOD_S)


@pytest.mark.parametrize("sensor", ["xsens-mtw", "lord-gx5", "mpu-9250", "kvh-1750"])
def test_the_noise_of_the_simulated_sensors_is_found(sensor):
    """N of every axis, to which rounding to whole steps adds its twelfth."""
    walk = simulate(replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(360.0)], sensor=sensor), 1)
    prior = walk.scenario.prior
    for one in measure_recording_noise(walk.recording).sensors:
        rate_hz = prior.mag.rate_hz if one.sensor == "mag" and sensor == "mpu-9250" else prior.rate_hz
        assert one.rate_hz == pytest.approx(rate_hz, rel=1e-3)  # a magnetometer is read at its own rows
        for fit in one.fits:
            if one.sensor == "mag":
                rounding = prior.mag.resolution_uT / np.sqrt(12)
                density = np.hypot(prior.mag.noise_sd_uT, rounding) / np.sqrt(one.rate_hz)
            else:
                triad = getattr(prior, one.sensor)
                rounding = triad.resolution / np.sqrt(12 * one.rate_hz)
                density = np.hypot(triad.noise_density, rounding)
            assert fit.white.value == pytest.approx(density, rel=0.03)


def still(seconds, rng, rate_hz=100.0):
    count = int(seconds * rate_hz)
    acc = np.array([0.0, 0.0, 9.8]) + 0.01 * rng.normal(size=(count, 3))
    return Recording(np.arange(count) / rate_hz, acc, 1e-3 * rng.normal(size=(count, 3)))


def test_the_longest_stretch_without_a_touch_is_taken_and_too_short_a_one_is_refused():
    recording = still(300.0, np.random.default_rng(0))
    acc, gyr = recording.acc.copy(), recording.gyr.copy()
    gyr[10_000:10_050] += 0.05  # a knock at 100 s
    acc[25_000:] += [0.1, 0.0, 0.0]  # laid down otherwise at 250 s
    assert find_longest_stillness(Recording(recording.t, acc, gyr)) == pytest.approx((10_100, 25_000), abs=100)
    for short in (still(25.0, np.random.default_rng(0)), simulate("demo", 1).recording):
        with pytest.raises(CalibrationError, match=r"still for \d+ s at most.* 30 s at least"):
            measure_recording_noise(short)
