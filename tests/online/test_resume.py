"""A walk that is killed anywhere goes on from its record: each line is given once, and its end is the same."""

import json
import os
import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from fg_nav.calibration.inertial import AccelerometerCalibration
from fg_nav.calibration.of_recording import Calibration
from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import EstimationError, FormatError, OutputError, StreamError
from fg_nav.frames import compute_heading
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online import record
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.record import Record
from fg_nav.online.rows import RowReader
from fg_nav.online.sources import TextSource
from fg_nav.view.outlets import Outlets
from tests.online.walks import NORTH, short_walk, solve_in_windows

BLOCK = 4000  # bytes, a quarter of a second: lines come between


class Killed(BaseException):
    """The end of a process, whatever it was about to do."""


class Sent(TextSource):
    """The rows of a file in blocks; `read` of them have come."""

    def __init__(self, data: bytes, begin: int = 0) -> None:
        self._data, self.place, self.said = data, begin, list[str]()
        super().__init__(RowReader("a test", self.said.append))

    async def _read_bytes(self) -> bytes | None:
        piece = self._data[self.place : self.place + BLOCK]
        self.place += len(piece)
        return piece or None


def walk_on(path: Path, source: Sent, options: StreamOptions, remarks: list[str] | None = None, lines=None):
    """Follow a source to its end, and on with its record; the navigator, and the lines it gave."""
    given, said = [] if lines is None else lines, [] if remarks is None else remarks
    recording = Record(path, True, False, said.append)
    try:
        walk = follow({None: Sensor(source, options, recording)}, Outlets(given.append, None, said.append))
    finally:
        recording.close()
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
    """Largest difference of two tables of the same footfalls, in their sigmas."""
    np.testing.assert_array_equal(one.sample, other.sample)
    positions = np.abs(one.position - other.position) / np.maximum(other.position_sigma, 1e-3)
    turn = compute_heading(one.nav_R_body) - compute_heading(other.nav_R_body)
    headings = np.angle(np.exp(1j * turn)) / other.heading_sigma
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


def walk_killed(tmp_path, monkeypatch, data, options, kills, goes_on):
    """Walk, killed so often at random bytes; the navigator that came to the end, and the lines of all processes."""
    path, rng, lines, size, begin = tmp_path / "record.csv", np.random.default_rng(7), [], len(data), 0
    deaths, navigator = 0, None
    for _ in range(kills + 1):
        source = Sent(data, begin)
        with monkeypatch.context() as dying:
            if deaths < kills:
                die_at(dying, int(rng.integers(1, size // kills)))
            try:
                navigator, _ = walk_on(path, source, options, lines=lines)
            except Killed:
                deaths += 1
        if goes_on and path.exists():
            # As a sensor does whose rows wait until they are read: from the first row that is not recorded.
            whole = path.read_bytes().rpartition(b"\n")[0].count(b"\n") + 1
            begin = len(b"".join(data.splitlines(keepends=True)[:whole])) if whole > 1 else 0
    assert deaths == kills
    assert navigator is not None
    return navigator, [json.loads(line) for line in lines]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("resume") / "walk.csv"
    write_canonical(short_walk(14), path)
    return path.read_bytes()


@pytest.mark.parametrize("goes_on", [False, True], ids=["the source begins again", "the source goes on"])
def test_killed_at_twenty_bytes_no_line_is_lost_or_given_twice(data, tmp_path, monkeypatch, goes_on):
    options = StreamOptions(online=NORTH)
    whole, lines = walk_on(tmp_path / "whole.csv", Sent(data), options)
    navigator, given = walk_killed(tmp_path, monkeypatch, data, options, 20, goes_on)
    check_lines(given, lines)
    assert measure_end(navigator.smoothed(), whole.smoothed()) < 0.1
    # The record is what a walk that is not killed leaves.
    assert (tmp_path / "record.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
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
    whole, lines = walk_on(tmp_path / "whole.csv", Sent(data), options)
    navigator, given = walk_killed(tmp_path, monkeypatch, data, options, 3, goes_on=kind == "pocket")
    check_lines(given, lines)
    assert len(navigator.finish().stances) == len(whole.finish().stances)
    # on a foot it was solved as a whole, and the other was not
    assert measure_end(navigator.smoothed(), whole.smoothed()) < (1.0 if kind != "pocket" else 1e-9)


def test_a_walk_that_ended_goes_on_and_takes_its_last_line_back(data, tmp_path):
    rows, options, path = data.splitlines(keepends=True), StreamOptions(online=NORTH), tmp_path / "record.csv"
    whole, lines = walk_on(tmp_path / "whole.csv", Sent(data), options)
    middle = next(k for k, row in enumerate(rows[1:], 1) if float(row.split(b",")[0]) > lines[-3]["t"] - 4.0)
    _, first = walk_on(path, Sent(b"".join(rows[:middle])), options)
    remarks: list[str] = []
    navigator, then = walk_on(path, Sent(data), options, remarks)
    check_lines([*first, *then], lines)
    assert measure_end(navigator.smoothed(), whole.smoothed()) < 0.1
    assert sum("resumed from record.csv" in words for words in remarks) == 1
    assert sum(f"{middle - 1} samples up to the last one" in words for words in remarks) == 1


def test_what_is_said_and_counted_is_of_the_whole_walk(tmp_path):
    """What was lost before an interruption counts on, and is not said again."""
    rows = np.delete(rows_of(short_walk()), slice(300, 1300, 50), axis=0)
    texts = ["".join(f"{','.join(map(repr, row[:10].tolist()))}\n" for row in part) for part in (rows[:900], rows)]
    names, said = ",".join(CANONICAL[:10]) + "\n", list[str]()
    for text in texts:
        navigator, _ = walk_on(tmp_path / "r.csv", Sent((names + text).encode()), StreamOptions(online=NORTH), said)
    assert navigator.lost == {"samples": 20, "came": len(rows), "datagrams": 0}
    assert any(f"20 samples of {len(rows) + 20}" in words for words in said)
    assert sum("samples are lost on the way" in words for words in said) == 1


def test_what_cannot_go_on_is_refused_in_a_sentence(data, tmp_path):
    path, options = tmp_path / "record.csv", StreamOptions(online=NORTH)
    walk_on(path, Sent(data[: len(data) // 2]), options)
    nothing = np.zeros(3)
    scale = AccelerometerCalibration(1.001, 1e-4, nothing, nothing, 9.81, 6, 60.0, separable=True)
    for other, words in (
        (StreamOptions(online=NORTH, calibration=Calibration("x", accelerometer=scale)), "another calibration"),
        (StreamOptions(online=OnlineOptions(heading_rad=1.0)), "other options"),
        (StreamOptions(online=OnlineOptions(heading_rad=None, mount="pocket")), "other options"),
    ):
        with pytest.raises(EstimationError, match=f"record.csv was recorded with {words}: resume it with the same"):
            walk_on(path, Sent(data), other)
    lines = tmp_path / "record.csv.lines"
    text = lines.read_text()
    lines.write_text(text.replace('"version": "', '"version": "9'))
    with pytest.raises(EstimationError, match="another version of fg-nav"):
        walk_on(path, Sent(data), options)
    for damaged in ("", "a letter\n", text.replace('"stance": 3', '"stance": 4'), text.replace('"t"', '"u"'), "3\n"):
        lines.write_text(damaged)
        with pytest.raises(FormatError, match="is damaged or not there"):
            walk_on(path, Sent(data), options)
    lines.write_text(text)
    path.write_text("a letter\nto my mother\n")
    with pytest.raises(FormatError, match="not recorded by"):
        walk_on(path, Sent(data), options)
    with pytest.raises(OutputError, match="--resume"):
        Record(path, False, False, print)
    path.unlink()  # its lines cannot go on, and none of them is overwritten
    with pytest.raises(FormatError, match="is there, and the samples of its walk are not"):
        walk_on(path, Sent(data), options)
    assert lines.read_text() == text


def test_a_walk_that_is_stopped_while_it_is_replayed_can_be_resumed_again(data, tmp_path):
    path, stop, lines = tmp_path / "record.csv", threading.Event(), list[str]()
    walk_on(path, Sent(data[: len(data) // 2]), StreamOptions(online=NORTH))
    kept = path.read_bytes()
    stop.set()
    with closing(Record(path, True, False, print)) as recording:
        sensor, outlets = Sensor(Sent(data), StreamOptions(online=NORTH), recording), Outlets(lines.append, None, print)
        with pytest.raises(StreamError, match="not replayed to its end: --resume goes on"):
            follow({None: sensor}, outlets, stop)
    assert (path.read_bytes(), lines) == (kept, [])
