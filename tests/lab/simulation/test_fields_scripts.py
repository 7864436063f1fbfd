"""The scripts that print how the fields compare: what they measure, on fields that are known."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2, yaw_rotation
from fg_nav.lab.simulation.fields import SITES, draw_environment, make_earth_field
from fg_nav.recording import Recording
from fg_nav.solution import Solution, StanceTable
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

realism = load_script("realism_field")


EARTH = SITES["munich"]

SAMPLES = 93  # Of a stride of 0.93 s.

STANCE_SHARE, STRIDE_M, SWING_RISE_M, ROLL_M = 0.4, 1.29, 0.12, 0.003


def corridor(level: str, seed: int, strides: int = 80) -> realism.Sensed:
    """Walk through a made-up corridor with right-angled corners: what the foot truly passes, without any noise."""
    rng = np.random.default_rng(seed)
    footprint, heading = _corridor(rng, strides)
    field = draw_environment(level, EARTH, footprint * [1.0, 1.0, 0.0], rng)
    t, position, phase = _foot(footprint)
    nav_R_body = np.repeat([yaw_rotation(np.pi / 2 - angle) for angle in heading], SAMPLES, axis=0)
    stances = Stances.from_mask(np.tile(phase < STANCE_SHARE, len(footprint)))
    recording = Recording(
        t=t,
        acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (len(t), 1)),
        gyr=np.zeros((len(t), 3)),
        mag=_body(field.at(position), nav_R_body),
    )
    return realism.Sensed(f"{level} {seed}", recording, stances, _truth(t, position, nav_R_body, stances))


def _corridor(rng: np.random.Generator, strides: int, straight: int = 9) -> tuple[Floats, Floats]:
    """Footprints (K, 3) m at the sensor's height and headings (K,) rad."""
    turns = np.where(np.arange(strides) % straight == straight - 1, rng.choice([-1, 1], strides) * np.pi / 2, 0.0)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(turns)
    step = STRIDE_M * (1 + 0.03 * rng.standard_normal(strides))
    xy = np.cumsum(step[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1), axis=0)
    return np.column_stack([xy, np.full(strides, 0.1)]), heading


def _foot(footprint: Floats) -> tuple[Floats, Floats, Floats]:
    """Stamps and positions of the samples, and the phase (SAMPLES,) of a stride: it stands, then swings."""
    phase = np.arange(SAMPLES) / SAMPLES
    u = np.clip((phase - STANCE_SHARE) / (1 - STANCE_SHARE), 0, 1)
    way = np.diff(footprint, axis=0, append=footprint[-1:])
    gone = u**2 * (3 - 2 * u) + ROLL_M / STRIDE_M * np.minimum(phase / STANCE_SHARE, 1) * (1 - u)
    position = footprint[:, None] + gone[:, None] * way[:, None]
    position[:, :, 2] += SWING_RISE_M * np.sin(np.pi * u) ** 2
    return 0.01 * np.arange(len(footprint) * SAMPLES), position.reshape(-1, 3), phase


def _body(nav_field: Floats, nav_R_body: Floats) -> Floats:
    return np.asarray(np.einsum("nji,nj->ni", nav_R_body, nav_field))


def _truth(t: Floats, position: Floats, nav_R_body: Floats, stances: Stances) -> Solution:
    """Return the truth as if an estimator had found it."""
    row = stances.start
    none = np.zeros((len(row), 3))
    table = StanceTable(
        sample=row,
        t=t[row],
        position=position[row],
        nav_R_body=nav_R_body[row],
        gyro_bias=none,
        position_cov=np.zeros((len(row), 3, 3)),
        heading_sigma=none[:, 0],
        gyro_bias_sigma=none,
        field=("none",) * len(row),
        field_reason=("",) * len(row),
    )
    return Solution("truth", t, position, np.gradient(position, t, axis=0), nav_R_body, table, runtime_s=0.0)


def replace_field(walk, nav_field):
    body = np.einsum("nji,nj->ni", walk.solution.nav_R_body, nav_field)
    return replace(walk, recording=replace(walk.recording, mag=body))


@pytest.fixture(scope="module")
def indoor():
    return corridor("indoor", 1)


def test_a_homogeneous_field_shows_nothing():
    walk = corridor("homogeneous", 0)
    for key in ("norm_sd_uT", "step_uT", "step_90_uT", "deviation_uT", "steadiness_uT", "delay_ms"):
        assert walk.facts()[key] == pytest.approx(0.0, abs=1e-9)
    assert walk.facts()["near_share"] == 1.0


def test_independent_footfalls_show_as_such():
    """White noise from stance to stance, constant within: sd, steps and correlation follow from its size."""
    walk = corridor("homogeneous", 0, strides=400)
    noise = np.repeat(np.random.default_rng(0).normal(size=(400, 3)), SAMPLES, axis=0)
    facts = replace_field(walk, make_earth_field(40.0, 0.0).vector + 6 * noise).facts()
    assert facts["deviation_uT"] == pytest.approx(6.0, rel=0.08)
    assert facts["step_uT"] == pytest.approx(6 * np.sqrt(2 * 2.366), rel=0.1)  # median of chi squared, 3 freedoms
    assert facts["norm_sd_uT"] == pytest.approx(6.0, rel=0.1)
    assert facts["compass_sd_deg"] == pytest.approx(np.degrees(6 / 40), rel=0.12)
    assert abs(facts["excess_kurtosis"]) < 0.6
    assert all(abs(facts[f"correlation_{lag}"]) < 0.1 for lag in realism.LAGS)


def test_a_late_magnetometer_is_found_and_forgiven():
    """On a foot that pitches in its swing, as real ones do."""
    walk = corridor("indoor", 1)
    swing = np.tile(np.sin(2 * np.pi * np.arange(SAMPLES) / SAMPLES), 80)
    pitch = np.array([[[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]] for a in swing])
    nav_field = np.einsum("nij,nj->ni", walk.solution.nav_R_body, walk.recording.mag)
    pitching = replace(walk, solution=replace(walk.solution, nav_R_body=walk.solution.nav_R_body @ pitch))
    prompt = replace_field(pitching, nav_field)
    late = replace(prompt, recording=replace(prompt.recording, mag=np.roll(prompt.recording.mag, 2, axis=0)))
    assert prompt.facts()["delay_ms"] == 0
    assert late.facts()["delay_ms"] == pytest.approx(20)
    assert late.facts()["step_uT"] == pytest.approx(prompt.facts()["step_uT"], rel=0.05)


def test_rows_without_a_sample_are_passed_over(indoor):
    mag = indoor.recording.mag.copy()
    mag[np.arange(len(mag)) % 4 != 1] = np.nan
    sparse = replace(indoor, recording=replace(indoor.recording, mag=mag)).facts()
    for key, value in indoor.facts().items():
        if key not in ("steadiness_uT", "delay_ms"):
            assert sparse[key] == pytest.approx(value, abs=0.05 * abs(value) + 0.05), key


def test_without_a_magnetometer_or_strides_it_says_so(indoor):
    with pytest.raises(RecordingError, match="no magnetometer"):
        replace(indoor, recording=replace(indoor.recording, mag=None)).facts()
    with pytest.raises(RecordingError, match="footfalls"):
        corridor("homogeneous", 0, strides=5).facts()


def floor_walk(level: str, seed: int, strides: int = 120) -> realism.FloorWalk:
    walk = corridor(level, seed, strides)
    return realism.make_floor_walk("made", walk.name, walk.recording, walk.stances, walk.solution)


def test_a_floor_of_known_waves_shows_its_spread_and_potential():
    """B = -grad phi, phi = a / k cos(k n): the spread of the potential is that of the field over k."""
    walk = floor_walk("homogeneous", 0, strides=300)
    number, size = 2 * np.pi / 15.0, 9.0
    angle = number * walk.position[:, 1]
    wave = np.stack([np.zeros_like(angle), size * np.sin(angle), np.zeros_like(angle)], axis=1)
    facts = replace(walk, nav_field=walk.nav_field + wave).facts()
    assert facts["level_sd_uT"] == pytest.approx(size / 2, rel=0.15)  # of two axes one
    assert facts["potential_m"] == pytest.approx(np.sqrt(2) / number, rel=0.15)
    assert facts["level_correlation_1"] > 0.7
    assert 0.8 < facts["path_sd_ratio"] < 1.2


def test_buildings_are_drawn_about_the_same_path():
    walk = floor_walk("homogeneous", 0)
    drawn = [walk.draw_building("indoor", seed) for seed in (1, 1, 2)]
    facts = [one.facts() for one in drawn]
    assert facts[0] == facts[1] != facts[2]
    assert set(facts[0]) == set(realism.FLOOR_FACTS)
    assert all(len(one.footfall) == len(walk.footfall) for one in drawn)
    np.testing.assert_allclose(drawn[0].position[drawn[0].footfall, :2], walk.position[walk.footfall, :2], atol=1e-9)
    sets = realism.middle_by_set(drawn)
    assert list(sets) == ["made"]


def test_short_walks_say_nothing_of_legs():
    facts = floor_walk("indoor", 1, strides=20).facts()
    assert np.isnan(facts["leg_sd_ratio"])
    assert np.isnan(facts["level_correlation_16"])


@needs_data
def test_indoor_lies_in_the_range_of_the_real_walks():
    real = [walk.facts() for walk in realism.read_walks(DATA, (15, 18, 22, 31, 33, 36))]  # the extremes are among them
    made = [corridor("indoor", seed).facts() for seed in range(5)]
    for key in set(realism.FACTS) - {"delay_ms", "steadiness_uT"}:  # both are of the sensor, not of the field
        values = [facts[key] for facts in real]
        assert min(values) <= np.median([facts[key] for facts in made]) <= max(values), key
