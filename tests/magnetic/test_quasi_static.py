"""The detectors on fields made by hand: who passes, who does not, and how often; and where the printed ones fail."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import chdtr
from scipy.stats import chi2, kstest, norm

from fg_nav.ekf.presets import find_parameters
from fg_nav.errors import MagneticError
from fg_nav.frames import yaw_rotation
from fg_nav.lab.field_survey import (
    MATTERS_UT,
    SIGMA_UT,
    WINDOW_S,
    find_sample_threshold,
    judge_samples,
)
from fg_nav.magnetic import DETECTORS, Detector, FieldVerdicts, judge_field
from fg_nav.magnetic.detectors import (
    ALIGNMENT_FOOTFALLS,
    DISTURBED,
    FALSE_ALARM_RATE,
    GATES,
    HARD,
    HEADING_DRIFT,
    NO_GATE,
    OFFSET,
    PRIOR_COUNT,
    QUASI_STATIC,
    UNKNOWN,
    Channel,
    apply_gate,
    count_needed,
    find_gate,
    weigh_statistic,
)
from fg_nav.recording import Recording
from fg_nav.text import format_ratio
from tests.magnetic.fields import EARTH, footfalls, still, turned

PHYSICAL = [name for name in DETECTORS if not name.endswith("-printed")]
LATER = np.arange(30) >= 15


def rng(seed=1):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("name", DETECTORS)
def test_a_still_field_passes_all_along_and_iqsf_alone_takes_a_curve_for_a_disturbance(name):
    verdicts = judge_field(footfalls(still(40), heading=0.7), name)
    assert verdicts.quasi_static[3:].all()
    assert len(verdicts) == len(verdicts.reason) == 40
    assert verdicts.detector == name
    curve = judge_field(footfalls(still(40), heading=np.deg2rad(25) * np.arange(40)), name)
    if name in ("iqsf", "iqsf-printed"):
        assert not curve.quasi_static.any()
        assert "heading" in curve.reason[20].split("(")[0]
    else:
        assert curve.quasi_static[3:].all()


@pytest.mark.parametrize(
    ("field", "who", "word"),
    [
        (turned(np.deg2rad(30) * LATER), ["iqsf", "ma2018"], "heading"),
        (still(30) * (1.0 + 0.2 * LATER)[:, None], ["qsf", "iqsf", "ma2018"], "strength"),
        (
            np.where(LATER[:, None], 48 * np.array([0, np.cos(0.9), -np.sin(0.9)]), EARTH),
            ["iqsf", "ma2018"],
            "inclination",
        ),
    ],
    ids=["heading", "strength", "inclination"],
)
def test_a_jump_fails_while_it_is_in_the_window_and_is_named(field, who, word):
    for name in who:
        verdicts = judge_field(footfalls(field), name)
        np.testing.assert_array_equal(np.flatnonzero(verdicts.judged & ~verdicts.quasi_static), [15, 16, 17])
        assert word in verdicts.reason[16].split("(")[0]
        assert f"{format_ratio(verdicts.statistic[16])} times the threshold" in verdicts.reason[16]


BOTH = Detector("both", (Channel("strength", 0.3), Channel("strength rate", 0.5)), fixed_threshold=6.0)


def test_from_readings_to_verdicts_the_statistic_is_chi_squared():
    n, sigma = 6000, np.deg2rad(1.0)
    turn, strength = sigma * rng(5).standard_normal(n), 1.0 + 0.3 / 48 * rng(6).standard_normal(n)
    detector = Detector("two", (Channel("heading difference", sigma), Channel("strength", 0.3)), fixed_threshold=6.0)
    walk = footfalls(turned(turn) * strength[:, None], heading=rng(7).uniform(-np.pi, np.pi, n))
    apart = judge_field(walk, detector).statistic[3::4] * 6.0
    assert kstest(apart, "chi2", args=(6,)).pvalue > 1e-3


@pytest.mark.parametrize("rate", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("name", [*PHYSICAL, "several stances"])
def test_the_least_change_that_matters_passes_at_the_false_alarm_rate(name, rate):
    """In the channel in which it is seen worst: Monte Carlo against the threshold."""
    preset = replace(DETECTORS["aiez"], window=3) if name == "several stances" else DETECTORS[name]
    detector = replace(preset, fixed_threshold=preset.find_threshold(rate))
    n, rows = 40000, detector.rows
    passed = []
    for c, channel in enumerate(detector.channels):
        window = rng(c).standard_normal((n, len(detector.channels), rows))
        change = np.linspace(0.0, 1.0, rows) if channel.signal.value else np.ones(rows)
        window[:, c] += channel.matters / channel.sigma * change
        passed.append((detector.compute_statistic(window) < detector.threshold).mean())
    assert max(passed) == pytest.approx(rate, abs=4 * np.sqrt(rate / n) + 1e-3)
    assert chi2.cdf(preset.threshold, preset.degrees_of_freedom) > 0.9  # of still fields


@pytest.mark.parametrize("name", DETECTORS)
def test_it_does_not_matter_how_the_sensor_sits_or_where_the_walk_heads(name):
    """A sensor turned about up or tilted on its shoe, and the whole walk turned about up with its field.

    Headings of the body's x axis, which `iqsf` takes, differ by the tilt; their difference to the field's does not.
    """
    n = 60
    field, heading = turned(rng(8).normal(0, 0.1, n)) * rng(9).normal(1, 0.01, (n, 1)), rng(10).normal(0, 0.03, n)
    rate, tilt = rng(11).normal(0, 0.5, n), Rotation.from_euler("XY", [0.5, 0.4]).as_matrix()
    reference = judge_field(footfalls(field, heading, rate=rate), name).statistic
    for mount in (yaw_rotation(2.1), *([] if name.startswith("iqsf") else [tilt])):
        on_shoe = judge_field(footfalls(field, heading, rate=rate, mount=mount), name).statistic
        np.testing.assert_allclose(on_shoe, reference, rtol=1e-6, atol=1e-9)
    whole = judge_field(footfalls(field @ yaw_rotation(2.5).T, heading - 2.5, rate=rate), name).statistic
    np.testing.assert_allclose(whole, reference, rtol=1e-6, atol=1e-9)


def test_north_and_south_are_no_jumps_and_compass_and_inertial_heading_may_be_opposed():
    """Aligned by a mean over both sides of 180 degrees; the change in the reason is no whole turn either."""
    sway = (-1.0) ** np.arange(40)
    for name in ("ma2018", "iqsf", "aiez"):
        for heading, drift in (
            (np.pi + np.deg2rad(0.5) * sway, 0.0),
            (np.deg2rad(0.5) * np.arange(40), np.pi),
            (0.0, np.pi + np.deg2rad(1.0) * sway),
        ):
            verdicts = judge_field(footfalls(still(40), heading=heading, drift=drift), name)
            assert verdicts.quasi_static[3:].all()
    assert "heading difference changes by 2 deg" in judge_field(footfalls(still(40), drift=drift), "ma2018").reason[10]


def test_footfalls_without_a_field_are_passed_over():
    field = turned(rng(12).normal(0, 0.05, 30))
    holed = field.copy()
    holed[[0, 7, 8, 20]] = np.nan
    for name in DETECTORS:
        verdicts, there = judge_field(footfalls(holed), name), np.isfinite(holed[:, 0])
        assert not verdicts.judged[~there].any()
        assert verdicts.reason[7] == "no field was measured at this footfall"
        if OFFSET not in {channel.name for channel in DETECTORS[name].channels}:  # which reckons with time
            np.testing.assert_allclose(verdicts.statistic[there], judge_field(footfalls(field[there]), name).statistic)


def test_places_far_apart_are_not_compared():
    holed = still(40)
    holed[10:13], holed[20:24] = np.nan, np.nan
    verdicts = judge_field(footfalls(holed), "qsf")
    np.testing.assert_array_equal(np.flatnonzero(~verdicts.judged), [0, 1, 2, 10, 11, 12, *range(20, 27)])
    assert verdicts.reason[13].startswith("over 6 strides: ")
    assert verdicts.reason[16].startswith("over 3 strides: ")
    assert verdicts.reason[24] == "over 3 strides there are too many footfalls without a field"
    assert verdicts.reason[2] == "fewer than 4 footfalls with a field so far"


def test_two_samples_of_the_field_are_a_mean_and_no_slope():
    walk = footfalls(still(10))
    poor = replace(walk, strength_rate_sigma=np.where(np.arange(10) == 6, np.nan, walk.strength_rate_sigma))
    assert judge_field(poor, "qsf").judged[6]
    verdicts = judge_field(poor, "aiez")
    assert not verdicts.judged[6]
    assert verdicts.reason[6] == "too little of the field was measured at this footfall"
    assert verdicts.quasi_static[7:].all()


def test_names_and_numbers_that_cannot_be():
    for words, make in {
        "no detector 'qfs': choose one of qsf, iqsf": lambda: judge_field(footfalls(still(5)), "qfs"),
        "no channel 'weight'": lambda: Channel("weight", 1.0),
        "sigma of channel 'strength' must be positive": lambda: Channel("strength", 0.0),
        "window": lambda: replace(DETECTORS["qsf"], window=0),
        "false-alarm rate": lambda: DETECTORS["qsf"].find_threshold(1.0),
        "threshold": lambda: replace(DETECTORS["qsf"], fixed_threshold=-1.0),
        "no form": lambda: replace(DETECTORS["qsf"], form="cubes"),
        "no channel": lambda: Detector("nothing", ()),
        "which changes matter": lambda: judge_field(footfalls(still(5)), replace(BOTH, fixed_threshold=None)),
    }.items():
        with pytest.raises(MagneticError, match=words):
            make()


def test_a_magnet_passes_the_rates_and_not_the_offset():
    beside = (np.arange(30) >= 10) & (np.arange(30) < 20)
    walk = footfalls(turned(np.deg2rad(25) * beside))
    assert judge_field(walk, "qsf-stance").quasi_static.all()
    assert not judge_field(walk, "aiez").quasi_static[beside].any()
    assert judge_field(walk, "aiez").quasi_static[20:].all()
    assert judge_field(walk, "ma2018").quasi_static[14:20].all()


ALL_PASS = replace(DETECTORS["aiez"], channels=(Channel(OFFSET, np.deg2rad(2.5)),), fixed_threshold=1e6)
"""The alignment of the heading alone."""


def test_innovations_of_the_alignment_are_as_large_as_its_variance():
    """Drift and readings drawn as it supposes them: a Kalman filter's normalised innovations are white and Gaussian.

    Of the first the variance is that of a reading, of a mean of three, and of one stride's drift.
    """
    n, stride_s = 3000, 1.1
    drift = np.cumsum(HEADING_DRIFT * np.sqrt(stride_s) * rng(1).standard_normal(n))
    walk = footfalls(turned(np.deg2rad(2.5) * rng(2).standard_normal(n)), drift=drift, stride_s=stride_s)
    squares = judge_field(walk, ALL_PASS).statistic[3:] * 1e6
    assert kstest(squares, "chi2", args=(1,)).pvalue > 1e-3
    assert squares.mean() == pytest.approx(1.0, abs=0.08)
    read_deg = np.array([2.0, -1.0, 3.5, -4.0])
    variance = 2.5**2 * (1 + 1 / 3) + 0.2**2 * stride_s
    first = judge_field(footfalls(turned(np.deg2rad(read_deg)), stride_s=stride_s), ALL_PASS).statistic[3] * 1e6
    assert first == pytest.approx((read_deg[3] - read_deg[:3].mean()) ** 2 / variance, rel=2e-3)


def test_a_lasting_deviation_is_accepted_in_the_end_and_a_greater_one_later():
    """While the field is rejected the test widens with the drift, until S = (deviation)^2 / threshold."""
    detector, beside = DETECTORS["aiez"], np.arange(1000) >= 10
    for deviation in np.deg2rad([10.0, 15.0]):
        walk = footfalls(turned(deviation * beside))
        passed = judge_field(walk, detector).quasi_static & beside
        wide = deviation**2 / detector.threshold - detector.channels[0].sigma ** 2
        assert walk.t[np.argmax(passed)] == pytest.approx(wide / HEADING_DRIFT**2, rel=0.07)
        locked = replace(detector, counts_drift=False)  # AIEZ (17) as printed, by sigma alone: never accepted
        assert not judge_field(walk, locked).quasi_static[beside].any()


def verdicts(*statistic):
    return FieldVerdicts("qsf", np.array(statistic, dtype=float), 7.0, tuple("x" for _ in statistic))


def test_below_one_the_field_passes_and_where_there_is_none_it_does_not():
    found = verdicts(np.nan, 0.0, 0.999, 1.0, 3.0)
    assert found.judged.tolist() == [False, True, True, True, True]
    assert found.quasi_static.tolist() == [False, True, True, False, False]
    assert found.words == ("none", "quasi-static", "quasi-static", "disturbed", "disturbed")
    assert found.coverage == pytest.approx(2 / 5)  # of all footfalls, judged or not
    assert verdicts(np.nan, np.nan).coverage == verdicts().coverage == 0.0


@pytest.mark.parametrize("gate", GATES)
def test_a_verdict_needs_the_latest_footfalls_only(gate):
    rng, field = np.random.default_rng(0), footfalls(still(40), rate=np.arange(40) % 3)
    changes = np.where(rng.uniform(size=(40, 1)) < 0.3, 20.0, 0.1) * rng.standard_normal((40, 3))
    field = replace(field, body_field=np.where((np.arange(40) % 11 == 5)[:, None], np.nan, field.body_field + changes))
    batch, needed = apply_gate(field, gate), count_needed(gate)
    for k in range(len(field)):
        first = 0 if needed is None else max(0, k + 1 - needed)
        online = apply_gate(field.select(slice(first, k + 1)), gate)
        if needed is None or k + 1 >= needed:
            assert online.words[-1] == batch.words[k]
            assert online.reason[-1] == batch.reason[k]
    assert set(batch.words) >= {QUASI_STATIC, UNKNOWN}
    assert gate == NO_GATE or DISTURBED in batch.words


SOFT = [gate for gate in GATES if gate in DETECTORS]


@pytest.mark.parametrize("gate", SOFT)
def test_the_variance_grows_with_the_statistic_from_footfall_to_footfall_and_without_a_step(gate):
    """It is the walk's at the median, in whatever unit; never none; and the walk's where nothing was judged."""
    statistic = np.linspace(0.0, 4.0, 401)
    weight = weigh_statistic(verdicts(*statistic), gate)
    np.testing.assert_allclose(weigh_statistic(verdicts(*40.0 * statistic), gate), weight)
    assert weight[200] == pytest.approx(1.0)
    steps = np.diff(weight)
    assert (steps > 0.0).all()
    np.testing.assert_allclose(steps, steps[0])
    count = find_gate(gate).window * len(find_gate(gate).channels)
    assert weight[0] == pytest.approx(PRIOR_COUNT / (PRIOR_COUNT + count))
    assert weigh_statistic(verdicts(np.nan, 1.0, 2.0, 3.0), gate)[[0, 2]].tolist() == [1.0, 1.0]
    for none in (verdicts(), verdicts(np.nan, np.nan), verdicts(0.0, 0.0, 0.0)):
        assert weigh_statistic(none, gate).tolist() == [1.0] * len(none)


def test_a_hard_gate_uses_the_compass_at_its_full_weight_or_not_at_all_and_no_gate_all_of_it():
    for name in DETECTORS:
        weight = weigh_statistic(verdicts(np.nan, 0.2, 0.999, 1.0, 50.0), name + HARD)
        assert weight.tolist() == [np.inf, 1.0, 1.0, np.inf, np.inf]
    assert weigh_statistic(apply_gate(footfalls(still(5)), NO_GATE), NO_GATE).tolist() == [1.0] * 5
    assert weigh_statistic(verdicts(np.nan, 0.1, 7.0), NO_GATE).tolist() == [1.0] * 3


def test_a_gate_is_the_detector_of_the_filter_of_its_name():
    for name in ("qsf", "iqsf", "ma2018", "aiez", "qsf-stance"):
        assert find_gate(name) == find_gate(name + HARD) == find_parameters(name, "tuned").detector
    for gate in (NO_GATE, HARD, "no such gate", "no such gate" + HARD):
        with pytest.raises(MagneticError, match="there is no detector"):
            find_gate(gate)


RATE_HZ = 100.0


def recording(strength_uT, rate_hz=RATE_HZ, noise_uT=0.0, seed=1):
    """A sensor that tumbles in a field of this strength (N,)."""
    n = len(strength_uT)
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal((n, 3))
    mag = strength_uT[:, None] * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    mag = mag * (1.0 + noise_uT * rng.standard_normal((n, 1)) / strength_uT[:, None])
    return Recording(np.arange(n) / rate_hz, np.tile([0.0, 0.0, 9.81], (n, 1)), np.zeros((n, 3)), mag)


def strength(n):
    return np.full(n, np.linalg.norm(EARTH))


def test_a_sensor_that_tumbles_in_a_still_field_passes_and_all_of_a_bump_is_rejected_its_top_included():
    """Two seconds past a lamp: at the top the rate of the strength is nothing."""
    found = judge_samples(recording(strength(1000)))
    assert found.judged[2:].all()
    assert found.quasi_static[2:].all()
    t = np.arange(1000) / RATE_HZ
    for bump_uT in (-5.0, 2.0):
        found = judge_samples(recording(strength(1000) + bump_uT * np.exp(-(((t - 5.0) / 0.6) ** 2))))
        assert not found.quasi_static[np.abs(t - 5.0) < 0.6].any()
        assert found.quasi_static[(t > 0.1) & (t < 3.0)].all()
        assert found.quasi_static[t > 8.0].all()


def test_the_window_is_as_long_as_said_and_no_sample_is_judged_by_later_ones():
    """One odd sample, at 64 Hz and so at exact times: it counts for 64 samples."""
    odd = strength(500) + 20.0 * (np.arange(500) == 200)
    failed = np.flatnonzero(judge_samples(recording(odd, 64.0)).statistic > 1.0)
    np.testing.assert_array_equal(failed, np.arange(200, 264))


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_as_many_still_fields_and_least_changes_pass_as_are_said_to(rate_hz):
    count = round(WINDOW_S * rate_hz)
    n = 2000 * count
    still = recording(strength(n), rate_hz, SIGMA_UT)
    ramp = np.tile(np.linspace(0.0, MATTERS_UT, count), 2000)
    changing = recording(strength(n) + ramp, rate_hz, SIGMA_UT, seed=2)
    passed = [judge_samples(walk).quasi_static[count - 1 :: count].mean() for walk in (still, changing)]
    assert passed[0] == pytest.approx(chdtr(count - 1, find_sample_threshold(count)), abs=0.03)
    assert passed[1] == pytest.approx(FALSE_ALARM_RATE, abs=0.02)


N = 3
OURS, PRINTED = DETECTORS["ma2018"], DETECTORS["ma2018-printed"]
SQUARES = replace(PRINTED, form="sum of squares")


def alone(detector, values):
    """Statistic of one channel's values over its sigma (..., rows), the others being nothing."""
    values = np.asarray(values, dtype=float)
    window = np.zeros((*values.shape[:-1], len(detector.channels), values.shape[-1]))
    window[..., 0, :] = values
    return detector.compute_statistic(window)


def test_the_printed_statistics_are_those_of_their_equations():
    """Ma (26) on Gaussian changes, as Ma (16) has them, sees nothing of +10 and -10 sigma; with absolutes it does.

    Ma's hypothesis "at every step" has the estimate s_k = y_k (AIEZ (16), (17)); Ma (20) has one for all.
    """
    opposite, creeping, jumping = [0.0, 10.0, 0.0, 0.0], [0.0, 2.0, 4.0, 6.0], [0.0, 6.0, 6.0, 6.0]
    for values, printed, squares in ((opposite, 400 / 3, 200 / 3), (creeping, 12.0, 4.0), (jumping, 12.0, 12.0)):
        assert alone(PRINTED, values) == pytest.approx(printed)
        assert alone(SQUARES, values) == pytest.approx(squares)
    assert alone(OURS, opposite) == pytest.approx(75.0)
    # the likelihood ratio of Ma (24), with the window's mean for an estimate: 2 ln(ratio) = (sum y)^2 / (N sigma^2)
    y, sigma = rng().uniform(0.1, 2.0, N), 0.7
    two_log_ratio = -2 * (norm.logpdf(y, 0.0, sigma) - norm.logpdf(y, y.mean(), sigma)).sum()
    assert alone(PRINTED, np.cumsum([0.0, *y]) / sigma) == pytest.approx(two_log_ratio)
    # AIEZ (15) has 1 / sqrt(2 pi sigma^2) where AIEZ (14) has its N-th power, which would leave a unit in the ratio
    product = -2 / N * (norm.logpdf(y, 0.0, 0.5) - norm.logpdf(0.0, 0.0, 0.5)).sum()
    assert alone(replace(DETECTORS["aiez-printed"], window=N), y / 0.5) == pytest.approx(product)


def test_170_lets_a_field_pass_that_turns_by_28_degrees_a_step_and_has_no_false_alarm_rate():
    """Ma (23) integrates a density whose estimate is made of the data: at 170 its "probability" is 10. Ours has one."""
    for step_deg, printed, ours in ((28.0, True, False), (30.0, False, False), (1.0, True, True)):
        walk = footfalls(turned(np.deg2rad(step_deg) * np.arange(20)))
        assert judge_field(walk, "ma2018-printed").quasi_static[3:].all() == printed
        assert judge_field(walk, "ma2018").quasi_static[3:].all() == ours
    edge = np.sqrt(170.0)
    assert quad(lambda y: norm.pdf(y, loc=y), -edge, edge)[0] == pytest.approx(10.4, abs=0.01)
    with pytest.raises(MagneticError, match="no distribution to take a rate from"):
        PRINTED.find_threshold(0.05)
    assert 0.0 < OURS.find_threshold(0.01) < OURS.find_threshold(0.1)


def test_the_sigma_of_the_one_channel_is_no_sigma_of_the_other():
    """AIEZ (12) divides the strength rate, uT/s, by the sigma of the heading, rad: still fields fail.

    On zeros, which are no differences, AIEZ (17) is what its authors take it for: chi squared over N.
    """
    detector = DETECTORS["aiez-printed"]
    heading, strength = detector.channels
    window = rng().standard_normal((100_000, 2, 1))
    assert (detector.compute_statistic(window) < detector.threshold).mean() == pytest.approx(0.99, abs=0.002)
    window[:, 1] *= strength.sigma / heading.sigma
    assert (detector.compute_statistic(window) < detector.threshold).mean() < 0.8
    three = replace(detector, window=N)
    scaled = N * three.compute_statistic(rng(3).standard_normal((20_000, 2, three.rows)))
    assert kstest(scaled, "chi2", args=(2 * N,)).pvalue > 1e-3


@pytest.mark.parametrize("name", ["aiez", "aiez-printed"])
def test_pure_is_only_what_agrees_with_the_inertial_heading(name):
    """AIEZ (8), (11) name it pure: a field that is wrong from the start passes, the same after a right one does not."""
    wrong = footfalls(turned(np.full(20, np.deg2rad(40.0))))
    wrong_later = footfalls(turned(np.deg2rad(40.0) * (np.arange(20) >= ALIGNMENT_FOOTFALLS)))
    assert judge_field(wrong, name).quasi_static[3:].all()
    assert not judge_field(wrong_later, name).quasi_static.any()
