"""The default walk lies where real ones do, in every fact but those that say why not."""

import importlib
import sys
from pathlib import Path

import pytest

from fg_nav.simulation.person import Person
from tests.real_data import DATA, needs_data

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
realism = importlib.import_module("realism")
walks = importlib.import_module("walks")

SEEDS = (11, 12, 13)  # not those on which the gait was chosen


@pytest.fixture(scope="module")
def facts() -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    real = [realism.inertial_facts(realism.foot(walk.name, walk.recording)) for walk in walks.gdin(DATA)]
    ours = [realism.inertial_facts(realism.foot(f"seed {seed}", realism.simulated(Person(), seed))) for seed in SEEDS]
    return real, ours


@needs_data
def test_default_walk_lies_within_the_real_ones(facts: tuple[list[dict[str, float]], list[dict[str, float]]]) -> None:
    real, ours = facts
    outside = {key for key in realism.FACTS if realism.verdict(real, ours, key) == "outside"}
    assert outside <= set(realism.REASONS)


@needs_data
def test_every_fact_tells_a_foot_from_a_table(facts: tuple[list[dict[str, float]], list[dict[str, float]]]) -> None:
    real, _ = facts
    assert all(set(of) == set(realism.FACTS) for of in real)
    assert all(of[key] > 0 for of in real for key in realism.FACTS)
