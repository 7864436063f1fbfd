"""The scripts that print how the fields compare: what they measure, on fields that are known."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import RecordingError
from fg_nav.lab.simulation.fields import make_earth_field
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

realism = load_script("realism_field")
maps = load_script("field_maps")


def replace_field(walk, nav_field):
    body = np.einsum("nji,nj->ni", walk.solution.nav_R_body, nav_field)
    return replace(walk, recording=replace(walk.recording, mag=body))


@pytest.fixture(scope="module")
def indoor():
    return realism.corridor("indoor", 1)


def test_a_homogeneous_field_shows_nothing():
    walk = realism.corridor("homogeneous", 0)
    for key in ("norm_sd_uT", "step_uT", "step_90_uT", "deviation_uT", "steadiness_uT", "delay_ms"):
        assert walk.facts()[key] == pytest.approx(0.0, abs=1e-9)
    assert walk.facts()["near_share"] == 1.0


def test_independent_footfalls_show_as_such():
    """White noise from stance to stance, constant within: sd, steps and correlation follow from its size."""
    walk = realism.corridor("homogeneous", 0, strides=400)
    noise = np.repeat(np.random.default_rng(0).normal(size=(400, 3)), realism.SAMPLES, axis=0)
    facts = replace_field(walk, make_earth_field(40.0, 0.0).vector + 6 * noise).facts()
    assert facts["deviation_uT"] == pytest.approx(6.0, rel=0.08)
    assert facts["step_uT"] == pytest.approx(6 * np.sqrt(2 * 2.366), rel=0.1)  # median of chi squared, 3 freedoms
    assert facts["norm_sd_uT"] == pytest.approx(6.0, rel=0.1)
    assert facts["compass_sd_deg"] == pytest.approx(np.degrees(6 / 40), rel=0.12)
    assert abs(facts["excess_kurtosis"]) < 0.6
    assert all(abs(facts[f"correlation_{lag}"]) < 0.1 for lag in realism.LAGS)


def test_a_late_magnetometer_is_found_and_forgiven():
    """On a foot that pitches in its swing, as real ones do."""
    walk = realism.corridor("indoor", 1)
    swing = np.tile(np.sin(2 * np.pi * np.arange(realism.SAMPLES) / realism.SAMPLES), 80)
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


def test_hard_iron_is_taken_off(indoor):
    shifted = replace(
        indoor, recording=replace(indoor.recording, mag=indoor.recording.mag + np.array([12.0, -9.0, 0.0]))
    )
    wide, back, true = (
        walk.facts()["compass_sd_deg"] for walk in (shifted, realism.without_hard_iron(shifted), indoor)
    )
    assert wide > 1.2 * true
    assert abs(back - true) < 0.35 * (wide - true)


def test_without_a_magnetometer_or_strides_it_says_so(indoor):
    with pytest.raises(RecordingError, match="no magnetometer"):
        replace(indoor, recording=replace(indoor.recording, mag=None)).facts()
    with pytest.raises(RecordingError, match="footfalls"):
        realism.corridor("homogeneous", 0, strides=5).facts()


@needs_data
def test_indoor_lies_in_the_range_of_the_real_walks():
    real = [walk.facts() for walk in realism.real_walks(DATA, (15, 18, 22, 31, 33, 36))]  # the extremes are among them
    made = [realism.corridor("indoor", seed).facts() for seed in range(5)]
    for key in set(realism.FACTS) - {"delay_ms", "steadiness_uT"}:  # both are of the sensor, not of the field
        values = [facts[key] for facts in real]
        assert min(values) <= np.median([facts[key] for facts in made]) <= max(values), key


def test_only_the_printed_cylinder_is_no_field():
    for patch in maps.all_patches(1):
        _, _, size, div, rot, added = maps.measure_patch(patch, 0.1, seed=0, count=300)
        assert size > 0
        assert added > 0
        printed = patch.name == "cylinder, as printed"
        assert (div > 0.1) == (rot > 0.1) == printed, patch.name
        assert printed or max(div, rot) < 1e-4, patch.name
