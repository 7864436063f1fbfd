"""The gyro bias by the field of a sensor that stays in one place, on rotations, biases and fields that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.factors.differential_field import (
    BiasInformation,
    FieldNoise,
    FieldStretches,
    Iron,
    StretchInformation,
    Variogram,
    measure_bias,
)
from fg_nav.factors.residual import Array
from fg_nav.factors.rotation import relative_rotations

RATE_HZ, SAMPLES, STRETCHES = 100.0, 50, 40
EARTH = np.array([5.0, 20.0, -43.0])
BIAS = np.radians([0.4, -0.3, 0.6])
NO_IRON = Iron.unknown(1e-3)
NOISE = FieldNoise(Variogram(1e-6, 1.0, 1.0), 0.3, NO_IRON)  # White, and nothing else.


def rocking(seed: int, amplitude_rad_s: float = 0.15) -> tuple[Array, Array]:
    """True rates (T, 3) rad/s of a foot that rocks about all its axes, and the stretch (T,) of each sample."""
    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / RATE_HZ
    phase, cycles = rng.uniform(0.0, 2.0 * np.pi, (2, STRETCHES, 3, 1))
    rate = amplitude_rad_s * np.sin(2.0 * np.pi * (0.5 + 0.3 * cycles) * t + phase)
    return np.swapaxes(rate, 1, 2).reshape(-1, 3), np.repeat(np.arange(STRETCHES), SAMPLES)


def measured(
    seed: int,
    white_uT: float = 0.3,
    drift: Array = np.zeros(3),
    iron: Array = np.zeros(3),
    bias: Array = BIAS,
    about: Array = np.zeros(3),
    amplitude_rad_s: float = 0.15,
) -> FieldStretches:
    """Stretches of a gyroscope with this bias, linearized about another; each begins at an attitude of its own."""
    rate, stretch = rocking(seed, amplitude_rad_s=amplitude_rad_s)
    rng = np.random.default_rng(seed + 1000)
    period = np.full(len(rate), 1.0 / RATE_HZ)
    true, _ = relative_rotations(rate, period, stretch, np.zeros(3))
    nav_R_first = Rotation.random(stretch[-1] + 1, rng=rng).as_matrix()
    there = np.broadcast_to(EARTH + drift, (len(rate), 3))
    y = np.einsum("tji,tj->ti", nav_R_first[stretch] @ true, there) + iron + rng.normal(0.0, white_uT, (len(rate), 3))
    about = np.broadcast_to(about, (stretch[-1] + 1, 3))
    rotation, jacobian = relative_rotations(rate + bias, period, stretch, np.ascontiguousarray(about))
    return FieldStretches(y, rotation, jacobian, np.zeros((len(rate), 3)), stretch, about)


def total(found: StretchInformation, iron: Iron = NO_IRON) -> tuple[Array, Array]:
    """Bias (3,) and covariance (3, 3) of all stretches together, with what is known of the iron."""
    information = BiasInformation(found.information.matrix.sum(axis=0), found.information.vector.sum(axis=0))
    information = information.eliminate_iron(iron)
    covariance = np.linalg.inv(information.matrix)
    return covariance @ information.vector, covariance


def whitened(found: StretchInformation, iron: Iron = NO_IRON) -> float:
    """Square of the error over its covariance, of three degrees of freedom."""
    bias, covariance = total(found, iron)
    return float((bias - BIAS) @ np.linalg.solve(covariance, bias - BIAS))


def test_without_noise_the_bias_is_found() -> None:
    bias, _ = total(measure_bias(measured(0, white_uT=0.0, about=BIAS * 0.9), NOISE, 64))
    np.testing.assert_allclose(bias, BIAS, atol=np.radians(1e-3))


@pytest.mark.parametrize("most", [64, 10], ids=["all samples", "averaged"])
def test_sigma_and_chi_square_are_true(most: int) -> None:
    found = [measure_bias(measured(seed), NOISE, most) for seed in range(40)]
    assert 3.0 - 3.0 * np.sqrt(6.0 / 40) < np.mean([whitened(one) for one in found]) < 3.0 + 3.0 * np.sqrt(6.0 / 40)
    ratio = [one.chi_square.sum() / one.freedom.sum() for one in found]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)


def test_averages_lose_little() -> None:
    all_samples, averaged = (measure_bias(measured(0), NOISE, most).information.matrix.sum(axis=0) for most in (64, 10))
    assert np.trace(averaged) > 0.95 * np.trace(all_samples)


def test_no_information_about_the_field_itself() -> None:
    still = measure_bias(measured(0, white_uT=0.0, bias=np.zeros(3), amplitude_rad_s=0.0), NOISE, 64)
    values = np.linalg.eigvalsh(still.information.matrix)
    assert (values[:, 0] < 1e-9 * values[:, -1]).all()


def test_it_does_not_matter_where_it_is_linearized() -> None:
    here, there = (measure_bias(measured(5, about=about), NOISE, 64) for about in (np.zeros(3), BIAS * 0.5))
    bias, covariance = total(here)
    again, _ = total(there)
    assert (np.abs(again - bias) < 0.05 * np.sqrt(np.diagonal(covariance))).all()


def wandering(seed: int, variogram: Variogram, speed_m_s: float) -> tuple[Array, Array]:
    """Place (T, 3) of a sensor that creeps through each stretch, and the field there off its mean (T, 3)."""
    rng = np.random.default_rng(seed + 2000)
    stretches = rocking(seed)[1][-1] + 1
    place = np.zeros((stretches, SAMPLES, 3))
    place[:, :, 0] = speed_m_s * np.arange(SAMPLES) / RATE_HZ
    square = (place[0, :, None, 0] - place[0, None, :, 0]) ** 2
    root = np.linalg.cholesky(variogram.covariance(square) + 1e-10 * np.eye(SAMPLES))
    off = np.einsum("ts,nsa->nta", root, rng.normal(size=(stretches, SAMPLES, 3)))
    return place.reshape(-1, 3), off.reshape(-1, 3)


def test_a_field_that_drifts_is_not_taken_for_a_bias() -> None:
    variogram = Variogram(5.0, 0.5, 1.0)
    squares, white, ratio = [], [], []
    for seed in range(40):
        place, off = wandering(seed, variogram, 0.02)
        seen = replace(measured(seed, drift=off), position=place)
        found = measure_bias(seen, FieldNoise(variogram, 0.3, NO_IRON), 64)
        squares.append(whitened(found))
        ratio.append(found.chi_square.sum() / found.freedom.sum())
        white.append(whitened(measure_bias(seen, NOISE, 64)))
    assert 3.0 - 3.0 * np.sqrt(6.0 / 40) < np.mean(squares) < 3.0 + 3.0 * np.sqrt(6.0 / 40)
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)
    assert np.mean(white) > 10.0


def test_iron_on_the_body_is_not_taken_for_a_bias() -> None:
    squares, ignored, of_iron, ratio = [], [], [], []
    for seed in range(40):
        iron = np.random.default_rng(seed).normal(0.0, 20.0, 3)
        seen = measured(seed, iron=iron, amplitude_rad_s=0.4)
        found = find_walk_iron(seen)
        off = found.mean_uT - iron
        of_iron.append(off @ np.linalg.solve(found.covariance, off))
        known = measure_bias(seen, replace(NOISE, iron=found), 64)
        squares.append(whitened(known, found))
        ratio.append(known.chi_square.sum() / known.freedom.sum())
        ignored.append(whitened(measure_bias(seen, NOISE, 64)))
    band = 3.0 * np.sqrt(6.0 / 40)
    assert 3.0 - band < np.mean(of_iron) < 3.0 + band
    assert np.mean(squares) < 3.0 + band
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)
    assert np.mean(ignored) > 10.0


def find_walk_iron(seen: FieldStretches) -> Iron:
    """Find the iron of all stretches, which have one bias, from 30 uT per axis; linearized again about it."""
    iron = Iron.unknown(30.0)
    for _ in range(3):
        information = measure_bias(seen, replace(NOISE, iron=iron), 64).information
        one = BiasInformation(information.matrix.sum(axis=0), information.vector.sum(axis=0))
        iron = one.find_iron(Iron.unknown(30.0))
    return iron


# ------------------------------------------------------------------------------------------------------- information


def random_information(seed: int) -> BiasInformation:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 3, 3)) * 1e3
    return BiasInformation(np.swapaxes(root, 1, 2) @ root, rng.normal(size=(5, 3)) * 1e4)


def test_a_common_error_limits_what_is_known_and_keeps_the_mean() -> None:
    one, sigma = random_information(0), np.radians(0.05)
    limited = one.limit(sigma)
    covariance = np.linalg.inv(one.matrix) + sigma**2 * np.eye(3)
    np.testing.assert_allclose(np.linalg.inv(limited.matrix), covariance, rtol=1e-8)
    means = [np.linalg.solve(some.matrix, some.vector[..., None]) for some in (one, limited)]
    np.testing.assert_allclose(means[1], means[0], rtol=1e-8)
    nothing = BiasInformation(np.zeros((1, 3, 3)), np.zeros((1, 3))).limit(sigma)
    assert not nothing.matrix.any()


def test_the_residual_has_the_information() -> None:
    one = random_information(1)
    residual = one.residual()
    root, target = residual.root, residual.target
    np.testing.assert_allclose(np.swapaxes(root, 1, 2) @ root, one.matrix, rtol=1e-9)
    np.testing.assert_allclose((np.swapaxes(root, 1, 2) @ target[..., None])[..., 0], one.vector, rtol=1e-9)
