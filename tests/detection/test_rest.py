"""Rests: the bias is where it is said to be, and a foot that rolls, however slowly, does not rest."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from fg_nav.detection import RestParameters, find_rests
from fg_nav.detection import rest as rest_module
from fg_nav.detection.rest import find_start
from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Mount, Person
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


def test_the_bias_is_known_to_within_its_sigma_and_a_longer_rest_knows_more():
    for seconds in (1.0, 3.0, 10.0, 60.0):
        errors = []
        for seed in range(20):
            (rest,) = find_rests(standing(seconds, seed, gyr_noise_deg_s=(0.02, 0.25)[seed % 2]))
            assert rest.stop - rest.start > 0.7 * seconds * 200
            errors.append((rest.rate - np.radians(BIAS_DEG_S)) / rest.sigma)
        assert np.sqrt(np.mean(np.square(errors))) < 1.2
    sigmas = np.array([find_rests(standing(seconds))[0].sigma for seconds in (1.0, 4.0, 16.0, 120.0)])
    first, second, third, last = np.sqrt(np.mean(sigmas**2, axis=1))
    assert first > 1.5 * second > 1.5**2 * third
    assert third > last
    assert (sigmas > np.radians(rest_module.MIN_SIGMA_DEG_S)).all()


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


def test_neither_mounting_nor_sample_rate_matter_and_the_force_is_gravity_in_the_body():
    """The limits are per axis, so the extent may differ by a block; the bias turns along."""
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5])
    (asis,), (turned,) = find_rests(standing(5.0)), find_rests(mounted(standing(5.0), turn))
    assert (np.abs(turned.rate - turn.inv().apply(asis.rate)) < 2 * turned.sigma).all()
    np.testing.assert_allclose(turned.force, turn.inv().apply([0.0, 0.0, GRAVITY_M_S2]), atol=0.02)
    for rate_hz in (100.0, 400.0):
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
@pytest.mark.parametrize("stride_s", [0.7, 1.3, 2.0, 2.4])
def test_the_stances_of_walking_and_running_are_no_rests(person, mount, stride_s):
    strolls = in_strides_of(person, stride_s)
    if stride_s < 2.2:
        walk = straight_walk(strolls, strides=10, standing_s=0.0, mount=mount)
        assert find_rests(walk.part(0, np.searchsorted(walk.recording.t, walk.swing[-1, 1])).recording) == ()
    rests = find_rests(straight_walk(strolls, strides=8, standing_s=3.0, mount=mount).recording)
    assert len(rests) == 2  # beside real ones
    np.testing.assert_allclose([rest.rate for rest in rests], 0.0, atol=np.radians(0.05))
    assert find_rests(straight_walk(person, Style.RUN, standing_s=0.0, mount=mount).recording) == ()


def test_what_rolls_turns_swings_or_drifts_does_not_rest():
    for period_s in (0.5, 0.7, 1.0):
        assert find_rests(turning(8.0, lambda t, f=1.0 / period_s: 2.0 * np.sin(2 * np.pi * t * f))) == ()
    assert find_rests(turning(5.0, lambda t: np.full_like(t, 30.0))) == ()
    assert len(find_rests(turning(5.0, lambda t: np.full_like(t, 15.0)))) == 1  # an uncalibrated gyroscope
    still = standing(5.0)
    swing = 1.5 * np.sin(2 * np.pi * still.t)  # as on a swing or in a car, at a steady attitude
    for pushed in (swing, still.t):  # of the drift no block is restless within, but each differs from the one before
        assert find_rests(replace(still, acc=still.acc + np.outer(pushed, [1.0, 0.0, 0.0]))) == ()
    assert find_rests(standing(0.15)) == ()  # shorter than a block
    assert find_rests(standing(1.1), RestParameters(shortest_s=1.5, shortest_at_end_s=1.5)) == ()


# the start: level by the first stance, and its rest


def test_a_start_is_level_keeps_the_heading_and_rests_in_no_rolling_or_short_stance():
    tilt = Rotation.from_rotvec([0.0, -0.2, 0.0])
    recording, stances = mounted(standing(2.0), tilt), Stances.from_mask(np.ones(400, dtype=bool))
    start = find_start(recording, stances, heading=0.7)
    assert compute_heading(start.nav_R_body) == pytest.approx(0.7)
    np.testing.assert_allclose(start.nav_R_body[2], tilt.as_matrix()[2], atol=1e-3)
    t = recording.t
    for rolling in (np.radians(2.0) * np.sin(2 * np.pi * t), np.radians(6.0) * np.linspace(-1, 1, len(t))):
        assert find_start(replace(recording, gyr=recording.gyr + rolling[:, None]), stances).rest is None
    short = find_start(recording, Stances.from_mask((np.arange(400) >= 100) & (np.arange(400) < 180)))
    assert (short.row, short.rest) == (100, None)


def test_the_rest_at_the_start_ends_with_the_lift_of_the_heel_and_may_come_after_some_fidgeting():
    recording = standing(4.0, sway_deg=0.01)
    gyr, mask = recording.gyr.copy(), np.ones(800, dtype=bool)
    gyr[700:] += np.linspace(0.0, 1.0, 100)[:, None]
    lifting = find_start(replace(recording, gyr=gyr), Stances.from_mask(mask)).rest
    assert lifting.stop == 700
    assert (np.abs(lifting.rate - np.radians(BIAS_DEG_S)) < 3 * lifting.sigma).all()
    gyr[150:250] += 1.0
    mask[140:260] = False
    fidgeting, stances = replace(recording, gyr=gyr), Stances.from_mask(mask)
    apart = find_start(fidgeting, stances)
    together = find_start(fidgeting, replace(stances, footfall=np.zeros(2, dtype=np.int64)))
    assert apart.rest.stop <= 150
    assert together.rest.start >= 250
    assert together.rest.stop - together.rest.start > 2 * (apart.rest.stop - apart.rest.start)
    np.testing.assert_allclose(together.nav_R_body, apart.nav_R_body)
