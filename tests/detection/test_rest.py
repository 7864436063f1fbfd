"""Rests: the bias is where it is said to be, and a foot that rolls, however slowly, does not rest."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from fg_nav.detection import RestParameters, find_rests
from fg_nav.detection import rest as rest_module
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import simulate
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.mount import Mount
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.recording import Recording
from tests.simulated import WALKERS, mounted, simulated, straight_walk

BIAS_DEG_S = np.array([0.3, -0.2, 0.1])
SWAY_HZ = 0.5


def standing(seconds, seed=0, sway_deg=0.02, gyr_noise_deg_s=0.15, bias_deg_s=BIAS_DEG_S, rate_hz=200.0):
    """A foot that stands and sways by small angles, slowly; tilt moves gravity along."""
    rng = np.random.default_rng(seed)
    n, width = round(seconds * rate_hz), rate_hz / (2 * np.pi * SWAY_HZ)
    margin = round(5 * width)
    angle = gaussian_filter1d(rng.standard_normal((n + 2 * margin, 3)), width, axis=0)[margin : margin + n]
    angle *= np.radians(sway_deg) * np.sqrt(2 * np.sqrt(np.pi) * width)  # unit variance, before
    rate = np.radians(bias_deg_s) + np.gradient(angle, 1 / rate_hz, axis=0)
    up = Rotation.from_rotvec(angle).inv().apply([0.0, 0.0, GRAVITY_M_S2])
    return Recording(
        t=np.arange(n) / rate_hz,
        acc=up + 0.02 * rng.standard_normal((n, 3)),
        gyr=rate + np.radians(gyr_noise_deg_s) * rng.standard_normal((n, 3)),
    )


def turning(seconds, rate_deg_s):
    """A sensor at rest but for this rate about y, a function of time."""
    recording = standing(seconds, sway_deg=0.0)
    gyr = recording.gyr.copy()
    gyr[:, 1] += np.radians(rate_deg_s(recording.t))
    return replace(recording, gyr=gyr)


def joined(*recordings):
    acc, gyr = (np.vstack([getattr(r, name) for r in recordings]) for name in ("acc", "gyr"))
    return Recording(t=np.arange(len(acc)) / 200, acc=acc, gyr=gyr)


@pytest.mark.parametrize("gyr_noise_deg_s", [0.02, 0.25])
@pytest.mark.parametrize("seconds", [1.0, 3.0, 10.0, 60.0])
def test_the_bias_is_known_to_within_its_sigma(seconds, gyr_noise_deg_s):
    errors = []
    for seed in range(20):
        (rest,) = find_rests(standing(seconds, seed, gyr_noise_deg_s=gyr_noise_deg_s))
        assert rest.stop - rest.start > 0.7 * seconds * 200
        errors.append((rest.rate - np.radians(BIAS_DEG_S)) / rest.sigma)
    assert np.sqrt(np.mean(np.square(errors))) < 1.2


@pytest.mark.parametrize(("sway_deg", "gyr_noise_deg_s"), [(0.02, 0.02), (0.0, 0.45)], ids=["sway", "noise"])
def test_sway_and_noise_are_not_overrated(sway_deg, gyr_noise_deg_s, monkeypatch):
    """Without the floor for what a bias does in time, the sigma is that of the errors, give or take a factor of two."""
    for name, value in (("MIN_SIGMA_DEG_S", 0.0), ("GYR_STD_DEG_S", 1.0)):
        monkeypatch.setattr(rest_module, name, value)
    errors = []
    for seed in range(30):
        (rest,) = find_rests(standing(3.0, seed, sway_deg, gyr_noise_deg_s))
        errors.append((rest.rate - np.radians(BIAS_DEG_S)) / rest.sigma)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.3


def test_each_axis_has_the_sigma_of_its_own_sway():
    recording = standing(3.0, sway_deg=0.0, gyr_noise_deg_s=0.02)
    rocking = np.radians(0.04) * np.cos(2 * np.pi * 1.0 * recording.t) * 2 * np.pi  # by 0.04 deg, once a second
    (rest,) = find_rests(replace(recording, gyr=recording.gyr + np.outer(rocking, [0.0, 1.0, 0.0])))
    sway = rest_module.SWAY_SCALE * 0.04 / np.sqrt(2.0) * np.sqrt(12.0) / 3.0
    assert np.degrees(rest.sigma[1]) == pytest.approx(np.hypot(sway, rest_module.MIN_SIGMA_DEG_S), rel=0.1)
    assert np.degrees(rest.sigma[[0, 2]]).max() < 1.3 * rest_module.MIN_SIGMA_DEG_S


def test_a_still_sensor_claims_no_more_than_the_floor():
    (rest,) = find_rests(standing(600.0, sway_deg=0.0, gyr_noise_deg_s=0.0, rate_hz=50.0))
    np.testing.assert_allclose(rest.sigma, np.radians(rest_module.MIN_SIGMA_DEG_S))


def test_a_longer_rest_knows_more():
    sigmas = np.array([find_rests(standing(seconds))[0].sigma for seconds in (1.0, 4.0, 16.0, 120.0)])
    first, second, third, last = np.sqrt(np.mean(sigmas**2, axis=1))
    assert first > 1.5 * second > 1.5**2 * third
    assert third > last
    assert (sigmas > np.radians(rest_module.MIN_SIGMA_DEG_S)).all()


def test_a_rest_that_goes_on_counts_once():
    """Each view adds what is new in it; nothing in a direction in which it shows less, for a foot that sways."""
    recording = standing(8.0, gyr_noise_deg_s=0.05)
    counted, *views = (find_rests(recording.slice(0, stop))[-1] for stop in range(400, 1601, 200))
    first, added = counted, [counted]
    for view in views:
        further = view.beyond(counted)
        if further is not None:
            counted, added = view, [*added, further]
    assert len(added) > 3
    weight = np.array([np.linalg.inv(rest.covariance) for rest in added])
    total, last = weight.sum(axis=0), np.linalg.inv(counted.covariance)
    rate = np.linalg.solve(total, sum(W @ rest.rate for W, rest in zip(weight, added, strict=True)))
    assert np.linalg.eigvalsh(total - last).min() > -0.01 * np.trace(last)
    assert np.trace(total) < 2.0 * np.trace(last)  # earlier views are not taken back
    assert (np.abs(rate - counted.rate) < counted.sigma).all()
    further = first.beyond(counted)
    assert further is None or (further.sigma > 5.0 * counted.sigma).all()


def test_the_force_is_gravity_in_the_body():
    tilt = Rotation.from_rotvec([0.4, -0.2, 0.0])
    (rest,) = find_rests(mounted(standing(2.0), tilt))
    np.testing.assert_allclose(rest.force, tilt.inv().apply([0.0, 0.0, GRAVITY_M_S2]), atol=0.02)


def test_mounting_does_not_matter_much():
    """The limits are per axis, so the extent may differ by a block; the bias turns along."""
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5])
    (asis,), (turned,) = find_rests(standing(5.0)), find_rests(mounted(standing(5.0), turn))
    assert (np.abs(turned.rate - turn.inv().apply(asis.rate)) < 2 * turned.sigma).all()


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_sample_rate_does_not_matter(rate_hz):
    (rest,) = find_rests(standing(3.0, rate_hz=rate_hz))
    assert (rest.stop - rest.start) / rate_hz > 2.7
    assert (np.abs(rest.rate - np.radians(BIAS_DEG_S)) < 3 * rest.sigma).all()


SETTLE_S, STIR_S = 0.3, 0.2  # For so long a foot still settles after it has come down, and stirs before it lifts.


@WALKERS
def test_rests_at_the_start_in_the_middle_and_at_the_end(person: Person, mount: Mount):
    there = straight(4.0)
    course = [Stand(2.0), Walk(there, strides=4), Stand(4.0), Walk(there.translate(there.end.position), strides=4)]
    walk = simulated([*course, Stand(2.0)], person, mount)
    recording = walk.recording
    rests = find_rests(recording)
    flat = walk.motion.flat[[0, 4, -1]]
    still = flat + np.array([[0.0, -STIR_S], [SETTLE_S, -STIR_S], [SETTLE_S, 0.0]])
    assert len(rests) == 3
    for rest, (a, b), (begin, end) in zip(rests, flat, still, strict=True):
        assert recording.t[rest.start] >= a - 0.02
        assert recording.t[rest.stop - 1] <= b + 0.02
        assert (rest.stop - rest.start) / 200 > end - begin - 0.55  # a block of a quarter of a second lost on each side


@pytest.mark.parametrize("seed", range(4))
def test_on_a_walk_only_standing_is_rest(seed):
    walk = simulate("demo", seed)
    recording, flat = walk.recording, walk.flat
    rests = find_rests(recording)
    assert len(rests) == 2
    assert recording.t[rests[0].stop - 1] < flat[0, 1] + 0.05
    assert recording.t[rests[1].start] > flat[-1, 0]
    np.testing.assert_allclose(rests[0].rate, rests[1].rate, atol=np.radians(0.05))


@pytest.mark.parametrize("lost", [range(50, 55), range(195, 201)])
def test_samples_lost_in_a_rest_do_not_shorten_it(lost):
    """Half a second at the start is a rest, and just so long: what moves behind it stays behind it."""
    swung = turning(1.0, lambda t: 50 * np.sin(2 * np.pi * 5 * t))
    for still in (standing(0.5), standing(1.0)):
        whole = joined(still, swung)
        kept = np.delete(np.arange(len(whole)), [i for i in lost if i < len(whole)])
        part = Recording(whole.t[kept], whole.acc[kept], whole.gyr[kept])
        (rest,), (same,) = find_rests(whole), find_rests(part)
        assert abs(part.t[same.stop - 1] - whole.t[rest.stop - 1]) < (len(lost) + 0.5) / 200
        assert (np.abs(same.rate - rest.rate) < rest.sigma).all()


def test_what_contradicts_the_longest_rest_is_none():
    rolled = standing(1.0, bias_deg_s=BIAS_DEG_S + np.array([0.0, 1.2, 0.0]))
    shaken = turning(0.5, lambda t: 50 * np.sin(2 * np.pi * 5 * t))
    recording = joined(rolled, shaken, standing(4.0, seed=1), shaken, standing(1.0, seed=2))
    rests = find_rests(recording)
    assert [round(rest.start / 200) for rest in rests] in ([2, 6], [1, 6])
    assert len(rest_module.find_still_stretches(recording, RestParameters())) == 3


def in_strides_of(person, stride_s):
    """The same person, whose stance takes longer; the swing hardly does."""
    share = min(person.walk.swing_share, 0.87 / stride_s)
    return replace(person, walk=replace(person.walk, stride_s=stride_s, swing_share=share))


@WALKERS
@pytest.mark.parametrize("stride_s", [1.8, 2.4])
def test_the_slow_stances_of_a_stroll_are_no_rests_beside_real_ones(person, mount, stride_s):
    walk = straight_walk(in_strides_of(person, stride_s), strides=8, standing_s=3.0, mount=mount)
    rests = find_rests(walk.recording)
    assert len(rests) == 2
    np.testing.assert_allclose([rest.rate for rest in rests], 0.0, atol=np.radians(0.05))


@WALKERS
@pytest.mark.parametrize("stride_s", [0.7, 1.3, 2.0])
def test_the_stances_of_walking_are_no_rests(person, mount, stride_s):
    walk = straight_walk(in_strides_of(person, stride_s), strides=10, standing_s=0.0, mount=mount)
    assert find_rests(walk.part(0, np.searchsorted(walk.recording.t, walk.swing[-1, 1])).recording) == ()


@WALKERS
def test_running_has_no_rests(person, mount):
    assert find_rests(straight_walk(person, Style.RUN, standing_s=0.0, mount=mount).recording) == ()


@pytest.mark.parametrize("period_s", [0.5, 0.7, 1.0])
def test_a_foot_that_rolls_to_and_fro_does_not_rest(period_s):
    assert find_rests(turning(8.0, lambda t: 2.0 * np.sin(2 * np.pi * t / period_s))) == ()


def test_a_steady_turn_is_not_a_bias():
    assert find_rests(turning(5.0, lambda t: np.full_like(t, 30.0))) == ()
    assert len(find_rests(turning(5.0, lambda t: np.full_like(t, 15.0)))) == 1  # an uncalibrated gyroscope


def test_a_sensor_in_free_motion_at_a_steady_attitude_does_not_rest():
    recording = standing(5.0)
    acc = recording.acc.copy()
    acc[:, 0] += 1.5 * np.sin(2 * np.pi * recording.t)  # as on a swing or in a car
    assert find_rests(replace(recording, acc=acc)) == ()


def test_a_force_that_drifts_is_no_rest():
    """No block is restless within, but each differs from the one before."""
    recording = standing(5.0)
    acc = recording.acc + np.outer(recording.t, [1.0, 0.0, 0.0])
    assert find_rests(replace(recording, acc=acc)) == ()


def test_what_is_shorter_than_the_shortest_rest_is_none():
    shaken = turning(1.0, lambda t: 50 * np.sin(2 * np.pi * 5 * t))
    recording = joined(shaken, standing(1.1), shaken)
    assert len(find_rests(recording)) == 1
    assert find_rests(recording, RestParameters(shortest_s=1.5)) == ()


def test_a_recording_shorter_than_a_block():
    assert find_rests(standing(0.15)) == ()
