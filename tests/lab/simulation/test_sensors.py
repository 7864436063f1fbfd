"""The whole sensor: blocks, units, what stays and what is new, its magnetometer, its clock, and what cannot be."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.sensors import (
    PRESETS,
    ClockPrior,
    Drift,
    IronPrior,
    MagnetometerPrior,
    Samples,
    SensorPrior,
    SensorRun,
    TriadPrior,
    make_iron,
    preset,
    read_sensor,
)
from fg_nav.lab.simulation.sensors.clock import ClockRun
from fg_nav.recording import Recording
from fg_nav.samples.stamps import remove_jitter

EIGHT = preset("mpu-9250x8")
assert EIGHT.mag is not None

UNFORGIVING = replace(
    EIGHT,
    mag=replace(EIGHT.mag, held=True),
    clock=ClockPrior(jitter_s=1e-3, scale_sd=1e-4, dropped_share=0.05, burst=2.0),
)
NAV_FIELD = np.array([0.0, 20.0, -44.0])


def waves(t: Floats) -> Floats:
    return np.stack([np.sin(5 * t), np.cos(3 * t), np.sin(2 * t + 1)], axis=1)


def motion(count: int, rate_hz: float) -> tuple[Floats, Floats, Floats]:
    """Instants (N,), and a rate and a specific force that change."""
    t = np.arange(count) / rate_hz
    return t, 8 * waves(t), 20 * waves(t) + [0.0, 0.0, GRAVITY_M_S2]


def changing_field(t: Floats) -> Floats:
    return 45 * waves(t)


def spinning(t: Floats, turns_a_second: float = 1.0) -> Floats:
    """A field that turns about the vertical."""
    angle = 2 * np.pi * turns_a_second * t
    return 40.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle + 1], axis=1)


def switch_on(prior: SensorPrior, seed: int = 0) -> SensorRun:
    return prior.draw(np.random.default_rng(seed)).switch_on(np.random.default_rng(seed + 1))


def recorded(
    prior: SensorPrior, count: int, block: int = 10**6, body_field: Callable[[Floats], Floats] = changing_field
) -> Samples:
    run, (t, rate, force) = switch_on(prior), motion(count, prior.rate_hz)
    cuts = [slice(i, i + block) for i in range(0, count, block)]
    parts = [(cut.start, run.measure(t[cut], rate[cut], force[cut], body_field)) for cut in cuts]
    names = ("t", "taken", "acc", "gyr", "mag")
    joined = {name: np.concatenate([getattr(part, name) for _, part in parts]) for name in names}
    return Samples(**joined, row=np.concatenate([start + part.row for start, part in parts]))


def fresh(samples: Samples) -> Bools:
    """Rows with a sample of the field."""
    return np.isfinite(samples.mag).all(axis=1)


def slow_mag(**parameters: object) -> SensorPrior:
    """A sensor at 400 Hz whose magnetometer has 100."""
    return SensorPrior("test", 400.0, mag=MagnetometerPrior(**{"rate_hz": 100.0, **parameters}))


# ---- the whole


@pytest.mark.parametrize("block", [1, 400, 1999])
def test_nothing_depends_on_the_size_of_blocks_and_all_makes_a_recording(block: int) -> None:
    whole, cut = recorded(UNFORGIVING, 2000), recorded(UNFORGIVING, 2000, block)
    assert len(whole) < 2000
    assert np.array_equal(cut.row, whole.row)
    for name in ("t", "taken", "acc", "gyr", "mag"):
        # the last digit of a product of matrices depends on how many rows it has
        assert getattr(cut, name) == pytest.approx(getattr(whole, name), rel=1e-12, abs=1e-12, nan_ok=True), name
    recording = Recording(whole.t, whole.acc, whole.gyr, whole.mag)
    assert recording.duration_s == pytest.approx(5.0, rel=0.01)
    assert np.diff(whole.t).max() < 0.1


def test_an_ideal_sensor_measures_the_truth() -> None:
    t, rate, force = motion(500, 200.0)
    samples = switch_on(preset("ideal")).measure(t, rate, force, changing_field)
    for got, true in ((samples.t, t), (samples.gyr, rate), (samples.acc, force), (samples.mag, changing_field(t))):
        assert np.array_equal(got, true)


def test_a_sensor_stays_itself_and_wakes_up_differently() -> None:
    first, second = (EIGHT.draw(np.random.default_rng(3)) for _ in range(2))
    assert first.as_dict() == second.as_dict() != EIGHT.draw(np.random.default_rng(4)).as_dict()
    rng = np.random.default_rng(1)
    assert first.switch_on(rng).as_dict() != first.switch_on(rng).as_dict()


def test_switching_an_error_off_leaves_the_others_as_they_were() -> None:
    prior = preset("mpu-9250")
    without = replace(prior, gyr=replace(prior.gyr, scale_sd=0.0, cross_axis_sd=0.0, drift=Drift()))
    full, part = (p.draw(np.random.default_rng(1)) for p in (prior, without))
    assert np.array_equal(part.effective["gyr_matrix"], np.eye(3))
    for name in ("acc_matrix", "soft_iron", "hard_iron_uT"):
        assert np.array_equal(full.effective[name], part.effective[name])
    with_it, without_it = (
        sensor.switch_on(np.random.default_rng(2)).measure(*motion(100, 400.0), changing_field)
        for sensor in (full, part)
    )
    assert np.array_equal(with_it.acc, without_it.acc)
    assert np.array_equal(with_it.mag, without_it.mag, equal_nan=True)


def test_readings_are_truth_distorted_by_the_errors_in_the_json() -> None:
    """With all noise off, what `Sensor` and `biases_at` tell explains the readings to rounding."""
    prior = replace(UNFORGIVING, clock=ClockPrior())
    gyr, acc = (replace(p, noise_density=0.0, resolution=0.0, limit=np.inf) for p in (prior.gyr, prior.acc))
    run = switch_on(replace(prior, gyr=gyr, acc=acc))
    t, rate, force = motion(3000, 400.0)
    samples, true, sensor = run.measure(t, rate, force, changing_field), run.biases_at(t), run.sensor
    explained = rate @ sensor.effective["gyr_matrix"].T + force @ sensor.effective["g_sensitivity"].T + true.gyr
    assert samples.gyr == pytest.approx(explained, abs=1e-12)
    assert samples.acc == pytest.approx(force @ sensor.effective["acc_matrix"].T + true.acc, abs=1e-12)
    assert np.ptp(true.gyr, axis=0).min() > 0
    assert true.gyr[0] == pytest.approx(run.as_dict()["gyr_turn_on_bias_rad_s"], abs=5 * gyr.drift.sd)


def noise_of(prior: SensorPrior) -> tuple[float, float, float]:
    """Standard deviation of successive differences at rest over sqrt(2): gyr, acc, mag."""
    t, rest = np.arange(40_000) * prior.period_s, np.zeros((40_000, 3))
    samples = switch_on(prior).measure(t, rest, rest, lambda at: np.zeros((len(at), 3)))
    columns = samples.gyr, samples.acc, samples.mag[np.isfinite(samples.mag[:, 0])]
    gyr, acc, mag = (float(np.diff(x, axis=0).std() / np.sqrt(2)) for x in columns)
    return gyr, acc, mag


def test_eight_units_are_quieter_by_the_root_of_eight_and_sheets_are_met() -> None:
    """MPU-9250: 0.1 deg/s rms in 92 Hz. GX5: 0.055 deg/s and 0.010 m/s^2 a sample at 200 Hz in a real recording."""
    one, eight = noise_of(preset("mpu-9250")), noise_of(EIGHT)
    assert np.array(one) / np.array(eight) == pytest.approx([np.sqrt(8)] * 3, rel=0.03)
    assert np.rad2deg(noise_of(preset("mpu-9250").at_rate(184.0))[0]) == pytest.approx(0.1, rel=0.06)
    gyr, acc, _ = noise_of(preset("lord-gx5"))
    assert (np.rad2deg(gyr), acc) == pytest.approx((0.055, 0.010), rel=0.15)


def test_what_units_share_does_not_average_away() -> None:
    triad, mag = TriadPrior(scale_sd=0.01), MagnetometerPrior(offset_sd_uT=10.0)
    unit = SensorPrior("unit", 100.0, gyr=triad, mag=mag, iron=IronPrior(hard_sd_uT=5.0))
    for count in (1, 4, 16):
        sensors = [replace(unit, units=count).draw(np.random.default_rng(seed)) for seed in range(400)]
        scale = np.stack([np.diag(s.effective["gyr_matrix"]) for s in sensors]).std()
        hard = np.stack([s.effective["hard_iron_uT"] for s in sensors]).std()
        wanted = (0.01 / np.sqrt(count), np.hypot(5.0, 10.0 / np.sqrt(count)))
        assert (scale, hard) == pytest.approx(wanted, rel=0.08)


def test_each_unit_is_cut_at_its_range_before_the_average() -> None:
    limit, step = 5.0, 0.01
    triad = TriadPrior(scale_sd=0.1, limit=limit, resolution=step)
    run = switch_on(SensorPrior("pair", 100.0, gyr=triad, units=2, mag=None))
    scales = np.stack([np.diag(unit.gyr.matrix) for unit in run.sensor.units])
    true = np.linspace(0.0, 8.0, 801)[:, None] * np.ones(3)
    gyr = run.measure(np.arange(801) / 100.0, true, np.zeros_like(true)).gyr
    readings = np.minimum(true * scales[:, None, :], limit)
    assert gyr == pytest.approx(readings.mean(axis=0), abs=step / 2 + 1e-9)
    assert np.abs(np.minimum(true * scales.mean(axis=0), limit) - gyr).max() > 5 * step
    assert gyr / (step / 2) == pytest.approx(np.rint(gyr / (step / 2)), abs=1e-6)
    assert gyr[-1] == pytest.approx([limit] * 3)


def test_table_2_of_munoz_diaz_is_exact() -> None:
    run = switch_on(preset("munoz-diaz-table-2"))
    t, rest = np.arange(100_000) / 100.0, np.zeros((100_000, 3))
    samples = run.measure(t, rest, rest, lambda at: np.zeros((len(at), 3)))
    assert np.rad2deg(samples.gyr.mean(axis=0)) == pytest.approx([-0.1, 0.1, -0.1], abs=0.002)
    assert np.rad2deg(samples.gyr.std(axis=0)) == pytest.approx([0.1, 0.1, 0.1], rel=0.02)
    assert samples.mag.std(axis=0) == pytest.approx([0.015] * 3, rel=0.02)
    assert np.rad2deg(run.biases_at(np.array([0.0, 2340.0])).gyr) == pytest.approx(np.array([[-0.1, 0.1, -0.1]] * 2))


def test_sensors_by_name_inherit_and_a_table_changes_what_it_names() -> None:
    raw, calibrated = preset("mpu-9250-raw"), preset("mpu-9250")
    assert all(preset(name).name == name for name in PRESETS)
    assert raw.gyr == replace(
        calibrated.gyr, bias_sd=raw.gyr.bias_sd, scale_sd=0.015, cross_axis_sd=0.01, g_sensitivity_sd=1.77974e-4
    )
    assert (raw.mag, raw.iron, raw.clock) == (calibrated.mag, calibrated.iron, calibrated.clock)
    assert replace(calibrated, name="mpu-9250x8", units=8) == EIGHT
    fast = read_sensor({"rate_hz": 500, "gyr": {"drift": {"walk": 0.5}}, "mag": "none"}, calibrated)
    assert (fast.rate_hz, fast.mag, fast.acc) == (500.0, None, calibrated.acc)
    assert fast.gyr == replace(calibrated.gyr, drift=replace(calibrated.gyr.drift, walk=0.5))


# ---- the magnetometer


def test_fresh_rows_keep_the_rate_and_the_others_are_empty_or_held() -> None:
    got = recorded(slow_mag(), 4000, body_field=spinning)
    assert set(np.diff(np.flatnonzero(fresh(got)))[1:]) == {4}
    assert fresh(got)[0]
    assert got.mag[fresh(got)] == pytest.approx(spinning(got.t[fresh(got)]))
    odd = fresh(recorded(slow_mag(rate_hz=61.7), 40_000))
    assert odd.sum() == pytest.approx(61.7 * 100.0, abs=2)
    assert set(np.diff(np.flatnonzero(odd))[1:]) == {6, 7}
    assert all(fresh(recorded(slow_mag(rate_hz=rate_hz), 2000)).all() for rate_hz in (400.0, 1000.0, np.inf))
    empty = recorded(slow_mag(noise_sd_uT=0.5), 4000, body_field=spinning)
    held = recorded(slow_mag(noise_sd_uT=0.5, held=True), 4000, 37, spinning)
    assert np.array_equal(held.mag[fresh(empty)], empty.mag[fresh(empty)])
    assert np.array_equal(np.abs(np.diff(held.mag, axis=0)).max(axis=1) > 0, fresh(empty)[1:])


@pytest.mark.parametrize(("block", "turns_a_second"), [(13, 1.0), (10**6, 170.0)])
def test_a_lagging_sample_shows_the_field_of_then_which_is_asked_for_only_there(
    block: int, turns_a_second: float
) -> None:
    """To rounding, from the first row on, and however far the field turns from row to row: nothing is interpolated."""
    asked: list[Floats] = []

    def listening(t: Floats) -> Floats:
        asked.append(t.copy())
        return spinning(t, turns_a_second)

    got = recorded(slow_mag(lag_s=0.011), 4000, block, listening)
    assert fresh(got)[0]
    x, y, z = got.mag[fresh(got)].T
    late = np.angle((x + 1j * y) * np.exp(-2j * np.pi * turns_a_second * got.t[fresh(got)]))
    lag_turns = -0.011 * turns_a_second
    assert late == pytest.approx(2 * np.pi * (lag_turns - np.rint(lag_turns)), abs=1e-9)
    assert np.hypot(x, y) == pytest.approx(z)
    assert np.concatenate(asked) == pytest.approx(got.t[fresh(got)] - 0.011, abs=1e-12)
    assert len(asked) == len(set(np.flatnonzero(fresh(got)) // block))


def test_without_a_magnetometer_nobody_asks_for_the_field() -> None:
    def never(t: Floats) -> Floats:
        raise AssertionError(f"asked for {len(t)} instants")

    samples = switch_on(SensorPrior("blind", 400.0, mag=None)).measure(*motion(100, 400.0), never)
    assert samples.mag is None


def test_effective_iron_is_what_the_readings_have() -> None:
    sensor = EIGHT.draw(np.random.default_rng(4))
    fields = 30.0 * np.vstack([np.zeros(3), np.eye(3)])  # for ten seconds each
    t, still = np.arange(16_000) / 400.0, np.zeros((16_000, 3))
    run = sensor.switch_on(np.random.default_rng(5))
    mag = run.measure(t, still, still, lambda at: fields[np.floor(at / 10.0).astype(int).clip(0)]).mag
    none, *axes = (np.nanmean(part[20:], axis=0) for part in np.split(mag, 4))
    assert none == pytest.approx(sensor.effective["hard_iron_uT"], abs=0.03)
    assert np.stack(axes, axis=1) - none[:, None] == pytest.approx(30.0 * sensor.effective["soft_iron"], abs=0.06)
    hard, soft = np.array([3.0, -4.0, 5.0]), np.array([[1.1, 0.02, 0.0], [0.02, 0.9, -0.01], [0.0, -0.01, 1.0]])
    exact = EIGHT.with_iron(make_iron(hard, soft)).draw(np.random.default_rng(0))
    assert exact.effective["hard_iron_uT"] == pytest.approx(hard, abs=1e-12)
    assert exact.effective["soft_iron"] == pytest.approx(soft, abs=1e-12)


def test_iron_is_drawn_alike_in_all_directions_and_as_in_real_shoes() -> None:
    """Real ones: 1 to 92 uT, half of them 5 or less."""
    rng = np.random.default_rng(6)
    irons = [IronPrior(hard_uT=(1.0, 2.0, 3.0), hard_sd_uT=5.0, soft_sd=0.06).draw(rng) for _ in range(3000)]
    hard, soft = np.stack([iron.hard_uT for iron in irons]), np.stack([iron.soft for iron in irons])
    assert hard.mean(axis=0) == pytest.approx([1.0, 2.0, 3.0], abs=0.4)
    assert hard.std(axis=0) == pytest.approx([5.0, 5.0, 5.0], rel=0.05)
    assert np.array_equal(soft, soft.transpose(0, 2, 1))
    for direction in (np.array([1.0, 0.0, 0.0]), np.array([0.6, 0.0, 0.8]), np.ones(3) / np.sqrt(3)):
        along = np.einsum("i,nij,j->n", direction, soft, direction)
        assert (along.mean(), along.std()) == pytest.approx((1.0, 0.06), abs=0.005)
    size = [np.linalg.norm(preset("mpu-9250-shoe").draw(rng).effective["hard_iron_uT"]) for _ in range(2000)]
    low, middle, high = np.percentile(size, [10, 50, 98])
    assert low < 2.0
    assert middle == pytest.approx(5.0, rel=0.15)
    assert 60.0 < high < 120.0


# ---- the clock


def clock(prior: ClockPrior, rate_hz: float = 200.0) -> ClockRun:
    return ClockRun(prior, 1e-3 if prior.scale_sd else 0.0, np.random.default_rng(0), rate_hz)


@pytest.mark.parametrize("jitter_s", [3e-4, 2e-3, 2e-2])
def test_jittered_stamps_rise_keep_the_rate_and_are_right_on_average(jitter_s: float) -> None:
    t = np.arange(100_000) / 200.0
    stamps, taken, row = clock(ClockPrior(jitter_s=jitter_s)).stamp(t)
    assert np.array_equal(row, np.arange(len(t)))
    assert np.array_equal(taken, t)
    assert (np.diff(stamps) > 0).all()
    assert (stamps[-1] - stamps[0]) / t[-1] == pytest.approx(1.0, abs=10 * jitter_s / t[-1])
    delay = stamps - t
    assert delay.std() > 0.5 * jitter_s
    assert delay.min() > -1.001 * jitter_s
    if jitter_s == 3e-4:  # none overtakes another
        assert (delay.mean(), delay.std()) == (pytest.approx(0.0, abs=1e-5), pytest.approx(3e-4, rel=0.03))


def test_a_fast_clock_shows_more_and_our_own_timing_undoes_the_jitter() -> None:
    t = np.arange(20_000) / 200.0
    stamps, taken, _ = clock(ClockPrior(jitter_s=1e-3, scale_sd=3e-5)).stamp(t)
    assert taken == pytest.approx(1.001 * t, rel=1e-12)
    assert np.abs(np.diff(stamps - taken)).max() > 2e-3
    assert np.abs(np.diff(remove_jitter(stamps) - taken)).max() < 5e-6
    errors = [SensorPrior("x", 9.0, clock=ClockPrior(scale_sd=1e-3)).draw(np.random.default_rng(n)) for n in range(150)]
    assert np.std([sensor.clock_scale_error for sensor in errors]) == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize(("share", "burst"), [(0.01, 1.0), (0.05, 3.0), (0.3, 8.0), (0.5, 1.0)])
def test_the_share_is_lost_in_bursts_up_to_the_longest_gap(share: float, burst: float) -> None:
    prior = ClockPrior(dropped_share=share, burst=burst, longest_gap_s=0.05)
    stamps, _, row = clock(prior).stamp(np.arange(400_000) / 200.0)
    assert row[0] == 0
    assert 1 - len(row) / 400_000 == pytest.approx(share, rel=0.08)
    assert np.diff(stamps).max() <= 0.05 + 1e-9
    runs = np.diff(row) - 1
    runs = runs[runs > 0]
    cut = np.minimum(np.random.default_rng(1).geometric(1 / burst, 100_000), 9)
    assert runs.mean() == pytest.approx(cut.mean(), rel=0.04)
    assert runs.std() == pytest.approx(cut.std(), rel=0.05, abs=1e-9)


# ---- what cannot be

IMPOSSIBLE = [
    (lambda: TriadPrior(noise_density=-0.1), "noise_density"),
    (lambda: TriadPrior(bias=(0.0, 1.0)), "bias"),
    (lambda: TriadPrior(scale_sd="1 %"), "scale_sd"),
    (lambda: Drift(time_s=0.5), "time_s"),
    (lambda: IronPrior(soft=((11.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))), "soft"),
    (lambda: ClockPrior(dropped_share=0.9), "dropped_share"),
    (lambda: SensorPrior("none", rate_hz=float("nan")), "rate_hz"),
    (lambda: read_sensor({"gyr": {"limit": "far"}}, EIGHT), "sensor.gyr.limit"),
]


def test_what_cannot_be_is_named() -> None:
    for make, field in IMPOSSIBLE:
        with pytest.raises(SimulationError, match=rf"^{field}[.0-9]* (cannot be .*|is missing): .*\.$"):
            make()
    for make, words in (
        (lambda: preset("mpu"), r"no sensor 'mpu': choose one of ideal, .*mpu-9250x8"),
        (lambda: read_sensor({"gyr": {"noise": 1.0}}, EIGHT), r"sensor.gyr has no parameter 'noise': it knows noise_d"),
        (lambda: clock(ClockPrior(dropped_share=0.01), rate_hz=20.0), "longest_gap_s"),
    ):
        with pytest.raises(SimulationError, match=words):
            make()
