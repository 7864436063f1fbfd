"""`fg-nav stream`: whatever happens to the stream, the walk goes on, and its end is written."""

import asyncio
import json
import os
import signal
import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.commands import stream
from fg_nav.commands.stream import LinePrinter
from fg_nav.io import write_canonical
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import rows_of
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.rows import RowReader
from fg_nav.online.sources import TextSource, open_source
from fg_nav.view.outlets import Outlets
from tests.command_line import names
from tests.online.walks import NORTH, push, short_walk, worst_difference


@pytest.fixture(autouse=True)
def waits_for_solutions(monkeypatch):
    """However slow the machine is."""
    monkeypatch.setattr("fg_nav.online.smoother.FAST", 0.0)


@pytest.fixture(scope="module")
def csv(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("stream") / "walk.csv"
    write_canonical(short_walk(), path)
    return path


@pytest.fixture(scope="module")
def whole():
    navigator = OnlineNavigator(NORTH)
    push(navigator, rows_of(short_walk()))
    navigator.close()
    return navigator


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


def followed(source, **options):
    lines, remarks = [], source.said if isinstance(source, Pieces) else []
    outlets = Outlets(lines.append, None, remarks.append)
    walk = follow({None: Sensor(source, StreamOptions(online=NORTH, **options))}, outlets)
    return walk.navigators[None], [json.loads(line) for line in lines], remarks


def of_now(lines: list[dict]) -> list[dict]:
    """The lines of estimates, without what is taken back between them."""
    return [line for line in lines if line["kind"] == "now"]


def cut(data: bytes, n: int) -> list[bytes]:
    edges = np.sort(np.random.default_rng(n).integers(0, len(data), n)).tolist()
    return [data[a:b] for a, b in zip([0, *edges], [*edges, len(data)], strict=True)]


def test_a_line_for_each_footfall(csv, whole):
    navigator, lines, remarks = followed(Pieces(*cut(csv.read_bytes(), 50)))
    assert worst_difference(navigator.causal(), whole.causal()) < 1e-9
    assert {line["kind"] for line in lines} == {"now", "revised"}
    path = lines[-1]["path"]  # the end is solved once more
    assert np.allclose(np.array(path)[:, 1:], whole.smoothed().position, atol=1e-3)
    lines = of_now(lines)
    assert [line["stance"] for line in lines] == list(range(len(whole.causal())))
    table = whole.causal()
    assert np.allclose([line["position_m"] for line in lines], table.position, atol=1e-6)
    assert np.allclose([line["gyro_bias_deg_s"] for line in lines], np.degrees(table.gyro_bias), atol=1e-6)
    assert np.allclose([line["heading_sigma_deg"] for line in lines], np.degrees(table.heading_sigma), atol=1e-6)
    assert remarks == []


def test_a_stalled_source_is_told_and_waited_for(csv, whole):
    data = csv.read_bytes()
    middle = data.index(b"\n", len(data) // 2) + 5
    navigator, _, remarks = followed(Pieces(data[:middle], data[middle:], silent=20), stalled_s=0.1)
    assert worst_difference(navigator.causal(), whole.causal()) < 1e-9
    assert len(remarks) == 2
    assert "no sample has come from a test" in remarks[0]
    assert "again" in remarks[1]
    over, _, _ = followed(Pieces(data[:middle], data[middle:], silent=10**6), until_silent_s=0.1)
    assert 0 < len(over.footfalls) < len(whole.footfalls)


def test_a_growing_file_is_followed(csv, whole, tmp_path):
    data = csv.read_bytes()
    path = tmp_path / "growing.csv"
    path.write_bytes(data[: len(data) // 3])

    def grow() -> None:
        with path.open("ab") as file:
            for piece in cut(data[len(data) // 3 :], 10):
                time.sleep(0.02)
                file.write(piece)
                file.flush()

    writer = threading.Thread(target=grow)
    writer.start()
    with closing(open_source(str(path), None, 115200, print)) as source:
        navigator, _, _ = followed(source, until_silent_s=0.5)
    writer.join()
    assert worst_difference(navigator.causal(), whole.causal()) < 1e-9


def test_rows_without_a_header_are_walked_by_their_columns(fg_nav, csv, tmp_path):
    """And a walk that is resumed has the same."""
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


POLISHED = {"trajectory_polished.tum", "strides_polished.csv"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_walk_and_not_its_result(fg_nav, csv, tmp_path, monkeypatch, number):
    """The pipe stays open: only the signal ends it, once most of the walk was printed."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    printed, ended = threading.Semaphore(0), threading.Event()

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
            ended.wait(30.0)

    writer = threading.Thread(target=write)
    writer.start()
    ran = fg_nav("stream", pipe, "--heading", 0)
    ended.set()
    writer.join()
    assert ran.code == 0
    kinds = [json.loads(line)["kind"] for line in ran.out.splitlines()]
    assert "revised" not in kinds[kinds.index("smoothed") :]
    told = [kind for kind in kinds if kind != "revised"]
    assert told == sorted(told)
    assert kinds.count("smoothed") >= 5
    assert ran.err == ""


def test_polished_both_are_written_with_their_gap(fg_nav, csv, whole, tmp_path):
    """By run and by stream, which write the same; without it neither solves the walk in batch."""
    given = (csv, "--heading", 0, "--polish", "--out")
    no_plots = ("--plots", "none")
    assert fg_nav("run", *given, tmp_path / "run", "--method", "online", *no_plots).code == 0
    assert fg_nav("stream", *given, tmp_path / "stream", "--silence", 0.3).code == 0
    ran = fg_nav("stream", *given[:-1], "--silence", 0.3)
    kinds = [json.loads(line)["kind"] for line in ran.out.splitlines()]
    assert kinds.count("polished") == kinds.count("smoothed") == 13
    assert kinds.index("polished") > kinds.index("smoothed") > kinds.index("now")
    assert fg_nav("run", csv, "--heading", 0, "--out", tmp_path / "batch", *no_plots).code == 0
    assert fg_nav("run", csv, "--heading", 0, "--method", "online", "--out", tmp_path / "plain", *no_plots).code == 0
    for place in ("run", "stream"):  # which write the same
        assert names(tmp_path / place) >= {"online.csv", "strides.csv"} | POLISHED
        online, polished, moment = (
            pd.read_csv(tmp_path / place / name) for name in ("strides.csv", "strides_polished.csv", "online.csv")
        )
        batch = pd.read_csv(tmp_path / "batch" / "strides.csv")
        pd.testing.assert_frame_equal(polished, batch, atol=1e-6)
        assert np.allclose(online[["x_m", "y_m", "z_m"]], whole.finish().stances.position, atol=1e-6)
        assert len(moment) == len(online)
        path, other = (np.loadtxt(tmp_path / place / name) for name in ("trajectory.tum", "trajectory_polished.tum"))
        apart = np.linalg.norm(path[:, 1:4] - other[:, 1:4], axis=1)
        summary = json.loads((tmp_path / place / "summary.json").read_text())
        assert summary["polish_gap_max_m"] == pytest.approx(apart.max(), abs=1e-5)
        assert summary["polish_gap_rms_m"] == pytest.approx(np.sqrt((apart**2).mean()), abs=1e-5)
        assert 0.0 < summary["polish_gap_heading_deg"] < 0.5
        assert summary["polished_distance_m"] == pytest.approx(summary["distance_m"], abs=0.1)
    plain = json.loads((tmp_path / "plain" / "summary.json").read_text())
    assert not POLISHED & names(tmp_path / "plain")
    assert not [key for key in plain if "polish" in key]


def test_with_a_lag_the_footfalls_are_written(fg_nav, csv, tmp_path):
    ran = fg_nav("stream", csv, "--heading", 0, "--lag", 10, "--silence", 0.3, "--out", tmp_path / "out", "--json")
    assert ran.code == 0
    told = {"source": str(csv), "folder": str(tmp_path / "out")}
    assert json.loads(ran.out) == {**told, **json.loads((tmp_path / "out" / "summary.json").read_text())}
    assert names(tmp_path / "out") == {"trajectory.tum", "strides.csv", "online.csv", "summary.json", "report.html"}
    assert len(np.loadtxt(tmp_path / "out" / "trajectory.tum")) == 13
    strides, online = (pd.read_csv(tmp_path / "out" / name) for name in ("strides.csv", "online.csv"))
    assert len(strides) == len(online) == 13
    assert np.abs(strides["y_m"].iloc[-1] - online["y_m"].iloc[-1]) < 0.2
