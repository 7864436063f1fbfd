"""The ROC of detectors with known distributions, bands against their claim, and true fields over a window."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, norm

from fg_nav.errors import EvaluationError
from fg_nav.frames import yaw_rotation
from fg_nav.lab.field_survey import measure_compass_deviation, measure_course_change, measure_field_change
from fg_nav.lab.reproduce.roc import make_roc
from fg_nav.lab.simulation import simulate
from fg_nav.magnetic.footfall_field import compute_field_heading, rotate_to_level

SHIFT = 1.2
NORTH = np.array([0.0, 21.0, -43.0])


def drawn(rng, walks=10, cases=60, shift=SHIFT, of_walk=0.0):
    """Statistics with signals `shift` sigmas below the rest; what is drawn for a walk is added to its signals."""
    walk = np.repeat(np.arange(walks), cases)
    signal = rng.random(len(walk)) < 0.4
    moved = shift + of_walk * rng.standard_normal(walks)
    return rng.standard_normal(len(walk)) - signal * moved[walk], signal, walk


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def test_area_is_that_of_two_gaussians_and_of_mann_and_whitney_ties_and_all(rng):
    for shift in (0.0, 0.7, 2.0):
        found = make_roc(*drawn(rng, cases=20_000, shift=shift))
        assert found.area == pytest.approx(norm.cdf(shift / np.sqrt(2)), abs=0.004)
        at = norm.ppf(0.2)
        assert found.at(at) == pytest.approx((norm.cdf(at + shift), 0.2), abs=0.006)
    statistic, signal, walk = drawn(rng)
    for some in (statistic, statistic.round(0)):
        u = mannwhitneyu(some[~signal], some[signal]).statistic
        assert make_roc(some, signal, walk).area == pytest.approx(u / signal.sum() / (~signal).sum(), abs=1e-12)


def test_only_the_order_of_the_statistic_counts(rng):
    statistic, signal, walk = drawn(rng)
    plain, turned = make_roc(statistic, signal, walk), make_roc(np.exp(3 * statistic), signal, walk)
    np.testing.assert_array_equal(plain.p_d, turned.p_d)
    np.testing.assert_array_equal(plain.p_fa, turned.p_fa)
    assert plain.area_band() == turned.area_band()
    assert plain.band_at(0.3) == turned.band_at(np.exp(0.9))


def test_a_curve_that_is_known_and_declared_are_those_strictly_below_the_threshold():
    found = make_roc(np.array([1.0, 2.0, 2.0, 3.0]), np.array([True, True, False, False]))
    np.testing.assert_array_equal(found.p_d, [0, 0.5, 1, 1])
    np.testing.assert_array_equal(found.p_fa, [0, 0, 0.5, 1])
    assert found.area == 0.875
    shares = {1.0: (0.0, 0.0), 2.0: (0.5, 0.0), 2.0001: (1.0, 0.5), np.inf: (1.0, 1.0)}
    assert {at: found.at(at) for at in shares} == shares


def test_what_was_not_judged_counts_neither_way_and_a_walk_of_such_cases_is_none(rng):
    """It tells nothing of how much walks differ; counted as one that agrees with the mean it would narrow the band."""
    statistic, signal, walk = drawn(rng)
    without = rng.random(len(walk)) < 0.3
    holed = np.where(without, np.nan, statistic)
    there, kept = make_roc(holed, signal, walk), make_roc(statistic[~without], signal[~without], walk[~without])
    assert (there.area, there.at(-0.5)) == (kept.area, kept.at(-0.5))
    assert there.area != make_roc(statistic, signal, walk).area
    mute = np.where(walk >= 4, np.nan, statistic)
    few, silent = make_roc(statistic[walk < 4], signal[walk < 4], walk[walk < 4]), make_roc(mute, signal, walk)
    assert silent.n_walks == 4
    assert (silent.area_band(), silent.band_at(-0.6)) == (few.area_band(), few.band_at(-0.6))
    alone = make_roc(np.where(walk == 0, statistic, np.nan), signal, walk).area_band()
    assert (alone.low, alone.high, alone.n) == (alone.median, alone.median, 1)


@pytest.mark.parametrize("of_walk", [0.0, 0.8])
def test_bands_cover_what_they_claim(of_walk):
    """Drawn anew 400 times, with walks that differ and without: a band of 90 % misses the truth one time in ten."""
    rng = np.random.default_rng(11)
    rocs = [make_roc(*drawn(rng, of_walk=of_walk)) for _ in range(400)]
    spread = np.sqrt(1 + of_walk**2)
    true = (norm.cdf(SHIFT / np.sqrt(2 + of_walk**2)), norm.cdf((-0.6 + SHIFT) / spread), norm.cdf(-0.6))
    found = [(roc.area_band(), *roc.band_at(-0.6)) for roc in rocs]
    inside = [[band.low <= figure <= band.high for figure, band in zip(true, bands, strict=True)] for bands in found]
    covered = np.mean(inside, axis=0)
    assert ((covered > 0.85) & (covered < 0.95)).all(), covered


def test_a_band_by_stances_would_be_too_narrow(rng):
    """Walks that differ: taking each stance for a walk of its own covers far less than it claims."""
    covered = []
    for _ in range(60):
        statistic, signal, _ = drawn(rng, walks=5, cases=40, of_walk=0.8)
        band = make_roc(statistic, signal, np.arange(len(signal))).area_band()
        covered.append(band.low <= norm.cdf(SHIFT / np.sqrt(2.64)) <= band.high)
    assert np.mean(covered) < 0.7


def test_where_one_walk_holds_all_signals_nothing_is_known_and_what_cannot_be_is_said(rng):
    statistic, signal, walk = drawn(rng)
    band = make_roc(statistic, (walk == 2) & (statistic < 0.5), walk).area_band()
    assert (band.low, band.high) == (0.0, 1.0)
    for some, of, words in (
        (statistic, np.zeros(600, dtype=bool), "600 judged cases have no signal among them"),
        (statistic, np.ones(600, dtype=bool), "are all signals"),
        (np.full(600, np.nan), signal, "none of the 600 cases has a statistic"),
    ):
        with pytest.raises(EvaluationError, match=words):
            make_roc(some, of, walk)


# --- what is true ----------------------------------------------------------------------------------------------------


def test_a_field_changes_by_its_whole_way_also_where_it_comes_back_and_however_the_map_is_turned():
    field = NORTH + np.arange(10.0)[:, None] * [0.3, 0.0, 0.0]
    np.testing.assert_allclose(measure_field_change(field, 1)[1:], 0.3)
    change = measure_field_change(field, 3)
    np.testing.assert_allclose(change, [np.nan] * 3 + [0.9] * 7)
    field = NORTH + np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0])[:, None] * [0.0, 0.0, 1.0]
    np.testing.assert_allclose(measure_field_change(field, 3), [np.nan, np.nan, np.nan, 2.0, 2.0, 0.0])
    field = NORTH + np.random.default_rng(2).normal(scale=3.0, size=(50, 3))
    there, turned_map = measure_field_change(field, 2), measure_field_change(field @ yaw_rotation(1.0).T, 2)
    np.testing.assert_allclose(there, turned_map, atol=1e-12)


def test_deviation_is_the_error_of_a_perfect_compass():
    """A level sensor at any heading, in a field turned off the Earth's, read as every compass of the library is."""
    earth, *field = [yaw_rotation(-angle) @ NORTH for angle in np.deg2rad([4.0, 4.0, 14.0, -20.0, 179.0])]
    nav_R_body = yaw_rotation(0.8)
    shown = [compute_field_heading(rotate_to_level(nav_R_body.T @ b, nav_R_body[2])) for b in (earth, *field)]
    found = measure_compass_deviation(np.array(field), earth)
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * (np.array(shown[1:]) - shown[0])), atol=1e-12)
    assert np.rad2deg(found[1]) == pytest.approx(-10.0)


def test_course_of_a_straight_way_and_of_a_circle():
    straight = np.arange(8.0)[:, None] * [0.5, 1.0, 0.0]
    np.testing.assert_allclose(measure_course_change(straight, 3)[3:], 0.0, atol=1e-12)
    angle = np.deg2rad(25.0) * np.arange(8)
    change = np.rad2deg(measure_course_change(np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), 3))
    np.testing.assert_allclose(change, [np.nan] * 3 + [50.0] * 5)


def test_the_simulator_tells_the_field_where_the_sensor_is():
    """It is what the magnetometer shows once its iron is taken off and the true attitude turns it."""
    walk = simulate("demo", 5)
    sample = np.arange(0, len(walk.recording.t), 997)
    iron, soft = (np.array(walk.drawn["sensor"][key]) for key in ("hard_iron_uT", "soft_iron"))
    corrected = np.linalg.solve(soft, (walk.recording.mag[sample] - iron).T).T
    shown = np.einsum("nij,nj->ni", walk.recording.truth.nav_R_body[sample], corrected)
    assert np.nanmedian(np.linalg.norm(shown - walk.nav_field(sample), axis=1)) < 1.5
    assert np.nanmedian(np.linalg.norm(walk.nav_field(sample) - walk.earth.vector, axis=1)) > 3.0
