"""The scripts about calibration: what they measure, on a few seeds."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.lab.reproduce.ma2018 import loop as ma2018_loop
from fg_nav.lab.simulation.sensors.magnetometer import MA_ETA_RAD, MA_OFFSET_UT, MA_TAU
from tests.scripts import load_script

script = load_script("calibration")


@pytest.fixture(scope="module")
def loop():
    return ma2018_loop.walk_loop(1)


def test_the_loop_gives_table_1_back(loop):
    offset, eta, tau = errors_of(loop.ellipse["ellipse, fitted"])
    assert offset < 0.3
    assert eta < 0.03
    assert tau < 0.02
    assert errors_of(loop.ellipse["ellipse, by extremes"])[1] > eta


def errors_of(shape):
    """Errors of offset (uT, the longer component), eta (rad) and tau."""
    eta = (shape[2] - MA_ETA_RAD + np.pi / 2) % np.pi - np.pi / 2
    return np.abs(shape[:2] - MA_OFFSET_UT).max(), abs(eta), abs(shape[3] - MA_TAU)


def test_on_the_shoe_beats_free_of_the_shoe(loop):
    largest = {name: ma2018_loop.heading_errors([loop], name)[0].max() for name in loop.heading}
    assert largest["ellipse, fitted"] < 5.0
    assert largest[ma2018_loop.CLSEF] > 1.5 * largest["ellipse, fitted"]


def test_a_bare_sensor_used_bare_is_right():
    """What is wrong with it on the shoe is the shoe: on the readings it was made from the ellipsoid holds."""
    prior = ma2018_loop.preset(ma2018_loop.SENSOR).with_iron(ma2018_loop.bare_of_table_1(np.eye(3)))
    readings = ma2018_loop.tumble(prior, 1)
    found = ma2018_loop.fit_ellipsoid(readings)
    strength = np.linalg.norm(found.correct(readings[np.isfinite(readings).all(axis=1)]), axis=1)
    assert found.hard_iron_uT == pytest.approx(ma2018_loop.MA_B_UT, abs=0.1)
    assert np.std(strength) < 0.3


def test_a_refusal_counts_as_infinite(loop):
    refused = replace(loop, heading={"refused": np.empty(0)})
    largest, rms = ma2018_loop.heading_errors([refused], "refused")
    assert np.isinf([largest[0], rms[0]]).all()


@pytest.mark.parametrize("way", script.WAYS)
@pytest.mark.parametrize("strength", [script.STRENGTH_UT, None])
def test_the_ellipsoid_is_as_wrong_as_it_says(way, strength):
    """rms of standardised errors, 40 seeds: 0.8 to 1.3 all in all, and no parameter far from it."""
    errors = np.array([script.standardize_errors(seed, way, strength) for seed in range(40)])
    assert 0.8 < script.rms_of_all(list(errors)) < 1.3
    assert (np.sqrt((errors**2).mean(axis=0)) < 1.5).all()
    assert (np.sqrt((errors**2).mean(axis=0)) > 0.6).all()


def test_consistency_prints_a_row_a_way(capsys):
    script.main(["ellipsoid", "--seeds", "2"])
    printed = capsys.readouterr().out
    assert all(way in printed for way in script.WAYS)
    assert "C_zz" in printed
