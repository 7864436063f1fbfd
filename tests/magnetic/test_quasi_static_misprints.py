"""What Ma 2018 (Eq. 13-26) and AIEZ (Eq. 9-18) print of their detectors, where it fails, and that ours does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

from fg_nav.errors import MagneticError
from fg_nav.magnetic import DETECTORS, judge
from fg_nav.magnetic.channels import OFFSET, Channel
from fg_nav.magnetic.detectors import Detector
from fg_nav.magnetic.presets import MA_SIGMA_HEADING, MA_SIGMA_INCLINATION, MA_SIGMA_STRENGTH
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
    return detector.statistic(window)


def test_without_the_absolutes_opposite_jumps_cancel():
    """Eq. 26 on Gaussian changes, as Eq. 16 has them, sees nothing of +10 and -10 sigma; all others do."""
    values = np.cumsum([0.0, 10.0, -10.0, 0.0])
    signed = np.diff(values).sum() ** 2 / N
    assert signed == 0.0
    assert alone(PRINTED, values) == pytest.approx(400 / 3)
    assert alone(SQUARES, values) == pytest.approx(200 / 3)
    assert alone(OURS, values) == pytest.approx(75.0)
    assert alone(OURS, values) > OURS.threshold


def test_absolute_changes_are_not_the_gaussians_of_equation_16():
    """|v| is half-normal, of mean 0.8 sigma: a window mean of it is no estimate of a change that is not there."""
    noise = np.abs(rng().standard_normal(100_000))
    assert noise.mean() == pytest.approx(np.sqrt(2 / np.pi), abs=0.01)
    assert noise.var() == pytest.approx(1 - 2 / np.pi, abs=0.01)


def test_sums_of_changes_have_a_third_of_the_variance_that_independent_ones_would():
    """Values that scatter by sigma change by sqrt(2) sigma, MA(1): Eq. 14 takes these changes for independent."""
    values = rng().standard_normal((200_000, N + 1))
    change = np.diff(values, axis=1)
    assert (change.sum(axis=1) ** 2 / (N * 2.0)).mean() == pytest.approx(1 / N, abs=0.01)
    assert np.corrcoef(change[:, 0], change[:, 1])[0, 1] == pytest.approx(-0.5, abs=0.01)
    assert alone(OURS, values).mean() == pytest.approx(N, abs=0.03)
    assert alone(OURS, values).var() == pytest.approx(2 * N, rel=0.03)


def test_a_sum_of_squared_changes_is_no_chi_squared_either():
    """AIEZ Eq. 17 on changes: right in the mean, with more than the variance, so that its tail is missed."""
    scaled = alone(replace(SQUARES, window=N), rng().standard_normal((200_000, N + 1))) * N / 2.0
    assert scaled.mean() == pytest.approx(N, abs=0.03)
    assert scaled.var() > 1.3 * 2 * N
    assert (scaled > chi2.ppf(0.99, N)).mean() > 0.017  # where 0.01 was asked for


def test_the_quantiles_of_mas_statistic_are_not_those_of_a_chi_squared():
    """Even with independent changes: chi squared with 3 degrees without the absolutes, and much more with them."""
    change = rng().standard_normal((400_000, 3, N))
    signed = (change.sum(axis=2) ** 2).sum(axis=1) / N
    absolute = PRINTED.statistic(np.cumsum(np.insert(change, 0, 0.0, axis=2), axis=2))
    np.testing.assert_allclose(np.quantile(signed, [0.95, 0.99]), chi2.ppf([0.95, 0.99], 3), rtol=0.01)
    assert absolute.mean() == pytest.approx(3 * (1 + (N - 1) * 2 / np.pi), rel=0.01)  # 6.8
    np.testing.assert_allclose(np.quantile(absolute, [0.95, 0.99]), [13.2, 17.2], rtol=0.02)


def test_the_printed_density_is_none_but_its_ratio_is():
    """(2 pi sigma^2)^(-3/2) a scalar (Eq. 16-18) integrates to 1 / (2 pi sigma^2); the ratio of two has lost it."""

    def density(y, power, s=0.0, sigma=2.0):
        return (2 * np.pi * sigma**2) ** -power * np.exp(-((y - s) ** 2) / (2 * sigma**2))

    assert quad(density, -40, 40, args=(0.5,))[0] == pytest.approx(1.0)
    assert quad(density, -40, 40, args=(1.5,))[0] == pytest.approx(1 / (2 * np.pi * 4.0))
    ratios = [density(1.3, power, s=1.0) / density(1.3, power) for power in (0.5, 1.5)]
    assert ratios[0] == pytest.approx(ratios[1])


def test_the_likelihood_ratio_of_equation_24_is_equation_26():
    """With the window's mean for an estimate: 2 ln(ratio) = (sum y)^2 / (N sigma^2)."""
    y, sigma = rng().normal(0.5, 1.0, N), 0.7
    two_log_ratio = (y**2).sum() / sigma**2 - ((y - y.mean()) ** 2).sum() / sigma**2
    assert two_log_ratio == pytest.approx(y.sum() ** 2 / (N * sigma**2))


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
    assert judge(walk, "ma2018-printed").quasi_static[3:].all() == printed
    assert judge(walk, "ma2018").quasi_static[3:].all() == ours


def test_the_printed_form_has_no_false_alarm_rate_to_ask_for():
    """Eq. 23 integrates a density whose estimate is made of the data: there is no such number. Ours has one."""
    with pytest.raises(MagneticError, match="no distribution to take a rate from"):
        _ = PRINTED.with_false_alarm_rate(0.05).threshold
    with pytest.raises(MagneticError, match="no distribution"):
        _ = PRINTED.detection_rate
    assert 0.0 < OURS.with_false_alarm_rate(0.01).threshold < OURS.with_false_alarm_rate(0.1).threshold


def test_two_estimates_of_a_change_give_two_statistics():
    """Ma's hypothesis "at every step" has the estimate s_k = y_k (AIEZ Eq. 16-17); his Eq. 20 has one for all."""
    creeping, jumping = [0.0, 2.0, 4.0, 6.0], [0.0, 6.0, 6.0, 6.0]
    assert alone(PRINTED, creeping) == alone(PRINTED, jumping) == pytest.approx(12.0)
    assert alone(SQUARES, creeping) == pytest.approx(4.0)
    assert alone(SQUARES, jumping) == pytest.approx(12.0)


def test_the_rate_of_the_vector_is_that_of_turning_and_the_rate_of_the_strength_is_not():
    """AIEZ Eq. 9: a foot that rolls at 0.2 rad/s in the Earth's still field has a |dB/dt| of nearly ten sigmas."""
    t = np.linspace(0.0, 0.3, 31)
    roll = 0.2 * t
    body = np.stack([0 * t, 48 * np.cos(1.1 + roll), -48 * np.sin(1.1 + roll)], axis=1)
    vector_rate = np.linalg.norm(np.diff(body, axis=0), axis=1) / np.diff(t)
    strength_rate = np.diff(np.linalg.norm(body, axis=1)) / np.diff(t)
    assert vector_rate.min() / 0.5 > 9.0
    assert np.abs(strength_rate).max() < 1e-9


def test_the_printed_offset_locks_out_once_the_inertial_heading_has_drifted():
    """Out of the disturbance after five minutes the compass is right again; with sigma alone it is never believed."""
    n = 400
    beside = (np.arange(n) > 20) & (np.arange(n) < 300)
    drift = np.where(np.arange(n) > 20, np.deg2rad(0.02) * (np.arange(n) - 20), 0.0)  # 6 deg until then, and on
    walk = footfalls(turned(np.deg2rad(60.0) * beside), drift=drift)
    detector = DETECTORS["aiez"]
    locked = replace(detector, laying=replace(detector.laying, in_test=False))
    limit = np.sqrt(detector.threshold) * np.degrees(detector.channels[0].sigma)
    out = np.degrees(drift[300])
    assert 0.8 * limit < out
    further = footfalls(turned(np.deg2rad(60.0) * beside), drift=1.5 * drift)
    assert judge(walk, detector).quasi_static[300:].all()
    assert judge(further, detector).quasi_static[300:].all()
    assert not judge(further, locked).quasi_static[300:].any()
    assert not judge(walk, detector).quasi_static[beside].any()


def test_as_printed_a_drift_of_30_degrees_is_for_ever():
    beside = (np.arange(100) > 20) & (np.arange(100) < 60)
    walk = footfalls(turned(np.pi / 2 * beside), drift=np.deg2rad(35.0) * (np.arange(100) >= 60))
    assert not judge(walk, "aiez-printed").quasi_static[21:].any()


def test_a_constant_local_deviation_passes_the_rate_and_not_the_offset():
    """Ma's text has the change of the heading difference, his equation the difference: these are two detectors."""
    deviating = turned(np.deg2rad(50.0) * (np.arange(30) >= 10))
    rate = judge(footfalls(deviating), "ma2018-printed")
    absolute = Detector(
        "ma2018, absolute",
        (Channel(OFFSET, MA_SIGMA_HEADING), *PRINTED.channels[1:]),
        PRINTED.form,
        fixed_threshold=PRINTED.threshold,
    )
    assert rate.quasi_static[13:].all()
    assert not judge(footfalls(deviating), absolute).quasi_static[12:].any()


def test_of_a_window_of_zeros_alone_no_footfall_before_it_is_needed():
    assert DETECTORS["aiez"].rows == 1
    assert judge(footfalls(still(1)), "qsf-stance").judged.all()
