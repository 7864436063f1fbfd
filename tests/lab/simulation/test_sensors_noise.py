"""Noise, drift and digits of a triad, against what statistics says of them."""

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.sensors import Drift, TriadPrior, preset
from fg_nav.lab.simulation.sensors.triad import DriftPath, TriadRun, digitize


def allan(rate: Floats, period_s: float, tau_s: float) -> float:
    """Overlapping Allan deviation of readings (N, axes), all axes together."""
    m = round(tau_s / period_s)
    angle = np.vstack([np.zeros(rate.shape[1]), np.cumsum(rate, axis=0)]) * period_s
    second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
    return float(np.sqrt(np.mean(second**2) / 2) / tau_s)


def at_rest(prior: TriadPrior, rate_hz: float, duration_s: float, seed: int = 0) -> Floats:
    """Readings of a triad of which nothing moves."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    return TriadRun(prior.draw(rng), rng, rate_hz).measure(t, np.zeros((len(t), 3)))


def markov_allan(sd: float, time_s: float, tau_s: float) -> float:
    """Allan deviation of a first-order Gauss-Markov process (IEEE Std 952, in terms of its standard deviation)."""
    x = tau_s / time_s
    return sd * np.sqrt(2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x)))


@pytest.mark.parametrize("rate_hz", [50.0, 400.0])
def test_white_noise_has_its_density_at_one_second_and_falls_with_the_root(rate_hz: float) -> None:
    rate = at_rest(TriadPrior(noise_density=0.02), rate_hz, 2000.0)
    for tau_s in (0.1, 1.0, 10.0):
        assert allan(rate, 1 / rate_hz, tau_s) == pytest.approx(0.02 / np.sqrt(tau_s), rel=0.06)


def test_a_random_walk_rises_with_the_root() -> None:
    rate = at_rest(TriadPrior(drift=Drift(walk=0.01)), 5.0, 40000.0)
    for tau_s in (10.0, 40.0, 160.0):
        assert allan(rate, 0.2, tau_s) == pytest.approx(0.01 * np.sqrt(tau_s / 3), rel=0.12)
    paths = [DriftPath(Drift(walk=0.5), np.random.default_rng(i)).at(np.array([0.0, 900.0])) for i in range(800)]
    assert np.std(paths, axis=(0, 2)) == pytest.approx([0.0, 0.5 * 30.0], rel=0.07)


def test_gauss_markov_has_its_hump_where_theory_has_it() -> None:
    rate = at_rest(TriadPrior(drift=Drift(sd=0.3, time_s=4.0)), 10.0, 40000.0)
    levels = {tau_s: allan(rate, 0.1, tau_s) for tau_s in (1.0, 3.0, 7.6, 20.0, 80.0)}
    for tau_s, level in levels.items():
        assert level == pytest.approx(markov_allan(0.3, 4.0, tau_s), rel=0.08)
    assert max(levels, key=lambda tau_s: levels[tau_s]) == 7.6
    assert levels[7.6] == pytest.approx(0.62 * 0.3, rel=0.05)
    # MD (24): its lowest Allan deviation of .05 deg/h is sqrt(2) of that
    assert preset("kvh-1750").gyr.drift.sd == pytest.approx(np.deg2rad(0.05 / 3600) / np.sqrt(2), rel=1e-4)


def test_gauss_markov_forgets_at_its_time_and_starts_anywhere() -> None:
    drift = Drift(sd=2.0, time_s=10.0)
    paths = np.stack([DriftPath(drift, np.random.default_rng(i)).at(np.array([0.0, 10.0, 500.0])) for i in range(1500)])
    assert paths.std(axis=(0, 2)) == pytest.approx([2.0, 2.0, 2.0], rel=0.05)
    ahead = np.mean(paths[:, 0] * paths[:, 1]) / 4
    assert ahead == pytest.approx(np.exp(-1), abs=0.06)


def test_drift_does_not_depend_on_who_asks() -> None:
    drift = Drift(sd=1.0, time_s=3.0, walk=0.1)
    t = np.random.default_rng(0).uniform(0.0, 3000.0, 500)
    far_first, in_order = (DriftPath(drift, np.random.default_rng(8)) for _ in range(2))
    wanted = far_first.at(t)
    assert np.array_equal(
        np.vstack([in_order.at(np.array([instant])) for instant in np.sort(t)]), wanted[np.argsort(t)]
    )


def test_parameters_are_drawn_with_their_spread() -> None:
    prior = TriadPrior(bias=(1.0, -2.0, 0.5), bias_sd=0.2, scale_sd=0.03, cross_axis_sd=0.01, g_sensitivity_sd=0.004)
    rng = np.random.default_rng(5)
    triads = [prior.draw(rng) for _ in range(2000)]
    error = np.stack([triad.matrix for triad in triads]) - np.eye(3)
    on = np.eye(3, dtype=bool)
    assert error[:, on].std() == pytest.approx(0.03, rel=0.05)
    assert error[:, ~on].std() == pytest.approx(0.01, rel=0.05)
    assert np.stack([triad.g_sensitivity for triad in triads]).std(axis=0) == pytest.approx(
        np.full((3, 3), 0.004), rel=0.1
    )
    bias = np.stack([TriadRun(triads[0], rng, 100.0).turn_on_bias for _ in range(2000)])
    assert bias.mean(axis=0) == pytest.approx([1.0, -2.0, 0.5], abs=0.02)
    assert bias.std(axis=0) == pytest.approx([0.2, 0.2, 0.2], rel=0.06)


def test_a_gyroscope_feels_force_in_proportion() -> None:
    rng = np.random.default_rng(1)
    triad = TriadPrior(g_sensitivity_sd=0.01).draw(rng)
    t, still = np.arange(3) / 100.0, np.zeros((3, 3))
    reading = TriadRun(triad, rng, 100.0).measure(t, still, 9.8 * np.eye(3))
    assert reading == pytest.approx(9.8 * triad.g_sensitivity.T)
    assert np.abs(reading).min() > 1e-5


def test_a_range_ends_and_steps_are_of_one_size() -> None:
    ramp = np.linspace(-3.0, 3.0, 3001)[:, None] * np.ones(3)
    reading = digitize(ramp.copy(), limit=2.0, resolution=0.125)
    assert reading.max() == 2.0
    assert reading.min() == -2.0
    assert set(np.unique(np.diff(reading[:, 0]))) == {0.0, 0.125}
    inside = np.abs(ramp) < 2.0
    error = (reading - ramp)[inside]
    assert np.abs(error).max() <= 0.0625 + 1e-12
    assert error.std() == pytest.approx(0.125 / np.sqrt(12), rel=0.02)


def test_a_trend_is_a_straight_line_beside_what_wanders() -> None:
    t, trend = np.array([-1.0, 0.0, 30.0, 600.0]), np.array([1e-3, 0.0, -2e-3])
    plain, tilted = (
        DriftPath(Drift(0.1, 50.0, 0.01, tuple(m)), np.random.default_rng(1)).at(t) for m in (0 * trend, trend)
    )
    np.testing.assert_allclose(tilted - plain, np.maximum(t, 0)[:, None] * trend, atol=1e-15)
