"""The ellipsoid fit, against sensors with known iron, and what it refuses."""

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from fg_nav.calibration import UPPER, ellipsoid
from fg_nav.calibration.ellipsoid import fit_constrained_quadric, fit_ellipsoid, fit_unit_sphere, measure_coverage
from fg_nav.errors import CalibrationError

STRENGTH = 48.0


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


def test_with_the_strength_unknown_the_size_of_c_is_no_parameter():
    """Its covariance has no room for a change of the determinant: trace(C^-1 dC) = 0."""
    for strength, expected in ((None, 0.0), (STRENGTH, 0.5 / 20 / STRENGTH)):  # three numbers' worth, if known
        found = fit_ellipsoid(sensor(3)[0], strength)
        by_size = np.linalg.inv(found.correction)[UPPER] * np.where(UPPER[0] == UPPER[1], 1.0, 2.0)
        variance = by_size @ found.covariance[3:, 3:] @ by_size
        assert np.sqrt(max(variance, 0.0)) / 3 == pytest.approx(expected, rel=0.3, abs=1e-7)


@pytest.mark.parametrize(
    ("fit", "strength"), [(fit_ellipsoid, STRENGTH), (fit_ellipsoid, None), (fit_unit_sphere, STRENGTH)]
)
def test_errors_are_as_large_as_their_sigmas(fit, strength):
    """In each direction of the nine parameters; with the strength unknown the size of C is none."""
    errors = []
    for seed in range(100):
        readings, hard, C = sensor(seed)
        C = C / np.cbrt(np.linalg.det(C)) if strength is None else C
        found = fit(readings, strength)
        errors.append((found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 0.85 < np.sqrt(np.mean(np.square(rms))) < 1.2
    assert rms.min() > 0.7
    assert rms.max() < 1.4
    assert fit_ellipsoid(sensor(2, count=4000)[0]).residual_uT == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize("within", [None, np.deg2rad(90.0)])
def test_wild_readings_do_not_matter_and_are_counted(within, monkeypatch):
    readings, hard, C = sensor(4, within=within)
    wild = readings.copy()
    wild[::25] += 20.0 * np.random.default_rng(5).standard_normal((16, 3))
    wild = np.vstack([wild, np.full((100, 3), np.nan)])  # rows without a field are left out
    found, clean = fit_ellipsoid(wild, STRENGTH), fit_ellipsoid(readings, STRENGTH)
    error = (found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma
    assert np.abs(error).max() < 4.0
    assert found.sigma == pytest.approx(clean.sigma, rel=0.15)
    assert 380 <= found.samples <= 390
    assert "of all directions covered" in found.notes[0]
    assert f"{400 - found.samples} of 400 readings left out" in found.notes[1]
    monkeypatch.setattr(ellipsoid, "MAX_SIGMA", np.inf)
    monkeypatch.setattr(ellipsoid, "MAX_RESIDUAL", np.inf)
    assert np.abs(fit_unit_sphere(wild, STRENGTH).hard_iron_uT - hard).max() > 0.5  # which the sphere is spoilt by


def test_the_constraint_keeps_to_ellipsoids_where_plain_least_squares_finds_others():
    """On a cap of 35 degrees with noise: always an ellipsoid, whatever it is worth."""
    for seed in range(30):
        readings, _, _ = sensor(seed, noise_uT=1.0, count=100, within=np.deg2rad(35.0))
        assert np.linalg.eigvalsh(fit_constrained_quadric(readings)[1]).min() > 0.0


@pytest.mark.parametrize("strength", [STRENGTH, None])
def test_too_narrow_a_tumbling_is_refused_with_its_weakest_direction(strength, monkeypatch):
    rng = np.random.default_rng(10)
    up, angle = np.sin(np.deg2rad(rng.uniform(-6.0, 6.0, 400))), rng.uniform(0.0, 2 * np.pi, 400)
    flat = np.column_stack([np.sqrt(1 - up**2) * np.cos(angle), np.sqrt(1 - up**2) * np.sin(angle), up])
    readings = STRENGTH * flat + 0.5 * rng.standard_normal((400, 3))
    with pytest.raises(CalibrationError, match=r"weakest along \(.0\.0\d, .0\.0\d, [+-]1\.00\)"):
        fit_ellipsoid(readings, strength)
    readings = sensor(11, within=np.deg2rad(60.0))[0]
    found = fit_ellipsoid(readings, strength)
    monkeypatch.setattr(ellipsoid, "MAX_SIGMA", 0.5 * found.sigma[:3].max() / found.strength_uT)
    with pytest.raises(CalibrationError, match="open"):
        fit_ellipsoid(readings, strength)


BALL = STRENGTH * np.array([[0.0, 0.0, 1.0]]) + 0.3 * np.random.default_rng(5).standard_normal((2000, 3))
Z, ANGLE = np.random.default_rng(4).uniform([[-1.5], [0.0]], [[1.5], [2 * np.pi]], (2, 200))
HYPERBOLOID = 20.0 * np.column_stack([np.sqrt(1 + Z**2) * np.cos(ANGLE), np.sqrt(1 + Z**2) * np.sin(ANGLE), Z])
REFUSED = {
    "few": (np.ones((5, 3)), "5 whole readings"),
    "nan": (np.full((50, 3), np.nan), "0 whole readings"),
    "a place": (np.ones((50, 3)), "no ellipsoid"),
    "a plane": (sensor(0)[0] * [1.0, 1.0, 0.0], "no ellipsoid"),
    "a hyperboloid": (HYPERBOLOID, "no ellipsoid|of all directions covered|not the same everywhere|open"),
    "not turned": (BALL, "was it turned"),  # noise about one reading is a ball, and a ball is an ellipsoid
    "T": (1e-6 * sensor(0)[0], "readings in uT"),
    "small": (0.09 * sensor(0)[0], r"strong, .* readings in uT"),
    "nT": (1e3 * sensor(0)[0], r"strong, .* readings in uT"),
    "a cap": (sensor(0, within=np.deg2rad(25.0))[0], "of all directions covered"),
    "a field each": (sensor(13, noise_uT=4.0, count=4000)[0], "not the same everywhere"),
}


@pytest.mark.parametrize("what", REFUSED)
@pytest.mark.parametrize("fit", [fit_unit_sphere, fit_ellipsoid])
def test_what_is_no_ellipsoid_or_would_calibrate_wrongly_is_refused(fit, what):
    readings, words = REFUSED[what]
    with pytest.raises(CalibrationError, match=words):
        fit(readings)
    for strength in (0.0, -48.0, np.nan, np.inf):
        with pytest.raises(CalibrationError, match="is none"):
            fit(sensor(0)[0], strength)


@pytest.mark.parametrize("strength", [1.0, STRENGTH])
def test_exact_readings_come_to_lie_on_the_sphere(strength):
    """Along an axis of the ellipsoid, of this length, a reading is taken to length 1 on that axis."""
    readings, hard, C = sensor(0, noise_uT=0.0)
    found = fit_unit_sphere(readings, strength)
    assert found.hard_iron_uT == pytest.approx(hard, abs=1e-6)
    assert found.correction == pytest.approx(C * strength / STRENGTH, abs=1e-8)
    assert np.linalg.norm(found.correct(readings), axis=1) == pytest.approx(strength)
    assert found.strength_uT == strength
    scale, axes = np.linalg.eigh(found.correction)
    assert found.correct(hard + (axes / scale).T) == pytest.approx(axes.T, abs=1e-6)


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
