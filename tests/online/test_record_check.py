"""A checkpoint that somebody changed is refused in one sentence, whatever was changed; one of ours never is."""

import json
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from fg_nav.online.checkpoint import VERSION, Checkpoint
from fg_nav.online.packing import pack, unpack, write_records
from fg_nav.online.record_check import doubt_resumed, find_fault
from fg_nav.online.saved_state import FootfallTable, RowTable

from fg_nav.detection.causal import CausalStances
from fg_nav.errors import EstimationError, FormatError
from fg_nav.factors.differential_field import Iron
from fg_nav.online import OnlineNavigator, load
from fg_nav.online.anchor import MarginalPrior, PathNodes
from fg_nav.online.buffer import rows_of
from fg_nav.solution import Return
from tests.online.walks import NORTH, push, short_walk


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows_of(short_walk())[:400])
    return Checkpoint(tmp_path_factory.mktemp("saved") / "walk").collect(navigator).record


def refuse(path, *records):
    write_records(path, VERSION, [one if isinstance(one, bytes) else pack(one) for one in records])
    with pytest.raises(FormatError, match=r"checkpoint.*: name another(, or| file, or) remove it\.$"):
        load(path)


def test_what_was_saved_is_sound(record, tmp_path):
    write_records(tmp_path / "walk", VERSION, [pack(record)])
    assert load(tmp_path / "walk").buffer.stop == 400


def turned_back(rows):
    return rows[::-1].copy()


def unknown_stamp(rows):
    return np.where(np.arange(rows.size).reshape(rows.shape) == 5 * rows.shape[1], np.nan, rows)


def infinite_rate(rows):
    return np.where(np.arange(rows.size).reshape(rows.shape) == 705, np.inf, rows)


def enormous_field(rows):
    return np.where(np.arange(rows.size).reshape(rows.shape) == 5 * rows.shape[1] + 8, 1e300, rows)


def both_unread(rows):
    return np.where(np.arange(rows.size).reshape(rows.shape) == 5 * rows.shape[1] + 11, 3.0, rows)


def unknown_unread(rows):
    return np.where(np.arange(rows.size).reshape(rows.shape) == 5 * rows.shape[1] + 11, np.nan, rows)


def name_change(changes):
    return ", ".join(f"{key}={getattr(value, '__name__', value)}" for key, value in changes.items())


@pytest.mark.parametrize(
    "changes",
    [
        {"kept_from": -1},
        {"kept_from": 10**12},
        {"first": -5},
        {"n_reported": -1},
        {"n_reported": "7"},
        {"n_reported": 1.5},
        {"has_ended": 0},
        {"takeovers": (1, None)},
        {"judge": {}},
        {"judge": None},
        {"source": []},
        {"source": {"units": {}}},
        {"frame": None},
        {"rows": turned_back},
        {"rows": unknown_stamp},
        {"rows": infinite_rate},
        {"rows": enormous_field},
        {"rows": both_unread},
        {"rows": unknown_unread},
        {"changes": 3},
    ],
    ids=name_change,
)
def test_a_field_that_was_changed_is_refused(record, changes, tmp_path):
    made = {name: value(record.rows) if callable(value) else value for name, value in changes.items()}
    refuse(tmp_path / "walk", replace(record, **made))


def test_each_number_of_the_judge_may_be_anything(record, tmp_path):
    for name, value in record.judge.items():
        for other in (None, 2**62 if isinstance(value, int) else [[]]):
            write_records(tmp_path / "walk", VERSION, [pack(replace(record, judge={**record.judge, name: other}))])
            with suppress(FormatError):
                load(tmp_path / "walk")


def test_records_that_do_not_follow_each_other_are_refused(record, tmp_path):
    later = replace(record, frame=None, first=400)
    refuse(tmp_path / "walk", record, later)  # the same stamps again
    refuse(tmp_path / "walk", record, replace(later, first=300))


def test_a_size_is_checked_before_anything_is_allocated(record, tmp_path):
    content = pack(record)
    stop = 8 + int.from_bytes(content[:8], "little")
    head = json.loads(content[8:stop])
    for shape in ([10**12, 10], [0, 10**12], [-1, 10], [2**63, 10]):
        head["arrays"][0]["shape"] = shape
        text = json.dumps(head).encode()
        refuse(tmp_path / "walk", len(text).to_bytes(8, "little") + text + content[stop:])


NODES = PathNodes(
    np.array([3, 9]),
    *(np.zeros((2, 3)) for _ in range(2)),
    np.stack([np.eye(3)] * 2),
    *(np.zeros((2, 3)) for _ in range(2)),
)
ROW = np.concatenate([[3.0, 0.1], np.zeros(6), np.eye(3).ravel(), np.zeros(3), np.eye(4).ravel(), np.zeros(4)])
ROWS = RowTable(0, np.stack([ROW, ROW + np.eye(40)[1]]), [("none", "")], np.zeros(2, dtype=np.int64))
LATER = np.array([5, 30])
FALLS = FootfallTable(0, np.array([1, 1]), np.array([2, 20]), LATER, np.ones(2), LATER - 1, LATER, LATER, LATER)
BENT = np.stack([np.eye(3), np.diag([1.0, 1.0, -1.0])])
ANCHOR = MarginalPrior((2**60,), (np.zeros(3),), np.eye(3), np.zeros(3))
IRON = Iron(np.zeros(3), np.eye(3))
RETURN = Return(np.arange(4.0), np.arange(4.0), False, 9.0, 1e-9, 2.0, np.zeros((4, 3)), np.zeros((4, 3)))


@pytest.mark.parametrize(
    ("sound", "changed"),
    [
        (NODES, {"sample": np.array([9, 3])}),
        (NODES, {"sample": np.array([3, 40])}),
        (NODES, {"sample": np.array([3.0, 9.0])}),
        (NODES, {"position": np.zeros((1, 3))}),
        (NODES, {"velocity": np.full((2, 3), np.nan)}),
        (NODES, {"velocity": np.full((2, 3), 1e300)}),
        (NODES, {"nav_R_body": BENT}),
        (ROWS, {"which": np.array([0, 1])}),
        (ROWS, {"numbers": ROWS.numbers[::-1]}),
        (ROWS, {"numbers": -ROWS.numbers}),
        (ROWS, {"numbers": np.where(np.arange(40) == 9, 1e300, ROWS.numbers)}),
        (ROWS, {"numbers": np.where(np.arange(40) == 0, np.inf, ROWS.numbers)}),
        (ROWS, {"numbers": ROWS.numbers[:, :30]}),
        (ROWS, {"words": "none"}),
        (FALLS, {"counts": np.array([1, 2])}),
        (FALLS, {"stop": np.array([1, 30])}),
        (FALLS, {"start": np.array([-2, 20])}),
        (FALLS, {"stillest": np.array([4, 100])}),
        (FALLS, {"line": np.array([4])}),
        (ANCHOR, {"keys": (None,)}),
        (ANCHOR, {"A": np.full((3, 3), np.nan)}),
        (ANCHOR, {"A": np.full((3, 3), np.inf)}),
        (ANCHOR, {"values": (2.0 * np.eye(4),)}),
        (IRON, {"covariance": -np.eye(3)}),
        (IRON, {"covariance": np.triu(np.ones((3, 3)))}),
        (RETURN, {"t": np.arange(3.0)}),
        (RETURN, {"t": np.arange(4.0)[::-1]}),
        (RETURN, {"earlier_t": np.full(4, np.nan)}),
        (RETURN, {"field_uT": np.zeros(4)}),
        (RETURN, {"score": np.nan}),
        (RETURN, {"t": np.zeros(0), "earlier_t": np.zeros(0), "field_uT": np.zeros((0, 3))}),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, dict) else next(iter(value)),
)
def test_tables_and_matrices_are_sound_and_changed_ones_are_not(sound, changed):
    assert find_fault(sound, stop=40) == ""
    other = sound._replace(**changed) if isinstance(sound, tuple) else replace(sound, **changed)
    assert find_fault(other, stop=40) != ""


@pytest.mark.parametrize("sound", [NODES, ROWS, FALLS, ANCHOR, IRON, RETURN], ids=lambda value: type(value).__name__)
def test_no_number_of_a_table_makes_its_check_fail(sound):
    for name, array in (sound._asdict() if isinstance(sound, tuple) else vars(sound)).items():
        for k in range(array.size if isinstance(array, np.ndarray) else 0):
            for value in (0, -1, 10**9, 2**62, *((np.nan, np.inf, -np.inf, 1e300, 5e-324) * (array.dtype.kind == "f"))):
                other = array.copy()
                other.flat[k] = value
                changed = {name: other}
                find_fault(
                    sound._replace(**changed) if isinstance(sound, tuple) else replace(sound, **changed), stop=40
                )


@pytest.mark.parametrize(
    ("name", "value"), [("_keep", 10**12), ("_first", -1), ("_rows", np.zeros((3, 3))), ("stop", 9999)]
)
def test_windows_of_the_search_fit_each_other(name, value):
    stances, rows = CausalStances(), rows_of(short_walk())[:300]
    stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    assert stances.is_sound()
    setattr(stances._search._acc, name, value)
    assert not stances.is_sound()


@pytest.mark.parametrize(("name", "value"), [("_t", np.inf), ("_t", 0.0), ("_acc", np.nan), ("_gyr", np.inf)])
def test_windows_of_the_search_hold_samples_in_order(name, value):
    stances, rows = CausalStances(), rows_of(short_walk())[:310]
    stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    assert stances.is_sound()
    window = getattr(stances._search, name)
    window.all()[-3:] = value
    assert not stances.is_sound()


@pytest.mark.parametrize(("part", "value"), [(0, np.inf), (1, np.nan), (2, np.inf)])
def test_samples_that_wait_for_the_search_are_samples(part, value):
    stances, rows = CausalStances(), rows_of(short_walk())[:303]
    stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    stances._waiting[0][part][0] = value
    assert not stances.is_sound()


def test_a_window_that_was_made_long_takes_no_memory_to_be_refused():
    stances, rows = CausalStances(), rows_of(short_walk())[:300]
    stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    stances._search._p = replace(stances._search._p, window_s=1e12)
    assert not stances.is_sound()


def test_raw_readings_that_were_left_out_later_are_sound(record):
    absurd = np.full((3, 10), 1e14)
    assert find_fault({"check": {"window": absurd, "seen": [absurd]}}) == ""
    assert find_fault({"check": {"passed_s": 1e14}}) != ""


def test_samples_that_wait_for_the_search_are_of_one_length():
    stances, rows = CausalStances(), rows_of(short_walk())[:303]
    stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    assert stances.is_sound()
    t, acc, gyr = stances._waiting[0]
    for other in ((t, acc), (t, acc[:-1], gyr), (t[:0], acc[:0], gyr[:0])):
        stances._waiting[0] = other
        assert not stances.is_sound()


@pytest.mark.parametrize("name", ["_passes", "_velocity"])
def test_each_part_of_the_search_is_of_its_kind(name):
    stances, rows = CausalStances(), rows_of(short_walk())[:300]
    stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    getattr(stances._search, name)[1] = "smoother"
    assert not stances.is_sound()


@pytest.mark.parametrize("part", ["position", "nav_R_body", "since"])
def test_the_passes_of_the_search_have_their_shapes_and_known_numbers(part):
    stances, rows = CausalStances(), rows_of(short_walk())[:300]
    stances.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    one = stances._search._passes[0]
    if part == "since":
        one._still_since_hole = np.array([-1])
    else:
        one._state = one._state._replace(**{part: np.full_like(getattr(one._state, part), np.nan)})
    assert not stances.is_sound()
    if part != "since":
        one._state = one._state._replace(**{part: np.zeros(7)})
        assert not stances.is_sound()


def test_a_walk_that_was_resumed_and_cannot_go_on_doubts_its_checkpoint(tmp_path):
    path = tmp_path / "walk"
    path.touch()
    with (
        pytest.raises(EstimationError, match=r"resumed from walk .*KeyError in record_check.py:\d+.*or this is a bug"),
        doubt_resumed(path),
    ):
        raise KeyError("x")
    for no_checkpoint in (None, tmp_path / "fresh"):
        with pytest.raises(KeyError), doubt_resumed(no_checkpoint):
            raise KeyError("x")
    with pytest.raises(FormatError), doubt_resumed(path):
        raise FormatError("as it is")


def test_an_object_without_what_its_class_gives_it_is_no_object() -> None:
    stances = CausalStances()
    content = pack(stances)
    assert vars(unpack(content)).keys() == vars(stances).keys()
    name = next(iter(vars(stances)))
    del vars(stances)[name]
    with pytest.raises(FormatError, match="no values"):
        unpack(pack(stances))
