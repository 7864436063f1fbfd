"""The magnetometer: fresh samples and held ones, iron, and the paper's own iron."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.simulation.sensors import (
    IronPrior,
    MagnetometerPrior,
    Samples,
    SensorPrior,
    fixed_iron,
    ma_table_1,
    preset,
)

NAV_FIELD = np.array([0.0, 20.0, -44.0])


def recorded(prior: SensorPrior, body_field: Floats, seed: int = 0, block: int = 10**6) -> Samples:
    """Samples of a sensor at rest in a changing field, put together from blocks."""
    run = prior.draw(np.random.default_rng(seed)).switched_on(np.random.default_rng(seed + 1))
    t, still = np.arange(len(body_field)) * prior.period_s, np.zeros_like(body_field)
    cuts = [slice(i, i + block) for i in range(0, len(t), block)]
    parts = [run.measure(t[cut], still[cut], still[cut], body_field[cut]) for cut in cuts]
    mag = np.vstack([part.mag for part in parts if part.mag is not None])
    fresh = np.concatenate([part.fresh for part in parts if part.fresh is not None])
    return Samples(t, mag, mag, mag, fresh, np.arange(len(t)))


def with_mag(mag: MagnetometerPrior) -> SensorPrior:
    return SensorPrior("test", 400.0, mag=mag)


def spinning(count: int, rate_hz: float) -> Floats:
    """A field that turns once a second."""
    angle = 2 * np.pi * np.arange(count) / rate_hz
    return 40.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle + 1], axis=1)


def test_every_fourth_row_is_fresh_and_the_others_are_empty() -> None:
    field = spinning(4000, 400.0)
    got = recorded(with_mag(MagnetometerPrior(rate_hz=100.0)), field)
    assert got.mag is not None
    assert got.fresh is not None
    assert set(np.diff(np.flatnonzero(got.fresh))[1:]) == {4}
    assert got.fresh[0]
    assert np.isnan(got.mag[~got.fresh]).all()
    assert got.mag[got.fresh] == pytest.approx(field[got.fresh])


def test_an_odd_rate_is_kept_on_average() -> None:
    got = recorded(with_mag(MagnetometerPrior(rate_hz=61.7)), spinning(40_000, 400.0))
    assert got.fresh is not None
    assert got.fresh.sum() == pytest.approx(61.7 * 100.0, abs=2)
    assert set(np.diff(np.flatnonzero(got.fresh))[1:]) == {6, 7}


def test_a_faster_magnetometer_has_a_sample_in_every_row() -> None:
    for rate_hz in (400.0, 1000.0, np.inf):
        got = recorded(with_mag(MagnetometerPrior(rate_hz=rate_hz)), spinning(2000, 400.0))
        assert got.fresh is not None
        assert got.fresh.all()


def test_held_samples_repeat_the_last_fresh_one() -> None:
    field = spinning(4000, 400.0)
    empty = recorded(with_mag(MagnetometerPrior(rate_hz=100.0, noise_sd_uT=0.5)), field)
    held = recorded(with_mag(MagnetometerPrior(rate_hz=100.0, noise_sd_uT=0.5)).with_held_field(), field, block=37)
    assert held.mag is not None
    assert empty.mag is not None
    assert held.fresh is not None
    assert np.array_equal(held.fresh, empty.fresh)
    assert np.array_equal(held.mag[held.fresh], empty.mag[held.fresh])
    steps = np.abs(np.diff(held.mag, axis=0)).max(axis=1)
    assert np.array_equal(steps > 0, held.fresh[1:])


def test_a_lagging_sample_shows_the_field_of_then() -> None:
    field = spinning(4000, 400.0)
    got = recorded(with_mag(MagnetometerPrior(lag_s=0.011)), field, block=13)
    assert got.mag is not None
    angle = np.unwrap(np.arctan2(got.mag[:, 1], got.mag[:, 0]))
    t = np.arange(4000) / 400.0
    assert angle[10:] == pytest.approx(2 * np.pi * (t[10:] - 0.011), abs=2e-4)
    assert got.mag[0] == pytest.approx(field[0])


def turned_level(level_R_body: Floats, prior: SensorPrior) -> Floats:
    """Levelled readings (N, 3) of a foot that stands in every direction, its sensor tilted as it is mounted."""
    heading = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
    nav_R_level = Rotation.from_rotvec(heading[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    body_field = np.einsum("nji,j->ni", nav_R_level, NAV_FIELD) @ level_R_body
    got = recorded(prior, body_field)
    assert got.mag is not None
    return got.mag @ level_R_body.T


@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (12.0, -25.0)])
def test_ma_calibration_undoes_the_iron_of_his_table(tilt_deg: tuple[float, float]) -> None:
    """Eq. 6 gives the offsets, Eq. 8-12 a circle again, whatever the tilt of the sensor in stance."""
    level_R_body = Rotation.from_euler("xy", tilt_deg, degrees=True).as_matrix()
    prior = SensorPrior("quiet", 400.0).with_iron(ma_table_1(level_R_body))
    level = turned_level(level_R_body, prior)[:, :2]
    offset = (level.max(axis=0) + level.min(axis=0)) / 2
    assert offset == pytest.approx([13.795, 7.526], abs=0.01)
    c, s = np.cos(0.973), np.sin(0.973)
    R = np.array([[c, s], [-s, c]])
    assert pytest.approx(np.array([[0.562, 0.827], [-0.827, 0.562]]), abs=1e-3) == R
    corrected = (level - offset) @ R.T * [0.896, 1.0] @ R
    assert np.linalg.norm(corrected, axis=1) == pytest.approx(20.0, abs=0.02)
    radius = np.linalg.norm(level - offset, axis=1)
    assert radius.min() / radius.max() == pytest.approx(0.896, abs=1e-3)


def test_effective_iron_is_what_the_readings_have() -> None:
    prior = preset("mpu-9250x8")
    sensor = prior.draw(np.random.default_rng(4))
    run = sensor.switched_on(np.random.default_rng(5))
    fields = np.repeat(30.0 * np.vstack([np.zeros(3), np.eye(3)]), 4000, axis=0)
    t, still = np.arange(len(fields)) / 400.0, np.zeros_like(fields)
    mag = run.measure(t, still, still, fields).mag
    assert mag is not None
    none, *axes = (np.nanmean(part[20:], axis=0) for part in np.split(mag, 4))
    assert none == pytest.approx(sensor.hard_iron_uT, abs=0.03)
    assert np.stack(axes, axis=1) - none[:, None] == pytest.approx(30.0 * sensor.soft_iron, abs=0.06)


def test_iron_is_drawn_alike_in_all_directions() -> None:
    prior = IronPrior(hard_uT=(1.0, 2.0, 3.0), hard_sd_uT=5.0, soft_sd=0.06)
    rng = np.random.default_rng(6)
    irons = [prior.draw(rng) for _ in range(3000)]
    hard = np.stack([iron.hard_uT for iron in irons])
    assert hard.mean(axis=0) == pytest.approx([1.0, 2.0, 3.0], abs=0.4)
    assert hard.std(axis=0) == pytest.approx([5.0, 5.0, 5.0], rel=0.05)
    soft = np.stack([iron.soft for iron in irons])
    assert np.array_equal(soft, soft.transpose(0, 2, 1))
    for direction in (np.array([1.0, 0.0, 0.0]), np.array([0.6, 0.0, 0.8]), np.ones(3) / np.sqrt(3)):
        along = np.einsum("i,nij,j->n", direction, soft, direction)
        assert along.mean() == pytest.approx(1.0, abs=0.005)
        assert along.std() == pytest.approx(0.06, rel=0.05)


def test_fixed_iron_is_exact_whatever_chips_there_are() -> None:
    hard, soft = np.array([3.0, -4.0, 5.0]), np.array([[1.1, 0.02, 0.0], [0.02, 0.9, -0.01], [0.0, -0.01, 1.0]])
    for seed in range(3):
        sensor = preset("mpu-9250x8").with_iron(fixed_iron(hard, soft)).draw(np.random.default_rng(seed))
        assert sensor.hard_iron_uT == pytest.approx(hard, abs=1e-12)
        assert sensor.soft_iron == pytest.approx(soft, abs=1e-12)
