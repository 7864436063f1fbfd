"""Munoz Diaz's ellipsoid to the unit sphere, against known iron, and where it falls short of the likeliest one."""

import numpy as np
import pytest

from fg_nav.calibration import UPPER, ellipsoid
from fg_nav.calibration.ellipsoid import fit_ellipsoid, fit_unit_sphere
from fg_nav.errors import CalibrationError
from tests.calibration.test_ellipsoid import STRENGTH, sensor


@pytest.mark.parametrize("strength", [1.0, STRENGTH])
def test_exact_readings_come_to_lie_on_the_sphere(strength):
    readings, hard, C = sensor(0, noise_uT=0.0)
    found = fit_unit_sphere(readings, strength)
    assert found.hard_iron_uT == pytest.approx(hard, abs=1e-6)
    assert found.correction == pytest.approx(C * strength / STRENGTH, abs=1e-8)
    assert np.linalg.norm(found.correct(readings), axis=1) == pytest.approx(strength)
    assert found.strength_uT == strength


def test_rotation_translation_and_scale_are_the_ellipsoids_axes():
    """Along an axis of the ellipsoid, of this length, a reading is taken to length 1 on that axis."""
    readings, hard, _ = sensor(1, noise_uT=0.0)
    found = fit_unit_sphere(readings)
    scale, axes = np.linalg.eigh(found.correction)
    assert found.correct(hard + (axes / scale).T) == pytest.approx(axes.T, abs=1e-6)


def test_errors_are_as_large_as_their_sigmas():
    errors = []
    for seed in range(100):
        readings, hard, C = sensor(seed)
        found = fit_unit_sphere(readings, STRENGTH)
        errors.append((found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma)
    assert 0.85 < np.sqrt(np.mean(np.square(errors))) < 1.2


def test_one_wild_reading_in_a_hundred_spoils_it_and_not_the_likeliest_ellipsoid(monkeypatch):
    readings, hard, _ = sensor(2)
    readings[::100] += 40.0 * np.random.default_rng(3).standard_normal((4, 3))
    likeliest = fit_ellipsoid(readings)
    monkeypatch.setattr(ellipsoid, "MAX_SIGMA", np.inf)
    monkeypatch.setattr(ellipsoid, "MAX_RESIDUAL", np.inf)
    both = fit_unit_sphere(readings), likeliest
    errors = [np.abs(found.hard_iron_uT - hard).max() for found in both]
    assert errors[0] > 0.5
    assert errors[1] < 0.2


@pytest.mark.parametrize(
    "readings",
    [np.ones((5, 3)), np.ones((50, 3)), sensor(0)[0] * [1.0, 1.0, 0.0], np.full((50, 3), np.nan)],
    ids=["few", "one place", "a plane", "nothing"],
)
def test_what_is_no_ellipsoid_is_refused(readings):
    with pytest.raises(CalibrationError, match=r"no ellipsoid|cannot make an ellipsoid"):
        fit_unit_sphere(readings)


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        (
            STRENGTH * np.array([[0.0, 0.0, 1.0]]) + 0.3 * np.random.default_rng(5).standard_normal((2000, 3)),
            "was it turned",
        ),
        (1e-6 * sensor(0)[0], "readings in uT"),
        (0.09 * sensor(0)[0], r"strong, .* readings in uT"),
        (1e3 * sensor(0)[0], r"strong, .* readings in uT"),
        (sensor(0, within=np.deg2rad(25.0))[0], "of all directions covered"),
        (sensor(13, noise_uT=4.0, count=4000)[0], "not the same everywhere"),
    ],
    ids=["not turned", "tesla", "too small", "nanotesla", "a cap", "another field each time"],
)
@pytest.mark.parametrize("method", [fit_unit_sphere, fit_ellipsoid])
def test_what_would_calibrate_wrongly_is_refused(method, readings, words):
    """Noise about one reading is a ball, and a ball is an ellipsoid."""
    with pytest.raises(CalibrationError, match=words):
        method(readings)


@pytest.mark.parametrize("strength", [0.0, -48.0, np.nan, np.inf])
def test_a_field_has_a_strength(strength):
    with pytest.raises(CalibrationError, match="is none"):
        fit_unit_sphere(sensor(0)[0], strength)


def test_a_hyperboloid_is_refused():
    rng = np.random.default_rng(4)
    z, angle = rng.uniform(-1.5, 1.5, 200), rng.uniform(0, 2 * np.pi, 200)
    across = 20.0 * np.sqrt(1 + z**2)
    with pytest.raises(CalibrationError, match="no ellipsoid"):
        fit_unit_sphere(np.column_stack([across * np.cos(angle), across * np.sin(angle), 20.0 * z]))
