"""A walk that is killed anywhere goes on from its record, which has all that could be read, to the last bit."""

import asyncio
import errno
import json
import os
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.calibration.inertial import AccelerometerCalibration
from fg_nav.calibration.of_recording import Calibration
from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import EstimationError, FormatError, OutputError, StreamError
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.io import read_raw, write_canonical
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online import OnlineNavigator, record
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.record import GivenLines, Record
from fg_nav.online.rows import RowReader
from fg_nav.online.sources import Replay, TextSource
from fg_nav.samples.delivery import WINDOW
from fg_nav.view.outlets import Outlets
from tests.online.walks import NORTH, push, revisions_of, short_walk, solve_in_windows, whole_walk

BLOCK = 4000  # bytes, a quarter of a second: lines come between
FOOT = StreamOptions(online=NORTH)


class Killed(BaseException):
    """The end of a process, whatever it was about to do."""


class Sent(TextSource):
    """The rows of a file in blocks, from a byte on."""

    def __init__(self, data: bytes, begin: int = 0) -> None:
        self._data, self._place = data, begin
        super().__init__(RowReader("a test", lambda words: None))

    async def _read_bytes(self) -> bytes | None:
        piece = self._data[self._place : self._place + BLOCK]
        self._place += len(piece)
        return piece or None


def walk_on(path: Path, source: Sent, options: StreamOptions = FOOT, remarks=None, lines=None):
    """Follow a source to its end, and on with its record; the navigator, and the lines it gave."""
    given, said = [] if lines is None else lines, [] if remarks is None else remarks
    with closing(Record(path, True, False, said.append)) as recording:
        walk = follow({None: Sensor(source, options, recording)}, Outlets(given.append, None, said.append))
    return walk.navigators[None], [json.loads(line) for line in given]


def die_at(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Let the process be killed behind so many bytes that it writes into its record, in the middle of a line or not."""
    left, write = [count], record._AppendedFile._write

    def write_some(self: record._AppendedFile, data: bytes) -> None:
        if len(data) > left[0]:
            write(self, data[: left[0]])
            left[0] = 0
            raise Killed
        left[0] -= len(data)
        write(self, data)

    monkeypatch.setattr(record._AppendedFile, "_write", write_some)
    monkeypatch.setattr(record._AppendedFile, "close", lambda self: os.close(self._file) or 0)


def measure_end(one, other) -> float:
    """Largest difference of what two navigators have smoothed of the same footfalls, in their sigmas."""
    one, other = one.smoothed(), other.smoothed()
    np.testing.assert_array_equal(one.sample, other.sample)
    positions = np.abs(one.position - other.position) / np.maximum(other.position_sigma, 1e-3)
    headings = wrap_angle(compute_heading(one.nav_R_body) - compute_heading(other.nav_R_body)) / other.heading_sigma
    return float(max(positions.max(), np.abs(headings).max()))


def check_lines(lines, whole) -> None:
    """Each line was given once, in order; what was not taken back are the footfalls of the whole walk."""
    now = [line for line in lines if line["kind"] == "now"]
    assert [line["stance"] for line in now] == list(range(len(now)))
    taken_back = [line["stance"] for line in lines if line["kind"] == "retracted"]
    assert len(set(taken_back)) == len(taken_back)
    kept = [line["t"] for line in now if line["stance"] not in taken_back]
    gone = {line["stance"] for line in whole if line["kind"] == "retracted"}
    expected = [line["t"] for line in whole if line["kind"] == "now" and line["stance"] not in gone]
    assert kept == pytest.approx(expected, abs=1e-6)
    assert kept == sorted(kept)


def walk_killed(path, monkeypatch, data, options, kills, goes_on):
    """Walk, killed so often at random bytes; the navigator that came to the end, and the lines of all processes."""
    rng, lines, begin, deaths, navigator = np.random.default_rng(7), [], 0, 0, None
    for _ in range(kills + 1):
        with monkeypatch.context() as dying:
            if deaths < kills:
                die_at(dying, int(rng.integers(1, len(data) // kills)))
            try:
                navigator, _ = walk_on(path, Sent(data, begin), options, lines=lines)
            except Killed:
                deaths += 1
        if goes_on and path.exists():
            # As a sensor does whose rows wait until they are read: from the first row that is not recorded.
            whole = path.read_bytes().rpartition(b"\n")[0].count(b"\n") + 1
            begin = len(b"".join(data.splitlines(keepends=True)[:whole])) if whole > 1 else 0
    assert deaths == kills
    return navigator, [json.loads(line) for line in lines]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("resume") / "walk.csv"
    write_canonical(short_walk(), path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def whole(data, tmp_path_factory):
    """Record, navigator and lines of the walk that is not killed."""
    path = tmp_path_factory.mktemp("whole") / "whole.csv"
    return path, *walk_on(path, Sent(data))


@pytest.mark.parametrize("goes_on", [False, True], ids=["the source begins again", "the source goes on"])
def test_killed_at_ten_bytes_no_line_is_lost_or_given_twice(data, whole, tmp_path, monkeypatch, goes_on):
    path = tmp_path / "record.csv"
    navigator, given = walk_killed(path, monkeypatch, data, FOOT, 10, goes_on)
    check_lines(given, whole[2])
    assert measure_end(navigator, whole[1]) < 0.1
    # The record is what a walk that is not killed leaves.
    assert path.read_bytes() == whole[0].read_bytes()
    recorded = (tmp_path / "record.csv.lines").read_text().splitlines()
    known = [line for lines in recorded for line in json.loads(lines) if line["kind"] not in ("walk", "header")]
    assert known == given
    assert len(navigator.causal()) == len([line for line in given if line["kind"] == "now"])


@pytest.mark.parametrize("kind", ["windows", "lag", "pocket"])
def test_a_walk_of_another_kind_goes_on(data, tmp_path, monkeypatch, kind):
    solve_in_windows(monkeypatch, 8, 4)
    online = OnlineOptions(heading_rad=0.0, lag_s=10.0 if kind == "lag" else None)
    if kind == "pocket":
        recording = simulate("demo", 103, Choices(worn="pocket", rate_hz=100.0)).recording.slice(0, 2500)
        write_canonical(recording, tmp_path / "walk.csv")
        data, online = (tmp_path / "walk.csv").read_bytes(), OnlineOptions(heading_rad=None, mount="pocket")
    options = StreamOptions(online=online)
    expected, lines = walk_on(tmp_path / "whole.csv", Sent(data), options)
    path = tmp_path / "record.csv"
    navigator, given = walk_killed(path, monkeypatch, data, options, 3, goes_on=kind == "pocket")
    check_lines(given, lines)
    assert len(navigator.finish().stances) == len(expected.finish().stances)
    # on a foot it was solved as a whole, and the other was not
    assert measure_end(navigator, expected) < (1.0 if kind != "pocket" else 1e-9)


def test_a_walk_that_ended_goes_on_and_takes_its_last_line_back(data, whole, tmp_path):
    rows, path, remarks = data.splitlines(keepends=True), tmp_path / "record.csv", list[str]()
    middle = next(k for k, row in enumerate(rows[1:], 1) if float(row.split(b",")[0]) > whole[2][-3]["t"] - 4.0)
    _, first = walk_on(path, Sent(b"".join(rows[:middle])))
    navigator, then = walk_on(path, Sent(data), remarks=remarks)
    check_lines([*first, *then], whole[2])
    assert measure_end(navigator, whole[1]) < 0.1
    for words in ("resumed from record.csv", f"{middle - 1} samples up to the last one"):
        assert sum(words in said for said in remarks) == 1


@pytest.mark.parametrize("known", [set(), {5}], ids=["not known yet", "taken back before"])
def test_a_line_whose_footfall_is_none_any_more_is_taken_back_once(known):
    """It was in the middle of a swing, and its walk was killed before that was seen."""
    true = whole_walk()[1][:10]
    false = replace(true[5], t=0.5 * (true[4].t + true[5].t))
    lines = [replace(one, number=k) for k, one in enumerate([*true[:5], false, *true[5:]])]
    navigator, n = OnlineNavigator(NORTH), len(lines)
    navigator.resume(GivenLines(list(lines), lines, [False] * n, [0.0] * n, known))
    (revision, *_) = revisions_of(push(navigator, rows_of(short_walk())))
    assert revision.retracted == (() if known else ((5, false.t),))
    assert [one.line for one in navigator.smoother.footfalls][:10] == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]


def test_what_is_said_and_counted_is_of_the_whole_walk(tmp_path):
    """What was lost before an interruption counts on, and is not said again; also at both sides of a full window."""
    rows = np.delete(rows_of(short_walk()), np.r_[WINDOW, WINDOW + 2, 300:1300:50], axis=0)
    texts = ["".join(f"{','.join(map(repr, row[:10].tolist()))}\n" for row in part) for part in (rows[:900], rows)]
    names, said = ",".join(CANONICAL[:10]) + "\n", list[str]()
    for text in texts:
        navigator, _ = walk_on(tmp_path / "r.csv", Sent((names + text).encode()), remarks=said)
    assert navigator.lost == {"samples": 22, "came": len(rows), "datagrams": 0}
    assert any(f"22 samples of {len(rows) + 22}" in words for words in said)
    assert sum("samples are lost on the way" in words for words in said) == 1


def test_what_cannot_go_on_is_refused_in_a_sentence(data, tmp_path):
    path, half, nothing = tmp_path / "record.csv", data[: len(data) // 3], np.zeros(3)
    walk_on(path, Sent(half))
    scale = AccelerometerCalibration(1.001, 1e-4, nothing, nothing, 9.81, 6, 60.0, separable=True)
    lines, samples = tmp_path / "record.csv.lines", path.read_text()
    text = lines.read_text()

    def refuses(error: type[Exception], words: str, options: StreamOptions = FOOT) -> None:
        with pytest.raises(error, match=words):
            walk_on(path, Sent(half), options)

    for other, words in (
        (StreamOptions(online=NORTH, calibration=Calibration("x", accelerometer=scale)), "another calibration"),
        (StreamOptions(online=OnlineOptions(heading_rad=1.0)), "other options"),
        (StreamOptions(online=OnlineOptions(heading_rad=None, mount="pocket")), "other options"),
    ):
        refuses(EstimationError, f"record.csv was recorded with {words}: resume it with the same", other)
    lines.write_text(text.replace('"version": "', '"version": "9'))
    refuses(EstimationError, "another version of fg-nav")
    for damaged in ("", "a letter\n", text.replace('"stance": 3', '"stance": 4'), text.replace('"t"', '"u"'), "3\n"):
        lines.write_text(damaged)
        refuses(FormatError, "is damaged or not there")
    lines.write_text(text)
    path.write_text("a letter\nto my mother\n")
    refuses(FormatError, "not recorded by")
    with pytest.raises(OutputError, match="--resume"):
        Record(path, False, False, print)
    path.unlink()  # its lines cannot go on, and none of them is overwritten
    refuses(FormatError, "is there, and the samples of its walk are not")
    assert lines.read_text() == text
    # A walk that is stopped while it is replayed can be resumed again.
    path.write_text(samples)
    stop, given = threading.Event(), list[str]()
    stop.set()
    with closing(Record(path, True, False, print)) as recording:
        sensor, outlets = Sensor(Sent(half), FOOT, recording), Outlets(given.append, None, print)
        with pytest.raises(StreamError, match="not replayed to its end: --resume goes on"):
            follow({None: sensor}, outlets, stop)
    assert (path.read_text(), given) == (samples, [])


# --- the record ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rows():
    odd = rows_of(short_walk()).copy()
    odd[100:110, 2] = np.nan
    odd[200:300, 7:10] = np.nan
    odd[400, 1] = np.inf
    odd[500:520, 0] -= 3.0
    return odd


@pytest.fixture(autouse=True)
def hurry(monkeypatch):
    monkeypatch.setattr(record, "RETRY_S", 0.01)


def recorded(path: Path):
    raw = read_raw(path)
    assert raw.pressure is None
    return np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag, np.full(len(raw.t), np.nan)])


def write(path, rows, goes_on=False, force=False, block=50):
    said = []
    recording = Record(path, goes_on, force, said.append)
    recording.begin({})
    for k in range(0, len(rows), block):
        recording.add(rows[k : k + block], None)
    recording.add(rows[:0], None, at_end=True)
    recording.close()
    return said


def test_an_older_file_is_kept_unless_it_may_be_replaced(rows, tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text("a letter\nto my mother")
    with pytest.raises(OutputError, match="there already"):
        write(path, rows)
    with pytest.raises(FormatError, match="not recorded by"):
        write(path, rows, goes_on=True)
    write(path, rows[:0], force=True)  # another source, of which no sample has come yet
    assert path.read_text() == "a letter\nto my mother"
    write(path, rows[:100], force=True)
    np.testing.assert_array_equal(recorded(path), rows[:100])
    with pytest.raises(OutputError, match="no such file"):
        write(tmp_path / "no folder" / "walk.csv", rows)


@pytest.mark.parametrize("kept", [0, 5, 700])
@pytest.mark.parametrize("back", [0, 30, 10_000], ids=["goes on", "some rows again", "from the beginning"])
def test_a_resumed_walk_goes_on_in_its_file(rows, tmp_path, kept, back):
    """Whose last line was cut off; what the source sends again is in it already."""
    path = tmp_path / "walk.csv"
    assert write(path, rows[:kept]) == []
    with path.open("a") as file:
        file.write("12.5,0.1,9" if kept else record.HEADER[:20])
    said = write(path, rows[max(kept - back, 0) :], goes_on=True)
    assert len(said) == (kept > 0 and back > 0)
    np.testing.assert_array_equal(recorded(path), rows)


def test_a_full_disk_does_not_end_the_walk(rows, tmp_path, monkeypatch):
    """It is said once, and what waited is written once there is room."""
    path, said, is_full = tmp_path / "walk.csv", [], [False]
    pwrite = os.pwrite

    def write_some(file, data, place):
        if is_full[0] and len(data) <= 100:
            raise OSError(errno.ENOSPC, "No space left on device")
        return pwrite(file, data[:100] if is_full[0] else data, place)

    monkeypatch.setattr(record.os, "pwrite", write_some)
    with closing(Record(path, False, False, said.append)) as recording:
        recording.begin({})
        for k in range(0, len(rows), 100):
            is_full[0] = 400 <= k < 900
            recording.add(rows[k : k + 100], None)
            time.sleep(0.02)
    np.testing.assert_array_equal(recorded(path), rows)
    assert [words.partition("walk.csv ")[2] for words in said] == [
        "cannot be written (no space left on device): the walk goes on, and it is tried again.",
        "is written again.",
    ]
    is_full[0], said[:] = True, []
    with closing(Record(tmp_path / "lost.csv", False, False, said.append)) as recording:
        recording.add(rows[:1000], None)  # with the entry on the walk
        recording.add_lines(["{}", "{}"])
    assert [words.rpartition(" lacks ")[2].split(" that")[0] for words in said[-2:]] == ["1000 samples", "3 lines"]


@pytest.mark.usefixtures("solved_here")
def test_a_replay_is_recorded_as_it_is(fg_nav, tmp_path):
    source = tmp_path / "walk.csv"
    write_canonical(short_walk(), source)
    words = ("stream", source, "--speed", "max", "--heading", 0, "--record", tmp_path / "record.csv")
    assert fg_nav(*words).code == 0
    np.testing.assert_array_equal(recorded(tmp_path / "record.csv"), rows_of(short_walk()))
    assert fg_nav(*words).refused("record.csv", "--force")
    assert fg_nav("stream", source, "--record", source, "--force").refused("what is streamed")
    for speed in ("0", "-1", "nan", "fast"):
        assert fg_nav("stream", source, f"--speed={speed}").refused("--speed", "no factor")


def test_a_replay_takes_its_time():
    """Never faster than was asked; how much slower is up to the machine."""
    walk = short_walk()
    replay = Replay(walk, 40.0, "a walk")
    began, came = time.monotonic(), []

    async def read() -> None:
        while (rows := await replay.read()) is not None:
            came.extend(rows[:, 0].tolist())
            assert came == [] or (came[-1] - walk.t[0]) / 40.0 <= time.monotonic() - began

    asyncio.run(asyncio.wait_for(read(), 60.0))
    assert np.array_equal(came, walk.t)


def test_two_streams_into_one_file_are_refused(rows, tmp_path):
    path = tmp_path / "walk.csv"
    with closing(Record(path, False, False, print)) as first:
        first.begin({})
        for force in (False, True):
            with pytest.raises(OutputError, match="another stream records into"):
                Record(path, False, force, print)
        first.add(rows, None)
    np.testing.assert_array_equal(recorded(path), rows)
