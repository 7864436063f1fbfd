"""Folders of recordings: which files are walks, what their truth is, and that one is solved with it."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.errors import CampaignError
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.campaign.command import TABLES
from fg_nav.lab.campaign.execute import Task, run_task
from fg_nav.lab.campaign.walks import OUR_TABLES, find_walks
from fg_nav.lab.simulation import simulate
from fg_nav.lab.store.files import MARKERS
from fg_nav.lab.store.results import Key
from fg_nav.lab.verbs.detect import DETECT_FILES
from fg_nav.lab.verbs.simulate import SIMULATION_FILES
from fg_nav.report.folder import RESULT_FILES


def names(folder: Path, *files: str) -> dict[str, str | None]:
    """Walks found among these files, each with its truth."""
    for name in files:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return {name: walk.truth and walk.truth.name for (_, name), walk in find_walks([folder]).items()}


def test_truths_lie_beside(tmp_path):
    beside = ("a.csv", "a.tum", "b.txt", "b.truth.csv", "c.mat", "c.truth.mat", "truth.tum", "README.md", ".x.csv")
    assert names(tmp_path / "1", *beside) == {"a.csv": "a.tum", "b.txt": "b.truth.csv", "c.mat": "c.truth.mat"}
    shared = ("1/recording.csv", "1/truth.tum", "1/landmarks.csv", "2/a.csv", "2/b.csv", "2/truth.tum")
    assert names(tmp_path / "2", *shared) == {"1/recording.csv": "truth.tum", "2/a.csv": None, "2/b.csv": None}


def test_a_mat_beside_belongs_to_the_walk_and_a_changed_file_makes_other_results(tmp_path):
    assert names(tmp_path, "a.csv", "a.mat", "b.mat") == {"a.csv": None, "b.mat": None}
    walk = find_walks([tmp_path])[tmp_path.name, "a.csv"]
    assert walk.description.keys() == {"a.csv", "a.mat"}
    (tmp_path / "a.mat").write_text("other")
    after = replace(walk).description
    assert after["a.csv"] == walk.description["a.csv"]
    assert after["a.mat"] != walk.description["a.mat"]


def test_what_our_commands_write_is_no_walk(tmp_path):
    """A campaign may write beside its recordings, and finds the same walks the next time."""
    ours = RESULT_FILES | SIMULATION_FILES | DETECT_FILES | set(TABLES)
    assert {name for name in ours if name.endswith(".csv")} - {"recording.csv"} == set(OUR_TABLES)
    alone = names(tmp_path, "1/recording.csv", "1/truth.tum")
    for mark in MARKERS:
        names(tmp_path, f"out{mark}/results.csv", f"out{mark}/table.csv", f"out{mark}/cells/a.csv", f"out{mark}/{mark}")
    assert names(tmp_path, "copied/results.csv") == alone == {"1/recording.csv": "truth.tum"}
    with pytest.raises(CampaignError, match="holds no recordings"):
        find_walks([tmp_path / f"out{MARKERS[0]}"])


@pytest.mark.skipif(sys.platform == "darwin", reason="has no such names")
def test_a_name_that_is_no_text_is_refused(tmp_path):
    (tmp_path / os.fsdecode(b"w\xff.csv")).write_text("x")
    with pytest.raises(CampaignError, match=r"w\\udcff.csv' is not UTF-8: rename it"):
        find_walks([tmp_path])


def test_a_recording_is_solved_with_its_truth(tmp_path):
    recording = simulate("demo", 101).recording
    write_canonical(recording, tmp_path / "walk.csv")
    write_tum(tmp_path / "walk.tum", recording.truth.t, recording.truth.position, recording.truth.nav_R_body)
    [((_, name), found)] = find_walks([tmp_path]).items()
    [result] = run_task(Task(found, {Key("walks", "recorded", name, "raw", "iez"): {}}))
    assert result.errors["origin"].rmse_m < 80.0  # the heading at the start is not known
    assert result.errors["yaw"].rmse_m < 1.0
