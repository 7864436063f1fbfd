"""Rests and the start, and the rolling lever: in any mounting, and not better known than they are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from fg_nav.detection import RestParameters, detect_stances, find_rests
from fg_nav.detection import rest as rest_module
from fg_nav.detection.rest import estimate_lever, find_start, freeze_ends
from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.lab.simulation.motion import Ramps, Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import INSTEP
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.recording import Recording
from tests.simulated import FIRM, PERSON, QUIET, RIGID, WALKERS, mounted, simulated, straight_walk, turning_foot

BIAS = np.radians([0.3, -0.2, 0.1])
SWAY_HZ = 0.5


def standing(seconds, seed=0, sway_deg=0.02, gyr_noise_deg_s=0.15, bias=BIAS, rate_hz=200.0, rate=None, push=None):
    """A foot that stands and sways by small angles, slowly; tilt moves gravity along.

    `rate` deg/s about y, and `push` m/s^2 along x, are functions of time.
    """
    rng = np.random.default_rng(seed)
    n, width = round(seconds * rate_hz), rate_hz / (2 * np.pi * SWAY_HZ)
    margin, t = round(5 * width), np.arange(n) / rate_hz
    angle = gaussian_filter1d(rng.standard_normal((n + 2 * margin, 3)), width, axis=0)[margin : margin + n]
    angle *= np.radians(sway_deg) * np.sqrt(2 * np.sqrt(np.pi) * width)  # unit variance, before
    acc = Rotation.from_rotvec(angle).inv().apply([0.0, 0.0, GRAVITY_M_S2]) + 0.02 * rng.standard_normal((n, 3))
    gyr = bias + np.gradient(angle, 1 / rate_hz, axis=0) + np.radians(gyr_noise_deg_s) * rng.standard_normal((n, 3))
    gyr[:, 1] += 0.0 if rate is None else np.radians(rate(t))
    acc[:, 0] += 0.0 if push is None else push(t)
    return Recording(t, acc, gyr)


def shaking(t):
    return 50 * np.sin(2 * np.pi * 5 * t)


def joined(*recordings):
    acc, gyr = (np.vstack([getattr(r, name) for r in recordings]) for name in ("acc", "gyr"))
    return Recording(t=np.arange(len(acc)) / 200, acc=acc, gyr=gyr)


def test_the_bias_is_known_to_within_its_sigma_and_a_longer_rest_knows_more():
    for seconds in (1.0, 3.0, 10.0, 60.0):
        found = []
        for seed in range(20):
            (rest,) = find_rests(standing(seconds, seed, gyr_noise_deg_s=(0.02, 0.25)[seed % 2]))
            assert rest.stop - rest.start > 0.7 * seconds * 200
            found.append((rest.rate - BIAS) / rest.sigma)
        assert np.sqrt(np.mean(np.square(found))) < 1.2
    sigmas = np.array([find_rests(standing(seconds))[0].sigma for seconds in (1.0, 4.0, 16.0, 120.0)])
    first, second, third, last = np.sqrt(np.mean(sigmas**2, axis=1))
    assert first > 1.5 * second > 1.5**2 * third
    assert third > last
    assert (sigmas > np.radians(rest_module.MIN_SIGMA_DEG_S)).all()


def test_each_axis_has_the_sigma_of_its_own_sway():
    """Rocking by 0.04 deg, once a second."""
    rocking = standing(3.0, 0, 0.0, 0.02, rate=lambda t: 0.04 * 2 * np.pi * np.cos(2 * np.pi * t))
    (rest,) = find_rests(rocking)
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
        assert (np.abs(rest.rate - BIAS) < 3 * rest.sigma).all()


@WALKERS
def test_rests_at_the_start_in_the_middle_and_at_the_end(person, mount):
    """For 0.3 s a foot still settles after it has come down, and stirs for 0.2 s before it lifts."""
    there = straight(4.0)
    course = [Stand(2.0), Walk(there, strides=4), Stand(4.0), Walk(there.translate(there.end.position), strides=4)]
    walk = simulated([*course, Stand(2.0)], person, mount)
    rests, t = find_rests(walk.recording), walk.recording.t
    flat = walk.motion.flat[[0, 4, -1]]
    still_s = np.diff(flat + np.array([[0.0, -0.2], [0.3, -0.2], [0.3, 0.0]]))[:, 0]
    assert len(rests) == 3
    for rest, (a, b), seconds in zip(rests, flat, still_s, strict=True):
        assert a - 0.02 <= t[rest.start] < t[rest.stop - 1] <= b + 0.02
        assert (rest.stop - rest.start) / 200 > seconds - 0.55  # a block of a quarter of a second lost on each side


@pytest.mark.parametrize("lost", [range(50, 55), range(195, 201)])
def test_samples_lost_in_a_rest_do_not_shorten_it(lost):
    """Half a second at the start is a rest, and just so long: what moves behind it stays behind it."""
    for still in (standing(0.5), standing(1.0)):
        whole = joined(still, standing(1.0, sway_deg=0.0, rate=shaking))
        kept = np.delete(np.arange(len(whole)), [i for i in lost if i < len(whole)])
        part = Recording(whole.t[kept], whole.acc[kept], whole.gyr[kept])
        (rest,), (same,) = find_rests(whole), find_rests(part)
        assert abs(part.t[same.stop - 1] - whole.t[rest.stop - 1]) < (len(lost) + 0.5) / 200
        assert (np.abs(same.rate - rest.rate) < rest.sigma).all()


def test_what_contradicts_the_longest_rest_is_none():
    rolled = standing(1.0, bias=BIAS + np.radians([0.0, 1.2, 0.0]))
    shaken = standing(0.5, sway_deg=0.0, rate=shaking)
    recording = joined(rolled, shaken, standing(4.0, seed=1), shaken, standing(1.0, seed=2))
    assert [round(rest.start / 200) for rest in find_rests(recording)] in ([2, 6], [1, 6])
    assert len(rest_module.find_still_stretches(recording, RestParameters())) == 3


@WALKERS
@pytest.mark.parametrize("stride_s", [0.7, 1.3, 2.0, 2.4])
def test_the_stances_of_walking_and_running_are_no_rests(person, mount, stride_s):
    share = min(person.walk.swing_share, 0.87 / stride_s)
    strolls = replace(person, walk=replace(person.walk, stride_s=stride_s, swing_share=share))
    if stride_s < 2.2:
        walk = straight_walk(strolls, strides=10, standing_s=0.0, mount=mount)
        assert find_rests(walk.part(0, np.searchsorted(walk.recording.t, walk.swing[-1, 1])).recording) == ()
    rests = find_rests(straight_walk(strolls, strides=8, standing_s=3.0, mount=mount).recording)
    assert len(rests) == 2  # beside real ones
    np.testing.assert_allclose([rest.rate for rest in rests], 0.0, atol=np.radians(0.05))
    assert find_rests(straight_walk(person, Style.RUN, standing_s=0.0, mount=mount).recording) == ()


@pytest.mark.parametrize(
    ("moved", "rests"),
    [
        *(({"rate": lambda t, s=s: 2.0 * np.sin(2 * np.pi * t / s), "sway_deg": 0.0}, 0) for s in (0.5, 0.7, 1.0)),
        ({"rate": lambda t: np.full_like(t, 30.0)}, 0),
        ({"rate": lambda t: np.full_like(t, 15.0)}, 1),  # an uncalibrated gyroscope
        ({"push": lambda t: 1.5 * np.sin(2 * np.pi * t)}, 0),  # on a swing or in a car, at a steady attitude
        ({"push": lambda t: t}, 0),  # no block is restless within, but each differs from the one before
        ({"seconds": 0.15}, 0),  # shorter than a block
    ],
)
def test_what_rolls_turns_swings_or_drifts_does_not_rest(moved, rests):
    assert len(find_rests(standing(**({"seconds": 6.0} | moved)))) == rests
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
    assert (np.abs(lifting.rate - BIAS) < 3 * lifting.sigma).all()
    gyr[150:250] += 1.0
    mask[140:260] = False
    fidgeting, stances = replace(recording, gyr=gyr), Stances.from_mask(mask)
    apart = find_start(fidgeting, stances)
    together = find_start(fidgeting, replace(stances, footfall=np.zeros(2, dtype=np.int64)))
    assert apart.rest.stop <= 150 < 250 <= together.rest.start
    assert together.rest.stop - together.rest.start > 2 * (apart.rest.stop - apart.rest.start)
    np.testing.assert_allclose(together.nav_R_body, apart.nav_R_body)


def test_beyond_some_seconds_from_the_outermost_stances_the_walk_is_held_in_place():
    t = np.arange(0.0, 60.0, 0.01)
    position, velocity = np.outer(t, [1.0, 2.0, 0.0]), np.tile([1.0, 2.0, 0.0], (len(t), 1))
    notes = freeze_ends(t, Stances.from_mask((t > 20.0) & (t < 35.0)), position, velocity)
    first, last = 20.0 - rest_module.MAX_FREE_S, 35.0 + rest_module.MAX_FREE_S
    np.testing.assert_allclose(position, np.outer(np.clip(t, first, last), [1.0, 2.0, 0.0]), atol=0.05)
    assert (velocity.any(axis=1) == ((t > first) & (t < last))).mean() > 0.999
    assert notes[0] == f"{first:.1f} s before the first footfall are not navigated"
    assert notes[1] == f"{60.0 - last:.1f} s after the last footfall are not navigated"


# the rolling lever, on feet whose lever is known

LEVER = np.array([-0.03, 0.02, 0.11])
STANCE_S, CYCLE_S = 0.4, 0.6
PRIOR = rest_module.PRIOR_SIGMA_M


def rolling(seed=0, stances=40, rise_deg=(3.0, 7.0, 3.0), noise=1.0, acc_bias=0.0, gyr_bias_deg_s=0.0, rate_hz=200.0):
    """A foot that turns about a fixed pivot in each stance, and in between goes back, by any mean angle.

    Every stance begins and ends at another attitude: all the tilt there is on a foot, and more.
    """
    rng = np.random.default_rng(seed)
    start = 0.1 + CYCLE_S * np.arange(stances)
    rise = np.radians(rise_deg) * (1 + 0.4 * rng.standard_normal((stances, 3)))
    begin = np.concatenate([start, start + STANCE_S])
    width = np.repeat([STANCE_S, CYCLE_S - STANCE_S], stances)
    motion = turning_foot(LEVER, [Ramps.of(begin, width, np.concatenate([angle, -angle])) for angle in rise.T])
    t = np.arange(round((0.3 + CYCLE_S * stances) * rate_hz)) / rate_hz
    gyr, acc = motion.sampled(t, 1 / rate_hz)
    acc = acc + acc_bias * rng.standard_normal(3) + noise * 0.03 * rng.standard_normal(acc.shape)
    gyr = gyr + np.radians(gyr_bias_deg_s) * rng.standard_normal(3)
    gyr = gyr + noise * np.radians(0.1) * rng.standard_normal(gyr.shape)
    since = (t - 0.1) % CYCLE_S
    stands = (t > 0.1) & (since < STANCE_S - 1 / rate_hz) & (t < start[-1] + CYCLE_S)
    return Recording(t=t, acc=acc, gyr=gyr), Stances.from_mask(stands)


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 800.0])
def test_without_noise_the_lever_is_exact(rate_hz):
    recording, stances = rolling(noise=0.0, acc_bias=0.05, rate_hz=rate_hz)
    end = int(stances.stop[-1])  # a stance at the very end of the recording
    for one in ((recording, stances), (recording.slice(0, end), replace(stances, n_samples=end))):
        found = estimate_lever(*one)
        np.testing.assert_allclose(found.lever, LEVER, atol=1e-3)
        assert found.stances_used == 40


@pytest.mark.parametrize("gyr_bias_deg_s", [0.0, 0.1])
def test_the_lever_is_known_to_within_its_sigma(gyr_bias_deg_s):
    found = [estimate_lever(*rolling(seed, acc_bias=0.05, gyr_bias_deg_s=gyr_bias_deg_s)) for seed in range(25)]
    off = np.array([np.linalg.solve(np.linalg.cholesky(one.covariance), one.lever - LEVER) for one in found])
    assert np.sqrt(np.mean(off**2)) < 1.0  # cautious: real feet share their model error
    assert np.abs(off).max() < 2.5


def test_without_the_caution_the_scatter_of_stances_is_an_honest_sigma(monkeypatch):
    monkeypatch.setattr(rest_module, "ERROR_CORRELATION", 1.0)
    monkeypatch.setattr(rest_module, "PRIOR_SIGMA_M", 10.0)
    found = [estimate_lever(*rolling(seed, stances=60)) for seed in range(60)]
    off = [(one.lever - LEVER) / np.sqrt(np.diag(one.covariance)) for one in found]
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.6
    np.testing.assert_allclose(np.mean([one.lever for one in found], axis=0), LEVER, atol=0.004)


def test_few_stances_and_a_foot_that_does_not_roll_leave_the_prior_and_a_wheel_does_not_show_how_wide_it_is():
    """The noise of the gyroscope is not taken for rolling that moves nothing, which would show a lever of zero."""
    recording, stances = rolling()
    nothing = replace(recording, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (len(recording), 1)), gyr=0.0 * recording.gyr)
    fews = [
        replace(stances, start=stances.start[:n], stop=stances.stop[:n], footfall=stances.footfall[:n])
        for n in (0, 1, 3)
    ]
    flat = rolling(rise_deg=(0.0, 0.0, 0.0))
    for one in (*((recording, few) for few in fews), flat, (nothing, stances)):
        found = estimate_lever(*one)
        np.testing.assert_array_equal(found.lever, 0.0)
        np.testing.assert_allclose(found.covariance, PRIOR**2 * np.eye(3))
    short = replace(stances, stop=np.where(np.arange(40) % 2 == 0, stances.start + 2, stances.stop))
    assert estimate_lever(recording, short).stances_used == 20  # two samples are no stance
    for noise in (0.0, 1.0):  # along the only axis of rolling the lever stays unknown
        found = estimate_lever(*rolling(rise_deg=(0.0, 7.0, 0.0), noise=noise))
        np.testing.assert_allclose(found.lever, [-0.03, 0.0, 0.11], atol=0.01)
        sigma = np.sqrt(np.diag(found.covariance))
        assert sigma[1] == pytest.approx(PRIOR, rel=1e-3)
        assert max(sigma[0], sigma[2]) < 0.2 * PRIOR


@pytest.mark.parametrize(
    ("person", "mount", "height_m"),
    [(RIGID, FIRM, 0.002), (QUIET, FIRM, 0.004), (PERSON, INSTEP, 0.02)],
    ids=["rigid", "quiet", "real"],
)
def test_a_walk_shows_the_height_of_the_sensor(person, mount, height_m):
    """On a whole walk, with detected stances: the height rolling shows well; the rest is within its sigma.

    A sole that sinks while the foot rolls on looks like a lever that ends 1 cm farther back.
    """
    for seed in range(4):
        walk = straight_walk(person, strides=40, seed=seed, mount=mount)
        found = estimate_lever(walk.recording, detect_stances(walk.recording))
        foot_R_body = walk.motion.foot_R_body
        error = foot_R_body @ found.lever - walk.motion.lever_m
        assert abs(error[2]) < height_m
        assert np.all(np.abs(error) < 3 * np.sqrt(np.diag(foot_R_body @ found.covariance @ foot_R_body.T)))
