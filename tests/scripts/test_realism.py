"""The persons drawn walk as real ones do: in every fact but those that say why not."""

import numpy as np
import pytest

from fg_nav.lab.simulation.fields import SITES, draw_environment
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

realism = load_script("realism")


@needs_data
def test_simulated_feet_lie_within_the_real_ones() -> None:
    real, ours = realism.compare_feet(DATA, (11, 12, 13, 14))  # not those on which the gait was chosen
    rows = realism.judge_facts(real, ours, ends=(0.0, 100.0))
    assert len(rows) == 15
    assert all(mark == "inside" or reason for *_, mark, reason in rows), rows
    for fact in ("peak rate, roll (deg/s)", "peak rate, pitch (deg/s)", "sensor above the rolling point (cm)"):
        spread = [np.ptp([facts[fact] for facts in some if fact in facts]) for some in (real, ours)]
        assert 0.15 * spread[0] < spread[1] < 2.0 * spread[0], fact


def test_a_floor_of_known_waves_shows_its_spread_and_potential() -> None:
    """B = -grad phi, phi = a / k cos(k n): the spread of the potential is that of the field over k."""
    north = np.linspace(0.0, 400.0, 20_001)
    number, size = 2.0 * np.pi / 15.0, 9.0
    path, feet = np.column_stack([0.0 * north, north, 0.0 * north]), np.arange(0, 20_001, 65)
    earth = draw_environment("homogeneous", SITES["munich"], path[feet], np.random.default_rng(1)).at(path)
    facts = realism.measure_floor(path, earth + np.outer(size * np.sin(number * north), [0.0, 1.0, 0.0]), feet)
    assert facts["sd per axis over ground (uT)"] == pytest.approx(size / 2, rel=0.1)  # of two axes one
    assert facts["sd of the potential / of the field (m)"] == pytest.approx(np.sqrt(2) / number, rel=0.1)
    assert facts["correlation, 1 stride apart"] == pytest.approx(np.cos(1.3 * number), abs=0.05)
