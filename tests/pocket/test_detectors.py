"""The detectors against fields and forces whose like is known."""

import numpy as np
import pytest

from fg_nav.pocket import filter as pocket_filter
from fg_nav.pocket.filter import detect_gravity, detect_steady_field

T = np.arange(3000) / 100.0
SIGMA_UT = 0.015


def test_gravity_counts_once_it_has_lasted():
    acc = np.tile([0.0, 0.0, 9.81], (len(T), 1))
    acc[100:200] *= 1.1
    acc[300] *= 1.1
    acc[400:450] = np.nan
    found = detect_gravity(T, acc)
    for first, last in ((0, 100), (200, 300), (301, 400), (450, 3000)):
        assert not found[first : first + 4].any()
        assert found[first + 4 : last].all()  # the fifth sample of 10 ms
    assert not found[100:200].any()
    assert not found[400:450].any()


def test_noise_alone_fails_as_often_as_said(monkeypatch):
    rng = np.random.default_rng(1)
    monkeypatch.setattr(pocket_filter, "FIELD_DRIFT_UT_S", 0.0)
    monkeypatch.setattr(pocket_filter, "FIELD_FALSE_ALARM", 0.05)
    t = np.arange(200_000) / 100.0
    steady = detect_steady_field(t, [20.0, 0.0, -43.0] + 0.015 * rng.standard_normal((len(t), 3)), SIGMA_UT)
    assert 1.0 - steady[49:].mean() == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize(("drift", "passes"), [(0.45, True), (0.6, False)])
def test_a_field_may_change_so_fast_and_no_faster(drift, passes):
    mag = np.stack([0 * T, 0 * T, -40.0 - drift * T], axis=1)
    assert detect_steady_field(T, mag, 1e-6)[49:].all() == passes
    assert detect_steady_field(T, mag, 1e-6)[49:].any() == passes


def test_only_a_strength_that_changes_is_seen_and_it_is_forgotten():
    """A field that turns is steady; rows without one are left out."""
    mag = 48.0 * np.stack([np.sin(T), np.cos(T), 0 * T], axis=1)
    mag *= 1.0 + 0.1 * np.exp(-(((T[:, None] - 15.0) / 0.5) ** 2))  # a passing object
    mag[1::2] = np.nan
    steady = detect_steady_field(T, mag, SIGMA_UT)
    assert not steady[1::2].any()
    assert not steady[:48].any()
    assert steady[60:1300:2].all()
    assert not steady[1450:1550].any()
    assert steady[1800::2].all()
