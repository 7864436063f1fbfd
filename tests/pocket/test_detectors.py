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
    found = detect_gravity(T, acc)
    assert not found[:4].any()
    assert found[4:100].all()  # the fifth sample of 10 ms
    assert not found[100:204].any()
    assert found[204:300].all()
    assert not found[300:305].any()


def test_no_force_is_no_gravity():
    acc = np.full((len(T), 3), np.nan)
    acc[50:] = [0.0, 0.0, 9.81]
    found = detect_gravity(T, acc)
    assert not found[:54].any()
    assert found[54:].all()


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


def test_a_field_that_turns_is_steady_and_rows_without_one_are_left_out():
    mag = 48.0 * np.stack([np.sin(T), np.cos(T), 0 * T], axis=1)
    mag[1::2] = np.nan
    steady = detect_steady_field(T, mag, SIGMA_UT)
    assert not steady[1::2].any()
    assert not steady[:48].any()
    assert steady[50::2].all()


def test_a_passing_object_is_seen_and_forgotten():
    mag = np.tile([0.0, 21.0, -43.0], (len(T), 1))
    mag[:, 2] += 5.0 * np.exp(-(((T - 15.0) / 0.5) ** 2))
    steady = detect_steady_field(T, mag, SIGMA_UT)
    assert steady[60:1300].all()
    assert not steady[1450:1550].any()
    assert steady[1800:].all()
