"""Bad samples of a recording, and of a stream however its samples come in blocks."""

import numpy as np
import pytest

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import rows_of, taken_rows
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.intake import Intake
from fg_nav.samples.plausibility import find_unit_problems
from fg_nav.samples.readings import ACC_OUT, AROUND, GYR_OUT, LONGEST, LOOK_AHEAD, find_outliers
from tests.online.walks import short_walk

PERIOD_S = 0.005
N = 600
STANDS = 450  # From then on.
STRUCK = range(200, 210)  # A heel strikes: 100 m/s^2 within two samples, and the shoe rings.


def striding() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, forces and rates of a foot that swings at up to 8 rad/s, and strikes once."""
    t = PERIOD_S * np.arange(N)
    rng = np.random.default_rng(1)
    swing = np.where(np.arange(N) < STANDS, np.sin(2 * np.pi * np.arange(N) / 200), 0.0)[:, None]
    gyr = 8 * swing * [0.1, 1.0, 0.2] + rng.normal(0, 0.02, (N, 3))
    acc = [0, 0, GRAVITY_M_S2] + 15 * swing * [1, 0, 0.5] + rng.normal(0, 0.2, (N, 3))
    ring = np.exp(-0.25 * np.arange(len(STRUCK))) * np.cos(1.2 * np.arange(len(STRUCK)))
    acc[STRUCK, 2] += 100 * ring
    gyr[STRUCK, 1] += 4 * ring
    return t, acc, gyr


@pytest.mark.parametrize("at", [0, 1, 30, 100, 199, 201, 206, 400, N - 3, N - 2, N - 1])
@pytest.mark.parametrize("length", [1, 5])
def test_far_samples_are_found_wherever_they_are_and_no_others(at, length):
    t, acc, gyr = striding()
    gyr[at : at + length, 2] += 100.0
    found = find_outliers(t, acc, gyr)
    expected = np.arange(N)[at : at + length] if at + length <= N - 2 or at >= N - 2 else []
    assert np.flatnonzero(found[1:] & GYR_OUT).tolist() == [i - 1 for i in expected if i]  # the first may be either
    assert not (found & ACC_OUT).any()


def test_what_lasts_and_a_blow_that_turns_the_shoe_are_motions_and_a_single_rate_without_a_blow_is_none():
    t, acc, gyr = striding()
    assert not find_outliers(t, acc, gyr).any()
    gyr[300, 1] += 6.0
    assert np.flatnonzero(find_outliers(t, acc, gyr) == GYR_OUT).tolist() == [300]
    acc[300, 2] += 40.0
    gyr[100 : 100 + LONGEST + AROUND, 0] += 30.0
    assert not find_outliers(t, acc, gyr).any()


def test_two_bad_samples_near_each_other_are_found_at_any_distance():
    for apart in range(1, 15):
        t, acc, gyr = striding()
        acc[[350, 350 + apart], 1] = 300.0, -300.0
        found = np.flatnonzero(find_outliers(t, acc, gyr) & ACC_OUT)
        assert {350, 350 + apart} <= set(found.tolist()) <= set(range(350, 351 + apart))


def test_a_recording_leaves_bad_samples_out_and_says_which():
    t, acc, gyr = striding()
    gyr[300, 0] = 30.0
    acc[400:403, 1] = -400.0
    mag = np.tile([20.0, 0.0, -40.0], (N, 1))
    mag[500], mag[520, 1] = 0.0, 1000.0
    recording = Recording.from_raw(RawRecording(t, acc, gyr, np.arange(1, N + 1) + 1, mag))
    np.testing.assert_array_equal(recording.t, t)
    assert [np.flatnonzero(recording.unread == which).tolist() for which in (ACC_OUT, GYR_OUT)] == [
        [400, 401, 402],
        [300],
    ]
    words = "did not use 4 bad samples of the gyroscope and accelerometer, far off what the samples around allow"
    first, second = recording.provenance.notes
    assert first == f"{words}, the first in row 302 (t = 1.500 s)"
    assert second.startswith("did not use 1 bad sample of the magnetometer")
    assert recording.t[np.isnan(recording.mag).any(axis=1)].tolist() == [t[500], t[520]]
    np.testing.assert_array_equal(recording.acc[300], acc[300])
    np.testing.assert_allclose(recording.gyr[300], (gyr[299] + gyr[301]) / 2)


def test_one_bad_sample_shows_no_wrong_unit():
    """300 rad/s while the sensor turns to and fro: so fast, gravity would turn with it."""
    t = PERIOD_S * np.arange(400)
    tilt, nothing = 0.2 * np.sin(np.pi * t), np.zeros(400)
    acc = GRAVITY_M_S2 * np.column_stack([nothing, np.sin(tilt), np.cos(tilt)])
    gyr = np.column_stack([np.gradient(tilt, t), nothing, nothing])
    gyr[200, 0] -= 300.0
    assert "gyr" in "".join(find_unit_problems(t, acc, gyr, None))
    assert len(Recording.from_raw(RawRecording(t, acc, gyr, np.arange(400)))) == 400


BAD = [0, 333, 334, 335, 700, 710]


def spoiled() -> np.ndarray:
    rows = rows_of(short_walk()).copy()
    rows[BAD, 6] += 60.0
    rows[1000:1005, 2] -= 1000.0
    rows[1005:1007, 5] += 60.0
    rows[600, [1, 5]] = 900.0, 60.0
    rows[[500, 712, 1006], 8] = 160.0
    return rows


@pytest.mark.parametrize("block", [1, 9, 5000])
def test_a_stream_leaves_out_what_a_recording_does_and_counts_it(block):
    rows, told = spoiled(), []
    judge = Intake(told.append)
    parts = [rows[i : i + block] for i in range(0, len(rows), block)]
    taken = [judge.push(part) for part in parts]
    whole = Recording.from_raw(
        RawRecording(rows[:, 0], rows[:, 1:4], rows[:, 4:7], np.arange(len(rows)), rows[:, 7:10])
    )
    np.testing.assert_array_equal(np.concatenate([*taken, judge.push(rows[:0], at_end=True)]), taken_rows(whole))
    assert judge.counts == {"gyr": len(BAD) + 3, "acc": 6, "mag": 3}
    assert len(whole) == len(rows) - 1
    sentence = "samples of the gyroscope are far off what those around allow, and not used, the first at t ="
    assert any(words.startswith(sentence) for words in told)
    behind = [rows[min((i + 1) * block, len(rows)) - 1, 0] - part[-1, 0] for i, part in enumerate(taken) if len(part)]
    assert max(behind) <= (LOOK_AHEAD + 1) * 0.01  # of 100 Hz
    assert sum(late > 0.0 for late in behind) < 0.1 * len(behind) + 1
