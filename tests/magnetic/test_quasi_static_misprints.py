"""The detectors of Ma (13)-(26) and AIEZ (8)-(18) as printed, where it fails, and that ours does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import kstest, norm

from fg_nav.errors import MagneticError
from fg_nav.magnetic import DETECTORS, judge_field
from fg_nav.magnetic.detectors import (
    ALIGNMENT_FOOTFALLS,
)
from tests.magnetic.fields import footfalls, turned

N = 3
OURS, PRINTED = DETECTORS["ma2018"], DETECTORS["ma2018-printed"]
SQUARES = replace(PRINTED, form="sum of squares")


def rng(seed=1):
    return np.random.default_rng(seed)


def alone(detector, values):
    """Statistic of one channel's values over its sigma (..., rows), the others being nothing."""
    values = np.asarray(values, dtype=float)
    window = np.zeros((*values.shape[:-1], len(detector.channels), values.shape[-1]))
    window[..., 0, :] = values
    return detector.compute_statistic(window)


def test_the_printed_statistics_are_those_of_their_equations():
    """Ma (26) on Gaussian changes, as Ma (16) has them, sees nothing of +10 and -10 sigma; with absolutes it does.

    Ma's hypothesis "at every step" has the estimate s_k = y_k (AIEZ (16), (17)); Ma (20) has one for all.
    """
    opposite, creeping, jumping = [0.0, 10.0, 0.0, 0.0], [0.0, 2.0, 4.0, 6.0], [0.0, 6.0, 6.0, 6.0]
    for values, printed, squares in ((opposite, 400 / 3, 200 / 3), (creeping, 12.0, 4.0), (jumping, 12.0, 12.0)):
        assert alone(PRINTED, values) == pytest.approx(printed)
        assert alone(SQUARES, values) == pytest.approx(squares)
    assert alone(OURS, opposite) == pytest.approx(75.0)
    # the likelihood ratio of Ma (24), with the window's mean for an estimate: 2 ln(ratio) = (sum y)^2 / (N sigma^2)
    y, sigma = rng().uniform(0.1, 2.0, N), 0.7
    two_log_ratio = -2 * (norm.logpdf(y, 0.0, sigma) - norm.logpdf(y, y.mean(), sigma)).sum()
    assert alone(PRINTED, np.cumsum([0.0, *y]) / sigma) == pytest.approx(two_log_ratio)


def test_absolute_changes_are_not_the_gaussians_of_equation_16():
    """|v| is half-normal, of mean 0.8 sigma: the window mean of Ma (20) sees a change in a field that does not.

    One Gaussian squared has the mean 1 that Ma (16) promises whatever the window; with absolutes it grows with it.
    """
    for window in (3, 12):
        change = rng().standard_normal((30_000, window + 1))
        change[:, 0] = 0.0
        found = alone(replace(PRINTED, window=window), np.cumsum(change, axis=1)).mean()
        assert found == pytest.approx(1 + (window - 1) * 2 / np.pi, rel=0.02)
        ours = replace(OURS, window=window)
        assert alone(ours, rng(2).standard_normal((30_000, ours.rows))).mean() == pytest.approx(window, rel=0.02)


def test_a_density_needs_the_power_of_its_numbers():
    """(2 pi sigma^2)^(-3/2) a scalar, Ma (16)-(18), is no density, and only its ratio is of use.

    AIEZ (15) has 1 / sqrt(2 pi sigma^2) where AIEZ (14) has its N-th power: their ratio depends on the unit.
    """

    def density(y, power, s=0.0, sigma=2.0):
        return (2 * np.pi * sigma**2) ** -power * np.exp(-((y - s) ** 2) / (2 * sigma**2))

    assert quad(density, -40, 40, args=(0.5,))[0] == pytest.approx(1.0)
    assert quad(density, -40, 40, args=(1.5,))[0] == pytest.approx(1 / (2 * np.pi * 4.0))
    assert density(1.3, 1.5, s=1.0) / density(1.3, 1.5) == pytest.approx(density(1.3, 0.5, s=1.0) / density(1.3, 0.5))
    y, detector = rng().normal(0.0, 0.5, N), replace(DETECTORS["aiez-printed"], window=N)
    product = -2 / N * (norm.logpdf(y, 0.0, 0.5) - norm.logpdf(0.0, 0.0, 0.5)).sum()
    assert alone(detector, y / 0.5) == pytest.approx(product)


def test_170_lets_a_field_pass_that_turns_by_28_degrees_a_step_and_has_no_false_alarm_rate():
    """Ma (23) integrates a density whose estimate is made of the data: at 170 its "probability" is 10. Ours has one."""
    for step_deg, printed, ours in ((28.0, True, False), (30.0, False, False), (1.0, True, True)):
        walk = footfalls(turned(np.deg2rad(step_deg) * np.arange(20)))
        assert judge_field(walk, "ma2018-printed").quasi_static[3:].all() == printed
        assert judge_field(walk, "ma2018").quasi_static[3:].all() == ours
    edge = np.sqrt(170.0)
    assert quad(lambda y: norm.pdf(y, loc=y), -edge, edge)[0] == pytest.approx(10.4, abs=0.01)
    with pytest.raises(MagneticError, match="no distribution to take a rate from"):
        PRINTED.find_threshold(0.05)
    assert 0.0 < OURS.find_threshold(0.01) < OURS.find_threshold(0.1)


def test_the_sigma_of_the_one_channel_is_no_sigma_of_the_other():
    """AIEZ (12) divides the strength rate, uT/s, by the sigma of the heading, rad: still fields fail.

    On zeros, which are no differences, AIEZ (17) is what its authors take it for: chi squared over N.
    """
    detector = DETECTORS["aiez-printed"]
    heading, strength = detector.channels
    window = rng().standard_normal((100_000, 2, 1))
    assert (detector.compute_statistic(window) < detector.threshold).mean() == pytest.approx(0.99, abs=0.002)
    window[:, 1] *= strength.sigma / heading.sigma
    assert (detector.compute_statistic(window) < detector.threshold).mean() < 0.8
    three = replace(detector, window=N)
    scaled = N * three.compute_statistic(rng(3).standard_normal((20_000, 2, three.rows)))
    assert kstest(scaled, "chi2", args=(2 * N,)).pvalue > 1e-3


@pytest.mark.parametrize("name", ["aiez", "aiez-printed"])
def test_pure_is_only_what_agrees_with_the_inertial_heading(name):
    """AIEZ (8), (11) name it pure: a field that is wrong from the start passes, the same after a right one does not."""
    wrong = footfalls(turned(np.full(20, np.deg2rad(40.0))))
    wrong_later = footfalls(turned(np.deg2rad(40.0) * (np.arange(20) >= ALIGNMENT_FOOTFALLS)))
    assert judge_field(wrong, name).quasi_static[3:].all()
    assert not judge_field(wrong_later, name).quasi_static.any()


def test_the_printed_offset_locks_out_once_the_inertial_heading_has_drifted():
    """Out of the disturbance after five minutes the compass is right again; with sigma alone it is never accepted."""
    n = 400
    beside = (np.arange(n) > 20) & (np.arange(n) < 300)
    drift = np.where(np.arange(n) > 20, np.deg2rad(0.02) * (np.arange(n) - 20), 0.0)  # 6 deg until then, and on
    walk = footfalls(turned(np.deg2rad(60.0) * beside), drift=drift)
    detector = DETECTORS["aiez"]
    locked = replace(detector, counts_drift=False)
    limit = np.sqrt(detector.threshold) * np.degrees(detector.channels[0].sigma)
    out = np.degrees(drift[300])
    assert 0.8 * limit < out
    further = footfalls(turned(np.deg2rad(60.0) * beside), drift=1.5 * drift)
    assert judge_field(walk, detector).quasi_static[300:].all()
    assert judge_field(further, detector).quasi_static[300:].all()
    assert not judge_field(further, locked).quasi_static[300:].any()
    assert not judge_field(walk, detector).quasi_static[beside].any()
