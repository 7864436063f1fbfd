"""Folders of recordings: which files are walks, what their truth is, and that a bad one is a result."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import CampaignError
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.campaign.execute import run_task, tasks_of
from fg_nav.lab.campaign.folder import TABLES
from fg_nav.lab.campaign.walks import OUR_TABLES, Recorded, find_walks, pack
from fg_nav.lab.simulation import simulate
from fg_nav.lab.store.files import MARKERS
from fg_nav.lab.verbs.detect import DETECT_FILES
from fg_nav.lab.verbs.simulate import SIMULATION_FILES
from fg_nav.report.folder import RESULT_FILES
from tests.lab.campaign import fakes


def names(folder: Path, *files: str) -> dict[str, str | None]:
    """Walks found among these files, each with its truth."""
    for name in files:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return {walk.name: walk.source.truth and walk.source.truth.name for walk in find_walks([folder])}


def test_truths_lie_beside(tmp_path):
    assert names(
        tmp_path, "a.csv", "a.tum", "b.txt", "b.truth.csv", "c.mat", "c.truth.mat", "truth.tum", "README.md", ".x.csv"
    ) == {"a.csv": "a.tum", "b.txt": "b.truth.csv", "c.mat": "c.truth.mat"}


def test_a_walk_alone_in_its_folder_has_the_truth_there(tmp_path):
    found = names(tmp_path, "1/recording.csv", "1/truth.tum", "1/landmarks.csv", "2/a.csv", "2/b.csv", "2/truth.tum")
    assert found == {"1/recording.csv": "truth.tum", "2/a.csv": None, "2/b.csv": None}


def test_a_mat_beside_belongs_to_the_walk(tmp_path):
    assert names(tmp_path, "a.csv", "a.mat", "b.mat") == {"a.csv": None, "b.mat": None}
    [walk, _] = find_walks([tmp_path])
    before = walk.sums()
    assert before.keys() == {"a.csv", "a.mat"}
    (tmp_path / "a.mat").write_text("other")
    assert walk.sums()["a.csv"] == before["a.csv"]
    assert walk.sums()["a.mat"] != before["a.mat"]


def test_our_own_tables_are_no_walks():
    ours = RESULT_FILES | SIMULATION_FILES | DETECT_FILES
    ours |= set(TABLES)
    assert {name for name in ours if name.endswith(".csv")} - {"recording.csv"} == set(OUR_TABLES)


def test_folders_that_our_commands_fill_have_no_walks(tmp_path):
    """A campaign may write beside its recordings, and finds the same walks the next time."""
    alone = names(tmp_path, "1/recording.csv", "1/truth.tum")
    for mark in MARKERS:
        names(tmp_path, f"out{mark}/results.csv", f"out{mark}/table.csv", f"out{mark}/cells/a.csv", f"out{mark}/{mark}")
    assert names(tmp_path, "copied/results.csv") == alone == {"1/recording.csv": "truth.tum"}
    with pytest.raises(CampaignError, match="holds no recordings"):
        find_walks([tmp_path / f"out{MARKERS[0]}"])


@pytest.mark.skipif(sys.platform == "darwin", reason="has no such names")
def test_a_name_that_is_no_text_is_told(tmp_path):
    (tmp_path / os.fsdecode(b"w\xff.csv")).write_text("x")
    with pytest.raises(CampaignError, match=r"w\\udcff.csv' is not UTF-8: rename it"):
        find_walks([tmp_path])


@pytest.mark.parametrize("far", [False, True], ids=["here", "as bytes"])
def test_a_recording_is_solved_with_its_truth_and_a_bad_one_is_told(tmp_path, far):
    walk = simulate("demo", 101)
    truth = walk.recording.truth
    write_canonical(walk.recording, tmp_path / "good.csv")
    write_tum(tmp_path / "good.tum", truth.t, truth.position, truth.nav_R_body)
    (tmp_path / "bad.csv").write_text("no,recording\n1,2\n")
    by_name = {}
    for one in find_walks([tmp_path]):
        source = pack(one.source) if far else one.source
        assert bool(source.contents) == far
        if far:
            source = replace(source, path=Path("/elsewhere") / source.path.name)
        [by_name[one.name]] = run_task(replace(fakes.task(one.group, one.name), source=source)).results
    assert by_name["good.csv"].errors["origin"].rmse_m < 80.0
    assert by_name["good.csv"].errors["yaw"].rmse_m < 1.0
    assert "bad.csv" in by_name["bad.csv"].failed
    assert "fg-nav-" not in by_name["bad.csv"].failed
    gone = Recorded(tmp_path / "gone.csv")
    missing = run_task(replace(fakes.task("walks", "gone"), source=pack(gone) if far else gone)).results[0]
    assert "gone.csv" in missing.failed


def test_a_task_is_split_into_its_results():
    keys = [replace(key, magnetometer=m) for m in ("loop", "raw") for key in fakes.task("demo", "1", "iez", "qsf").keys]
    [task] = tasks_of(keys, {key: {"of": key.method} for key in keys})
    cells = task.split()
    assert [one.keys for one in cells] == [[key] for key in keys]
    assert np.all(
        [one.missing[key.magnetometer][key.method] == {"of": key.method} for one, key in zip(cells, keys, strict=True)]
    )
