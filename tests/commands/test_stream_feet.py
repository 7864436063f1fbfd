"""`fg-nav stream LEFT RIGHT --mount feet`: two files as they were recorded, in the order of their stamps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.columns.mapping import CANONICAL
from fg_nav.feet import SIDES
from fg_nav.io import read_truth
from fg_nav.online.buffer import rows_of
from fg_nav.online.feet import BLOCK_S, HELD_S, MAX_HELD, FeetMerge
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.sources import SampleSource
from fg_nav.view.outlets import Outlets
from tests.command_line import names
from tests.commands.folders import summary
from tests.online.feet_walks import demo_feet, heads_known


@pytest.mark.usefixtures("solved_here")
def test_lines_and_files_of_both_feet_and_of_the_person(fg_nav) -> None:
    """The right one's sensor is off from 6 s before the end on."""
    for side, until in (("left", 26.0), ("right", 20.0)):
        rows = rows_of(demo_feet().sides[side].recording)
        pd.DataFrame(rows[rows[:, 0] < until], columns=list(CANONICAL)).to_csv(f"{side}.csv", index=False)
    words = ("--mount", "feet", "--speed", "max", "--out", "mine", "--no-mag")
    ran = fg_nav("stream", "left.csv", "right.csv", *words)
    assert ran.code == 0
    lines = [json.loads(line) for line in ran.out.splitlines()]
    assert all({"foot", "frame", "kind"} <= set(line) for line in lines)
    now = [line for line in lines if line["kind"] == "now"]
    assert {line["foot"] for line in now} == {"left", "right", "person"}
    assert {line.get("verdict") for line in now if line["foot"] != "person"} == {"trusted", "doubtful"}
    (state,) = [line for line in lines if line["kind"] == "foot"]
    assert (state["foot"], state["state"]) == ("right", "silent")
    assert max(line["t"] for line in lines if line["foot"] == "left") > 24.0
    kinds = ("trajectory_{}.tum", "strides_{}.csv", "online_{}.csv")
    of_feet = {kind.format(side) for side in SIDES for kind in kinds}
    assert names(Path("mine")) == {
        *("trajectory.tum", "person.csv", "summary.json", "config.json", "report.html"), *of_feet,
    }  # fmt: skip
    said = summary("mine")
    assert said["width_m"] == pytest.approx(demo_feet().step_width_m, abs=0.15)
    assert said["left"]["strides"] > said["right"]["strides"]
    person, left = (read_truth(Path(f"mine/trajectory{end}.tum")) for end in ("", "_left"))
    beside = np.stack([np.interp(person.t, left.t, column) for column in left.position.T], axis=1)
    assert np.linalg.norm(person.position - beside, axis=1).max() < 1.0


class Parts(SampleSource):
    """Rows in parts of any length; `came` is the newest stamp of each source that was read, after each read."""

    def __init__(self, side, rows, seconds, came) -> None:
        self.name, self._side, self._came = side, side, came
        edges = np.searchsorted(rows[:, 0], np.arange(seconds, rows[-1, 0], seconds))
        self._parts = [part for part in np.split(rows, edges) if len(part)]

    async def read(self):
        part = self._parts.pop(0) if self._parts else None
        newest = dict(self._came[-1]) if self._came else dict.fromkeys(SIDES, 0.0)
        self._came.append(newest | ({} if part is None else {self._side: float(part[-1, 0])}))
        return part


@pytest.mark.parametrize("seconds", [(0.1, 0.7), (0.7, 0.1)])
def test_the_source_of_the_foot_that_is_behind_is_read_first(seconds) -> None:
    came, lines = [], []
    sensors = {}
    for side, each in zip(SIDES, seconds, strict=True):
        rows = rows_of(demo_feet().sides[side].recording)
        source = Parts(side, rows[rows[:, 0] < 11.0], each, came)
        sensors[side] = Sensor(source, StreamOptions(online=heads_known()))
    follow(sensors, Outlets(lines.append, None, lines.append))
    ahead = [max(one.values()) - min(one.values()) for one in came if max(one.values()) < 10.0]
    assert len(ahead) > 100
    assert max(ahead) < 0.75
    assert {json.loads(line)["foot"] for line in lines if '"now"' in line} >= set(SIDES)


def test_rows_are_merged_by_their_stamps() -> None:
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

    def take() -> int:
        return sum(len(block) for _, block in merge.take(alone=False))

    merge, rows = FeetMerge(), np.zeros((MAX_HELD + 500, 11))
    rows[:, 0] = 0.01 * np.arange(len(rows))
    burst = rows[: MAX_HELD + 100]
    merge.put("left", burst + apart_s)
    assert take() == len(burst)
    for part in np.array_split(burst, 4):
        merge.put("right", part)
        assert take() == len(part)
    merge.put("left", rows[len(burst) :] + apart_s)
    assert take() == (400 if apart_s > HELD_S else 0)
