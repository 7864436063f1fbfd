"""`fg-nav stream LEFT RIGHT --mount feet`: two files as they were recorded, and what of one sensor is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.columns.mapping import CANONICAL
from fg_nav.io import read_truth
from fg_nav.online.buffer import rows_of
from fg_nav.online.feet import BLOCK_S, HELD_S, MAX_HELD, FeetMerge
from tests.command_line import names
from tests.online.feet_walks import demo_feet


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Both feet of the demo; the right one's sensor is off from 20 s before the end on."""
    folder = tmp_path_factory.mktemp("feet")
    paths = []
    for side, until in (("left", 40.0), ("right", 34.0)):
        rows = rows_of(demo_feet().sides[side].recording)
        path = folder / f"{side}.csv"
        pd.DataFrame(rows[rows[:, 0] < until], columns=list(CANONICAL)).to_csv(path, index=False)
        paths.append(path)
    return paths[0], paths[1]


def test_lines_and_files_of_both_feet_and_of_the_person(fg_nav, sources, tmp_path) -> None:
    ran = fg_nav("stream", *sources, "--mount", "feet", "--speed", "max", "--out", tmp_path / "mine", "--no-mag")
    assert ran.code == 0
    lines = [json.loads(line) for line in ran.out.splitlines()]
    assert all({"foot", "frame", "kind"} <= set(line) for line in lines)
    assert {line["foot"] for line in lines if line["kind"] == "now"} == {"left", "right", "person"}
    assert {line.get("verdict") for line in lines if line["kind"] == "now" and line["foot"] != "person"} == {
        "trusted", "doubtful",
    }  # fmt: skip
    (state,) = [line for line in lines if line["kind"] == "foot"]
    assert (state["foot"], state["state"]) == ("right", "silent")
    assert max(line["t"] for line in lines if line["foot"] == "left") > 38.0
    of_feet = {f"{kind}_{side}.{end}" for side in ("left", "right") for kind, end in
               (("trajectory", "tum"), ("strides", "csv"), ("online", "csv"))}  # fmt: skip
    assert names(tmp_path / "mine") == {
        "trajectory.tum", "person.csv", "summary.json", "config.json", "report.html", *of_feet,
    }  # fmt: skip
    summary = json.loads((tmp_path / "mine" / "summary.json").read_text())
    assert summary["width_m"] == pytest.approx(demo_feet().step_width_m, abs=0.15)
    assert summary["left"]["strides"] > summary["right"]["strides"]
    person, left = (read_truth(tmp_path / "mine" / f"trajectory{end}.tum") for end in ("", "_left"))
    beside = np.stack([np.interp(person.t, left.t, column) for column in left.position.T], axis=1)
    assert np.linalg.norm(person.position - beside, axis=1).max() < 1.0


def test_rows_are_merged_by_their_stamps() -> None:
    """A file gives seconds at once: no foot runs ahead, and nothing is lost or changed."""
    merge, rows = FeetMerge(), np.zeros((500, 11))
    rows[:, 0] = 0.01 * np.arange(500)
    merge.put("left", rows)
    assert not list(merge.take(alone=False))
    merge.put("right", rows[:300])
    blocks = list(merge.take(alone=False))
    ends = {"left": 0.0, "right": 0.0}
    for side, block in blocks:
        ends[side] = block[-1, 0]
        assert abs(ends["left"] - ends["right"]) < 2.5 * BLOCK_S
    assert sum(len(block) for side, block in blocks if side == "left") == 300
    rest = np.concatenate([block for _, block in merge.take(alone=True)])
    np.testing.assert_array_equal(rest, rows[300:])


@pytest.mark.parametrize("apart_s", [0.0, 100.0], ids=["one clock", "clocks that differ"])
def test_after_a_burst_the_feet_wait_for_each_other_again(apart_s) -> None:
    """More rows than are held come of one foot at once; where the clocks differ, no foot waits any more."""
    merge, rows = FeetMerge(), np.zeros((MAX_HELD + 500, 11))
    rows[:, 0] = 0.01 * np.arange(len(rows))
    burst = rows[: MAX_HELD + 100]
    merge.put("left", burst + apart_s)
    assert sum(len(block) for _, block in merge.take(alone=False)) == len(burst)
    for part in np.array_split(burst, 4):
        merge.put("right", part)
        assert sum(len(block) for _, block in merge.take(alone=False)) == len(part)
    merge.put("left", rows[len(burst) :] + apart_s)
    given = sum(len(block) for _, block in merge.take(alone=False))
    assert given == (400 if apart_s > HELD_S else 0)
