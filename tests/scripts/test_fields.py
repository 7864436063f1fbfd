"""The scripts on real fields and on calibration from a walk: what they measure, and that they run."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from fg_nav.calibration import calibrate_on_walk, circular_sd_deg, correct_field, find_level_iron
from fg_nav.frames import wrap_angle
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

real_fields = load_script("real_fields")
calibration = load_script("calibration")


def judged(difference, passed):
    """Stand in for a walk."""
    verdicts = {"d": SimpleNamespace(quasi_static=np.asarray(passed))}
    return SimpleNamespace(difference=np.asarray(difference), verdicts=verdicts)


def test_a_detector_that_picks_the_good_stances_is_told_from_chance():
    rng = np.random.default_rng(1)
    difference = [0.4 * rng.standard_normal(60) for _ in range(4)]
    knowing = [np.abs(d) < 0.1 for d in difference]
    assert max(real_fields.chances(difference, knowing, 200, rng)) < 0.01


def test_a_detector_that_knows_nothing_is_not():
    rng = np.random.default_rng(2)
    shares = []
    for _ in range(60):
        difference = [0.4 * rng.standard_normal(40) for _ in range(2)]
        passed = [rng.uniform(size=40) < 0.2 for _ in difference]
        shares.append(real_fields.chances(difference, passed, 100, rng))
    assert np.mean(shares, axis=0) == pytest.approx(0.5, abs=0.12)  # uniform: 0.29 / sqrt(60) = 0.04


def test_stances_without_a_field_are_left_out_of_the_comparison():
    difference = [np.array([0.1, np.nan, -0.3, 0.2])]
    some, along = real_fields.chances(
        difference, [np.array([True, False, False, False])], 300, np.random.default_rng(3)
    )
    assert some == pytest.approx(1 / 3, abs=0.1)
    assert along == pytest.approx(1 / 3, abs=0.1)


def test_a_made_up_walk_is_what_it_says_it_is():
    walk = calibration.make_walk("demo", "smooth", "preset", 5)
    reading = walk.iron.bend(walk.free)
    assert np.std(walk.field.body_field - reading) == pytest.approx(calibration.READ_TO_UT, rel=0.2)
    # Against the drifted axes the field turns with the drift.
    level = np.einsum("nij,nj->ni", walk.field.nav_R_body, walk.free)
    toward = wrap_angle(np.arctan2(level[:, 0], level[:, 1]) - walk.drift)
    assert np.degrees(np.abs(np.median(toward))) < 6


def test_on_a_smooth_field_the_walk_finds_what_a_loop_would():
    walk = calibration.make_walk("demo", "smooth", "Ma", 6)
    found = calibrate_on_walk(walk.field)
    offset, covariance = find_level_iron(found, walk.field)
    assert np.abs(offset - walk.level_iron).max() < 2
    assert np.sqrt(np.trace(covariance)) < 3
    after = correct_field(walk.field, found).heading_difference
    assert circular_sd_deg(after) < 0.5 * circular_sd_deg(walk.field.heading_difference)


def test_walks_are_calibrated_and_the_straight_ones_refused(capsys):
    calibration.main(["walk", "--course", "straight", "--seeds", "2"])
    out = capsys.readouterr().out
    assert re.search(r"straight +indoor +preset +0/2", out)
    assert "100 % of them head within 45 deg of one direction" in out


@needs_data
def test_real_fields_are_surveyed(capsys):
    real_fields.main(["--data", str(DATA), "--walks", "gdin 31", "gdin 24", "--draws", "40"])
    out = capsys.readouterr().out
    assert re.search(r"gdin 31 +34 ", out)
    assert re.search(r"median +\d+\.\d +\d+\.\d", out)
