"""Bad readings, of a recording and of a stream in blocks; readings cut at a range; gravity as a witness of units."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import rows_of, taken_rows
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.intake import Intake
from fg_nav.samples.plausibility import (
    find_lasting_problems,
    find_unit_problems,
    measure_field_strength,
    measure_gravity_transport,
)
from fg_nav.samples.readings import (
    ACC_OUT,
    AROUND,
    GYR_OUT,
    LONGEST,
    LOOK_AHEAD,
    find_clipping_levels,
    find_outliers,
    find_saturated,
    find_saturation_level,
)
from tests.io.samples import tilting
from tests.online.walks import short_walk
from tests.real_data import DATA, needs_data

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


RATE = 200.0


def _motion(rng: np.random.Generator, duration_s: float = 60.0, bandwidth_hz: float = 8.0) -> np.ndarray:
    """Smooth random motion of 3 axes, standard deviation 3."""
    sos = butter(4, 2 * bandwidth_hz / RATE, output="sos")
    smooth = sosfiltfilt(sos, rng.normal(size=(int(duration_s * RATE), 3)), axis=0)
    return np.asarray(3.0 * smooth / smooth.std())


def test_rounded_peaks_and_random_motion_are_not_flagged() -> None:
    rng = np.random.default_rng(2)
    for frequency_hz, noise, rate_hz in product(
        (0.3, 1.0, 2.0, 5.0, 10.0, 20.0), (0.0, 1e-3, 5e-3, 2e-2), (50.0, 100.0, 200.0, 400.0, 1000.0)
    ):
        t = np.arange(0, 30, 1 / rate_hz)
        phases = 2 * np.pi * frequency_hz * t[:, None] + np.arange(3)
        samples = 8.0 * np.sin(phases) + noise * rng.normal(size=(len(t), 3))
        assert not find_saturated(samples).any(), (frequency_hz, noise, rate_hz)
    for bandwidth_hz in (2.0, 5.0, 10.0, 20.0, 40.0):
        assert not find_saturated(_motion(rng, 300.0, bandwidth_hz)).any()


@pytest.mark.parametrize(("mixing", "noise"), [*product((0.0, 0.01), (0.0, 5e-3))])
def test_cut_peaks_are_flagged(mixing: float, noise: float) -> None:
    rng = np.random.default_rng(3)
    motion = _motion(rng)
    limit = np.quantile(np.abs(motion[:, 1]), 0.99)
    clipped = motion.copy()
    clipped[:, 1] = np.clip(motion[:, 1], -limit, limit)
    cut = np.abs(motion[:, 1]) >= limit
    calibration = np.eye(3) + mixing * rng.uniform(-1, 1, (3, 3))
    flags = find_saturated(clipped @ calibration.T + noise * rng.normal(size=motion.shape))
    assert flags[cut, 1].mean() > 0.9
    assert cut[flags[:, 1]].mean() > 0.9
    assert not flags[:, [0, 2]].any()


def test_a_part_is_clipped_where_the_whole_is() -> None:
    """Few of the cut tops of a long recording are flat for long enough to show a range by themselves."""
    motion = _motion(np.random.default_rng(5), 120.0)
    limit = np.quantile(np.abs(motion[:, 1]), 0.995)
    clipped = motion.copy()
    clipped[:, 1] = np.clip(motion[:, 1], -limit, limit)
    levels, whole = find_clipping_levels(clipped), find_saturated(clipped)
    alone, told = (
        np.concatenate([find_saturated(part, of) for part in np.split(clipped, 60)]) for of in (None, levels)
    )
    np.testing.assert_array_equal(told, whole)
    assert alone[whole].mean() < 0.9


def test_one_end_only_and_nothing_to_tell() -> None:
    motion = _motion(np.random.default_rng(4))[:, 0]
    limit = np.quantile(motion, 0.99)
    clipped = np.minimum(motion, limit)
    assert find_saturation_level(clipped) == pytest.approx(limit, rel=5e-3)
    steps = np.round(np.random.default_rng(5).normal(size=1000))  # of a sensor that sees these only
    for signal in (-clipped, np.zeros(1000), np.full(1000, 5.0), steps, np.arange(4.0), np.empty(0), -np.ones(100)):
        assert find_saturation_level(signal) == np.inf


@needs_data
def test_real_gyroscopes_known_to_clip_and_sensors_far_from_their_range() -> None:
    """The 3DM-GX5's range is 500 deg/s = 8.73 rad/s before calibration."""
    for name, ends, range_rad_s in (
        ("vicon/2017-11-22-11-44-47.mat", [(1, -1)], (8.9, 9.2)),
        ("vicon/2017-11-27-11-18-11.mat", [(1, -1)], (8.8, 9.2)),
        ("gdin/own/SensorConnectData_35.csv", [(1, 1), (1, -1)], (8.5, 8.9)),
        ("gdin/own/SensorConnectData_43.csv", [(0, -1), (1, -1)], (8.5, 8.9)),
        ("gdin/own_obsolete/SensorConnectData_15.csv", [(1, 1)], (8.5, 8.9)),
    ):
        gyr = read(DATA / name).gyr
        for axis, sign in ends:
            assert range_rad_s[0] < find_saturation_level(sign * gyr[:, axis]) < range_rad_s[1], (name, axis, sign)
    for path in (path for pattern in ("xio/*.csv", "openshoe/*1.txt", "broad/0*.mat") for path in DATA.glob(pattern)):
        recording = read(path)
        assert not find_saturated(recording.gyr).any()
        assert not find_saturated(recording.acc).any()


def _tumbling(rng: np.random.Generator, swing_rad: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """Turn about all axes in place: attitude by composition, acc and gyr by differences of it."""
    n = 6000
    t = PERIOD_S * np.arange(n + 1)
    angles = swing_rad * np.sin(2 * np.pi * t[:, None] * [0.3, 0.23, 0.41] + rng.uniform(0, 6, 3))
    nav_R_body = Rotation.from_euler("ZYX", angles)
    gyr = (nav_R_body[:-1].inv() * nav_R_body[1:]).as_rotvec() / PERIOD_S
    acc = nav_R_body[:-1].inv().apply([0.0, 0.0, GRAVITY_M_S2])
    return acc, gyr


def test_gravity_turns_as_the_gyroscope_says_in_any_right_handed_axes() -> None:
    acc, gyr = _tumbling(np.random.default_rng(1))
    transport = measure_gravity_transport(acc, gyr, PERIOD_S)
    assert transport.gain == pytest.approx(1.0, abs=0.02)
    assert transport.correlation > 0.99
    assert measure_gravity_transport(acc, np.rad2deg(gyr), PERIOD_S).gain == pytest.approx(np.pi / 180, rel=0.02)
    mirror = np.array([1.0, 1.0, -1.0])
    for turned in Rotation.random(3, rng=np.random.default_rng(0)):
        acc, gyr = turned.apply(acc), turned.apply(gyr)
        found = measure_gravity_transport(acc, gyr, PERIOD_S)
        assert found.gain == pytest.approx(transport.gain)
        assert not found.is_mirrored
        assert measure_gravity_transport(acc * mirror, gyr * mirror, PERIOD_S).is_mirrored


def test_slow_turning_in_degrees_is_recognised_by_gravity_alone() -> None:
    """Too slow for a threshold on the rate: 30 deg/s taken for 30 rad/s."""
    acc, gyr = _tumbling(np.random.default_rng(2), swing_rad=0.2)
    gyr_deg_s = np.rad2deg(gyr)
    assert np.quantile(np.linalg.norm(gyr_deg_s, axis=1), 0.99) < 40
    problems = find_unit_problems(PERIOD_S * np.arange(len(acc)), acc, gyr_deg_s, None)
    assert len(problems) == 1
    assert "deg/s" in problems[0]


def test_nonsense_is_borne() -> None:
    raw = tilting(np.random.default_rng(4))
    for stamps in ((1e308,), (1e308, -1e308), (1e99, -1e99, np.inf)):
        t = np.full(len(raw.t), -1.0)
        t[20 : 20 + len(stamps)] = stamps
        assert find_lasting_problems(t, raw.acc, raw.gyr, raw.mag, np.isfinite(t))
    for array in (raw.t, raw.acc, raw.gyr, raw.mag):
        array[::3] = np.inf
        array[1::7] = 1e308
        array[2::11] = -np.inf
    assert find_unit_problems(raw.t, raw.acc, raw.gyr, raw.mag) == ()
    nothing = np.full((50, 3), np.nan)
    assert "do not advance" in find_unit_problems(nothing[:, 0], nothing, nothing, nothing)[0]
    assert find_unit_problems(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3)))
    mag = np.array([[3.0, 4.0, 0.0], [np.nan, 1.0, 1.0], [1e300, 0.0, 0.0]])
    np.testing.assert_array_equal(measure_field_strength(mag), [5.0, np.nan, np.nan])


@needs_data
def test_removed_gravity_of_a_real_walk() -> None:
    for path in sorted((DATA / "gdin").glob("*/SensorConnectData_[23]*.csv")):
        table = pd.read_csv(path)
        roll, pitch = (table.filter(like=name).to_numpy()[:, 0] for name in (":roll", ":pitch"))
        down = np.stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)], axis=1)
        recording = read(path)
        linear = recording.acc + GRAVITY_M_S2 * down
        problems = find_unit_problems(recording.t, linear, recording.gyr, None)
        assert len(problems) == 1
        assert "gravity removed" in problems[0]


@pytest.mark.parametrize("seed", range(1, 4))
def test_the_beginning_of_a_right_handed_walk_is_not_called_mirrored(seed: int) -> None:
    """Most of it is rest, and the few windows that turn are those of heel-off: too few to tell."""
    walk = simulate("demo", seed, Choices(field="homogeneous")).recording
    for rows in (walk.t < seconds for seconds in (8.0, 15.0, 25.0)):
        assert not list(find_unit_problems(walk.t[rows], walk.acc[rows], walk.gyr[rows], None))
