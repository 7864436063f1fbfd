"""The scripts on real fields and on calibration from a walk: what they measure, and that they run."""

import re

import numpy as np

from tests.real_data import DATA, needs_data
from tests.scripts import load_script

real_fields = load_script("real_fields")
calibration = load_script("calibration")


def test_on_a_smooth_field_the_walk_finds_what_a_compass_needs():
    walk = calibration.calibrate_walk("loop", "smooth", 106)
    before, calibrated, free = walk.spread_deg
    assert not walk.refused
    assert np.abs(walk.error[:3]).max() < 0.5
    assert calibrated < free + 0.5
    assert calibrated < before


def test_walks_in_a_building_err_as_their_sigmas_say():
    """Hard iron per axis, circles and loops; the table of `scripts/calibration.py walk` in the small."""
    found = [calibration.calibrate_walk(*case, seed) for case in SMALL for seed in range(201, 204)]
    over = np.array([outcome.error[:3] / outcome.sigma[:3] for outcome in found])
    assert 0.6 < np.sqrt(np.mean(over**2)) < 1.5
    assert np.abs(over).max() < 4.0


SMALL = [(course, level) for course in ("circle", "loop") for level in ("homogeneous", "indoor")]


def test_walks_are_calibrated_and_printed(capsys):
    calibration.main(["walk", "--course", "straight", "--seeds", "1"])
    out = capsys.readouterr().out
    assert re.search(r"straight +indoor +[01]/1", out)


@needs_data
def test_real_fields_are_surveyed(capsys):
    real_fields.main(["--data", str(DATA), "--walks", "gdin 31", "gdin 24", "--draws", "1"])
    out = capsys.readouterr().out
    assert re.search(r"gdin 31 +34 ", out)
    assert re.search(r"median +\d+\.\d +\d+\.\d", out)
