"""A day through `fg-nav stream --lag`: how fast, how much memory, how long it is ever held up, and killed again.

    python scripts/online_hours.py [--hours N] [--lag SECONDS] [--rate HZ] [--kills N] [--real-time MINUTES] [--seed N]
                                   [--json FILE]

A simulated walk with a magnetometer, repeated as long as it takes (`walks.RepeatedWalk`), is written to the standard
input of the command as fast as it reads. With `--kills` the same walk goes through a second process with
`--record FILE --resume`, which is killed (SIGKILL) at random instants and begun again, in turn with the samples from
some seconds before the last recorded one on, as of a logger's buffer, and with all from the beginning, as of a file.
With `--real-time` the last minutes are written as they are walked, a twentieth of a second at a time; the command then
waits for no solution, and how far it is behind is how long what is in the pipe has waited.

A row an hour of walking:

=============== ====================================================================================================
took, s         of the clock on the wall
faster          than it was walked
memory, MB      of the command and of the process beside it that solves the walk again, at its end and highest so far
longest wait, s for which the command did not read
=============== ====================================================================================================

The lines of the walk that was killed are compared with those of the other as in `online_kills`.
"""

from __future__ import annotations

import fcntl
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import harness
import numpy as np
from benchmark_online import memory_mb
from harness import FIRST_SEED, Figure, option
from online_kills import compare_lines, read_lines
from walks import RepeatedWalk, simulate_long_walk

from fg_nav.columns.mapping import CANONICAL
from fg_nav.io.writing import format_rows

HOUR_S, MINUTE_S = 3600.0, 60.0
BLOCK_S, PACE_S = 1.0, 0.05
"""Of samples, written at once, as fast as they are read and as they are walked: a pipe holds some three seconds."""

AGAIN_S = 10.0  # Of samples before the last save, sent again after a kill: less than the lag.
MINUTES = 60.0  # Of the walk that is repeated.
MAX_WAIT_S = 0.5  # Of rows that come as they are walked: a stride.

HEADER = ",".join(CANONICAL).encode() + b"\n"
EXACT = 1e-9


class Rows:
    """The lines of a repeated walk by number, stamped evenly."""

    def __init__(self, walk: RepeatedWalk) -> None:
        recording = walk.recording
        samples = np.column_stack([recording.acc, recording.gyr, recording.mag])
        text = "".join(format_rows(samples, "%.9g", ",")).encode()
        self._tails = text.splitlines(keepends=True)
        self._walk, self.period_s = walk, recording.period_s

    def format(self, start: int, stop: int) -> bytes:
        """Return the lines of samples `start <= i < stop`."""
        number = self._walk.number(np.arange(start, stop)).tolist()
        tails = self._tails
        return b"".join(
            b"%.6f,%b" % (i * self.period_s, tails[k]) for i, k in zip(range(start, stop), number, strict=True)
        )


@dataclass
class Hour:
    """What became of an hour of walking."""

    took_s: float
    memory: list[float]
    highest: float
    wait_s: float


@dataclass
class Follower:
    """A running command: its lines, and its memory as it goes."""

    command: Sequence[str]
    lines: list[str] = field(default_factory=list)
    highest: float = 0.0

    def __post_init__(self) -> None:
        self.process = subprocess.Popen(self.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=False)
        self._reader = threading.Thread(target=self._collect, daemon=True)
        self._reader.start()

    def _collect(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.decode())

    def write(self, piece: bytes) -> float:
        """Hand it bytes; returns how long it did not take them, s."""
        assert self.process.stdin is not None
        began = perf_counter()
        self.process.stdin.write(piece)
        self.process.stdin.flush()
        return perf_counter() - began

    def waits(self) -> bool:
        """Whether there are bytes that it has not taken."""
        assert self.process.stdin is not None
        size = fcntl.ioctl(self.process.stdin.fileno(), termios.FIONREAD, bytes(4))
        return any(size)

    def memory(self) -> list[float]:
        """Return MB of the command and of the process beside it."""
        pids = [self.process.pid, *list_children(self.process.pid)]
        found = [memory_mb(pid) for pid in pids]
        self.highest = max(self.highest, float(np.nansum(found)))
        return found

    def end(self) -> None:
        """Close its input and wait for it."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()
        self._reader.join()

    def kill(self) -> None:
        """End it without a warning."""
        self.process.kill()
        self.process.wait()
        self._reader.join()


def list_children(pid: int) -> list[int]:
    """Return the processes that a process began."""
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def stream_command(lag_s: float, record: Path | None = None) -> list[str]:
    """Return the command that follows standard input."""
    words = [sys.executable, "-m", "fg_nav.cli", "stream", "-", "--lag", f"{lag_s:g}"]
    return words if record is None else [*words, "--record", str(record), "--resume"]


def follow(
    rows: Rows, samples: int, command: Sequence[str], label: str, real_time_s: float = 0.0
) -> tuple[list[str], list[Hour], float]:
    """Send a walk, an hour after the other, and some seconds more in their time.

    Returns the lines, what each hour took, and the longest wait of those seconds.
    """
    follower = Follower(command)
    follower.write(HEADER)
    hours, hour, block = [], round(HOUR_S / rows.period_s), round(BLOCK_S / rows.period_s)
    for begin in range(0, samples, hour):
        began, wait_s, end = perf_counter(), 0.0, min(begin + hour, samples)
        for start in range(begin, end, block):
            wait_s = max(wait_s, follower.write(rows.format(start, min(start + block, end))))
            if start // block % 20 == 0:
                follower.memory()
        hours.append(Hour(perf_counter() - began, follower.memory(), follower.highest, wait_s))
        print_hour(label, len(hours), (end - begin) * rows.period_s, hours[-1])
    wait_s = follow_in_time(rows, samples, samples + round(real_time_s / rows.period_s), follower)
    began = perf_counter()
    follower.end()
    print(f"{label}: closed in {perf_counter() - began:.1f} s, {len(follower.lines)} lines", flush=True)
    return follower.lines, hours, wait_s


def follow_in_time(rows: Rows, start: int, stop: int, follower: Follower) -> float:
    """Send samples as they are walked; return the longest time for which there was always something to be read, s."""
    block = round(PACE_S / rows.period_s)
    began = empty = perf_counter()
    longest = 0.0
    for k, first in enumerate(range(start, stop, block)):
        time.sleep(max(began + k * PACE_S - perf_counter(), 0.0))
        now = perf_counter()
        empty = empty if follower.waits() else now
        longest = max(longest, now - empty)
        follower.write(rows.format(first, min(first + block, stop)))
    return longest


def print_hour(label: str, number: int, walked_s: float, hour: Hour) -> None:
    """Print a row."""
    memory = " + ".join(f"{one:.0f}" for one in hour.memory)
    print(
        f"{label}: hour {number}: took {hour.took_s:.1f} s, {walked_s / hour.took_s:.1f} times faster, "
        f"memory {memory} MB, highest {hour.highest:.0f} MB, longest wait {hour.wait_s:.2f} s",
        flush=True,
    )


def follow_killed(rows: Rows, samples: int, path: Path, lag_s: float, kills: Sequence[int], label: str) -> list[str]:
    """Send a walk and kill the command at these samples; return the lines of all processes."""
    lines: list[str] = []
    begin, block, again = 0, round(BLOCK_S / rows.period_s), round(AGAIN_S / rows.period_s)
    for number, end in enumerate([*kills, samples]):
        follower = Follower(stream_command(lag_s, path))
        follower.write(HEADER)
        for start in range(begin, end, block):
            follower.write(rows.format(start, min(start + block, end)))
        if end == samples:
            follower.end()
        else:
            follower.kill()
            print(f"{label}: killed behind sample {end}, {len(follower.lines)} lines", flush=True)
        lines += follower.lines
        begin = 0 if number % 2 or end == samples else max(path.read_bytes().count(b"\n") - 1 - again, 0)
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures of the script."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        hours=option(24.0, "of walking", metavar="N"),
        lag=option(60.0, "fixed lag", metavar="SECONDS"),
        rate=option(200.0, "of the samples", metavar="HZ"),
        kills=option(0, "how often a second process is killed", metavar="N"),
        real_time=option(0.0, "more, as they are walked", metavar="MINUTES"),
        seed=FIRST_SEED,
        json=None,
    )
    walk = RepeatedWalk.of(simulate_long_walk(min(MINUTES, 60 * chosen.hours), chosen.seed, chosen.rate, "indoor"))
    rows = Rows(walk)
    samples = round(chosen.hours * round(HOUR_S / rows.period_s))
    more_s = MINUTE_S * chosen.real_time
    lines, hours, wait_s = follow(rows, samples, stream_command(chosen.lag), "whole", more_s)
    figures = judge_hours(hours, samples * rows.period_s)
    if chosen.real_time:
        name = f"{chosen.real_time:g} minutes as walked"
        figures.append(Figure(name, "longest wait of rows (s)", "stream", wait_s, high=MAX_WAIT_S))
    if chosen.kills:
        samples += round(more_s / rows.period_s)
        figures += measure_kills(rows, samples, lines, chosen.kills, chosen.lag, chosen.seed)
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json, hours=[vars(hour) for hour in hours])


def judge_hours(hours: Sequence[Hour], walked_s: float) -> list[Figure]:
    """Return the figures of a walk that was not killed."""
    name = f"{walked_s / HOUR_S:.3g} hours"
    speed = walked_s / sum(hour.took_s for hour in hours)
    early = hours[min(1, len(hours) - 1)].memory
    growth = float(np.nansum(hours[-1].memory) / np.nansum(early))
    return [
        Figure(name, "times faster than walked", "stream", speed, low=1.0, pattern="{:.1f}"),
        Figure(name, "longest wait (s)", "stream", max(hour.wait_s for hour in hours)),
        Figure(name, "memory, highest (MB)", "stream", max(hour.highest for hour in hours), pattern="{:.0f}"),
        Figure(name, "memory at the end over that of hour 2", "stream", growth),
    ]


def measure_kills(rows: Rows, samples: int, whole: Sequence[str], kills: int, lag_s: float, seed: int) -> list[Figure]:
    """Return how far the lines of a walk that is killed are from those of one that is not."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.integers(samples // 20, samples, kills)).tolist()
    with tempfile.TemporaryDirectory() as name:
        found = follow_killed(rows, samples, Path(name) / "walk.csv", lag_s, at, "killed")
    missing, twice, difference = compare_lines(_parse(whole), _parse(found))
    mode = f"{kills} kills"
    return [
        Figure(mode, "lines missing", "stream", float(missing), high=0.0, pattern="{:.0f}"),
        Figure(mode, "lines twice", "stream", float(twice), high=0.0, pattern="{:.0f}"),
        Figure(mode, "end, sigmas", "stream", difference, pattern="{:.3f}"),
    ]


def _parse(lines: Sequence[str]) -> Iterator[dict[str, object]]:
    return read_lines("".join(lines))


if __name__ == "__main__":
    harness.run(main)
