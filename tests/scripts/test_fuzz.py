"""The fuzz campaign: inputs are what their seed says, faults are seen, and a few inputs show none."""

import io
import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav import cli
from fg_nav.online.buffer import rows_of
from fg_nav.recording import Recording
from tests.scripts import load_script
from tests.simulated import PERSON, straight_walk

fuzz = load_script("fuzz")
cases = load_script("fuzz_cases")
inputs = load_script("fuzz_inputs")
mutations = load_script("fuzz_mutations")
pool = load_script("fuzz_pool")
variations = load_script("fuzz_variations")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return straight_walk(PERSON, strides=6, standing_s=1.0, rate_hz=100.0).recording


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory, recording: Recording) -> object:
    """One short walk under the names of all."""
    folder = tmp_path_factory.mktemp("inputs")
    store = inputs.Store(folder, None)
    for name in store.recordings:
        np.save(folder / f"{name.replace(' ', '_')}.npy", rows_of(recording))
    inputs.write_canonical(inputs.raw_of(rows_of(recording)), folder / "walk.csv")
    (folder / "truth.tum").write_bytes(b"0 0 0 0 0 0 0 1\n9 9 0 0 0 0 0 1\n")
    (folder / "footprints.csv").write_bytes(b"stride,x_m,y_m\n0,0,0\n1,1.5,2\n")
    return store


@pytest.mark.parametrize("kind", ["format", "truth", "scenario", "options"])
def test_a_few_inputs_show_no_fault(kind: str, store: object) -> None:
    for number in range(2):
        fate = cases.run_case(cases.Case(kind, 7, number), store)
        assert fate.outcome in ("refused", "accepted"), fate
        assert not fate.faults, fate


def test_every_mutation_is_its_seed_s_and_changes_something(recording: Recording) -> None:
    rows = rows_of(recording)
    rows[:, 7:10] = [20.0, 0.0, -43.0]
    for name, mutate in mutations.SAMPLE_MUTATIONS.items():
        one, again = (mutate(rows.copy(), np.random.default_rng(3)) for _ in range(2))
        assert one.shape[1] == 11, name
        assert np.array_equal(one, again, equal_nan=True), name
        assert not np.array_equal(one, rows, equal_nan=True), name
    for seed in range(20):
        data, _ = mutations.mutate_bytes(b"time_s,x_m\n1.0,2.0\n", np.random.default_rng(seed))
        assert (data, _) == mutations.mutate_bytes(b"time_s,x_m\n1.0,2.0\n", np.random.default_rng(seed))


def test_a_variation_is_its_seed_s_changes_something_and_can_be_read() -> None:
    text = "time_s,x_m,y_m\n" + "".join(f"{k}.0,{k * k}.5,{k}\n" for k in range(20))
    tree = {"scale": [[2.0, 0.5], [0.5, 3.0]], "rounds": 3, "is_on": True, "method": "iez", "sigma": None}
    words = np.arange(1.0, 9.0).tobytes()
    changed = 0
    for seed in range(40):
        one, again = (
            (
                variations.vary_table(text, rng, ","),
                variations.vary_numbers(text, rng),
                json.dumps(variations.vary_tree(tree, rng)),
                variations.vary_words(words, rng),
            )
            for rng in (np.random.default_rng(seed) for _ in range(2))
        )
        assert one == again
        table = pd.read_csv(io.StringIO(one[0]))
        assert list(table) == ["time_s", "x_m", "y_m"]
        assert table.empty or all(np.issubdtype(kind, np.number) for kind in table.dtypes), seed
        assert list(json.loads(one[2])) == list(tree)
        assert len(one[3]) == len(words)
        changed += sum(a != b for a, b in zip(one, (text, text, json.dumps(tree), words), strict=True))
    assert changed > 120


def test_a_worker_that_dies_or_hangs_is_named_and_another_goes_on(tmp_path: Path) -> None:
    given = ["1 + 1", "__import__('time').sleep(60)", "__import__('os').abort()", "2 + 2"]
    workers = pool.Pool(eval, lambda case, words: (case, words), 1, 0.2, tmp_path)
    one, slow, dead, other = workers.map(given)
    assert (one, other) == (2, 4)
    assert slow == (given[1], "hang: more than 0.2 s")
    assert dead[0] == given[2]
    assert dead[1].startswith("crash: SIGABRT")


def test_what_must_not_be_is_seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fault(main: object) -> str:
        monkeypatch.setattr(cli, "main", main)
        fate = cases.Fate(cases.Case("samples", 1, 1))
        cases._run(cases.Input(["run", "walk.csv"], "nothing"), tmp_path, fate)
        return ";".join(fate.faults)

    def leave(code: int, words: str = "") -> object:
        def main() -> None:
            sys.stderr.write(words)
            sys.exit(code)

        return main

    assert fault(leave(1, "fg-nav: it is wrong.\n")) == ""
    assert fault(leave(1, "one\ntwo\n")).startswith("refused in 2 lines")
    assert fault(leave(3)) == "exit code 3"
    assert fault(leave(70, 'Traceback\n  File "/x/fg_nav/a.py", line 3, in f\nValueError: x\nfg-nav: a bug')) == (
        "exception: ValueError: x [a.py:3 f]"
    )


def test_numbers_that_must_not_be_are_seen() -> None:
    t = np.linspace(0.0, 2.0, 201)
    path = np.column_stack([t, 5.0 * t, 0.0 * t, 0.0 * t])
    strides = pd.DataFrame({"x_m": [0.0, 1.0, 2.0], "y_m": 0.0, "sigma_x_m": [0.0, 0.1, 0.2]})
    assert list(cases._judge_numbers(path, strides)) == list(cases._judge_motion(path, strides)) == []
    fast = path * [1.0, 3.0, 1.0, 1.0]
    assert list(cases._judge_motion(fast, strides * 5)) == ["absurd: 15.0 m/s", "absurd: a stride of 5.0 m"]
    strides.loc[1, "sigma_x_m"], path[3, 1] = 0.0, np.nan
    assert [words.split(":")[0] for words in cases._judge_numbers(path, strides)] == [
        "not finite",
        "sigma not above zero",
    ]


def test_kinds_have_their_shares_at_any_moment() -> None:
    drawn = list(fuzz.draw_cases(list(cases.KINDS), 100, 1))
    for kind, (share, _) in cases.KINDS.items():
        assert sum(case.kind == kind for case in drawn) == pytest.approx(share, abs=1), kind
        assert [case.number for case in drawn if case.kind == kind] == list(range(sum(c.kind == kind for c in drawn)))
