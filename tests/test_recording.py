"""From samples of files, arrays and data frames to a recording: each kind of bad input has its sentence."""

import doctest
import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fg_nav.errors import FgNavError, FormatError, RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Provenance, RawRecording, Recording
from fg_nav.samples.stamps import MAX_BRIDGED_S, order_stamps
from tests.io.samples import tilting

RAW = replace(tilting(np.random.default_rng(6)), provenance=Provenance(Path("some/walk.csv"), "canonical"))
assert RAW.mag is not None
MAG = RAW.mag


def _with(name: str, index: object, value: float) -> RawRecording:
    array = getattr(RAW, name).copy()
    array[index] = value
    return replace(RAW, **{name: array})


def _only(raw: RawRecording, kept: np.ndarray) -> RawRecording:
    assert raw.mag is not None
    return replace(raw, t=raw.t[kept], acc=raw.acc[kept], gyr=raw.gyr[kept], mag=raw.mag[kept], row=raw.row[kept])


def test_a_good_recording_and_its_parts_come_through_unchanged() -> None:
    """A sensor may point down, too: only specific force and turn must agree."""
    recording, flip = Recording.from_raw(RAW), np.array([1.0, -1.0, -1.0])
    part = recording.slice(100, 300)
    for name in ("t", "acc", "gyr", "mag"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(RAW, name))
        np.testing.assert_array_equal(getattr(part, name), getattr(RAW, name)[100:300])
    assert (recording.provenance, recording.provenance.notes) == (RAW.provenance, ())
    assert part.duration_s == pytest.approx(199 / 200)
    with pytest.raises(RecordingError, match="cannot make a walk"):
        part.slice(0, 5)
    assert len(Recording.from_raw(replace(RAW, acc=RAW.acc * flip, gyr=RAW.gyr * flip, mag=MAG * flip))) == len(RAW.t)


@pytest.mark.parametrize(("name", "value"), [("t", np.nan), ("acc", np.inf), ("gyr", -np.inf), ("acc", 1e300)])
def test_a_run_of_missing_samples_is_a_gap(name: str, value: float) -> None:
    recording = Recording.from_raw(_with(name, np.s_[100:150], value))
    np.testing.assert_array_equal(recording.t, np.delete(RAW.t, np.s_[100:150]))
    lost, bridged = recording.provenance.notes
    assert lost == "left out 50 missing samples, the first in row 102"
    assert bridged.startswith("1 gap of more than 0.1 s is bridged, the longest of 255 ms before row 152")
    recording = Recording.from_raw(_with(name, np.s_[:1000], value))  # at an end they are cut off
    np.testing.assert_array_equal(recording.t, RAW.t[1000:])
    assert recording.provenance.notes == ("left out 1000 missing samples, the first in row 2",)


def test_many_scattered_missing_samples_are_refused() -> None:
    with pytest.raises(RecordingError, match=r"399 of 1598 samples are missing .*first in row 6"):
        Recording.from_raw(_with("acc", np.s_[::4], np.nan))
    assert len(Recording.from_raw(_with("acc", np.s_[::15], np.nan))) == 1600 - 107


def test_same_samples_with_one_stamp_are_repeats_even_with_time_for_them() -> None:
    """As NGIMU files have them: a packet lost, and the next one written twice."""
    index = np.arange(len(RAW.t))
    index[500] = 501
    recording = Recording.from_raw(_only(RAW, index))
    np.testing.assert_array_equal(recording.t, np.delete(RAW.t, 500))
    assert recording.provenance.notes == ("left out 1 repeated stamp, the first in row 503",)
    raw = _only(RAW, np.sort(np.concatenate([np.arange(len(RAW.t)), [10, 500, 500]])))
    raw.acc[11] = 77.0  # the later row costs, whatever it says
    recording = Recording.from_raw(raw)
    np.testing.assert_array_equal(recording.acc, RAW.acc)
    assert recording.provenance.notes == ("left out 3 repeated stamps, the first in row 12",)


def test_polled_samples_that_share_a_stamp_are_all_kept() -> None:
    """A logger that looks every 6 ms for the samples of a 200 Hz sensor finds two of them at every fifth look."""
    polled = np.ceil(RAW.t / 0.006 - 1e-9) * 0.006
    assert (np.diff(polled) == 0).any()
    recording = Recording.from_raw(replace(RAW, t=polled))
    assert len(recording) == len(RAW.t)
    late = recording.t - RAW.t
    assert np.ptp(late) < 5e-4  # evened out
    spread, evened = recording.provenance.notes
    assert spread == "532 samples share their stamps with others, from row 7 on: spread evenly"
    assert evened.startswith("evened out the jitter")
    coarse = Recording.from_raw(replace(RAW, t=np.floor(RAW.t * 100 + 1e-9) / 100))
    np.testing.assert_allclose(np.diff(coarse.t), 0.005, rtol=1e-3)
    with pytest.raises(RecordingError, match=r"step by 0\.125 s, no inertial sensor's rate"):
        Recording.from_raw(replace(RAW, t=np.floor(RAW.t * 8 + 1e-9) / 8))


def test_late_samples_are_sorted() -> None:
    order = np.arange(len(RAW.t))
    order[[100, 101]] = [101, 100]
    order[300:330] = np.roll(order[300:330], 10)  # a block of ten overtaken by twenty
    recording = Recording.from_raw(_only(RAW, order))
    np.testing.assert_array_equal(recording.t, RAW.t)
    np.testing.assert_array_equal(recording.acc, RAW.acc)
    assert "sorted" in recording.provenance.notes[0]


def test_stamps_far_ahead_are_left_out() -> None:
    t = RAW.t.copy()
    t[300:303] += 60.0
    recording = Recording.from_raw(replace(RAW, t=t))
    np.testing.assert_array_equal(recording.t, np.delete(RAW.t, np.s_[300:303]))
    assert recording.provenance.notes[0] == "3 stamps, the first in row 302, far ahead of those around: left out"
    t = RAW.t.copy()
    t[300:304] -= 0.1  # late, without time for them
    recording = Recording.from_raw(replace(RAW, t=t))
    np.testing.assert_array_equal(recording.t, np.delete(RAW.t, np.s_[300:304]))
    assert "4 stamps, the first in row 302, behind later ones, where there are others" in recording.provenance.notes[0]


def test_a_clock_that_begins_again_is_set_on_where_nothing_is_missing() -> None:
    for back_s in (0.1, 1.5, 1.0e6):
        t = RAW.t.copy()
        t[300:] -= back_s
        recording = Recording.from_raw(replace(RAW, t=t))
        np.testing.assert_allclose(recording.t, RAW.t, atol=1e-8)
        np.testing.assert_array_equal(recording.gyr, RAW.gyr)
        (note,) = recording.provenance.notes
        assert note.startswith("the clock began again at row 302 (t = ")
        assert "with nothing missing" in note


def test_stamps_that_all_but_coincide_are_one() -> None:
    """A result is written to the nanosecond, in which they would not rise."""
    t = RAW.t - RAW.t[0]
    t[3:6] = t[2] + 1e-10 * np.arange(1, 4)
    found = order_stamps(t, np.column_stack([RAW.acc, RAW.gyr]), RAW.row)
    assert np.diff(found.t).min() > 1e-4


def test_a_recording_that_jumps_where_its_clock_begins_again_is_cut() -> None:
    t, acc, gyr = RAW.t.copy(), RAW.acc.copy(), RAW.gyr.copy()
    t[300:] -= t[300]
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ np.diag([1.0, -1.0, -1.0])
    acc[300:], gyr[300:] = acc[300:] @ turn.T, gyr[300:] @ turn.T
    recording = Recording.from_raw(replace(RAW, t=t, acc=acc, gyr=gyr, mag=None))
    np.testing.assert_array_equal(recording.acc, acc[300:])
    np.testing.assert_array_equal(recording.t, t[300:])
    assert recording.provenance.notes == (
        "only rows 302 to 1601 (t = 0.000 to 6.495 s) are used, and 300 samples left out: "
        "the clock begins again at row 302",
    )


def test_a_column_that_is_no_clock_is_refused() -> None:
    with pytest.raises(RecordingError, match=r"run backward 1280 times, the first at row 3: mend their column"):
        Recording.from_raw(replace(RAW, t=RAW.t.reshape(-1, 5)[:, ::-1].ravel()))


def test_short_gaps_are_noted_longer_ones_bridged_and_at_the_longest_the_recording_is_cut() -> None:
    index = np.arange(len(RAW.t))
    short = Recording.from_raw(_only(RAW, (index < 400) | (index > 415)))
    assert short.provenance.notes == ("1 gap of more than two samples, the longest of 85 ms before row 418",)
    bridged = (index < 401) | (index > 480)
    (note,) = Recording.from_raw(_only(RAW, bridged)).provenance.notes
    assert note.startswith("1 gap of more than 0.1 s is bridged, the longest of 405 ms before row 483")
    for steps, kept in ((round(MAX_BRIDGED_S * 200), 1501), (round(MAX_BRIDGED_S * 200) + 2, 1098)):
        assert len(Recording.from_raw(_only(RAW, (index < 401) | (index >= 400 + steps)))) == kept
    cut = Recording.from_raw(_only(RAW, (index < 401) | (index > 501)))
    assert cut.t[0] == RAW.t[502]
    assert cut.provenance.notes == (
        "only rows 504 to 1601 (t = 2.510 to 7.995 s) are used, and 401 samples left out: "
        "there is a gap of 0.51 s before row 504",
    )


def test_wrong_units_and_axes_are_named() -> None:
    mirrored = np.array([1, -1, 1])
    for change, message in (
        ({"acc": RAW.acc / 9.80665}, r"acc seems to be in g .*multiply it by 9\.80665"),
        ({"acc": RAW.acc / 9.80665 * 1000}, "acc seems to be in mg"),
        ({"acc": RAW.acc / 0.3048}, r"acc seems to be in ft/s\^2"),
        ({"acc": RAW.acc * 16384}, r"acc measures .* at rest where gravity is 9\.81"),
        ({"acc": RAW.acc - [0.0, 0.0, 9.75]}, "gravity removed"),
        ({"gyr": np.rad2deg(RAW.gyr)}, r"gyr seems to be in deg/s .*multiply it by 0\.0174533"),
        ({"gyr": np.deg2rad(RAW.gyr)}, "gyr is far too small for this motion"),
        ({"gyr": -RAW.gyr}, "axes are left-handed or a sign"),
        ({"acc": RAW.acc * mirrored, "gyr": RAW.gyr * mirrored}, "axes are left-handed or a sign"),
        ({"acc": RAW.acc[1:]}, r"acc has shape \(1599, 3\), not \(1600, 3\)"),
        ({"t": RAW.t * 1e3}, r"stamps seem to be in ms \(step 5\).*divide by 1000"),
        ({"t": 1.6e15 + RAW.t * 1e6}, "stamps seem to be in us"),
        ({"t": 1.6e18 + RAW.t * 1e9}, "stamps seem to be in ns"),
        ({"t": RAW.t / 60}, "no inertial sensor's rate"),
        ({"t": RAW.t * 0}, "stamps do not advance"),
        ({"mag": MAG / 100}, "mag seems to be in gauss .*multiply it by 100"),
        ({"mag": MAG * 10}, "mag seems to be in mG"),
        ({"mag": MAG * 1e3}, "mag seems to be in nT"),
        ({"mag": MAG / 1e6}, "mag seems to be in T "),
        ({"mag": MAG / np.linalg.norm(MAG, axis=1)[:, None]}, "median strength of 1 uT, no field on Earth"),
    ):
        with pytest.raises(RecordingError, match=rf"^walk\.csv: .*{message}.*\.$"):
            Recording.from_raw(replace(RAW, **change))


def test_magnetometer_rows_are_whole_or_none() -> None:
    recording = Recording.from_raw(_with("mag", ([3, 4, 5], [0, 1, 2]), np.nan))
    assert recording.mag is not None
    assert np.isnan(recording.mag[3:6]).all()
    assert np.isnan(recording.mag).sum() == 9
    assert Recording.from_raw(_with("mag", np.s_[:], np.nan)).mag is None
    spike = Recording.from_raw(_with("mag", (7, 0), 1e30)).mag
    assert spike is not None
    assert np.isnan(spike[7]).all()
    assert not np.isnan(RAW.mag).any()  # the raw samples are left as they were


def test_recording_is_valid_by_construction() -> None:
    for arrays, message in (
        ((RAW.t, _with("acc", (5, 2), np.inf).acc, RAW.gyr), "sample 5 is not finite"),
        ((_with("t", 8, RAW.t[7]).t, RAW.acc, RAW.gyr), "stamp of sample 8 is not after"),
        ((RAW.t[:3], RAW.acc[:3], RAW.gyr[:3]), "3 usable samples cannot make a walk"),
        ((RAW.t, RAW.acc, RAW.gyr, MAG[:, :2]), "mag has shape"),
    ):
        with pytest.raises(RecordingError, match=message):
            Recording(*arrays)
    with pytest.raises(RecordingError, match="19 usable samples cannot make a walk: record at least 20"):
        Recording.from_raw(_only(RAW, np.arange(19)))
    assert len(Recording.from_raw(_only(RAW, np.arange(20)))) == 20
    single = Recording(RAW.t, RAW.acc.astype(np.float32), np.asfortranarray(RAW.gyr))  # type: ignore[arg-type]
    assert single.acc.dtype == np.float64
    assert single.gyr.flags.c_contiguous


@given(st.integers(0, 1500), st.floats(-0.05, 0.05), st.floats(8.0, 11.5))
def test_small_calibration_errors_pass(at: int, bias: float, gravity: float) -> None:
    raw = replace(RAW, acc=RAW.acc * gravity / 9.80665, gyr=RAW.gyr + bias)
    assert len(Recording.from_raw(_only(raw, np.arange(at, at + 100)))) == 100


OWN = tilting(np.random.default_rng(41), duration_s=4.0, rate_hz=100.0, still_s=1.0)
ACC_G, GYR_DEG_S = OWN.acc / GRAVITY_M_S2, np.degrees(OWN.gyr)


def is_the_same(recording: Recording, mag: bool = True) -> bool:
    np.testing.assert_allclose(recording.t, OWN.t, atol=1e-9)
    np.testing.assert_allclose(recording.acc, OWN.acc, rtol=1e-12)
    np.testing.assert_allclose(recording.gyr, OWN.gyr, rtol=1e-12)
    if mag:
        np.testing.assert_allclose(recording.mag, OWN.mag, rtol=1e-12)
    return (recording.mag is not None) == mag


def frame_of(*names: str) -> pd.DataFrame:
    return pd.DataFrame(np.column_stack([OWN.t * 1e3, ACC_G, GYR_DEG_S]), columns=list(names))


def test_examples_in_docstrings_run():
    for name in ("columns.headers", "columns.mapping"):
        found = doctest.testmod(importlib.import_module(f"fg_nav.{name}"), extraglobs={"pd": pd})
        assert found.attempted > 0
        assert found.failed == 0


def test_arrays_in_si_and_in_other_units():
    assert is_the_same(Recording.from_arrays(OWN.t, OWN.acc, OWN.gyr, OWN.mag))
    own = (OWN.t * 1e6, ACC_G, GYR_DEG_S, OWN.mag / 100)
    assert is_the_same(Recording.from_arrays(*own, units="us, g, deg/s, gauss"))
    assert is_the_same(Recording.from_arrays(*own, units={"time": "µs", "acc": "g", "gyr": "°/s", "mag": "G"}))
    lists = [array.tolist() for array in (OWN.t, OWN.acc, OWN.gyr)]
    assert is_the_same(Recording.from_arrays(*lists), mag=False)
    t = np.datetime64("2026-01-01T10:00") + (OWN.t * 1e9).astype("timedelta64[ns]")  # whatever the unit
    recording = Recording.from_arrays(t, ACC_G, OWN.gyr, units={"acc": "g"})
    np.testing.assert_allclose(recording.t - recording.t[0], OWN.t, atol=1e-6)


@pytest.mark.parametrize(
    ("own", "units", "words"),
    [
        ((OWN.t[:-1], OWN.acc, OWN.gyr), None, r"acc has shape \(400, 3\), not \(399, 3\)"),
        ((OWN.acc, OWN.acc, OWN.gyr), None, r"t has shape \(400, 3\), not \(N,\)"),
        ((OWN.t, ACC_G, OWN.gyr), None, "acc seems to be in g"),
        ((OWN.t, OWN.acc, OWN.gyr), "furlong", "'furlong' is no unit"),
        ((OWN.t, OWN.acc, OWN.gyr), {"acc": "deg/s"}, "no unit 'deg/s' of acc"),
        ((OWN.t, OWN.acc, OWN.gyr), {"force": "g"}, "units name 'force'"),
        ((OWN.t, OWN.acc, [["a", 0, 0]] * 400), None, "row 1, column 'gyr': 'a' is not a number"),
        ((OWN.t, OWN.acc, None), None, "gyr"),
    ],
)
def test_arrays_that_are_no_recording(own, units, words):
    with pytest.raises((RecordingError, FormatError), match=words):
        Recording.from_arrays(*own, units=units)


def test_data_frames_by_their_names():
    assert is_the_same(Recording.from_dataframe(frame_of("t", "ax", "ay", "az", "gx", "gy", "gz")), mag=False)
    named = frame_of("Time [ms]", *(f"Acc {a} [g]" for a in "XYZ"), *(f"Gyr {a} (deg/s)" for a in "XYZ"))
    named[["mx (uT)", "my (uT)", "mz (uT)"]] = OWN.mag
    recording = Recording.from_dataframe(named)
    assert is_the_same(recording)
    assert recording.provenance.notes == ()
    odd, columns = frame_of("stamp", *"abcdef"), {"acc": ["a", "b", "c"], "gyr": ["d", "e", "f"]}
    assert is_the_same(Recording.from_dataframe(odd, "time=stamp[ms],acc=a:b:c[g],gyr=d:e:f[deg/s]"), mag=False)
    assert is_the_same(Recording.from_dataframe(odd, columns, "g, deg/s", rate_hz=100.0), mag=False)
    dated = named.iloc[:, 1:].set_index(pd.to_datetime(OWN.t, unit="s"))
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
