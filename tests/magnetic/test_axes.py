"""The axes of the magnetometer against the gyroscope: wrong ones are named, right ones never."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import MagneticError
from fg_nav.io import read
from fg_nav.magnetic.axes import MagAxes, align_magnetometer, field_points_up, find_wrong_axes
from fg_nav.pipeline import prepare_walk
from fg_nav.walk import Options, Walk
from tests.magnetic.turning_walks import minute
from tests.real_data import DATA, needs_data

TEN = ("y,x,-z", "-x,-y,z", "x,-y,-z", "-x,y,-z", "y,z,x", "x,y,-z", "-x,y,z", "y,x,z", "-z,y,x", "x,-z,-y")
"""Five rotations, five mirrors; half turns about the axis about which a foot turns most among them."""


@pytest.mark.parametrize("words", TEN)
@pytest.mark.parametrize(("seed", "field", "lag_s"), [(5, "indoor", 0.022), (6, "smooth", 0.0)])
def test_permutations_and_mirrors_are_named(words, seed, field, lag_s):
    right, axes = minute(seed, lag_s, field), MagAxes.parse(words)
    turned = MagAxes(axes.P.T).apply_to(right)  # what a chip soldered on like this reads
    found = find_wrong_axes(turned)
    assert str(found) == words
    assert ("mirrored" in found.warning) == (np.linalg.det(axes.P) < 0)
    np.testing.assert_array_equal(found.apply_to(turned).mag, right.mag)


def test_right_axes_are_not_accused():
    for field in ("homogeneous", "smooth", "indoor"):
        for lag_s in (0.0, 0.022, 0.08):
            for seed in (1, 5):
                assert find_wrong_axes(minute(seed, lag_s, field)) is None


def test_all_axes_reversed_cannot_be_told_by_turning_but_by_the_vertical_and_too_little_turning_accuses_none():
    recording = minute(5, 0.022)
    reversed_ = MagAxes(-np.eye(3)).apply_to(recording)
    assert find_wrong_axes(reversed_) is None
    assert field_points_up(reversed_)
    up = recording.truth.nav_R_body[:, 2]  # and near the equator the field is level, which is not clearly up
    level = recording.mag - (recording.mag * up).sum(axis=1).mean() * up
    for mag in (recording.mag, level):
        assert not field_points_up(replace(recording, mag=mag))
    wrong = MagAxes.parse("y,x,-z").apply_to(recording)
    assert find_wrong_axes(wrong) is not None
    assert find_wrong_axes(wrong.slice(0, 1500)) is None


def test_axes_are_read_as_they_are_written_and_what_names_none_is_refused():
    assert [str(MagAxes.parse(words)) for words in TEN] == list(TEN)
    assert str(MagAxes.parse("+x, -y, z")) == "x,-y,z"
    for words in ("x,y", "x,y,y", "x,y,w", "", "x,y,--z", "x y z", "x,y,z,x"):
        with pytest.raises(MagneticError, match="names no axes"):
            MagAxes.parse(words)


def test_a_magnetometer_with_wrong_axes_is_not_used_unless_they_are_given():
    axes = MagAxes.parse("y,x,-z")
    right = minute(5, 0.022)
    turned = MagAxes(axes.P.T).apply_to(right)
    walk = prepare_walk(Walk.of(turned))
    assert walk.recording.mag is None
    assert walk.field is None
    assert any("not used" in note and "--mag-axes=y,x,-z" in note for note in walk.notes)
    assert "--mag-axes" in walk.unjudged
    given = prepare_walk(Walk.of(turned, Options(mag_axes=axes)))
    np.testing.assert_array_equal(given.recording.mag, prepare_walk(Walk.of(right)).recording.mag)
    assert not any("mag-axes" in note for note in given.notes)
    forced = prepare_walk(Walk.of(turned, Options(mag_axes=MagAxes.parse("x,y,z"))))
    assert forced.recording.mag is not None
    assert any("used all the same" in note for note in forced.notes)


@needs_data
@pytest.mark.parametrize(
    "name",
    [
        "gdin/own/SensorConnectData_36.csv",
        "gdin/own_obsolete/SensorConnectData_22.csv",
        "openshoe/data_inert1.txt",
        "broad/01_undisturbed_slow_rotation_A.mat",
    ],
)
def test_real_magnetometers_are_not_accused_and_named_where_they_are_turned(name):
    recording = read(DATA / name)
    assert align_magnetometer(recording).wrong_axes is None
    for words in TEN[:4]:
        turned = MagAxes(MagAxes.parse(words).P.T).apply_to(recording)
        assert str(find_wrong_axes(turned)) == words
