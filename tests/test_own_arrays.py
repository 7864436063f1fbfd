"""Recordings of the user's own arrays and data frames: the units, shapes and checks of a file's."""

import doctest
import importlib

import numpy as np
import pandas as pd
import pytest

from fg_nav.errors import FgNavError, FormatError, RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from tests.io.samples import tilting

RAW = tilting(np.random.default_rng(41), duration_s=4.0, rate_hz=100.0, still_s=1.0)
ACC_G, GYR_DEG_S = RAW.acc / GRAVITY_M_S2, np.degrees(RAW.gyr)


def is_the_same(recording: Recording, mag: bool = True) -> bool:
    np.testing.assert_allclose(recording.t, RAW.t, atol=1e-9)
    np.testing.assert_allclose(recording.acc, RAW.acc, rtol=1e-12)
    np.testing.assert_allclose(recording.gyr, RAW.gyr, rtol=1e-12)
    if mag:
        np.testing.assert_allclose(recording.mag, RAW.mag, rtol=1e-12)
    return (recording.mag is not None) == mag


def frame_of(*names: str) -> pd.DataFrame:
    return pd.DataFrame(np.column_stack([RAW.t * 1e3, ACC_G, GYR_DEG_S]), columns=list(names))


def test_examples_in_docstrings_run():
    for name in ("columns.headers", "columns.mapping"):
        found = doctest.testmod(importlib.import_module(f"fg_nav.{name}"), extraglobs={"pd": pd})
        assert found.attempted > 0
        assert found.failed == 0


def test_arrays_in_si_and_in_other_units():
    assert is_the_same(Recording.from_arrays(RAW.t, RAW.acc, RAW.gyr, RAW.mag))
    own = (RAW.t * 1e6, ACC_G, GYR_DEG_S, RAW.mag / 100)
    assert is_the_same(Recording.from_arrays(*own, units="us, g, deg/s, gauss"))
    assert is_the_same(Recording.from_arrays(*own, units={"time": "µs", "acc": "g", "gyr": "°/s", "mag": "G"}))
    lists = [array.tolist() for array in (RAW.t, RAW.acc, RAW.gyr)]
    assert is_the_same(Recording.from_arrays(*lists), mag=False)
    t = np.datetime64("2026-01-01T10:00") + (RAW.t * 1e9).astype("timedelta64[ns]")  # whatever the unit
    recording = Recording.from_arrays(t, ACC_G, RAW.gyr, units={"acc": "g"})
    np.testing.assert_allclose(recording.t - recording.t[0], RAW.t, atol=1e-6)


@pytest.mark.parametrize(
    ("own", "units", "words"),
    [
        ((RAW.t[:-1], RAW.acc, RAW.gyr), None, r"acc has shape \(400, 3\), not \(399, 3\)"),
        ((RAW.acc, RAW.acc, RAW.gyr), None, r"t has shape \(400, 3\), not \(N,\)"),
        ((RAW.t, ACC_G, RAW.gyr), None, "acc seems to be in g"),
        ((RAW.t, RAW.acc, RAW.gyr), "furlong", "'furlong' is no unit"),
        ((RAW.t, RAW.acc, RAW.gyr), {"acc": "deg/s"}, "no unit 'deg/s' of acc"),
        ((RAW.t, RAW.acc, RAW.gyr), {"force": "g"}, "units name 'force'"),
        ((RAW.t, RAW.acc, [["a", 0, 0]] * 400), None, "row 1, column 'gyr': 'a' is not a number"),
        ((RAW.t, RAW.acc, None), None, "gyr"),
    ],
)
def test_arrays_that_are_no_recording(own, units, words):
    with pytest.raises((RecordingError, FormatError), match=words):
        Recording.from_arrays(*own, units=units)


def test_data_frames_by_their_names():
    assert is_the_same(Recording.from_dataframe(frame_of("t", "ax", "ay", "az", "gx", "gy", "gz")), mag=False)
    named = frame_of("Time [ms]", *(f"Acc {a} [g]" for a in "XYZ"), *(f"Gyr {a} (deg/s)" for a in "XYZ"))
    named[["mx (uT)", "my (uT)", "mz (uT)"]] = RAW.mag
    recording = Recording.from_dataframe(named)
    assert is_the_same(recording)
    assert recording.provenance.notes == ()
    odd, columns = frame_of("stamp", *"abcdef"), {"acc": ["a", "b", "c"], "gyr": ["d", "e", "f"]}
    assert is_the_same(Recording.from_dataframe(odd, "time=stamp[ms],acc=a:b:c[g],gyr=d:e:f[deg/s]"), mag=False)
    assert is_the_same(Recording.from_dataframe(odd, columns, "g, deg/s", rate_hz=100.0), mag=False)
    dated = named.iloc[:, 1:].set_index(pd.to_datetime(RAW.t, unit="s"))
    assert is_the_same(Recording.from_dataframe(dated))
    two = named.iloc[:, :7].set_axis(
        pd.MultiIndex.from_tuples([("", "t"), *((s, a) for s in ("acc", "gyr") for a in "xyz")]), axis=1
    )
    assert is_the_same(Recording.from_dataframe(two, units="ms, g, deg/s"), mag=False)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda df: df.drop(columns="gy"), "not all three axes of angular rate, only 'gx', 'gz'.*columns="),
        (lambda df: df.drop(columns="t"), "no stamps: give its rate, such as rate_hz=100"),
        (lambda df: df.astype({"ay": object}).replace({"ay": {df["ay"][7]: "oops"}}), "row 8, column 'ay'"),
        (lambda df: df.assign(gx=0.01, gy=0.0, gz=0.0), "gyr .*names no unit.*columns="),
        (lambda df: df.iloc[:0], "fg-nav|usable|stamps|unit|rest"),
    ],
)  # fmt: skip
def test_data_frames_that_leave_something_open(change, words):
    with pytest.raises(FgNavError, match=words):
        Recording.from_dataframe(change(frame_of("t", "ax", "ay", "az", "gx", "gy", "gz")))
