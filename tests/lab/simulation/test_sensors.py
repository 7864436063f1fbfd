"""The whole sensor: blocks, units, what stays and what is new, presets, and parameters that cannot be."""

import json
import time
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from fg_nav.arrays import Floats
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
    preset,
)
from fg_nav.recording import Recording

EIGHT = preset("mpu-9250x8")
assert EIGHT.mag is not None

UNFORGIVING = replace(
    EIGHT,
    mag=replace(EIGHT.mag, held=True),
    mount_sd_rad=0.02,
    clock=ClockPrior(jitter_s=1e-3, scale_sd=1e-4, dropped_share=0.05, burst=2.0),
)


def waves(t: Floats) -> Floats:
    return np.stack([np.sin(5 * t), np.cos(3 * t), np.sin(2 * t + 1)], axis=1)


def motion(count: int, rate_hz: float) -> tuple[Floats, Floats, Floats]:
    """Instants (N,), and a rate and a specific force that change."""
    t = np.arange(count) / rate_hz
    return t, 8 * waves(t), 20 * waves(t) + [0.0, 0.0, GRAVITY_M_S2]


def changing_field(t: Floats) -> Floats:
    return 45 * waves(t)


def no_field(t: Floats) -> Floats:
    return np.zeros((len(t), 3))


def switch_on(prior: SensorPrior, seed: int = 0) -> SensorRun:
    return prior.draw(np.random.default_rng(seed)).switch_on(np.random.default_rng(seed + 1))


def recorded(prior: SensorPrior, count: int, block: int) -> Samples:
    run, (t, rate, force) = switch_on(prior), motion(count, prior.rate_hz)
    cuts = [slice(i, i + block) for i in range(0, count, block)]
    parts = [(cut.start, run.measure(t[cut], rate[cut], force[cut], changing_field)) for cut in cuts]
    names = ("t", "taken", "acc", "gyr", "mag")
    joined = {name: np.concatenate([getattr(part, name) for _, part in parts]) for name in names}
    fresh = np.concatenate([part.fresh for _, part in parts if part.fresh is not None])
    return Samples(**joined, fresh=fresh, row=np.concatenate([start + part.row for start, part in parts]))


@pytest.mark.parametrize("block", [1, 7, 400, 1999])
def test_nothing_depends_on_the_size_of_blocks(block: int) -> None:
    whole, cut = recorded(UNFORGIVING, 2000, 2000), recorded(UNFORGIVING, 2000, block)
    assert len(whole) < 2000
    assert np.array_equal(cut.row, whole.row)
    for name in ("t", "taken", "acc", "gyr", "mag", "fresh"):
        # the last digit of a product of matrices depends on how many rows it has
        assert getattr(cut, name) == pytest.approx(getattr(whole, name), rel=1e-12, abs=1e-12, nan_ok=True), name


def test_what_arrives_makes_a_recording() -> None:
    samples = recorded(UNFORGIVING, 4000, 1000)
    recording = Recording(samples.t, samples.acc, samples.gyr, samples.mag)
    assert recording.duration_s == pytest.approx(10.0, rel=0.01)
    assert np.diff(samples.t).max() < 0.1


def test_an_ideal_sensor_measures_the_truth() -> None:
    t, rate, force = motion(500, 200.0)
    samples = switch_on(preset("ideal")).measure(t, rate, force, changing_field)
    assert samples.mag is not None
    field = changing_field(t)
    for got, true in ((samples.t, t), (samples.gyr, rate), (samples.acc, force), (samples.mag, field)):
        assert np.array_equal(got, true)


def test_a_sensor_stays_itself_and_wakes_up_differently() -> None:
    prior = preset("mpu-9250x8")
    first, second = (prior.draw(np.random.default_rng(3)) for _ in range(2))
    assert first.as_dict() == second.as_dict()
    assert first.as_dict() != prior.draw(np.random.default_rng(4)).as_dict()
    one_walk, another = (first.switch_on(np.random.default_rng(seed)) for seed in (1, 2))
    assert one_walk.as_dict() != another.as_dict()
    rng = np.random.default_rng(1)
    assert first.switch_on(rng).as_dict() != first.switch_on(rng).as_dict()


def test_switching_an_error_off_leaves_the_others_as_they_were() -> None:
    prior = preset("mpu-9250")
    assert prior.mag is not None
    without = replace(prior, gyr=replace(prior.gyr, scale_sd=0.0, cross_axis_sd=0.0, drift=Drift()))
    rngs = (np.random.default_rng(1) for _ in range(2))
    full, part = (p.draw(rng) for p, rng in zip((prior, without), rngs, strict=True))
    assert np.array_equal(part.gyr_matrix, np.eye(3))
    assert np.array_equal(full.acc_matrix, part.acc_matrix)
    assert np.array_equal(full.soft_iron, part.soft_iron)
    t, rate, force = motion(100, 400.0)
    runs = (sensor.switch_on(np.random.default_rng(2)) for sensor in (full, part))
    with_it, without_it = (run.measure(t, rate, force, changing_field) for run in runs)
    assert np.array_equal(with_it.acc, without_it.acc)
    assert np.array_equal(with_it.mag, without_it.mag, equal_nan=True)


def test_readings_are_truth_distorted_by_the_errors_in_the_json() -> None:
    """With all noise off, what `Sensor` and `biases_at` tell explains the readings to rounding."""
    prior = replace(UNFORGIVING, clock=ClockPrior())
    gyr, acc = (replace(p, noise_density=0.0, resolution=0.0, limit=np.inf) for p in (prior.gyr, prior.acc))
    run = switch_on(replace(prior, gyr=gyr, acc=acc))
    t, rate, force = motion(3000, 400.0)
    samples, true = run.measure(t, rate, force, changing_field), run.biases_at(t)
    sensor = run.sensor
    explained = rate @ sensor.gyr_matrix.T + force @ sensor.g_sensitivity.T + true.gyr
    assert samples.gyr == pytest.approx(explained, abs=1e-12)
    assert samples.acc == pytest.approx(force @ sensor.acc_matrix.T + true.acc, abs=1e-12)
    assert np.ptp(true.gyr, axis=0).min() > 0
    told = run.as_dict()
    assert true.gyr[0] == pytest.approx(told["gyr_turn_on_bias_rad_s"], abs=5 * gyr.drift.sd)


def noise_of(prior: SensorPrior) -> tuple[float, float, float]:
    """Standard deviation of successive differences at rest over sqrt(2): gyr, acc, mag."""
    run = switch_on(prior)
    t = np.arange(40_000) * prior.period_s
    rest = np.zeros((len(t), 3))
    samples = run.measure(t, rest, rest, no_field)
    assert samples.mag is not None
    mag = samples.mag[samples.fresh]
    gyr, acc, field = (float(np.diff(x, axis=0).std() / np.sqrt(2)) for x in (samples.gyr, samples.acc, mag))
    return gyr, acc, field


def test_eight_units_are_quieter_by_the_root_of_eight() -> None:
    one, eight = noise_of(preset("mpu-9250")), noise_of(preset("mpu-9250x8"))
    assert np.array(one) / np.array(eight) == pytest.approx([np.sqrt(8)] * 3, rel=0.03)


def test_what_units_share_does_not_average_away() -> None:
    unit = SensorPrior(
        "unit",
        100.0,
        gyr=TriadPrior(scale_sd=0.01),
        mag=MagnetometerPrior(offset_sd_uT=10.0),
        iron=IronPrior(hard_sd_uT=5.0),
        mount_sd_rad=0.01,
    )
    spread = {}
    for count in (1, 4, 16):
        sensors = [replace(unit, units=count).draw(np.random.default_rng(seed)) for seed in range(400)]
        scale = np.stack([np.diag(s.gyr_matrix @ s.board_R_body.T) for s in sensors]).std()
        hard = np.stack([s.hard_iron_uT for s in sensors]).std()
        mount = np.stack([s.board_R_body[[2, 0, 1], [1, 2, 0]] for s in sensors]).std()
        spread[count] = (scale, hard, mount)
        wanted = (0.01 / np.sqrt(count), np.hypot(5.0, 10.0 / np.sqrt(count)), 0.01)
        assert spread[count] == pytest.approx(wanted, rel=0.08)


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


def leaves(value: object) -> list[object]:
    """All numbers and texts in nested dataclasses and tuples."""
    if is_dataclass(value):
        return [leaf for item in fields(value) for leaf in leaves(getattr(value, item.name))]
    return [leaf for part in value for leaf in leaves(part)] if isinstance(value, tuple) else [value]


@pytest.mark.parametrize("name", PRESETS)
def test_parameters_of_presets_are_plain(name: str) -> None:
    """A number of numpy is written otherwise in messages and files."""
    assert {type(leaf) for leaf in leaves(preset(name))} <= {float, int, bool, str, type(None)}


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_measures_and_is_written_as_json(name: str) -> None:
    prior = preset(name)
    assert prior.name == name
    run = switch_on(prior)
    samples = run.measure(*motion(1000, prior.rate_hz), changing_field)
    assert (samples.mag is None) == (prior.mag is None)
    assert np.isfinite(samples.gyr).all()
    assert np.isfinite(samples.acc).all()
    text = json.dumps({"sensor": run.sensor.as_dict(), "walk": run.as_dict()}, allow_nan=False)
    assert json.loads(text)["sensor"]["prior"]["rate_hz"] == prior.rate_hz


def test_the_data_sheets_noise_in_their_own_bandwidth() -> None:
    """MPU-9250: 0.1 deg/s rms in 92 Hz. GX5: 0.055 deg/s and 0.010 m/s^2 a sample at 200 Hz in a real recording."""
    mpu_gyr, _, _ = noise_of(preset("mpu-9250").at_rate(184.0))
    assert np.rad2deg(mpu_gyr) == pytest.approx(0.1, rel=0.06)
    gx5_gyr, gx5_acc, _ = noise_of(preset("lord-gx5"))
    assert np.rad2deg(gx5_gyr) == pytest.approx(0.055, rel=0.15)
    assert gx5_acc == pytest.approx(0.010, rel=0.15)


def test_table_2_of_munoz_diaz_is_exact() -> None:
    prior = preset("munoz-diaz-table-2")
    run = switch_on(prior)
    t, rest = np.arange(100_000) / 100.0, np.zeros((100_000, 3))
    samples = run.measure(t, rest, rest, no_field)
    assert np.rad2deg(samples.gyr.mean(axis=0)) == pytest.approx([-0.1, 0.1, -0.1], abs=0.002)
    assert np.rad2deg(samples.gyr.std(axis=0)) == pytest.approx([0.1, 0.1, 0.1], rel=0.02)
    assert samples.mag is not None
    assert samples.mag.std(axis=0) == pytest.approx([0.015] * 3, rel=0.02)
    assert np.rad2deg(run.biases_at(np.array([0.0, 2340.0])).gyr) == pytest.approx(np.array([[-0.1, 0.1, -0.1]] * 2))


def test_a_fibre_optic_gyroscope_stays_within_a_degree_an_hour() -> None:
    """Munoz Diaz, section 2.2: integrated for an hour at rest, no axis errs by more than about a degree."""
    prior = preset("kvh-1750")
    ends = []
    for seed in range(20):
        run = switch_on(prior.at_rate(10.0), seed)
        t, rest = np.arange(36_000) / 10.0, np.zeros((36_000, 3))
        ends.append(np.rad2deg(run.measure(t, rest, rest).gyr.sum(axis=0) / 10.0))
    assert 0.3 < np.std(ends) < 1.5


def test_an_hour_at_400_hz_takes_seconds() -> None:
    run = switch_on(preset("mpu-9250x8"))
    t, rate, force = motion(50_000, 400.0)
    run.measure(t[:10], rate[:10], force[:10], changing_field)
    begin = time.process_time()
    run.measure(t + 1.0, rate, force, changing_field)
    assert time.process_time() - begin < 8.0 / 28.8 * 3, "1.44 million samples would take more than 24 s"


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: TriadPrior(noise_density=-0.1), "noise_density"),
        (lambda: TriadPrior(bias_sd=float("nan")), "bias_sd"),
        (lambda: TriadPrior(bias=(0.0, 1.0)), "bias"),
        (lambda: TriadPrior(bias=(0.0, 1.0, float("inf"))), "bias"),
        (lambda: TriadPrior(limit=0.0), "limit"),
        (lambda: TriadPrior(resolution=-1.0), "resolution"),
        (lambda: TriadPrior(scale_sd="1 %"), "scale_sd"),
        (lambda: Drift(sd=-1.0), "sd"),
        (lambda: Drift(time_s=0.0), "time_s"),
        (lambda: MagnetometerPrior(rate_hz=0.0), "rate_hz"),
        (lambda: MagnetometerPrior(noise_sd_uT=-0.5), "noise_sd_uT"),
        (lambda: MagnetometerPrior(lag_s=float("inf")), "lag_s"),
        (lambda: IronPrior(soft=((1.0, 0.0), (0.0, 1.0))), "soft"),
        (lambda: IronPrior(hard_sd_uT=float("nan")), "hard_sd_uT"),
        (lambda: ClockPrior(jitter_s=-1e-3), "jitter_s"),
        (lambda: ClockPrior(dropped_share=0.9), "dropped_share"),
        (lambda: ClockPrior(burst=0.0), "burst"),
        (lambda: ClockPrior(longest_gap_s=float("inf")), "longest_gap_s"),
        (lambda: SensorPrior("none", rate_hz=0.0), "rate_hz"),
        (lambda: SensorPrior("none", rate_hz=float("nan")), "rate_hz"),
        (lambda: SensorPrior("none", 100.0, units=0), "units"),
        (lambda: preset("ideal").at_rate(-1.0), "rate_hz"),
        (lambda: ClockPrior(scale_sd=0.011), "scale_sd"),
        (lambda: ClockPrior(jitter_s=0.051), "jitter_s"),
        (lambda: ClockPrior(burst=1e300), "burst"),
        (lambda: ClockPrior(longest_gap_s=2.0), "longest_gap_s"),
        (lambda: ClockPrior(longest_gap_s=0.0), "longest_gap_s"),
        (lambda: TriadPrior(scale_sd=0.51), "scale_sd"),
        (lambda: TriadPrior(cross_axis_sd=0.51), "cross_axis_sd"),
        (lambda: MagnetometerPrior(scale_sd=0.51), "scale_sd"),
        (lambda: MagnetometerPrior(cross_axis_sd=0.51), "cross_axis_sd"),
        (lambda: MagnetometerPrior(lag_s=0.21), "lag_s"),
        (lambda: MagnetometerPrior(noise_sd_uT=1.1e4), "noise_sd_uT"),
        (lambda: MagnetometerPrior(offset_sd_uT=1.1e4), "offset_sd_uT"),
        (lambda: MagnetometerPrior(resolution_uT=1.1e4), "resolution_uT"),
        (lambda: IronPrior(hard_sd_uT=1.1e4), "hard_sd_uT"),
        (lambda: IronPrior(hard_uT=(0.0, 0.0, -1.1e4)), "hard_uT"),
        (lambda: IronPrior(soft_sd=0.51), "soft_sd"),
        (lambda: IronPrior(soft=((11.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))), "soft"),
        (lambda: SensorPrior("any", 100.0, mount_sd_rad=3.2), "mount_sd_rad"),
    ],
)
def test_what_cannot_be_is_named(make: Callable[[], object], field: str) -> None:
    with pytest.raises(SimulationError, match=rf"^{field} of a \w+ is .*: give .*\.$"):
        make()


@pytest.mark.parametrize(
    ("triad", "field"),
    [
        (lambda most: TriadPrior(noise_density=most), "noise_density"),
        (lambda most: TriadPrior(bias_sd=most), "bias_sd"),
        (lambda most: TriadPrior(bias=(0.0, -most, 0.0)), "bias"),
        (lambda most: TriadPrior(g_sensitivity_sd=most), "g_sensitivity_sd"),
        (lambda most: TriadPrior(resolution=most), "resolution"),
        (lambda most: TriadPrior(drift=Drift(sd=most)), "sd"),
        (lambda most: TriadPrior(drift=Drift(walk=most)), "walk"),
    ],
)
@pytest.mark.parametrize(("where", "most"), [("gyr", 100.0), ("acc", 1000.0)])
def test_errors_beyond_any_range_are_refused(
    triad: Callable[[float], TriadPrior], field: str, where: str, most: float
) -> None:
    def make(size: float) -> SensorPrior:
        return replace(SensorPrior("any", 100.0), **{where: triad(size)})

    make(most)
    with pytest.raises(SimulationError, match=rf"^{field} of a SensorPrior\.{where}[.a-z]* is .*{most:g}\.$"):
        make(1.01 * most)


def test_an_unknown_sensor_names_the_known_ones() -> None:
    with pytest.raises(SimulationError, match=r"no sensor 'mpu': take one of ideal, .*mpu-9250x8"):
        preset("mpu")


def test_blocks_that_do_not_follow_on_are_refused() -> None:
    run, (t, rate, force) = switch_on(preset("demo")), motion(100, 200.0)
    run.measure(t[:50], rate[:50], force[:50], changing_field)
    with pytest.raises(SimulationError, match="do not rise"):
        run.measure(t[40:], rate[40:], force[40:], changing_field)
    with pytest.raises(SimulationError, match=r"force to measure has shape \(49, 3\), not \(50, 3\)"):
        run.measure(t[50:], rate[50:], force[51:], changing_field)
    force[70, 1] = np.nan
    with pytest.raises(SimulationError, match=r"force to measure is not finite at 0\.350 s"):
        run.measure(t[50:], rate[50:], force[50:], changing_field)
