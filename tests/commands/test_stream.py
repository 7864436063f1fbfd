"""`fg-nav stream`: whatever happens to the stream, the walk of one foot or of both goes on, and its end is written."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import signal
import sys
import threading
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.calibration import MagnetometerCalibration
from fg_nav.calibration.inertial import AccelerometerCalibration
from fg_nav.calibration.of_recording import Calibration
from fg_nav.columns.mapping import CANONICAL
from fg_nav.commands import stream
from fg_nav.commands.shared import Target
from fg_nav.commands.stream import End, LinePrinter, save_end
from fg_nav.errors import OutputError
from fg_nav.feet import SIDES
from fg_nav.frames import compute_heading
from fg_nav.io import read_truth
from fg_nav.magnetic.axes import MagAxes
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.online.feet import BLOCK_S, HELD_S, MAX_HELD, FeetMerge
from fg_nav.online.follow import FollowedWalk, Sensor, StreamOptions, describe_walk, follow
from fg_nav.online.rows import RowReader, parse_columns
from fg_nav.online.sources import SampleSource, TextSource, open_source
from fg_nav.recording import NOMINAL_SIGMA
from fg_nav.report.files import summarize_lagged, write_footfalls, write_lagged
from fg_nav.view.outlets import Outlets
from tests.command_line import names
from tests.commands.folders import strides, summary
from tests.commands.recordings import recorded
from tests.feet.walks import demo_feet
from tests.online.feet_walks import heads_known
from tests.online.walks import NORTH, push, short_walk, whole_walk, worst_difference


@pytest.fixture(autouse=True)
def waits_for_solutions(monkeypatch):
    """However slow the machine is."""
    monkeypatch.setattr("fg_nav.online.smoother.FAST", 0.0)


@pytest.fixture
def csv() -> Path:
    return recorded("short")


class Pieces(TextSource):
    """A source of pieces that were put together before, at the end of which it ends; what was said of it."""

    def __init__(self, *pieces: bytes, silent: int = 0) -> None:
        """`silent` reads of 10 ms find nothing before the last piece."""
        self.said: list[str] = []
        super().__init__(RowReader("a test", self.said.append))
        self._pieces, self._silent = list(pieces), silent

    async def _read_bytes(self) -> bytes | None:
        if len(self._pieces) == 1 and self._silent:
            self._silent -= 1
            await asyncio.sleep(0.01)
            return b""
        return self._pieces.pop(0) if self._pieces else None


def followed(source, emit=lambda line: None, **options):
    lines, remarks = [], source.said if isinstance(source, Pieces) else []

    def print_line(line: str) -> None:
        lines.append(json.loads(line))
        emit(line)

    sensor = Sensor(source, StreamOptions(online=NORTH, **options))
    walk = follow({None: sensor}, Outlets(print_line, None, remarks.append))
    return walk.navigators[None], lines, remarks


def cut(data: bytes, n: int) -> list[bytes]:
    edges = np.sort(np.random.default_rng(n).integers(0, len(data), n)).tolist()
    return [data[a:b] for a, b in zip([0, *edges], [*edges, len(data)], strict=True)]


def test_a_line_for_each_footfall(csv):
    navigator, lines, remarks = followed(Pieces(*cut(csv.read_bytes(), 50)))
    whole = whole_walk()[0]
    table = whole.causal()
    assert worst_difference(navigator.causal(), table) < 1e-9
    assert {line["kind"] for line in lines} == {"now", "revised"}
    # the end is solved once more
    assert np.allclose(np.array(lines[-1]["path"])[:, 1:], whole.smoothed().position, atol=1e-3)
    lines = [line for line in lines if line["kind"] == "now"]
    assert [line["stance"] for line in lines] == list(range(len(table)))
    for name, column in (
        ("position_m", table.position),
        ("gyro_bias_deg_s", np.degrees(table.gyro_bias)),
        ("heading_sigma_deg", np.degrees(table.heading_sigma)),
    ):
        assert np.allclose([line[name] for line in lines], column, atol=1e-6), name
    assert remarks == []


def test_a_stalled_source_is_told_and_waited_for(csv):
    data, whole = csv.read_bytes(), whole_walk()[0]
    middle = data.index(b"\n", len(data) // 2) + 5
    navigator, _, remarks = followed(Pieces(data[:middle], data[middle:], silent=20), stalled_s=0.1)
    assert worst_difference(navigator.causal(), whole.causal()) < 1e-9
    assert len(remarks) == 2
    assert "no sample has come from a test" in remarks[0]
    assert "again" in remarks[1]
    over, _, _ = followed(Pieces(data[:middle], data[middle:], silent=10**6), until_silent_s=0.1)
    assert 0 < len(over.footfalls) < len(whole.footfalls)


def test_samples_are_corrected_as_those_of_a_recording_and_counted_stamps_have_the_doubt_of_their_rate(csv):
    accelerometer = AccelerometerCalibration(1.01, 1e-4, np.array([0.1, 0.0, -0.1]), np.ones(3), 9.81, 6, 60.0, True)
    soft = np.diag([1.1, 0.9, 1.0])
    magnetometer = MagnetometerCalibration("loop", np.array([3.0, -2.0, 1.0]), soft, 0.01 * np.eye(9), 48.0, 1.0, 1000)
    given, axes = Calibration("x", magnetometer=magnetometer, accelerometer=accelerometer), MagAxes.parse("y,-x,z")
    navigator, _, _ = followed(Pieces(csv.read_bytes()), calibration=given, mag_axes=axes)
    rows, sent = navigator.buffer.between(0, len(short_walk())), short_walk()
    np.testing.assert_allclose(rows[:, 1:4], accelerometer.correct(sent.acc), atol=1e-9)
    np.testing.assert_allclose(rows[:, 7:10], magnetometer.correct(sent.mag @ axes.P.T), atol=1e-9)
    # As by a share of the rate of what was walked: force is integrated twice.
    body = b"".join(csv.read_bytes().splitlines(keepends=True)[1:])
    counted = parse_columns("-,ax,ay,az,gx,gy,gz,mx,my,mz", None, 100.0)
    _, lines, _ = followed(Pieces(body), columns=counted)
    line, plain = [one for one in lines if one["kind"] == "now"][-1], whole_walk()[0].causal()
    np.testing.assert_allclose(line["position_m"], plain.position[-1], atol=1e-5)
    expected = np.hypot(plain.position_sigma[-1], 2.0 * NOMINAL_SIGMA * np.abs(plain.position[-1]))
    np.testing.assert_allclose(line["position_sigma_m"], expected, rtol=1e-3)


def test_the_state_between_footfalls_is_that_of_the_newest_sample():
    navigator = whole_walk()[0]
    pose, told = navigator.pose(), describe_walk([navigator])
    assert told["t"] == round(navigator.buffer.newest_s, 6) == round(float(short_walk().t[-1]), 6)
    np.testing.assert_allclose(told["position_m"], pose.position[-1], atol=1e-5)
    assert (told["standing"], told["floor"], told["returns"]) == (True, navigator.floor, [])
    assert 0.0 <= told["heading_deg"] < 360.0
    heading = np.degrees(compute_heading(pose.nav_R_body[-1]))
    assert abs((told["heading_deg"] - heading + 180.0) % 360.0 - 180.0) < 1e-3
    swinging = OnlineNavigator(NORTH)
    push(swinging, rows_of(short_walk())[:640])
    both = describe_walk([navigator, swinging])
    assert (both["t"], both["standing"], both["position_m"], both["heading_deg"]) == (
        told["t"],
        swinging.stands,
        None,
        None,
    )
    begun = describe_walk([OnlineNavigator(NORTH)])
    assert (begun["t"], begun["position_m"]) == (None, None)


def test_a_growing_file_is_followed(csv, tmp_path):
    data, path = csv.read_bytes(), tmp_path / "growing.csv"
    path.write_bytes(data[: len(data) // 3])
    pieces = cut(data[len(data) // 3 :], 5)

    def grow(line: str) -> None:
        if pieces and '"now"' in line:
            with path.open("ab") as file:
                file.write(pieces.pop(0))

    with closing(open_source(str(path), None, 115200, print)) as source:
        navigator, _, _ = followed(source, grow, until_silent_s=0.3)
    assert pieces == []
    assert worst_difference(navigator.causal(), whole_walk()[0].causal()) < 1e-9


@pytest.mark.usefixtures("solved_here")
def test_rows_without_a_header_are_walked_by_their_columns(fg_nav, csv, tmp_path):
    path = tmp_path / "rows.csv"
    path.write_bytes(b"".join(csv.read_bytes().splitlines(keepends=True)[1:]))
    given = ("--heading", 0, "--silence", 0.3)
    words = ("stream", path, *given, "--record", tmp_path / "x.csv", "--resume", "--columns")
    ran = fg_nav(*words, "t,ax,ay,az,gx,gy,gz,mx,my,mz"), fg_nav("stream", csv, *given)
    told = [[line for line in one.out.splitlines() if '"now"' in line] for one in ran]
    assert told[0] == told[1]
    assert len(told[0]) > 5
    assert fg_nav(*words, "t,ay,ax,az,gx,gy,gz,mx,my,mz").refused("--columns", "x.csv")
    (tmp_path / "y.csv").write_text("something else")
    assert fg_nav("stream", csv, "--record", tmp_path / "y.csv", "--resume").refused("not recorded by")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_walk_and_not_its_result(fg_nav, csv, tmp_path, monkeypatch, request, number):
    if number != signal.SIGINT:  # that with its process beside
        request.getfixturevalue("solved_here")
    pipe, printed, ended = tmp_path / "pipe", threading.Semaphore(0), threading.Event()
    os.mkfifo(pipe)

    class Noted(LinePrinter):
        def __call__(self, line: str) -> None:
            super().__call__(line)
            if '"now"' in line:
                printed.release()

    monkeypatch.setattr(stream, "LinePrinter", Noted)

    def write() -> None:
        with pipe.open("wb") as file:
            file.write(csv.read_bytes())
            file.flush()
            for _ in range(8):
                printed.acquire(timeout=60.0)
            os.kill(os.getpid(), number)
            ended.wait(60.0)

    writer = threading.Thread(target=write)
    writer.start()
    ran = fg_nav("stream", pipe, "--heading", 0)
    ended.set()
    writer.join()
    assert (ran.code, ran.err) == (0, "")
    kinds = [json.loads(line)["kind"] for line in ran.out.splitlines()]
    assert "revised" not in kinds[kinds.index("smoothed") :]
    told = [kind for kind in kinds if kind != "revised"]
    assert told == sorted(told)
    assert kinds.count("smoothed") >= 5


@pytest.mark.usefixtures("solved_here")
def test_with_a_lag_the_footfalls_are_written(fg_nav, csv, tmp_path):
    out = tmp_path / "out"
    ran = fg_nav("stream", csv, "--heading", 0, "--lag", 10, "--speed", "max", "--out", out, "--json").succeeded()
    assert json.loads(ran.out) == {"source": str(csv), "folder": str(out), **summary(out)}
    assert names(out) == {"trajectory.tum", "strides.csv", "online.csv", "summary.json", "report.html"}
    assert len(np.loadtxt(out / "trajectory.tum")) == len(strides(out)) == len(strides(out, "online.csv")) == 13
    ends = [strides(out, name)["y_m"].iloc[-1] for name in ("strides.csv", "online.csv")]
    assert abs(ends[0] - ends[1]) < 0.2


# --- where the disk is full, or nobody reads -------------------------------------------------------------------------


@pytest.fixture
def end():
    solution = whole_walk()[0].finish()
    said = summarize_lagged(solution)
    least = partial(write_footfalls, solution=solution, summary=said)
    return End(said, lambda: [], partial(write_lagged, solution=solution), least)


def fail(folder: Path, **given: object) -> None:
    """Write into a folder on a full disk."""
    raise OSError(errno.ENOSPC, "No space left on device")


def save(end, out) -> OutputError | None:
    with Target(out, False, "stream") as target:
        return save_end(end, target, "none")


def test_on_a_full_disk_the_footfalls_are_saved_where_there_is_room_and_it_says_where(end, tmp_path, monkeypatch):
    assert save(end, tmp_path / "room") is None
    assert names(tmp_path / "room") == {"online.csv", "strides.csv", "summary.json", "trajectory.tum"}
    monkeypatch.setattr(stream.tempfile, "tempdir", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    out, end = tmp_path / "out", replace(end, write=fail)
    failure = str(save(end, out))
    assert failure.startswith(f"{out} cannot be written (no space left on device)")
    assert failure.endswith(f"the footfalls alone are in {out}.")
    assert len(strides(out)) == len(whole_walk()[0].finish().stances)
    assert names(out) == {"strides.csv", "summary.json"}
    # No room for them either: among the temporary files.
    with monkeypatch.context() as patched, Target(tmp_path / "other", False, "stream") as target:
        patched.setattr(Target, "open", lambda self: stream.result_folder(Path(os.devnull) / "none"))
        words = str(save_end(end, target, "none"))
    (place,) = (tmp_path / "tmp").glob("fg-nav-stream-*/result")
    assert words.endswith(f"the footfalls alone are in {place}.")
    with pytest.raises(OutputError, match="the result of the walk is lost"):
        save(replace(end, write_least=fail), tmp_path / "none")


def test_lines_that_cannot_be_written_do_not_end_the_walk(monkeypatch, caplog):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        printer = LinePrinter()
        printer("{}")
        printer("{}")
        monkeypatch.undo()
    assert printer.has_failed
    (said,) = caplog.messages
    assert "the lines cannot be written any more (no space left on device)" in said


def test_a_walk_whose_lines_were_lost_is_written_into_a_fresh_folder(end, fg_nav, monkeypatch):
    monkeypatch.setattr(stream, "run_stream", lambda request, outlets: FollowedWalk({}, {}, None))
    monkeypatch.setattr(stream, "find_end", lambda walk, polish: replace(end, format_lines=lambda: ["{}"]))
    monkeypatch.setattr(stream.typer, "echo", lambda line: (_ for _ in ()).throw(BrokenPipeError))
    monkeypatch.setattr(stream.os, "dup2", lambda *descriptors: None)
    monkeypatch.setattr(sys.stdout, "fileno", lambda: 1, raising=False)
    ran = fg_nav("stream", "walk.csv", "--plots", "none")
    assert (ran.code, ran.out) == (0, "")
    assert "no reader any more" in ran.err
    assert summary("results/stream-1")["strides"] >= 5


@pytest.mark.usefixtures("solved_here")
def test_lines_and_files_of_both_feet_and_of_the_person(fg_nav) -> None:
    """The right one's sensor is off from 6 s before the end on."""
    for side, until in (("left", 26.0), ("right", 20.0)):
        rows = rows_of(demo_feet().sides[side].recording)
        pd.DataFrame(rows[rows[:, 0] < until], columns=list(CANONICAL)).to_csv(f"{side}.csv", index=False)
    words = ("--mount", "feet", "--speed", "max", "--out", "mine", "--no-mag")
    ran = fg_nav("stream", "left.csv", "right.csv", *words).succeeded()
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
        *("trajectory.tum", "person.csv", "gait.csv", "summary.json", "config.json", "report.html"), *of_feet,
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
