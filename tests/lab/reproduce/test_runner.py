"""What experiments store: measurements to the last bit, walks once; and figures of walks, as the papers have them."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fg_nav.errors import OutputError
from fg_nav.lab.campaign.execute import settings_of, simulated_keys
from fg_nav.lab.reproduce import aiez2017, ma2018, munoz_diaz2017
from fg_nav.lab.reproduce.runner import (
    WALK_FIGURES,
    describe_other_code,
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


def test_a_part_comes_back_to_the_last_bit_and_one_of_other_code_or_damaged_is_none(tmp_path, monkeypatch):
    part = Measurement("some", partial(drawn, 3))
    assert part.read(tmp_path) is None
    made = part.load(tmp_path)
    np.testing.assert_array_equal(made["some/values"], drawn(3)["some/values"])
    assert set(made) == {"some/values", "count"}
    assert [path.name for path in (tmp_path / "parts").iterdir()] == ["some.npz"]
    for other in ("code_sum", "_sum_folder"):  # of the library, and of the paper's own modules
        with monkeypatch.context() as patch:
            patch.setattr(results, other, lambda *_: "other")
            assert part.read(tmp_path) is None
    assert part.read(tmp_path) is not None
    path = tmp_path / "parts" / "some.npz"
    path.write_bytes(path.read_bytes()[:100])
    assert part.read(tmp_path) is None
    assert part.load(tmp_path)["count"] == 3


def modules_behind(function):
    """Modules of what a function names, and of what those that it names in its own folder name."""
    modules, seen, left = set(), set(), [function]
    while left:
        one = left.pop()
        seen.add(one)
        for named in (one.__globals__.get(name) for name in one.__code__.co_names):
            module = getattr(named, "__module__", None) or ""
            modules.add(module)
            if module.startswith(function.__module__) and hasattr(named, "__code__") and named not in seen:
                left.append(named)
    return modules


@pytest.mark.parametrize("paper", [aiez2017, ma2018, munoz_diaz2017])
def test_what_is_measured_rests_on_no_module_that_its_sum_leaves_out(paper):
    """Its sum is over its own folder and the library: a change of another module of the experiments goes unseen."""
    for part in (part for parts in paper.list_parts([1], True).values() for part in parts):
        behind = modules_behind(part.measure.func)
        assert not {name for name in behind if name.startswith("fg_nav.lab.reproduce") and paper.__name__ not in name}


def test_what_cannot_be_written_leaves_nothing_beside(tmp_path):
    (tmp_path / "parts" / "some.npz").mkdir(parents=True)
    with pytest.raises(OutputError, match="could not be written"):
        Measurement("some", partial(drawn, 3)).run(tmp_path)
    assert [path.name for path in (tmp_path / "parts").iterdir()] == ["some.npz"]
    (tmp_path / "cells").write_text("a file")
    with pytest.raises(OutputError, match="name another"):
        run_missing(tmp_path, [], [])


@pytest.mark.parametrize("workers", [1, 2])
def test_walks_and_parts_are_made_once(tmp_path, monkeypatch, workers):
    keys, part, shown = simulated_keys(["demo"], ["smooth"], ["loop"], ["iez"], [3, 4]), partial(drawn, 3), []
    part = Measurement("some", part)
    run_missing(tmp_path, keys, [part], workers, shown.append)
    assert shown == pytest.approx([1 / 3, 2 / 3, 1.0])
    walks = read_walks(tmp_path, keys)["demo", "smooth", "iez"]
    assert [one.key.walk for one in walks] == ["3", "4"]
    assert 0.0 < spread_over(walks, WALK_FIGURES["end_m"]).median < 3.0
    assert [bool(one.estimate) for one in walks] == [True, False]
    monkeypatch.setattr("fg_nav.lab.reproduce.runner.run_task", None)
    run_missing(tmp_path, keys, [part], workers)


def test_what_other_code_made_is_counted_and_shown():
    def of(*codes):
        return [replace(result("iez", seed, 1.0), code=code) for seed, code in enumerate(codes)]

    ours = code_sum()
    others = {("mall", "smooth", "iez"): of("554df78", "554df78")}
    [shown] = describe_other_code({("mall", "indoor", "iez"): of(ours, "554df78"), **others})
    assert shown.startswith("3 of 4 results")
    assert "(3 with sum 554df78)" in shown
    assert describe_other_code({("mall", "indoor", "iez"): of(ours, ours)}) == ()


def test_figures_are_over_walks_and_a_failed_one_is_infinitely_wrong():
    some = [result("ma2018", seed, 1.0 * seed) for seed in (1, 2, 3)]
    medians = {name: spread_over(some, figure).median for name, figure in WALK_FIGURES.items()}
    assert medians == pytest.approx(
        {
            **dict.fromkeys(("end_m", "heading_deg", "mean_m", "max_m", "landmark_mean_m", "landmark_max_m"), 2.0),
            **dict.fromkeys(("end_percent", "max_percent"), 0.2),
            **dict.fromkeys(("laid_max_m", "laid_landmark_mean_m"), 1.0),
            "used_percent": 100 / 3,
        }
    )
    some[0] = replace(some[0], failed="so.", errors={})
    found = spread_over(some, WALK_FIGURES["end_m"])
    assert (found.median, found.high, found.n) == (3.0, np.inf, 3)
    assert used_percent(replace(some[0], used="")) is None
    assert set(settings_of(some[0].key)) == {"method", "stances", "magnetometer", "walk"}  # as a campaign's


def test_a_reduction_is_that_of_each_walk():
    ours = [result("ma2018", 1, 1.0), result("ma2018", 2, 3.0)]
    theirs = [result("iqsf", 2, 4.0), result("iqsf", 1, 2.0)]
    found = reduction_over(ours, theirs, WALK_FIGURES["end_m"])
    assert (found.low, found.median, found.high) == pytest.approx((26.25, 37.5, 48.75))
    failed = [replace(ours[0], failed="so.", errors={}), ours[1]]
    assert reduction_over(failed, theirs, WALK_FIGURES["end_m"]).low == -np.inf
