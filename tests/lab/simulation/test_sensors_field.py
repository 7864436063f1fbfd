"""The magnetometer: fresh samples, late and held ones, iron, and the paper's own iron."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.sensors import (
    IronPrior,
    MagnetometerPrior,
    Samples,
    SensorPrior,
    ma_table_1,
    make_iron,
    preset,
)

NAV_FIELD = np.array([0.0, 20.0, -44.0])


def recorded(prior: SensorPrior, body_field: Callable[[Floats], Floats], count: int, block: int = 10**6) -> Samples:
    """Samples of a sensor at rest in a changing field, put together from blocks."""
    run = prior.draw(np.random.default_rng(0)).switch_on(np.random.default_rng(1))
    t, still = np.arange(count) * prior.period_s, np.zeros((count, 3))
    cuts = [slice(i, i + block) for i in range(0, len(t), block)]
    parts = [run.measure(t[cut], still[cut], still[cut], body_field) for cut in cuts]
    mag = np.vstack([part.mag for part in parts if part.mag is not None])
    fresh = np.concatenate([part.fresh for part in parts if part.fresh is not None])
    return Samples(t, t, mag, mag, mag, fresh, np.arange(len(t)))


def with_mag(mag: MagnetometerPrior) -> SensorPrior:
    return SensorPrior("test", 400.0, mag=mag)


def spinning(t: Floats, turns_a_second: float = 1.0) -> Floats:
    """A field that turns about the vertical."""
    angle = 2 * np.pi * turns_a_second * t
    return 40.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle + 1], axis=1)


def test_every_fourth_row_is_fresh_and_the_others_are_empty() -> None:
    got = recorded(with_mag(MagnetometerPrior(rate_hz=100.0)), spinning, 4000)
    assert got.mag is not None
    assert got.fresh is not None
    assert set(np.diff(np.flatnonzero(got.fresh))[1:]) == {4}
    assert got.fresh[0]
    assert np.isnan(got.mag[~got.fresh]).all()
    assert got.mag[got.fresh] == pytest.approx(spinning(got.t[got.fresh]))


def test_an_odd_rate_is_kept_on_average() -> None:
    got = recorded(with_mag(MagnetometerPrior(rate_hz=61.7)), spinning, 40_000)
    assert got.fresh is not None
    assert got.fresh.sum() == pytest.approx(61.7 * 100.0, abs=2)
    assert set(np.diff(np.flatnonzero(got.fresh))[1:]) == {6, 7}


def test_a_faster_magnetometer_has_a_sample_in_every_row() -> None:
    for rate_hz in (400.0, 1000.0, np.inf):
        got = recorded(with_mag(MagnetometerPrior(rate_hz=rate_hz)), spinning, 2000)
        assert got.fresh is not None
        assert got.fresh.all()


def test_held_samples_repeat_the_last_fresh_one() -> None:
    prior = with_mag(MagnetometerPrior(rate_hz=100.0, noise_sd_uT=0.5))
    empty = recorded(prior, spinning, 4000)
    held = recorded(with_mag(MagnetometerPrior(rate_hz=100.0, noise_sd_uT=0.5, held=True)), spinning, 4000, block=37)
    assert held.mag is not None
    assert empty.mag is not None
    assert held.fresh is not None
    assert np.array_equal(held.fresh, empty.fresh)
    assert np.array_equal(held.mag[held.fresh], empty.mag[held.fresh])
    steps = np.abs(np.diff(held.mag, axis=0)).max(axis=1)
    assert np.array_equal(steps > 0, held.fresh[1:])


@pytest.mark.parametrize("block", [13, 10**6])
@pytest.mark.parametrize("turns_a_second", [1.0, 170.0])
def test_a_lagging_sample_shows_the_field_of_then(turns_a_second: float, block: int) -> None:
    """To rounding, from the first row on, and however far the field turns from row to row: nothing is interpolated."""
    prior = with_mag(MagnetometerPrior(rate_hz=100.0, lag_s=0.011))
    got = recorded(prior, lambda t: spinning(t, turns_a_second), 4000, block)
    assert got.mag is not None
    assert got.fresh is not None
    assert got.fresh[0]
    x, y, z = got.mag[got.fresh].T
    late = np.angle((x + 1j * y) * np.exp(-2j * np.pi * turns_a_second * got.t[got.fresh]))
    lag_turns = -0.011 * turns_a_second
    assert late == pytest.approx(2 * np.pi * (lag_turns - np.rint(lag_turns)), abs=1e-9)
    assert np.hypot(x, y) == pytest.approx(z)


@pytest.mark.parametrize(("block", "most_asked"), [(3, 1), (37, 10), (4000, 1001)])
def test_the_field_is_asked_for_only_where_it_is_measured(block: int, most_asked: int) -> None:
    asked: list[Floats] = []

    def listening(t: Floats) -> Floats:
        asked.append(t.copy())
        return spinning(t)

    got = recorded(with_mag(MagnetometerPrior(rate_hz=100.0, lag_s=0.011)), listening, 4000, block)
    assert got.fresh is not None
    assert np.concatenate(asked) == pytest.approx(got.t[got.fresh] - 0.011, abs=1e-12)
    assert (np.diff(np.concatenate(asked)) > 0).all()
    assert len(asked) == len(set(np.flatnonzero(got.fresh) // block))
    assert all(1 <= len(instants) <= most_asked for instants in asked)


def test_a_sensor_without_a_magnetometer_does_not_ask_for_the_field() -> None:
    def never(t: Floats) -> Floats:
        raise AssertionError(f"asked for {len(t)} instants")

    run = SensorPrior("blind", 400.0, mag=None).draw(np.random.default_rng(0)).switch_on(np.random.default_rng(1))
    samples = run.measure(np.arange(100) / 400.0, np.zeros((100, 3)), np.zeros((100, 3)), never)
    assert samples.mag is None
    assert samples.fresh is None


@pytest.mark.parametrize(
    ("body_field", "words"),
    [
        (lambda t: NAV_FIELD, r"field to measure has shape \(3,\), not \(100, 3\): give each instant a row"),
        (lambda t: spinning(t[1:]), r"field to measure has shape \(99, 3\), not \(100, 3\)"),
        (lambda t: spinning(t).T, r"field to measure has shape \(3, 100\), not \(100, 3\)"),
        (lambda t: np.where(t[:, None] < 0.5, spinning(t), np.nan), r"field to measure is not finite at 0\.500 s"),
        (lambda t: spinning(t) / (np.abs(t[:, None] - 0.25) > 0.001), r"field to measure is not finite at 0\.250 s"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_field_that_cannot_be_is_refused(body_field: Callable[[Floats], Floats], words: str) -> None:
    run = SensorPrior("any", 100.0).draw(np.random.default_rng(0)).switch_on(np.random.default_rng(1))
    still = np.zeros((100, 3))
    with pytest.raises(SimulationError, match=words):
        run.measure(np.arange(100) / 100.0, still, still, body_field)


def turned_level(level_R_body: Floats, prior: SensorPrior) -> Floats:
    """Levelled readings (N, 3) of a foot that stands in every direction, its sensor tilted as it is mounted."""
    count = 720
    turn_s = count * prior.period_s

    def body_field(t: Floats) -> Floats:
        angle = 2 * np.pi * t / turn_s
        nav_R_level = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
        turned: Floats = np.einsum("nji,j->ni", nav_R_level, NAV_FIELD) @ level_R_body
        return turned

    got = recorded(prior, body_field, count)
    assert got.mag is not None
    return got.mag @ level_R_body.T


@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (12.0, -25.0)])
def test_ma_calibration_undoes_the_iron_of_his_table(tilt_deg: tuple[float, float]) -> None:
    """Ma (6) gives the offsets, Ma (8)-(12) a circle again, whatever the tilt of the sensor in stance."""
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
    run = sensor.switch_on(np.random.default_rng(5))
    fields = 30.0 * np.vstack([np.zeros(3), np.eye(3)])  # for ten seconds each
    t, still = np.arange(16_000) / 400.0, np.zeros((16_000, 3))
    mag = run.measure(t, still, still, lambda t: fields[np.floor(t / 10.0).astype(int).clip(0)]).mag
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


def test_shoes_have_the_iron_of_real_ones() -> None:
    """Real ones: 1 to 92 uT, half of them 5 or less."""
    prior = preset("mpu-9250-shoe")
    rng = np.random.default_rng(7)
    size = np.array([np.linalg.norm(prior.draw(rng).hard_iron_uT) for _ in range(2000)])
    low, middle, high = np.percentile(size, [10, 50, 98])
    assert low < 2.0
    assert middle == pytest.approx(5.0, rel=0.15)
    assert 60.0 < high < 120.0


def test_fixed_iron_is_exact_whatever_chips_there_are() -> None:
    hard, soft = np.array([3.0, -4.0, 5.0]), np.array([[1.1, 0.02, 0.0], [0.02, 0.9, -0.01], [0.0, -0.01, 1.0]])
    for seed in range(3):
        sensor = preset("mpu-9250x8").with_iron(make_iron(hard, soft)).draw(np.random.default_rng(seed))
        assert sensor.hard_iron_uT == pytest.approx(hard, abs=1e-12)
        assert sensor.soft_iron == pytest.approx(soft, abs=1e-12)
