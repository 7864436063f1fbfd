"""A simulated walk as a whole: what the sensor recorded belongs to what is said to be true."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2, compute_heading, wrap_angle
from fg_nav.lab.simulation import SCENARIOS, Choices, Scenario, SimulatedWalk, simulate, walk
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.lab.simulation.scenario_file import parse_scenario
from fg_nav.lab.simulation.sensors import ClockPrior, preset
from fg_nav.recording import Recording

IDEAL = Choices(sensor="ideal")
CORRIDOR = polyline([(0, 0), (0, 12), (9, 12)], 1.2)
SHORT = replace(
    SCENARIOS["demo"], name="short", route=lambda rng: [Stand(3.0), Walk(CORRIDOR), Stand(3.0)], field="indoor"
)


@pytest.fixture(scope="module")
def ideal() -> SimulatedWalk:
    return simulate(SHORT, 3, IDEAL)


@pytest.fixture(scope="module")
def real() -> SimulatedWalk:
    return simulate(SHORT, 3)


def strapdown(recording: Recording, begin_s: float, end_s: float) -> tuple[float, float]:
    """Errors of position (m, rms) and attitude (rad, rms) on the way, of steps of constant rate and force from rest."""
    truth, dt = recording.truth, recording.period_s
    steps = range(round(begin_s / dt), round(end_s / dt))
    R, p = truth.nav_R_body[steps.start], truth.position[steps.start].copy()
    v = (truth.position[steps.start + 1] - truth.position[steps.start - 1]) / (2 * dt)  # one who stands sways
    half = Rotation.from_rotvec(recording.gyr * dt / 2).as_matrix()
    away, turned = [], []
    for k in steps:
        a = R @ half[k] @ recording.acc[k] - [0.0, 0.0, GRAVITY_M_S2]
        p += v * dt + a * dt**2 / 2
        v += a * dt
        R = R @ half[k] @ half[k]
        away.append(p - truth.position[k + 1])
        turned.append(R.T @ truth.nav_R_body[k + 1])
    return rms(np.array(away)), rms(Rotation.from_matrix(turned).magnitude())


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_strapdown_of_ideal_samples_reproduces_the_truth_to_second_order():
    """From standing into the first strides: twice the rate, a quarter of the error."""
    walks = [simulate(SHORT, 3, replace(IDEAL, rate_hz=rate_hz)).recording for rate_hz in (400.0, 800.0)]
    assert np.ptp(walks[0].truth.position[800:2000], axis=0).max() > 1.0
    coarse, fine = (np.array(strapdown(walk, 2.0, 5.0)) for walk in walks)
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.15)
    assert coarse[0] < 1e-3
    assert np.rad2deg(coarse[1]) < 0.01


def test_the_field_turned_back_is_that_of_the_place(ideal):
    truth = ideal.recording.truth
    nav_field = np.einsum("nij,nj->ni", truth.nav_R_body, ideal.recording.mag)
    expected = ideal.field.at(truth.position + ideal.origin)
    np.testing.assert_allclose(nav_field, expected, atol=1e-9)
    assert np.ptp(np.linalg.norm(expected, axis=1)) > 5.0  # it is not homogeneous


def test_at_rest_a_sensor_shows_gravity_its_bias_and_a_noise_of_its_own(real):
    recording, prior = real.recording, real.scenario.prior
    still = recording.t < 2.5
    gyr = recording.gyr[still].mean(axis=0) - real.biases.gyr[:3].mean(axis=0)
    assert np.rad2deg(np.abs(gyr)).max() < 0.05  # g-sensitivity and what noise leaves
    assert abs(np.linalg.norm(recording.acc[still].mean(axis=0)) - GRAVITY_M_S2) < 0.1
    for samples, triad in ((recording.acc, prior.acc), (recording.gyr, prior.gyr)):
        noise = np.diff(samples[still], axis=0).std(axis=0) / np.sqrt(2)
        np.testing.assert_allclose(noise, triad.noise_density * np.sqrt(prior.rate_hz), rtol=0.2)


def test_the_foot_is_slow_where_it_is_said_to_be_flat_and_fast_elsewhere(ideal):
    truth = ideal.recording.truth
    speed = np.linalg.norm(np.gradient(truth.position, truth.t, axis=0), axis=1)
    flat = np.zeros(len(truth.t), dtype=bool)
    for start, stop in ideal.flat:
        flat |= (truth.t > start + 0.05) & (truth.t < stop - 0.05)  # it rolls faster where it comes down and leaves
    assert np.percentile(speed[flat], 99) < 0.3
    assert speed[~flat].mean() > 1.0
    assert len(ideal.flat) == len(ideal.strides) + 1


def test_truth_begins_at_the_origin_and_goes_as_far_as_the_course(ideal):
    position, footprint = ideal.recording.truth.position, ideal.strides.footprint
    np.testing.assert_array_equal(position[0], 0.0)
    np.testing.assert_allclose(position[-1, :2], footprint[-1, :2] - footprint[0, :2], atol=0.3)


RATE_HZ = 41.0  # Quick for all scenarios, and fast enough that a lost sample leaves no gap.
LARGE = {"office", "office-open", "mall", "mall-open"}  # Their buildings take seconds to draw; others have one too.


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_seed_is_one_walk_and_another_seed_another(name):
    choices = Choices(rate_hz=RATE_HZ, field="homogeneous" if name in LARGE else None)
    walk, again, other = (simulate(name, seed, choices) for seed in (5, 5, 6))
    one, same, different = (w.recording for w in (walk, again, other))
    for column in ("t", "acc", "gyr", "mag"):
        np.testing.assert_array_equal(getattr(one, column), getattr(same, column))
    np.testing.assert_array_equal(one.truth.position, same.truth.position)
    n = min(len(one), len(different), 50)
    assert (one.gyr[:n] != different.gyr[:n]).any(axis=1).all()
    assert not np.allclose(one.truth.nav_R_body[0], different.truth.nav_R_body[0], atol=1e-4)
    assert walk.drawn != other.drawn
    if len(walk.strides):  # person and path
        k = min(len(walk.strides), len(other.strides))
        assert (walk.strides.duration[:k] != other.strides.duration[:k]).mean() > 0.9
        assert np.abs(walk.strides.footprint[:k] - other.strides.footprint[:k]).max() > 0.02
    place = np.array([[0.5, 1.0, 0.1], [2.0, 3.0, 0.1], [-1.0, 5.0, 0.1]]) + walk.origin
    if walk.scenario.field == "indoor":
        assert np.linalg.norm(walk.field.at(place) - other.field.at(place), axis=1).min() > 0.1
    assert walk.scenario.summary
    assert walk.scenario.prior.rate_hz == RATE_HZ


def up_of_the_standing(walk: SimulatedWalk):
    """Up (3,) in the body before the first stride: how the sensor is mounted."""
    return walk.recording.truth.nav_R_body[0][2]


def test_a_seed_keeps_its_sensor_and_mount_in_all_scenarios_and_another_has_others(real):
    other, stranger = simulate(replace(SHORT, name="elsewhere"), 3), simulate(SHORT, 4)
    assert other.drawn["sensor"] == real.drawn["sensor"] != stranger.drawn["sensor"]
    assert other.drawn["switched_on"] != real.drawn["switched_on"]
    np.testing.assert_allclose(up_of_the_standing(other), up_of_the_standing(real), atol=1e-3)
    assert np.linalg.norm(up_of_the_standing(stranger) - up_of_the_standing(real)) > 0.02
    assert np.abs(other.recording.truth.position[1500] - real.recording.truth.position[1500]).max() > 1e-3


def test_a_pocket_keeps_its_tilt_and_draws_its_own_ringing():
    walks = [simulate(replace(SHORT, name=name), 3, replace(IDEAL, worn="pocket")) for name in ("one", "other")]
    one, other = (up_of_the_standing(walk) for walk in walks)
    np.testing.assert_allclose(one, other, atol=0.01)  # but for the sway of who stands
    assert np.linalg.norm(up_of_the_standing(simulate(SHORT, 4, replace(IDEAL, worn="pocket"))) - one) > 0.05
    first, second = (walk.recording.gyr[:400] for walk in walks)  # standing
    assert np.abs(first - second).max() > 1e-4


def test_the_result_does_not_depend_on_the_size_of_the_blocks(monkeypatch, real):
    monkeypatch.setattr(walk, "BLOCK", 777)
    small = simulate(SHORT, 3)
    for name in ("t", "acc", "gyr", "mag"):
        np.testing.assert_allclose(getattr(small.recording, name), getattr(real.recording, name), atol=1e-9)
    np.testing.assert_allclose(small.recording.truth.position, real.recording.truth.position, atol=1e-9)


def test_turning_a_course_turns_its_truth_and_not_the_field_of_the_earth():
    plain, turned = (simulate(SHORT, 3, replace(IDEAL, field="homogeneous", turned_deg=a)) for a in (0.0, 90.0))
    east, north, up = plain.recording.truth.position.T
    np.testing.assert_allclose(turned.recording.truth.position, np.stack([north, -east, up], axis=1), atol=1e-6)
    start, stop = (w.recording.mag[0] @ w.recording.truth.nav_R_body[0].T for w in (plain, turned))
    np.testing.assert_allclose(start, stop, atol=1e-9)


def test_choices_are_taken():
    chosen = simulate(SHORT, 1, Choices("mpu-9250x8", "equator", "homogeneous", "heel", 100.0, calibrated=True))
    assert chosen.recording.period_s == pytest.approx(0.01, rel=1e-3)
    strength = np.linalg.norm(chosen.recording.mag, axis=1)
    assert np.nanmedian(strength) == pytest.approx(25.0, abs=0.2)  # no iron: the field itself
    assert chosen.drawn["sensor"]["iron"]["hard_uT"] == [0.0, 0.0, 0.0]


def test_landmarks_are_passed_on_every_lap_at_the_same_place():
    lap = polyline([(0, 5), (0, 10), (8, 10), (8, 0), (0, 0), (0, 5)], 1.2).with_landmarks(
        [4.0, 20.0], ["door", "desk"]
    )
    course = [Stand(2.0), Walk(lap.repeat(3)), Stand(2.0)]
    walk = simulate(replace(SHORT, route=lambda rng: course), 2, IDEAL)
    assert [mark.landmark for mark in walk.landmarks] == ["door", "desk"] * 3
    truth = walk.recording.truth
    for mark in walk.landmarks:
        there = np.array([np.interp(mark.time_s, truth.t, axis) for axis in truth.position.T])
        np.testing.assert_allclose(there, mark.position, atol=1e-4)
    doors = np.array([mark.position for mark in walk.landmarks[::2]])
    assert np.linalg.norm(doors - doors[0], axis=1).max() < 1.5  # a stride comes down within 0.65 m of it


def test_a_pocket_never_stands_still_while_walking():
    walk = simulate(SHORT, 1, Choices(worn="pocket", sensor="xsens-mtw"))
    t, speed = (
        walk.recording.t,
        np.linalg.norm(np.gradient(walk.recording.truth.position, walk.recording.t, axis=0), axis=1),
    )
    going = (t > walk.strides.start[2]) & (t < walk.strides.start[-2])
    assert speed[going].min() > 0.2
    assert walk.flat is None


def with_clock(**parameters) -> Scenario:
    return replace(SHORT, sensor=replace(preset("ideal"), clock=ClockPrior(**parameters)))


def test_jittered_stamps_leave_the_truth_smooth(ideal):
    late = simulate(with_clock(jitter_s=0.003), 3).recording
    assert np.std(late.t - late.truth.t) > 0.002
    assert (np.diff(late.truth.t) > 0).all()
    np.testing.assert_allclose(np.diff(late.truth.t), late.truth.t[-1] / (len(late) - 1), rtol=1e-6)
    speed, true = (np.gradient(r.truth.position, r.truth.t, axis=0) for r in (late, ideal.recording))
    np.testing.assert_allclose(speed, true, atol=1e-6)


def test_all_times_are_on_the_clock_of_the_recording(ideal):
    """A clock that runs fast shows more time for each stride, and everything at the same share of the walk."""
    fast = simulate(with_clock(scale_sd=0.01), 8)
    true = simulate(SHORT, 8, IDEAL)
    rate = 1.0 + fast.drawn["sensor"]["clock_scale_error"]
    assert abs(rate - 1.0) > 0.004
    for name in ("start", "duration", "end_s"):
        np.testing.assert_allclose(getattr(fast.strides, name), rate * getattr(true.strides, name), rtol=1e-12)
    np.testing.assert_allclose(fast.flat, rate * true.flat, rtol=1e-12)
    np.testing.assert_allclose(fast.recording.t, rate * true.recording.t, rtol=1e-12)
    np.testing.assert_allclose(fast.recording.truth.t, rate * true.recording.truth.t, rtol=1e-12)
    assert fast.strides.end_s - fast.recording.t[-1] < 3 * fast.recording.period_s


def test_lost_samples_are_lost_in_all_columns():
    """The truth of what arrives is that of the walk at those instants."""
    some, every = simulate(with_clock(dropped_share=0.2, burst=2.0), 3), simulate(SHORT, 3, IDEAL)
    assert 0.7 < len(some.recording) / len(every.recording) < 0.9
    there = np.isin(every.recording.t, some.recording.t)
    assert there.sum() == len(some.recording)
    for name in ("acc", "gyr", "mag"):
        np.testing.assert_array_equal(getattr(some.recording, name), getattr(every.recording, name)[there])
    for name in ("t", "position", "nav_R_body"):
        np.testing.assert_array_equal(getattr(some.recording.truth, name), getattr(every.recording.truth, name)[there])


@pytest.mark.parametrize("sensor", ["lord-gx5", "xsens-mtw"])
def test_more_rows_bring_no_more_samples_of_the_field(sensor):
    usual, fast = (simulate(SHORT, 1, Choices(sensor=sensor, rate_hz=rate_hz)) for rate_hz in (None, 1000.0))
    there, often = (np.isfinite(walk.mag[:, 0]) for walk in (usual, fast))
    assert there.all()
    assert often.sum() == pytest.approx(there.sum(), rel=0.01)


REFUSED = [
    (Choices(sensor="nonsense"), "no sensor 'nonsense'"),
    (Choices(field=""), "no field ''"),
    (Choices(site="atlantis"), "no site"),
    (Choices(site="north,by,northwest"), "is no place"),
    (Choices(site="48,11"), "is no place"),
    (Choices(site="48,11,"), "is no place"),
    (Choices(site="48,11,20240501"), "is no place"),
    (Choices(site="48,11,2024-W18-3"), "is no place"),
    (Choices(site="48,11,2024-02-30"), "is no place"),
    (Choices(site="48,11,2024-05-01,noon"), "is no place"),
    (Choices(worn="hand"), "no place to wear a sensor at 'hand': choose one of heel, instep, pocket"),
    (Choices(rests="some"), "no kind of rests 'some': choose one of still, rocking, none"),
    (Choices(feet="cold"), "no kind of feet 'cold'"),
    (Choices(worn="table"), "on a table goes nowhere"),
    (Choices(sensor="kvh-1750", calibrated=True), "kvh-1750 has no magnetometer to be calibrated"),
    (Choices(rate_hz=0.2), "for at least 20"),
    (Choices(rate_hz=1e9), "for at most"),
    (Choices(rate_hz=-100.0), "rate_hz"),
    (Choices(turned_deg=float("inf")), "cannot be turned"),
]


def test_what_cannot_be_is_refused_by_name():
    for choices, words in REFUSED:
        with pytest.raises(SimulationError, match=words) as refusal:
            simulate(SHORT, 1, choices)
        assert str(refusal.value).count(". ") == 0, words
    with pytest.raises(SimulationError, match=r"no scenario 'offfice'.*office, office-open"):
        simulate("offfice", 1)
    with pytest.raises(SimulationError, match="-1 is no seed"):
        simulate(SHORT, -1)
    with pytest.raises(SimulationError, match="no strides"):
        simulate("at-rest", 1, Choices(worn="heel"))


def test_a_closed_course_ends_where_and_as_it_began():
    walk = simulate("demo", 4, IDEAL)
    truth = walk.recording.truth
    np.testing.assert_allclose(walk.strides.footprint[-1], walk.strides.footprint[0], atol=1e-9)
    assert np.linalg.norm(truth.position[-1] - truth.position[0]) < 0.02  # slip of the last stances and sway
    assert abs(float(wrap_angle(walk.strides.heading[-1] - walk.strides.heading[0]))) < 1e-6
    assert 60 < walk.recording.duration_s < 75
    assert 70 < np.linalg.norm(np.diff(truth.position[:, :2], axis=0), axis=1).sum() < 85
    heading_deg = np.rad2deg(np.unwrap(compute_heading(truth.nav_R_body)))
    assert heading_deg[-1] - heading_deg[0] == pytest.approx(360.0, abs=0.5)


def test_a_sensor_on_a_table_reads_gravity_and_the_field_in_one_attitude():
    minute = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(40.0), Stand(20.0)])
    walk, other = (simulate(minute, seed, IDEAL) for seed in (1, 2))
    recording, truth = walk.recording, walk.recording.truth
    assert recording.duration_s == pytest.approx(60.0, abs=0.01)
    np.testing.assert_array_equal(recording.gyr, 0.0)
    np.testing.assert_array_equal(truth.position, 0.0)
    up = np.tile([0, 0, GRAVITY_M_S2], (len(truth.t), 1))
    np.testing.assert_allclose(truth.nav_R_body @ recording.acc[0], up, atol=1e-12)
    assert 0.0 < np.degrees(np.arccos(truth.nav_R_body[0, 2, 2])) < 3.0
    assert len(walk.strides) == 0
    assert walk.flat is None
    assert np.abs(recording.acc[0] - other.recording.acc[0]).max() > 1e-3


COURSE = "[course]\npoints_m = [[0, 0], [0, 25], [40, 25]]\n"
FILES = {
    COURSE + "laps = " + "9" * 5000: "number too long or a list too deep",
    "a = " + "[" * 1000 + "]" * 1000 + "\n" + COURSE: "number too long or a list too deep",
    COURSE + "[sensor]\nrate_hz = " + "[" * 1000 + "]" * 1000: "number too long or a list too deep",
    COURSE + f"[sensor{'.a' * 3000}]\nb = 1": "number too long or a list too deep",
    COURSE + "laps = " + "9" * 4000: "course.laps cannot be 999.*: give less than or equal to 1000000",
    COURSE + "strides = 0": "course.strides cannot be 0",
    COURSE + "rest_s = 1e99": "course.rest_s cannot be 1e.99: give less than or equal to 86400",
    COURSE + "laps = 2": "course.laps needs a closed path",
    'rests = "some"\n' + COURSE: "rests cannot be 'some'",
    "cuorse = 1\n" + COURSE: "the file has no parameter 'cuorse': it knows course, like",
    COURSE + "[sensor.gyr]\nnoise_density = -1": "sensor.gyr.noise_density cannot be -1",
    COURSE + "[sensor.gyr]\nnoise = 1": "sensor.gyr has no parameter 'noise': it knows noise_density",
    "[course]\nlaps = 2": "course.points_m is missing",
    "like = 1": "no table .course.",
    "= 1": "is no TOML",
}


def test_a_scenario_of_a_file_and_what_no_file_may_say():
    text = 'rests = "none"\nlike = "office"\n' + COURSE + "rest_s = 9.0\n[sensor]\nrate_hz = 100\n"
    scenario = parse_scenario("mine.toml", text.encode())
    assert (scenario.name, scenario.worn, scenario.prior.rate_hz, scenario.prior.units) == ("mine", "heel", 100.0, 8)
    assert simulate(scenario, 1).recording.duration_s < 60.0
    assert scenario.prior.gyr == preset("mpu-9250x8").gyr
    for wrong, words in FILES.items():
        with pytest.raises(SimulationError, match=words) as caught:
            parse_scenario("mine.toml", wrong.encode())
        assert len(str(caught.value)) < 300
