"""The persons drawn walk as real ones do: in every fact of every table but those that say why not."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from tests.real_data import DATA, needs_data
from tests.scripts import load_script

realism = load_script("realism")
realism_field = load_script("realism_field")
realism_foot = load_script("realism_foot")
walks = load_script("walks")

SEEDS = (11, 12, 13, 14)  # not those on which the gait was chosen
Facts = Sequence[Mapping[str, float]]
Tables = Mapping[str, tuple[Mapping[str, object], Mapping[str, Facts]]]


@pytest.fixture(scope="module")
def tables() -> Tables:
    """Of each table its facts, and its columns: real first."""
    real = [
        realism_foot.measure_foot(walk.name, walk.recording)
        for walk in (one.read() for one in walks.list_set(DATA, "gdin"))
    ]
    recorded = {name: [realism.simulate_walk(person(s), s) for s in SEEDS] for name, person in realism.PEOPLE.items()}
    ours = {name: [realism_foot.measure_foot(name, one) for one in of] for name, of in recorded.items()}
    inertial = {
        name: [realism_foot.measure_inertial(walk) for walk in of] for name, of in ({"real": real} | ours).items()
    }
    captured = {"real": realism_foot.read_captured(DATA)} | ours
    true = {name: [realism_foot.measure_true(walk) for walk in of] for name, of in captured.items()}
    field = {"real": [walk.facts() for walk in realism_field.read_walks(DATA)]}
    field |= {name: [realism_field.sense_walk(walk).facts() for walk in of] for name, of in recorded.items()}
    return {
        "inertial": (realism_foot.FACTS, inertial),
        "true": (realism_foot.TRUE_FACTS, true),
        "field": (realism_field.FACTS, field),
    }


@needs_data
@pytest.mark.parametrize("column", list(realism.PEOPLE))
@pytest.mark.parametrize("table", ["inertial", "true", "field"])
def test_walks_lie_within_the_real_ones(tables: Tables, table: str, column: str) -> None:
    facts, columns = tables[table]
    real, ours = columns["real"], columns[column]
    outside = {key for key in facts if realism.judge_fact(real, ours, key) == "outside"}
    assert outside <= set(realism.REASONS[column])
    share = np.mean([realism.count_within(real, ours, key) / len(ours) for key in facts if key not in outside])
    assert share > 0.7


@needs_data
def test_persons_differ_as_real_ones_do(tables: Tables) -> None:
    """What the person and the mount decide spans a good part of what it spans in ten real walks, for so few."""
    _, columns = tables["inertial"]
    for key in ("toe_down_deg", "toe_up_deg", "roll_deg_s", "pitch_deg_s", "rise_cm", "lever_cm"):
        real, ours = (np.ptp([facts[key] for facts in columns[name]]) for name in ("real", "simulated"))
        assert 0.15 * real < ours < 2 * real, key


@needs_data
def test_every_fact_distinguishes_a_foot_from_a_table(tables: Tables) -> None:
    facts, columns = tables["inertial"]
    assert all(set(of) == set(facts) for of in columns["real"])
    assert all(of[key] > 0 for of in columns["real"] for key in facts)


def test_reasons_are_of_facts_and_columns_there_are() -> None:
    known = set(realism_foot.FACTS) | set(realism_foot.TRUE_FACTS) | set(realism_field.FACTS)
    assert set(realism.PEOPLE) < set(realism.REASONS)
    assert all(set(reasons) <= known for reasons in realism.REASONS.values())
