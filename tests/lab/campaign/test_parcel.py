"""What a worker makes of a parcel, and what it holds for the next."""

from dataclasses import replace

import pytest

from fg_nav.io.canonical import write_canonical
from fg_nav.lab.campaign import made, parcel, sources
from fg_nav.lab.campaign.kept import Key
from fg_nav.lab.campaign.made import jobs_of
from fg_nav.lab.campaign.parcel import in_cells, unpacked
from fg_nav.lab.campaign.sources import LOOP, RAW
from fg_nav.lab.simulation import simulate
from fg_nav.plain import plain

METHODS = ("iez", "ma2018")
WALK = ("campaign", "demo", "101")


@pytest.fixture(autouse=True)
def nothing_held(monkeypatch):
    monkeypatch.setattr(parcel, "_HELD", [])


@pytest.fixture
def counted(monkeypatch):
    """Walks that are simulated or read, one after the other."""
    some = []
    for name in ("simulated", "read"):
        was = getattr(sources, name)
        monkeypatch.setattr(sources, name, lambda *what, was=was: some.append(what[0]) or was(*what))
    return some


def job(group="demo", field="smooth", magnetometers=(LOOP, RAW), methods=METHODS):
    keys = [Key(group, field, "101", magnetometer, method) for magnetometer in magnetometers for method in methods]
    [whole] = jobs_of(keys, {key: {"of": key.method} for key in keys})
    return whole


def without_times(results):
    return [plain(replace(one, runtime_s=0.0)) for one in results]


def recorded(folder, content=None):
    """A walk in a file."""
    path = folder / "walk.csv"
    if content is None:
        write_canonical(simulate("demo", 101).recording, path)
    else:
        path.write_text(content)
    return replace(job(group="walks", field="recorded", magnetometers=(RAW,)), walk="walk.csv", path=path)


def test_cells_one_by_one_are_those_of_the_whole_walk_and_it_is_simulated_once(counted):
    whole = unpacked(parcel.parcel(job(), False)).results
    assert len(whole) == 4
    assert not any(one.failed for one in whole)
    counted.clear()
    cells = [unpacked(parcel.parcel(cell, False, WALK)) for cell in in_cells(job())]
    assert without_times(one for brought in cells for one in brought.results) == without_times(whole)
    assert len(counted) == 1


def test_another_walk_is_made_ready_anew(counted):
    cell = in_cells(job(magnetometers=(RAW,)))[0]
    for walk in (WALK, (*WALK[:-1], "102"), WALK, ()):
        unpacked(parcel.parcel(cell, False, walk))
    assert len(counted) == 4


def test_files_go_once_and_the_worker_tells_if_it_has_them_not(tmp_path, counted):
    whole = recorded(tmp_path)
    cells = in_cells(whole)
    expected = unpacked(parcel.parcel(whole, True)).results
    assert not any(one.failed for one in expected)
    counted.clear()
    first, second = parcel.parcel(cells[0], True, WALK), parcel.parcel(cells[1], True, WALK, has_walk=True)
    assert first.files
    assert not second.files
    assert unpacked(second).results == ()
    (tmp_path / "walk.csv").unlink()
    came = [one for sent in (first, second) for one in unpacked(sent).results]
    assert without_times(came) == without_times(expected)
    assert len(counted) == 1


def test_a_file_that_cannot_be_read_is_not_held_but_told_in_the_same_words(tmp_path):
    cells = in_cells(recorded(tmp_path, "time_s\n1\n"))
    reasons = {unpacked(parcel.parcel(cell, True, WALK)).results[0].failed for cell in cells}
    assert reasons == {unpacked(parcel.parcel(cells[0], False)).results[0].failed}
    assert reasons.pop().startswith("walk.csv")
    assert unpacked(parcel.parcel(cells[1], True, WALK, has_walk=True)).results == ()


def test_after_a_bug_nothing_is_held_and_the_other_cells_are_made(monkeypatch, counted):
    was = made.solved

    def solved(session, method):
        if method == "iez":
            raise ZeroDivisionError("by nothing")
        return was(session, method)

    monkeypatch.setattr(made, "solved", solved)
    whole = job(magnetometers=(RAW,))
    assert [one.failed for one in unpacked(parcel.parcel(whole, False, WALK)).results] == [
        "a bug (ZeroDivisionError: by nothing)",
        "",
    ]
    assert [unpacked(parcel.parcel(cell, False, WALK)).results[0].failed for cell in in_cells(whole)][1] == ""
    assert len(counted) == 3
