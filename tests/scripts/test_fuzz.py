"""The fuzz campaign: inputs are what their seed says, faults are seen, and a few inputs show none."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.online.buffer import rows_of
from tests.scripts import load_script
from tests.simulated import PERSON, straight_walk

run = load_script("fuzz.run")
mutations = load_script("fuzz.mutations")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> object:
    """One short walk under the names of all, and the files that go with it."""
    store = run.Store(tmp_path_factory.mktemp("inputs"), None)
    rows = rows_of(straight_walk(PERSON, strides=6, standing_s=1.0, rate_hz=100.0).recording)[:, :10]
    for name in store.sources:
        np.save(store.folder / f"{name}.npy", rows)
    run.write_rows(rows, store.folder / "walk.csv")
    (store.folder / "truth.tum").write_text("0 0 0 0 0 0 0 1\n9 9 0 0 0 0 0 1\n")
    (store.folder / "footprints.csv").write_text("stride,x_m,y_m\n0,0,0\n1,1.5,2\n")
    (store.folder / "scenario.toml").write_text(run.SCENARIO)
    return store


@pytest.mark.parametrize("kind", ["samples", "format", "stream", "truth", "scenario", "options"])
def test_a_few_inputs_show_no_fault(kind: str, store: object) -> None:
    for number in range(2):
        fate = run.run_case(store, run.Case(kind, 7, number))
        assert fate.outcome in ("refused", "accepted"), fate
        assert not fate.faults, fate


def test_every_mutation_is_its_seed_s_and_changes_something() -> None:
    rows = np.random.default_rng(1).normal(scale=30.0, size=(500, 10))
    rows[:, 0] = np.arange(500) / 99.0
    table, tree = "time_s,x_m\n" + "1.5,2.5\n" * 30, {"scale": [[2.0, 0.5], [0.5, 3.0]], "rounds": 3, "method": "iez"}
    ways = [
        lambda rng, name=name: mutations.mutate_samples(rows, rng, [name])[0].tobytes()
        for name in mutations.SAMPLE_MUTATIONS
    ]
    ways += [
        lambda rng: mutations.mutate_bytes(table.encode(), rng)[0],
        lambda rng: mutations.scramble_table(table, rng),
        lambda rng: mutations.scramble_table(table, rng, ",", mutations.VARIATIONS, 3),
        lambda rng: str(mutations.change_tree(tree, rng, breaks=True)),
        lambda rng: str(mutations.change_tree(tree, rng, breaks=False)),
    ]
    clean = (rows.tobytes(), table.encode(), table, str(tree))
    for way in ways:
        one, again = ([way(np.random.default_rng(seed)) for seed in range(20)] for _ in range(2))
        assert one == again
        assert sum(value not in clean for value in one) > 10


def act(store: object, case: object) -> object:
    """Do what the kind of a case says in place of running it."""
    eval(case.kind)
    return run.Fate(case)


def test_a_worker_that_dies_or_hangs_is_named_and_another_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kinds = {"1 + 1": 1, "__import__('time').sleep(60)": 1, "__import__('os').abort()": 1, "2 + 2": 1}
    monkeypatch.setattr(run, "run_case", act)
    monkeypatch.setattr(run, "KINDS", kinds)
    fates = run.run_all([run.Case(kind, 1, 1) for kind in kinds], run.Store(tmp_path, None), 1, 2.0)
    one, slow, dead, other = (fate.faults for fate in fates)
    assert (one, slow, other) == ([], ["hang: more than 2 s"], [])
    assert dead[0].startswith("crash: exit code -6")


def test_what_must_not_be_is_seen(tmp_path: Path) -> None:
    def fault(code: int, err: str) -> str:
        fate = run.Fate(run.Case("samples", 1, 1))
        return ";".join(run.judge_answer(fate, code, "", err, tmp_path))

    assert fault(1, "fg-nav: it is wrong.\n") == ""
    assert fault(1, "one\ntwo\n").startswith("refused in 2 lines")
    assert fault(3, "") == "exit code 3"
    raised = 'Traceback\n  File "/x/fg_nav/a.py", line 3, in f\nValueError: x\nfg-nav: a bug'
    assert fault(70, raised).startswith("exception: ValueError: x [a.py")


def test_numbers_that_must_not_be_are_seen() -> None:
    t = np.linspace(0.0, 2.0, 201)
    path = np.column_stack([t, 5.0 * t, 0.0 * t, 0.0 * t])
    strides = pd.DataFrame({"x_m": [0.0, 1.0, 2.0], "y_m": 0.0, "sigma_x_m": [0.0, 0.1, 0.2]})
    assert list(run.judge_path(path, strides, is_marked=False)) == []
    fast = list(run.judge_path(path * [1.0, 3.0, 1.0, 1.0], strides * [5, 5, 1], is_marked=False))
    assert fast == ["absurd: 15.0 m/s", "absurd: a stride of 5.0 m"]
    strides.loc[1, "sigma_x_m"], path[3, 1] = 0.0, np.nan
    words = [words.split(":")[0] for words in run.judge_path(path, strides, is_marked=True)]
    assert words == ["not finite", "sigma not above zero"]
