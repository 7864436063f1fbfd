"""The ROC of detectors with known distributions, against Gauss, Mann and Whitney, and bands against their claim."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, norm

from fg_nav.errors import EvaluationError
from fg_nav.lab.reproduce.roc import make_roc

SHIFT = 1.2
WALKS, CASES = 10, 60


def drawn(rng, walks=WALKS, cases=CASES, shift=SHIFT, of_walk=0.0):
    """Statistics with signals `shift` sigmas below the rest; what is drawn for a walk is added to its signals."""
    walk = np.repeat(np.arange(walks), cases)
    signal = rng.random(len(walk)) < 0.4
    moved = shift + of_walk * rng.standard_normal(walks)
    return rng.standard_normal(len(walk)) - signal * moved[walk], signal, walk


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.mark.parametrize("shift", [0.0, 0.7, 2.0])
def test_area_of_two_gaussians(rng, shift):
    found = make_roc(*drawn(rng, cases=20_000, shift=shift))
    assert found.area == pytest.approx(norm.cdf(shift / np.sqrt(2)), abs=0.004)
    at = norm.ppf(0.2)
    assert found.at(at) == pytest.approx((norm.cdf(at + shift), 0.2), abs=0.006)


@pytest.mark.parametrize("decimals", [12, 0])
def test_area_is_that_of_mann_and_whitney_ties_and_all(rng, decimals):
    statistic, signal, walk = drawn(rng)
    statistic = statistic.round(decimals)
    u = mannwhitneyu(statistic[~signal], statistic[signal]).statistic
    assert make_roc(statistic, signal, walk).area == pytest.approx(u / signal.sum() / (~signal).sum(), abs=1e-12)


def test_only_the_order_of_the_statistic_counts(rng):
    statistic, signal, walk = drawn(rng)
    plain, turned = make_roc(statistic, signal, walk), make_roc(np.exp(3 * statistic), signal, walk)
    np.testing.assert_array_equal(plain.p_d, turned.p_d)
    np.testing.assert_array_equal(plain.p_fa, turned.p_fa)
    assert plain.area_band() == turned.area_band()
    assert plain.band_at(0.3) == turned.band_at(np.exp(0.9))


def test_declared_are_those_strictly_below_the_threshold():
    found = make_roc(np.array([1.0, 2.0, 2.0, 3.0]), np.array([True, True, False, False]))
    assert found.at(1.0) == (0.0, 0.0)
    assert found.at(2.0) == (0.5, 0.0)
    assert found.at(2.0001) == (1.0, 0.5)
    assert found.at(np.inf) == (1.0, 1.0)


def test_a_curve_that_is_known():
    found = make_roc(np.array([1.0, 2.0, 2.0, 3.0]), np.array([True, True, False, False]))
    np.testing.assert_array_equal(found.p_d, [0, 0.5, 1, 1])
    np.testing.assert_array_equal(found.p_fa, [0, 0, 0.5, 1])
    assert found.area == 0.875


def test_what_was_not_judged_counts_neither_way(rng):
    statistic, signal, walk = drawn(rng)
    without = rng.random(len(walk)) < 0.3
    holed = np.where(without, np.nan, statistic)
    there, kept = make_roc(holed, signal, walk), make_roc(statistic[~without], signal[~without], walk[~without])
    assert there.area == kept.area
    assert there.at(-0.5) == kept.at(-0.5)
    assert there.area != make_roc(statistic, signal, walk).area


def test_a_walk_without_a_judged_case_is_none(rng):
    """It tells nothing of how much walks differ; counted as one that agrees with the mean it would narrow the band."""
    statistic, signal, walk = drawn(rng)
    mute = np.where(walk >= 4, np.nan, statistic)
    few, silent = make_roc(statistic[walk < 4], signal[walk < 4], walk[walk < 4]), make_roc(mute, signal, walk)
    assert silent.n_walks == 4
    assert silent.area_band() == few.area_band()
    assert silent.band_at(-0.6) == few.band_at(-0.6)
    with pytest.raises(EvaluationError, match="two walks or more"):
        make_roc(np.where(walk == 0, statistic, np.nan), signal, walk).area_band()


@pytest.mark.parametrize("of_walk", [0.0, 0.8])
def test_bands_cover_what_they_claim(of_walk):
    """Drawn anew 400 times, with walks that differ and without: a band of 90 % misses the truth one time in ten."""
    rng = np.random.default_rng(11)
    rocs = [make_roc(*drawn(rng, of_walk=of_walk)) for _ in range(400)]
    spread = np.sqrt(1 + of_walk**2)
    p_d, p_fa = norm.cdf((-0.6 + SHIFT) / spread), norm.cdf(-0.6)
    found = [(roc.area_band(), *roc.band_at(-0.6)) for roc in rocs]
    true = (norm.cdf(SHIFT / np.sqrt(2 + of_walk**2)), p_d, p_fa)
    covered = np.mean([[figure in band for figure, band in zip(true, bands, strict=True)] for bands in found], axis=0)
    assert ((covered > 0.85) & (covered < 0.95)).all(), covered


def test_a_band_by_stances_would_be_too_narrow(rng):
    """Walks that differ: taking each stance for a walk of its own covers far less than it claims."""
    covered = []
    for _ in range(60):
        statistic, signal, _ = drawn(rng, walks=5, cases=40, of_walk=0.8)
        covered.append(
            norm.cdf(SHIFT / np.sqrt(2.64)) in make_roc(statistic, signal, np.arange(len(signal))).area_band()
        )
    assert np.mean(covered) < 0.7


def test_where_one_walk_holds_all_signals_nothing_is_known(rng):
    statistic, _, walk = drawn(rng)
    found = make_roc(statistic, (walk == 2) & (statistic < 0.5), walk)
    band = found.area_band()
    assert (band.low, band.high) == (0.0, 1.0)


def test_what_cannot_be_is_said(rng):
    statistic, signal, walk = drawn(rng)
    with pytest.raises(EvaluationError, match="600 judged cases have no signal among them"):
        make_roc(statistic, np.zeros(600, dtype=bool), walk)
    with pytest.raises(EvaluationError, match="are all signals"):
        make_roc(statistic, np.ones(600, dtype=bool), walk)
    with pytest.raises(EvaluationError, match="none of the 600 cases has a statistic"):
        make_roc(np.full(600, np.nan), signal, walk)
    with pytest.raises(EvaluationError, match="two walks or more"):
        make_roc(statistic, signal).area_band()
