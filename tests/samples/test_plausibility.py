"""Gravity as a witness: what the recognisers rest on; their sentences are tested with `Recording`."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.samples.plausibility import (
    find_lasting_problems,
    find_unit_problems,
    measure_field_strength,
    measure_gravity_transport,
    measure_rest_acc,
)
from tests.io.samples import tilting
from tests.real_data import DATA, needs_data

PERIOD_S = 0.005


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


def test_rest_is_found_in_any_unit() -> None:
    acc = np.random.default_rng(3).normal(size=(4000, 3)) * 5 + [0, 0, GRAVITY_M_S2]
    acc[1000:1400] = [0.0, 0.6 * GRAVITY_M_S2, -0.8 * GRAVITY_M_S2]
    for unit in (1.0, 1 / GRAVITY_M_S2, 1000.0):
        assert measure_rest_acc(acc * unit, PERIOD_S) == pytest.approx(GRAVITY_M_S2 * unit)
    assert np.isnan(measure_rest_acc(acc[:5], PERIOD_S))


def test_nonsense_is_borne() -> None:
    """Also stamps beyond all bounds among ones that stand still."""
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
    """Take gravity out with the sensor's own attitude, as its linear acceleration does."""
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
