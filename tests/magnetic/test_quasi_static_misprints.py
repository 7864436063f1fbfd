"""The detectors of Ma (13)-(26) and AIEZ (8)-(18) as printed, where it fails, and that ours does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, kstest, norm

from fg_nav.errors import MagneticError
from fg_nav.magnetic import DETECTORS, judge_field
from fg_nav.magnetic.detectors import (
    ALIGNMENT_FOOTFALLS,
    FALSE_ALARM_RATE,
    MA_SIGMA_HEADING,
    MA_SIGMA_INCLINATION,
    MA_SIGMA_STRENGTH,
    OFFSET,
    Channel,
    Detector,
)
from tests.magnetic.fields import footfalls, still, turned

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


def test_without_the_absolutes_opposite_jumps_cancel():
    """Ma (26) on Gaussian changes, as Ma (16) has them, sees nothing of +10 and -10 sigma; all others do."""
    values = np.cumsum([0.0, 10.0, -10.0, 0.0])
    signed = np.diff(values).sum() ** 2 / N
    assert signed == 0.0
    assert alone(PRINTED, values) == pytest.approx(400 / 3)
    assert alone(SQUARES, values) == pytest.approx(200 / 3)
    assert alone(OURS, values) == pytest.approx(75.0)
    assert alone(OURS, values) > OURS.threshold


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


def test_sums_of_changes_have_a_third_of_the_variance_that_independent_ones_would():
    """Values that scatter by sigma change by sqrt(2) sigma, MA(1): Ma (14) takes these changes for independent."""
    values = rng().standard_normal((200_000, N + 1))
    change = np.diff(values, axis=1)
    assert (change.sum(axis=1) ** 2 / (N * 2.0)).mean() == pytest.approx(1 / N, abs=0.01)
    assert np.corrcoef(change[:, 0], change[:, 1])[0, 1] == pytest.approx(-0.5, abs=0.01)
    assert alone(OURS, values).mean() == pytest.approx(N, abs=0.03)
    assert alone(OURS, values).var() == pytest.approx(2 * N, rel=0.03)


def test_a_sum_of_squared_changes_is_no_chi_squared_either():
    """AIEZ (17) on changes: right in the mean, with more than the variance, so that its tail is missed."""
    scaled = alone(replace(SQUARES, window=N), rng().standard_normal((200_000, N + 1))) * N / 2.0
    assert scaled.mean() == pytest.approx(N, abs=0.03)
    assert scaled.var() > 1.3 * 2 * N
    assert (scaled > chi2.ppf(0.99, N)).mean() > 0.017  # where 0.01 was asked for


def test_the_quantiles_of_mas_statistic_are_not_those_of_a_chi_squared():
    """Even with independent changes: chi squared with 3 degrees without the absolutes, and much more with them."""
    change = rng().standard_normal((400_000, 3, N))
    signed = (change.sum(axis=2) ** 2).sum(axis=1) / N
    absolute = PRINTED.compute_statistic(np.cumsum(np.insert(change, 0, 0.0, axis=2), axis=2))
    np.testing.assert_allclose(np.quantile(signed, [0.95, 0.99]), chi2.ppf([0.95, 0.99], 3), rtol=0.01)
    assert absolute.mean() == pytest.approx(3 * (1 + (N - 1) * 2 / np.pi), rel=0.01)  # 6.8
    np.testing.assert_allclose(np.quantile(absolute, [0.95, 0.99]), [13.2, 17.2], rtol=0.02)


def test_the_printed_density_is_none_but_its_ratio_is():
    """(2 pi sigma^2)^(-3/2) a scalar (Ma (16)-(18)) integrates to 1 / (2 pi sigma^2); the ratio of two has lost it."""

    def density(y, power, s=0.0, sigma=2.0):
        return (2 * np.pi * sigma**2) ** -power * np.exp(-((y - s) ** 2) / (2 * sigma**2))

    assert quad(density, -40, 40, args=(0.5,))[0] == pytest.approx(1.0)
    assert quad(density, -40, 40, args=(1.5,))[0] == pytest.approx(1 / (2 * np.pi * 4.0))
    ratios = [density(1.3, power, s=1.0) / density(1.3, power) for power in (0.5, 1.5)]
    assert ratios[0] == pytest.approx(ratios[1])


def test_the_likelihood_ratio_of_equation_24_is_equation_26():
    """With the window's mean for an estimate: 2 ln(ratio) = (sum y)^2 / (N sigma^2)."""
    y, sigma = rng().uniform(0.1, 2.0, N), 0.7
    two_log_ratio = -2 * (norm.logpdf(y, 0.0, sigma) - norm.logpdf(y, y.mean(), sigma)).sum()
    assert alone(PRINTED, np.cumsum([0.0, *y]) / sigma) == pytest.approx(two_log_ratio)


def test_170_is_no_threshold_of_noise():
    assert chi2.sf(170.0, 3) < 1e-35
    per_step = np.sqrt(170.0 / N)  # sigmas of mean change a step in one channel alone
    assert np.degrees(per_step * MA_SIGMA_HEADING) == pytest.approx(28.9, abs=0.05)
    assert np.degrees(per_step * MA_SIGMA_INCLINATION) == pytest.approx(23.3, abs=0.05)
    assert 10 * per_step * MA_SIGMA_STRENGTH == pytest.approx(40.3, abs=0.05)  # mG


@pytest.mark.parametrize(
    ("step_deg", "printed", "ours"), [(28.0, True, False), (30.0, False, False), (1.0, True, True)]
)
def test_170_lets_a_field_pass_that_turns_by_28_degrees_a_step(step_deg, printed, ours):
    walk = footfalls(turned(np.deg2rad(step_deg) * np.arange(20)))
    assert judge_field(walk, "ma2018-printed").quasi_static[3:].all() == printed
    assert judge_field(walk, "ma2018").quasi_static[3:].all() == ours


def test_the_printed_form_has_no_false_alarm_rate_to_ask_for():
    """Ma (23) integrates a density whose estimate is made of the data: there is no such number. Ours has one."""
    with pytest.raises(MagneticError, match="no distribution to take a rate from"):
        PRINTED.find_threshold(0.05)
    assert 0.0 < OURS.find_threshold(0.01) < OURS.find_threshold(0.1)


def test_the_printed_integral_is_no_probability():
    """Ma (23) at its simplest, one change in one channel: at 170 the "false-alarm probability" is 10."""
    single, edge = replace(PRINTED, window=1), np.sqrt(170.0)
    assert alone(single, [0.0, edge]) == pytest.approx(170.0)
    found, _ = quad(lambda y: norm.pdf(y, loc=y), -edge, edge)  # the estimate of the change is the change
    assert found == pytest.approx(10.4, abs=0.01)
    window = rng().standard_normal((100_000, 3, OURS.rows))
    window[:, 0] += OURS.channels[0].matters / OURS.channels[0].sigma * np.linspace(0.0, 1.0, OURS.rows)
    assert (OURS.compute_statistic(window) < OURS.threshold).mean() == pytest.approx(FALSE_ALARM_RATE, abs=0.004)


def test_two_estimates_of_a_change_give_two_statistics():
    """Ma's hypothesis "at every step" has the estimate s_k = y_k (AIEZ (16), (17)); Ma (20) has one for all."""
    creeping, jumping = [0.0, 2.0, 4.0, 6.0], [0.0, 6.0, 6.0, 6.0]
    assert alone(PRINTED, creeping) == alone(PRINTED, jumping) == pytest.approx(12.0)
    assert alone(SQUARES, creeping) == pytest.approx(4.0)
    assert alone(SQUARES, jumping) == pytest.approx(12.0)


def test_an_offset_that_is_not_wrapped_is_a_whole_turn_at_south():
    """AIEZ (9) as printed, |psi - psi_compass|, of a foot that looks south and a compass that wavers by a degree."""
    walk = footfalls(turned(np.deg2rad(1.0) * (-1.0) ** np.arange(20)), heading=np.pi - 1e-9)
    as_it_stands = np.degrees(np.abs(walk.gyro_heading - walk.magnetic_heading))
    assert (as_it_stands > 358.0).sum() == 10
    assert np.degrees(np.abs(walk.heading_difference)).max() < 1.01
    assert judge_field(walk, "aiez-printed").quasi_static[3:].all()


def test_the_sigma_of_the_one_channel_is_no_sigma_of_the_other():
    """AIEZ (12) divides the strength rate, uT/s, by the sigma of the heading, rad: still fields fail."""
    heading, strength = DETECTORS["aiez-printed"].channels
    threshold = DETECTORS["aiez-printed"].threshold
    window = rng().standard_normal((100_000, 2, 1))
    assert (DETECTORS["aiez-printed"].compute_statistic(window) < threshold).mean() == pytest.approx(0.99, abs=0.002)
    window[:, 1] *= strength.sigma / heading.sigma
    assert (DETECTORS["aiez-printed"].compute_statistic(window) < threshold).mean() < 0.8


def test_one_power_for_a_window_leaves_the_unit_in_the_ratio():
    """AIEZ (15) has 1 / sqrt(2 pi sigma^2) where AIEZ (14) has its N-th power: their ratio is not AIEZ (16)."""
    y, detector = rng().normal(0.0, 0.5, N), replace(DETECTORS["aiez-printed"], window=N)

    def literal(unit):  # of the strength rate alone, in so many units a uT/s
        sigma = 0.5 * unit
        h1 = -0.5 * np.log(2 * np.pi * sigma**2) - ((y * unit) ** 2).sum() / (2 * sigma**2)
        h0 = -0.5 * N * np.log(2 * np.pi * sigma**2)
        return -2 / N * (h1 - h0)

    assert literal(10.0) - literal(1.0) == pytest.approx(-(N - 1) / N * 2 * np.log(10.0))
    product = -2 / N * (norm.logpdf(y, 0.0, 0.5) - norm.logpdf(0.0, 0.0, 0.5)).sum()
    assert alone(detector, y / 0.5) == pytest.approx(product)


def test_equation_17_of_white_zeros_is_chi_squared_over_n():
    """On zeros, which are not differences, AIEZ's sum is what its authors take it for: 2 N degrees of freedom."""
    detector = replace(DETECTORS["aiez-printed"], window=N)
    scaled = N * detector.compute_statistic(rng(3).standard_normal((20_000, 2, detector.rows)))
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


def test_as_printed_a_drift_of_30_degrees_is_for_ever():
    beside = (np.arange(100) > 20) & (np.arange(100) < 60)
    walk = footfalls(turned(np.pi / 2 * beside), drift=np.deg2rad(35.0) * (np.arange(100) >= 60))
    assert not judge_field(walk, "aiez-printed").quasi_static[21:].any()


def test_a_constant_local_deviation_passes_the_rate_and_not_the_offset():
    """Ma's text has the change of the heading difference, his equation the difference: these are two detectors."""
    deviating = turned(np.deg2rad(50.0) * (np.arange(30) >= 10))
    rate = judge_field(footfalls(deviating), "ma2018-printed")
    absolute = Detector(
        "ma2018, absolute",
        (Channel(OFFSET, MA_SIGMA_HEADING), *PRINTED.channels[1:]),
        PRINTED.form,
        fixed_threshold=PRINTED.threshold,
    )
    assert rate.quasi_static[13:].all()
    assert not judge_field(footfalls(deviating), absolute).quasi_static[12:].any()


def test_of_a_window_of_zeros_alone_no_footfall_before_it_is_needed():
    assert DETECTORS["aiez"].rows == 1
    assert judge_field(footfalls(still(1)), "qsf-stance").judged.all()
