"""The scripts on real fields and on calibration from a walk: what they measure, and that they run."""

import re

import numpy as np
import pytest

from fg_nav.calibration import calibrate_on_walk, circular_sd_deg, correct_field, find_level_iron
from fg_nav.frames import wrap_angle
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

real_fields = load_script("real_fields")
calibration = load_script("calibration")


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
    real_fields.main(["--data", str(DATA), "--walks", "gdin 31", "gdin 24", "--draws", "1"])
    out = capsys.readouterr().out
    assert re.search(r"gdin 31 +34 ", out)
    assert re.search(r"median +\d+\.\d +\d+\.\d", out)
