"""What experiments store: measurements to the last bit, walks once; and figures of walks, as the papers have them."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import OutputError
from fg_nav.lab import reproduce
from fg_nav.lab.campaign.execute import settings_of
from fg_nav.lab.reproduce.runner import (
    FIGURES,
    Walks,
    describe_other_code,
    keys_of,
    read_walks,
    reduction_over,
    run_missing,
    spread_over,
    used_percent,
)
from fg_nav.lab.store import results
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import Key, Measurement, Result
from tests.lab.reproduce.stored_walks import walk


def drawn(seed):
    return {"some/values": np.random.default_rng(seed).standard_normal(50), "count": np.array(seed)}


def result(method, seed, error_m):
    return walk(Result(Key("mall", "indoor", str(seed), "loop", method), {}, ""), error_m)


def test_a_part_comes_back_to_the_last_bit(tmp_path):
    part = Measurement("some", partial(drawn, 3))
    assert part.read(tmp_path) is None
    made = part.load(tmp_path)
    np.testing.assert_array_equal(made["some/values"], drawn(3)["some/values"])
    assert set(made) == {"some/values", "count"}
    assert [path.name for path in (tmp_path / "parts").iterdir()] == ["some.npz"]


def test_a_part_of_other_code_or_a_damaged_one_is_none(tmp_path, monkeypatch):
    part = Measurement("some", partial(drawn, 3))
    part.run(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(results, "code_sum", lambda: "other")
        assert part.read(tmp_path) is None
    assert part.read(tmp_path) is not None
    path = tmp_path / "parts" / "some.npz"
    path.write_bytes(path.read_bytes()[:100])
    assert part.read(tmp_path) is None
    assert part.load(tmp_path)["count"] == 3


def test_what_makes_parts_rests_on_no_other_module_of_the_experiments():
    """Its sum is over its own module and the library: another one's change would go unseen."""
    sources = {str(path): path.read_text() for path in Path(reproduce.__file__).parent.rglob("*.py")}
    makers = {name: text for name, text in sources.items() if "return Measurement(" in text}
    assert len(makers) == 3
    for name, text in makers.items():
        imported = set(re.findall(r"fg_nav\.lab\.reproduce[.\w]*", text.split('"""', 2)[2]))
        assert not imported, name


def test_a_part_that_cannot_be_moved_to_its_place_leaves_nothing_beside(tmp_path):
    (tmp_path / "parts" / "some.npz").mkdir(parents=True)
    with pytest.raises(OutputError, match="could not be written"):
        Measurement("some", partial(drawn, 3)).run(tmp_path)
    assert [path.name for path in (tmp_path / "parts").iterdir()] == ["some.npz"]


def test_a_folder_that_cannot_be_is_shown(tmp_path):
    (tmp_path / "cells").write_text("a file")
    with pytest.raises(OutputError, match="name another"):
        run_missing(tmp_path, [], [])


@pytest.mark.parametrize("workers", [1, 2])
def test_walks_and_parts_are_made_once(tmp_path, monkeypatch, workers):
    keys, part, shown = keys_of("demo", ["smooth"], ["iez"], [3, 4]), Measurement("some", partial(drawn, 3)), []
    run_missing(tmp_path, keys, [part], workers, shown.append)
    assert shown == pytest.approx([1 / 3, 2 / 3, 1.0])
    walks = read_walks(tmp_path, keys).of("demo", "smooth", "iez")
    assert [one.key.walk for one in walks] == ["3", "4"]
    assert 0.0 < spread_over(walks, FIGURES["end_m"]).median < 3.0
    assert [bool(one.estimate) for one in walks] == [True, False]
    monkeypatch.setattr("fg_nav.lab.reproduce.runner.run_task", None)
    run_missing(tmp_path, keys, [part], workers)


def test_what_other_code_made_is_counted_and_shown():
    def of(*codes):
        return [replace(result("iez", seed, 1.0), code=code) for seed, code in enumerate(codes)]

    ours = code_sum()
    walks = Walks({("mall", "indoor", "iez"): of(ours, "554df78"), ("mall", "smooth", "iez"): of("554df78", "554df78")})
    [shown] = describe_other_code(walks)
    assert shown.startswith("3 of 4 results")
    assert "(3 with sum 554df78)" in shown
    assert describe_other_code(Walks({("mall", "indoor", "iez"): of(ours, ours)})) == ()


def test_what_a_campaign_kept_is_known_by_its_settings():
    """The same settings as `scripts/compare_ekf.py` gives: of the method, the stances, the calibration and the walk."""
    [key] = keys_of("office", ["indoor"], ["ma2018:as-printed"], [101])
    assert key.magnetometer == "loop"
    assert set(settings_of(key)) == {"method", "stances", "magnetometer", "walk"}


def test_figures_are_over_walks_and_a_failed_one_is_infinitely_wrong():
    some = [result("ma2018", seed, 1.0 * seed) for seed in (1, 2, 3)]
    assert (spread_over(some, FIGURES["end_m"]).median, spread_over(some, FIGURES["heading_deg"]).median) == (2.0, 2.0)
    assert spread_over(some, used_percent).median == pytest.approx(100 / 3)
    some[0] = replace(some[0], failed="so.", errors={})
    found = spread_over(some, FIGURES["end_m"])
    assert (found.median, found.high, found.n) == (3.0, np.inf, 3)


def test_a_reduction_is_that_of_each_walk():
    ours = [result("ma2018", 1, 1.0), result("ma2018", 2, 3.0)]
    theirs = [result("iqsf", 2, 4.0), result("iqsf", 1, 2.0)]
    found = reduction_over(ours, theirs, FIGURES["end_m"])
    assert (found.low, found.median, found.high) == pytest.approx((26.25, 37.5, 48.75))
    failed = [replace(ours[0], failed="so.", errors={}), ours[1]]
    assert reduction_over(failed, theirs, FIGURES["end_m"]).low == -np.inf
