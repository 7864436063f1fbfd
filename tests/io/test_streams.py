"""Sensors on clocks of their own come back to what is true at the gyroscope's stamps."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.streams import Stream, join_streams, keep_changes
from fg_nav.recording import RawRecording, Recording

PATH = Path("walk.zip")
AMPLITUDE_RAD, TURN_RAD_S = 0.8, 2 * np.pi * 0.7
START_NS = 1_663_326_947_248_860_701


def angle(t):
    return AMPLITUDE_RAD * np.sin(TURN_RAD_S * t)


def up(t):
    """Up in a sensor that tilts to and fro about x."""
    return np.stack([np.zeros_like(t), np.sin(angle(t)), np.cos(angle(t))], axis=1)


def sense(what, t):
    if what == "gyr":
        rate = AMPLITUDE_RAD * TURN_RAD_S * np.cos(TURN_RAD_S * t)
        return np.stack([rate, np.zeros_like(t), np.zeros_like(t)], axis=1)
    return (GRAVITY_M_S2 if what == "acc" else 48.0) * up(t)


def stream(what, t):
    return Stream(what, t, sense(what, t), np.arange(2, len(t) + 2), f"{what}.csv")


def clock(rate_hz, start_s=0.0, duration_s=8.0, jitter_s=0.0, seed=1):
    t = start_s + np.arange(round(duration_s * rate_hz)) / rate_hz
    return t + np.random.default_rng(seed).uniform(-jitter_s, jitter_s, len(t))


def join(*streams: Stream) -> RawRecording:
    return join_streams(streams, PATH, "phyphox")


def test_a_tilting_sensor_on_three_clocks():
    t_acc, t_gyr = clock(52.4, 0.021, jitter_s=1e-3), clock(100.0, 0.03, jitter_s=5e-4, seed=2)
    t_mag = clock(49.9, 0.042, jitter_s=1e-3, seed=3)
    raw = join(stream("mag", t_mag), stream("acc", t_acc), stream("gyr", t_gyr))
    curvature = GRAVITY_M_S2 * (AMPLITUDE_RAD * TURN_RAD_S) ** 2 * (1 + 1 / AMPLITUDE_RAD)
    bound = np.diff(t_acc).max() ** 2 / 8 * curvature
    assert np.abs(raw.acc - sense("acc", raw.t)).max() < bound
    np.testing.assert_array_equal(raw.gyr, sense("gyr", raw.t))
    assert raw.t[0] >= max(t_acc[0], t_gyr[0])
    assert raw.t[-1] <= min(t_acc[-1], t_gyr[-1])
    sampled = np.isfinite(raw.mag).all(axis=1)
    fastest = 48.0 * AMPLITUDE_RAD * TURN_RAD_S
    assert np.abs(raw.mag - sense("mag", raw.t))[sampled].max() <= fastest * 0.5 * np.diff(t_gyr).max()
    within = (t_mag > raw.t[0]) & (t_mag < raw.t[-1])
    assert sampled.sum() == pytest.approx(within.sum(), abs=1)
    assert len(np.unique(raw.mag[sampled], axis=0)) == sampled.sum()
    words = " ".join(raw.provenance.notes)
    assert re.search(r"accelerometer 52.. Hz, gyroscope \d+.. Hz, magnetometer 49.. Hz, begun 2. ms apart", words)


def test_whole_nanoseconds_lose_nothing():
    whole = np.arange(400, dtype=np.int64) * 9_957_001
    streams = [stream(what, whole * 1e-9) for what in ("acc", "gyr")]
    streams = [Stream(s.what, START_NS + whole, s.xyz, s.row, s.source) for s in streams]
    raw = join(*streams)
    np.testing.assert_array_equal(raw.t, whole * 1e-9)
    np.testing.assert_array_equal(raw.acc, streams[0].xyz)
    assert raw.provenance.notes[0] == "time 0 is 2022-09-16 11:15:47.248 UTC"
    assert raw.provenance.notes[-1] == "accelerometer 100.4 Hz, gyroscope 100.4 Hz, on one clock"
    # time 0 is the first stamp of all but the barometer, in whatever order they come
    acc, late = streams[0], streams[1].take(slice(100, None))
    air = Stream("pressure", acc.t[:60] - 10**10, np.full((60, 1), 1e5), acc.row[:60], "air.csv")
    for order in ([acc, late, air], [air, late, acc]):
        raw = join(*order)
        np.testing.assert_array_equal(raw.t, whole[100:] * 1e-9)
        assert raw.provenance.notes[0] == "time 0 is 2022-09-16 11:15:47.248 UTC"


def test_no_line_is_drawn_across_a_gap():
    t = clock(100.0)
    t_acc = np.delete(clock(50.0, 0.003), np.s_[100:110])
    raw = join(stream("acc", t_acc), stream("gyr", t))
    gap = (raw.t > t_acc[99]) & (raw.t < t_acc[100])
    np.testing.assert_array_equal(np.isnan(raw.acc).any(axis=1), gap)
    assert "22 rows in gaps of the accelerometer, up to 0.220 s, left out" in raw.provenance.notes
    recording = Recording.from_raw(raw)
    assert np.diff(recording.t).max() == pytest.approx(0.23, abs=0.011)


def test_cut_to_what_both_recorded_and_to_where_both_are_awake():
    raw = join(stream("acc", clock(100.0, 1.0)), stream("gyr", clock(100.0, 0.0)))
    assert raw.t[[0, -1]] == pytest.approx([1.0, 7.99])
    np.testing.assert_allclose(raw.acc, sense("acc", raw.t), atol=1e-12)
    assert any("1.000 s left out at the start, 1.000 s at the end" in note for note in raw.provenance.notes)
    t = clock(100.0)
    acc, gyr = stream("acc", t), stream("gyr", t)
    acc.xyz[:7], gyr.xyz[:3] = acc.xyz[7] + 0.1, 0.0
    raw = join(acc, gyr)
    assert raw.t[0] == t[7]
    assert "the first 7 rows of the accelerometer, one sample repeated, left out" in raw.provenance.notes
    assert "the first 3 rows of the gyroscope, zero, left out" in raw.provenance.notes


def test_repeats_late_samples_and_clocks_that_begin_again():
    t = clock(100.0)
    order = np.r_[0:50, 52, 50, 51, 53:800, 799, 799]
    raw = join(stream("acc", t), stream("gyr", t[order]))
    np.testing.assert_array_equal(raw.t, t)
    notes = " ".join(raw.provenance.notes)
    assert "2 samples of the gyroscope with the stamp of another left out" in notes
    assert "1 sample of the gyroscope came late: sorted" in notes
    twice = np.r_[t[:200], t]
    raw = join(stream("acc", twice), stream("gyr", twice))
    np.testing.assert_array_equal(raw.t, t)
    assert any("begin again in row 202: of 2 parts the longest" in note for note in raw.provenance.notes)


def test_a_table_of_events():
    """A row for each event of any sensor: the others hold their values."""
    t = clock(1000.0, duration_s=2.0)
    held = sense("acc", np.floor(t * 50.0 + 1e-6) / 50.0)
    changes = keep_changes(Stream("acc", t, held, np.arange(2000), "moving"))
    np.testing.assert_allclose(changes.t, np.arange(100) / 50.0, atol=1e-9)
    held[100:] = held[100]
    rest = keep_changes(Stream("acc", t, held, np.arange(2000), "at rest"))
    assert np.diff(rest.t).max() < 0.065
    assert len(rest.t) < 40


def test_what_cannot_be_joined_is_refused():
    brief = stream("acc", np.array([3.0, 3.02]))
    for streams, message in (
        ([stream("acc", clock(100.0)), stream("mag", clock(50.0))], "no gyroscope, only accelerometer and mag"),
        ([stream("mag", clock(50.0))], "no accelerometer, only magnetometer"),
        ([], r"no accelerometer: record"),
        ([stream("acc", clock(2.0)), stream("gyr", clock(2.0))], r"accelerometer has 2 samples a second, too few"),
        ([stream("acc", clock(100.0)), stream("gyr", clock(100.0, 6.0))], "ran at different times"),
        ([stream("acc", clock(100.0)), stream("gyr", np.full(50, np.nan))], "gyr.csv has 0 samples of the gyroscope"),
        ([brief, stream("gyr", clock(50.0, 0.01))], "gyr.csv has 1 sample while the accelerometer ran"),
    ):
        with pytest.raises(FormatError, match=message):
            join(*streams)


def test_the_slower_sensor_is_named():
    for acc_hz, gyr_hz, name in ((10.0, 100.0, "accelerometer"), (100.0, 10.0, "gyroscope")):
        notes = " ".join(join(stream("acc", clock(acc_hz)), stream("gyr", clock(gyr_hz))).provenance.notes)
        assert f"the {name} has 10 samples a second, too few to follow a step well: record" in notes


def test_a_faster_accelerometer_is_averaged_over_the_gyroscopes_period():
    t_acc, t_gyr = clock(400.0), clock(100.0)
    acc = np.column_stack([t_acc, np.where(np.arange(len(t_acc)) == 1601, 8.0, 0.0), np.full(len(t_acc), 9.8)])
    raw = join(Stream("acc", t_acc, acc, np.arange(len(t_acc)), "acc.csv"), stream("gyr", t_gyr))
    np.testing.assert_allclose(raw.acc[1:-1, 0], t_gyr[1:-1], atol=1e-9)
    assert raw.acc[:, 1].sum() == pytest.approx(8.0 / 4)
    assert "the accelerometer is faster than the gyroscope: averaged" in " ".join(raw.provenance.notes)


def test_of_a_faster_magnetometer_the_nearest_sample_is_placed():
    t_mag, t_gyr = clock(290.0, 0.001), clock(100.0)
    raw = join(stream("acc", t_gyr), stream("gyr", t_gyr), stream("mag", t_mag))
    nearest = t_mag[np.argmin(np.abs(t_mag[:, None] - t_gyr), axis=0)]
    np.testing.assert_array_equal(raw.mag, sense("mag", nearest))
