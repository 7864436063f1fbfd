"""The ellipsoid fit, against sensors with known iron, and what it refuses."""

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from fg_nav.calibration import UPPER, ellipsoid
from fg_nav.calibration.ellipsoid import fit_constrained_quadric, fit_ellipsoid, measure_coverage
from fg_nav.errors import CalibrationError
from fg_nav.lab.extremes import upper_triangular

STRENGTH = 48.0
MA_K = np.array([[1.027, 0.037, 0.046], [0.0, 1.018, -0.002], [0.0, 0.0, 1.062]])  # Ma et al. 2018, Table 1
MA_B = np.array([14.336, 7.975, -5.641])


def directions(rng, count=400, within=None):
    """Unit vectors; within an angle (rad) of the z axis if given."""
    many = rng.standard_normal((count if within is None else 40 * count, 3))
    many /= np.linalg.norm(many, axis=1, keepdims=True)
    return many[:count] if within is None else many[many[:, 2] > np.cos(within)][:count]


def sensor(seed, noise_uT=0.5, count=400, within=None):
    """Readings, hard iron, and the symmetric correction that they can tell."""
    rng = np.random.default_rng(seed)
    hard, soft = 15.0 * rng.standard_normal(3), np.eye(3) + 0.06 * rng.standard_normal((3, 3))
    readings = STRENGTH * directions(rng, count, within) @ soft.T + hard
    return readings + noise_uT * rng.standard_normal(readings.shape), hard, polar(np.linalg.inv(soft))[1]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("within", [None, np.deg2rad(80.0)])
def test_exact_readings_give_the_exact_iron(seed, within):
    readings, hard, C = sensor(seed, noise_uT=0.0, within=within)
    known, unknown = fit_ellipsoid(readings, STRENGTH), fit_ellipsoid(readings)
    scale = np.cbrt(np.linalg.det(C))
    for found, strength, matrix in ((known, STRENGTH, C), (unknown, STRENGTH / scale, C / scale)):
        assert found.hard_iron_uT == pytest.approx(hard, abs=1e-5)
        assert found.correction == pytest.approx(matrix, abs=1e-6)
        assert found.strength_uT == pytest.approx(strength, rel=1e-6)
        assert np.linalg.norm(found.correct(readings), axis=1) == pytest.approx(strength, rel=1e-6)
    assert np.linalg.det(unknown.correction) == pytest.approx(1.0)


@pytest.mark.parametrize("strength", [STRENGTH, None])
def test_a_turned_sensor_has_the_same_iron_turned(strength):
    readings, _, _ = sensor(1)
    R = Rotation.from_euler("xyz", [0.4, -1.0, 2.0]).as_matrix()
    one, other = fit_ellipsoid(readings, strength), fit_ellipsoid(readings @ R.T, strength)
    assert other.hard_iron_uT == pytest.approx(R @ one.hard_iron_uT, abs=1e-4)
    assert other.correction == pytest.approx(R @ one.correction @ R.T, abs=1e-6)
    assert other.residual_uT == pytest.approx(one.residual_uT)


def test_the_residual_is_the_noise_of_a_reading():
    assert fit_ellipsoid(sensor(2, count=4000)[0]).residual_uT == pytest.approx(0.5, rel=0.05)


def test_twice_the_noise_doubles_sigma_and_four_times_the_readings_halve_it():
    once, twice, long = (
        fit_ellipsoid(sensor(2, noise, count)[0]).sigma for noise, count in ((0.3, 500), (0.6, 500), (0.3, 2000))
    )
    assert twice == pytest.approx(2 * once, rel=0.25)
    assert long == pytest.approx(once / 2, rel=0.25)


def test_with_the_strength_unknown_the_size_of_c_is_no_parameter():
    """Its covariance has no room for a change of the determinant: trace(C^-1 dC) = 0."""
    found = fit_ellipsoid(sensor(3)[0])
    by_size = np.linalg.inv(found.correction)[UPPER] * np.where(UPPER[0] == UPPER[1], 1.0, 2.0)
    variance = by_size @ found.covariance[3:, 3:] @ by_size
    assert variance == pytest.approx(0.0, abs=1e-6 * found.covariance[3:, 3:].max())
    known = fit_ellipsoid(sensor(3)[0], STRENGTH)
    by_size = np.linalg.inv(known.correction)[UPPER] * np.where(UPPER[0] == UPPER[1], 1.0, 2.0)
    # of the size, three numbers' worth: a strength that is known to 0.5 / sqrt(400) of 48
    assert np.sqrt(by_size @ known.covariance[3:, 3:] @ by_size) / 3 == pytest.approx(0.5 / 20 / STRENGTH, rel=0.3)


@pytest.mark.parametrize("within", [None, np.deg2rad(90.0)])
def test_wild_readings_do_not_matter_and_are_counted(within):
    readings, hard, C = sensor(4, within=within)
    wild = readings.copy()
    wild[::25] += 20.0 * np.random.default_rng(5).standard_normal((16, 3))
    found, clean = fit_ellipsoid(wild, STRENGTH), fit_ellipsoid(readings, STRENGTH)
    error = (found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma
    assert np.abs(error).max() < 4.0
    assert found.sigma == pytest.approx(clean.sigma, rel=0.15)
    assert 380 <= found.samples <= 390
    assert f"{400 - found.samples} of 400 readings left out" in found.notes[1]


def test_ma_table_in_its_own_form():
    """K_c is upper triangular: the same strengths as the symmetric form, and found again from readings."""
    readings = np.linalg.solve(MA_K, STRENGTH * directions(np.random.default_rng(6)).T).T + MA_B
    found = fit_ellipsoid(readings, STRENGTH)
    assert found.hard_iron_uT == pytest.approx(MA_B, abs=1e-4)
    assert upper_triangular(found.correction) == pytest.approx(MA_K, abs=1e-6)
    assert upper_triangular(polar(MA_K)[1]) == pytest.approx(MA_K)


def test_the_constraint_keeps_to_ellipsoids_where_plain_least_squares_finds_others():
    """On a cap of 35 degrees with noise: always an ellipsoid, whatever it is worth; the plain fit turns inside out."""
    turned_out = 0
    for seed in range(30):
        readings, _, _ = sensor(seed, noise_uT=1.0, count=100, within=np.deg2rad(35.0))
        _, C = fit_constrained_quadric(readings)
        assert np.linalg.eigvalsh(C).min() > 0.0
        x = (readings - readings.mean(axis=0)) / 10.0
        columns = np.column_stack([x**2, x[:, [0]] * x[:, 1:], x[:, 1] * x[:, 2], x, np.ones(len(x))])
        a = np.linalg.svd(columns)[2][-1]
        A = np.array([[2 * a[0], a[3], a[4]], [a[3], 2 * a[1], a[5]], [a[4], a[5], 2 * a[2]]])
        turned_out += int(np.ptp(np.sign(np.linalg.eigvalsh(A))) > 0)
    assert turned_out > 5


def test_rows_without_a_field_are_left_out():
    readings = sensor(8)[0]
    readings[::4] = np.nan
    assert fit_ellipsoid(readings).samples == 300


def test_the_notes_begin_with_the_coverage():
    assert fit_ellipsoid(sensor(9)[0]).notes[0].startswith("99 % of all directions covered")


@pytest.mark.parametrize("strength", [STRENGTH, None])
def test_too_narrow_a_tumbling_is_refused_with_its_weakest_direction(strength):
    rng = np.random.default_rng(10)
    up, angle = np.sin(np.deg2rad(rng.uniform(-6.0, 6.0, 400))), rng.uniform(0.0, 2 * np.pi, 400)
    flat = np.column_stack([np.sqrt(1 - up**2) * np.cos(angle), np.sqrt(1 - up**2) * np.sin(angle), up])
    readings = STRENGTH * flat + 0.5 * rng.standard_normal((400, 3))
    with pytest.raises(CalibrationError, match=r"weakest along \(.0\.0\d, .0\.0\d, [+-]1\.00\)"):
        fit_ellipsoid(readings, strength)


def test_a_field_that_changes_from_place_to_place_is_refused():
    with pytest.raises(CalibrationError, match="not the same everywhere"):
        fit_ellipsoid(sensor(13, noise_uT=4.0, count=4000)[0])


def test_how_much_may_stay_open_is_limited(monkeypatch):
    readings = sensor(11, within=np.deg2rad(60.0))[0]
    found = fit_ellipsoid(readings)
    monkeypatch.setattr(ellipsoid, "MAX_SIGMA", 0.5 * found.sigma[:3].max() / found.strength_uT)
    with pytest.raises(CalibrationError, match="open"):
        fit_ellipsoid(readings)


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        (np.ones((5, 3)), "5 whole readings"),
        (np.ones((50, 3)), "no ellipsoid"),
        (sensor(0)[0] * [1.0, 1.0, 0.0], "no ellipsoid"),
        (np.full((50, 3), np.nan), "0 whole readings"),
    ],
    ids=["few", "one place", "a plane", "nothing"],
)
def test_what_is_no_ellipsoid_is_refused(readings, words):
    with pytest.raises(CalibrationError, match=words):
        fit_ellipsoid(readings)


@pytest.mark.parametrize("strength", [0.0, -48.0, np.nan, np.inf])
def test_a_field_has_a_strength(strength):
    with pytest.raises(CalibrationError, match="is none"):
        fit_ellipsoid(sensor(0)[0], strength)


def test_coverage_of_all_of_half_and_of_a_plane():
    rng = np.random.default_rng(12)
    everywhere = measure_coverage(STRENGTH * directions(rng, 5000))
    half = measure_coverage(directions(rng, 5000, within=np.pi / 2))
    plane = measure_coverage(directions(rng, 5000) * [1.0, 1.0, 1e-6])
    (share, _, weakest_share), (of_half, _, weakest_of_half), (_, across, of_plane) = everywhere, half, plane
    assert (share, weakest_share) == pytest.approx((1.0, 1.0), abs=0.05)
    assert 0.5 < of_half < 0.65  # patches on the rim count
    assert weakest_of_half == pytest.approx(1.0, abs=0.05)  # a half is weak on one side only
    assert of_plane == pytest.approx(0.0, abs=1e-6)
    assert np.abs(across) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
