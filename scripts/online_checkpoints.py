"""Checkpoints that were tampered with: each field in turn is made another, and the walk resumed.

    python scripts/online_checkpoints.py [--tries N] [--first SEED] [--show] [--streams N] [--data DIR]

A walk of 44 s is saved after 36 s, with the state of its graph. Its records are taken apart, one value is changed, and
they are put together again with right sums, as no disk would do it: what a reader must notice by itself.

========== ==============================================================
zero       0, an empty text, zeros
nan        NaN in place of a number, of all or of one
huge       1e300, 2^62
negative   -1, or the negative
type       a number for a text, a text for a number, null for either
length     a list or an array one longer, one shorter, empty
shape      an array that claims 7 TiB, or another type of number
truncated  bytes are missing; and single bits of the file are other
========== ==============================================================

A process of its own resumes it, takes the rest of the walk and solves it. Asked: a sentence, or a walk that goes on
with nothing but numbers; no exception, no end of the process, no more than `MAX_S` and `MAX_MB`.

With `--streams` so many real walks are followed to a third and two thirds of their way, and resumed there: with the
verdict of their lines, the checks of their source and the counts of losses in the checkpoint, none may be refused.
"""

from __future__ import annotations

import copy
import json
import os
import resource
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import harness
import numpy as np
import walks
from fg_nav.online.checkpoint import VERSION
from fg_nav.online.packing import read_records, write_records
from harness import FIRST_SEED, Figure, option
from line_verdicts import RawRows
from verdicts import GOOD, list_cases

from fg_nav.errors import FgNavError
from fg_nav.lab.simulation import simulate
from fg_nav.online import OnlineNavigator, load, save
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.follow import StreamOptions, follow_source

MAX_S = 60
MAX_MB = 4096
SAVED, MORE, BLOCK = 3600, 800, 400
RATE_HZ = 100.0
Place = tuple[str | int, ...]
Head = dict[str, Any]

SENTENCE, GOES_ON, EXCEPTION, NO_NUMBER, ENDED, TOO_LONG = (
    "sentence", "goes on", "exception", "not finite", "process ended", "too long or too large",
)  # fmt: skip
FATES = (SENTENCE, GOES_ON, EXCEPTION, NO_NUMBER, ENDED, TOO_LONG)


def make_checkpoint(path: Path) -> np.ndarray:
    """Save a walk; return all of its rows."""
    rows = rows_of(simulate("demo", 1).recording)[: SAVED + MORE]
    navigator = OnlineNavigator()
    for start in range(0, SAVED, BLOCK):
        push(navigator, rows[start : min(start + BLOCK, SAVED)])
    save(navigator, path)
    return rows


def push(navigator: Any, rows: np.ndarray) -> None:
    """Push rows (n, 10)."""
    navigator.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10])


def split(record: bytes) -> tuple[Head, bytes]:
    """Return the head of a record and the bytes of its arrays."""
    stop = 8 + int.from_bytes(record[:8], "little")
    return json.loads(record[8:stop]), record[stop:]


def join(head: Head, arrays: bytes) -> bytes:
    """Return a record again."""
    text = json.dumps(head).encode()
    return len(text).to_bytes(8, "little") + text + arrays


def list_places(tree: Any, place: Place = ()) -> Iterator[Place]:
    """Yield where the values of a tree are; of a long list those of its first and last part."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from list_places(value, (*place, key))
    elif isinstance(tree, list):
        yield place
        for k in sorted({0, 1, len(tree) - 1} & set(range(len(tree)))):
            yield from list_places(tree[k], (*place, k))
    else:
        yield place


def find(tree: Any, place: Place) -> Any:
    """Return what is at a place of a tree."""
    for key in place:
        tree = tree[key]
    return tree


def put(tree: Any, place: Place, value: Any) -> None:
    """Put a value there."""
    find(tree, place[:-1])[place[-1]] = value


NAN = float("nan")


def change_value(value: Any, rng: np.random.Generator) -> Any:
    """Return another value in place of one of the tree."""
    if isinstance(value, list):
        return [value[:-1], value + value[-1:], [], None, value[::-1]][rng.integers(5)]
    if isinstance(value, bool) or value is None:
        return [0, 1.5, "x", None, not value, [], NAN][rng.integers(7)]
    if isinstance(value, str):
        return ["", "x", 3, None, value * 1000][rng.integers(5)]
    return [0, NAN, 1e300, 2**62, -1, -value, "7", None, value + 1, [value]][rng.integers(10)]


def change_array(head: Head, arrays: bytes, rng: np.random.Generator) -> tuple[str, bytes]:
    """Change one of the arrays; return how, and the bytes then."""
    sizes = [np.dtype(one["type"]).itemsize * int(np.prod(one["shape"])) for one in head["arrays"]]
    filled = [k for k, size in enumerate(sizes) if size]
    k = int(rng.choice(filled))
    one, begin = head["arrays"][k], sum(sizes[:k])
    values = np.frombuffer(arrays[begin : begin + sizes[k]], dtype=one["type"]).copy()
    kind = ["zero", "nan", "huge", "negative", "one", "swapped", "longer", "shorter", "7 TiB", "dtype"][
        rng.integers(10)
    ]
    at = rng.integers(len(values))
    match kind:
        case "zero":
            values[:] = 0
        case "nan":
            values[at] = NAN if values.dtype.kind == "f" else -(2**62)
        case "huge":
            values[at] = 1e300 if values.dtype.kind == "f" else 2**62
        case "negative":
            values = -values if values.dtype.kind in "if" else values
        case "one":
            values[at] = values[at] + 1 if values.dtype.kind in "if" else values[at]
        case "swapped":
            values = values[::-1]
        case "longer":
            one["shape"] = [one["shape"][0] + 1, *one["shape"][1:]] if one["shape"] else [1]
            values = np.resize(values, int(np.prod(one["shape"])))
        case "shorter":
            one["shape"] = [one["shape"][0] - 1, *one["shape"][1:]] if one["shape"] else [0]
            values = values[: int(np.prod(one["shape"]))]
        case "7 TiB":
            one["shape"] = [10**12]
        case "dtype":
            one["type"] = ["<i8", "<f8", "<c16", "|b1"][rng.integers(4)]
    return f"{kind} in array {k}", arrays[:begin] + values.tobytes() + arrays[begin + sizes[k] :]


def tamper(record: bytes, places: Sequence[Place], rng: np.random.Generator) -> tuple[str, bytes]:
    """Return what was changed, and the record then."""
    chosen = rng.random()
    head, arrays = split(record)
    if chosen < 0.55:
        place = places[rng.integers(len(places))]
        before = find(head, place)
        after = change_value(before, rng)
        put(head, place, after)
        return f"{'.'.join(map(str, place))}: {str(before)[:30]} -> {str(after)[:30]}", join(head, arrays)
    if chosen < 0.95:
        words, arrays = change_array(head, arrays, rng)
        return words, join(head, arrays)
    if chosen < 0.975:
        cut = int(rng.integers(len(record)))
        return f"cut at {cut}", record[:cut]
    damaged = bytearray(record)
    at = int(rng.integers(len(record)))
    damaged[at] ^= 1 << int(rng.integers(8))
    return f"bit at {at}", bytes(damaged)


def go_on(path: Path, rows: np.ndarray) -> str:
    """Resume a walk, push what comes then, and solve it; return what became of it."""
    try:
        navigator = load(path)
        for start in range(SAVED, len(rows), BLOCK):
            push(navigator, rows[start : start + BLOCK])
        navigator.close()
        tables = [navigator.causal(), navigator.smoothed(), navigator.finish().stances]
    except FgNavError as error:
        return SENTENCE if "\n" not in str(error) and str(error).endswith(".") else EXCEPTION
    except MemoryError:
        return TOO_LONG
    parts = [part for one in tables for part in (one.position, one.nav_R_body, one.position_cov, one.heading_sigma)]
    return GOES_ON if all(np.isfinite(part).all() for part in parts) else NO_NUMBER


def try_one(path: Path, rows: np.ndarray, show: bool) -> str:
    """Do so in a process of its own, with limits."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        with suppress(BaseException):
            signal.alarm(MAX_S)
            resource.setrlimit(resource.RLIMIT_AS, (MAX_MB << 20, MAX_MB << 20))
            os.write(writer, _catch(partial(go_on, path, rows), show).encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as answer:
        said = answer.read().decode()
    _, status = os.waitpid(child, 0)
    if said:
        return said
    return TOO_LONG if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM else ENDED


def _catch(work: Callable[[], str], show: bool) -> str:
    try:
        return work()
    except Exception:
        if show:
            traceback.print_exc(limit=-3)
            sys.stderr.flush()
        return EXCEPTION


def resume_real_walks(data: Path, count: int, folder: Path) -> tuple[int, int]:
    """Resume genuine checkpoints; return how many there were, and how many were refused."""
    good = [case for case in list_cases(data) if case.kind == GOOD]
    tried = refused = 0
    for case in good[:: max(len(good) // count, 1)][:count]:
        raw, path = case.load(), folder / f"walk {tried}"
        options = StreamOptions(online=OnlineOptions(use_field=False), checkpoint=path)
        for share in (1 / 3, 2 / 3, 1.0):
            begins = not path.exists()
            try:
                follow_source(RawRows(raw, share), options, lambda line: None, lambda words: None)
            except FgNavError as error:
                print(f"{case.name}, {share:.0%}: {error}", flush=True)
                refused += not begins
            tried += not begins
    return tried, refused


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it and print the figures."""
    given = harness.parse_arguments(
        __doc__,
        arguments,
        tries=option(300, "checkpoints"),
        first=FIRST_SEED,
        show=option(False, "each that is not well, with its traceback"),
        streams=option(0, "real walks that are resumed from checkpoints of their own"),
        data=None,
    )
    rng, fates = np.random.default_rng(given.first), Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "walk"
        rows = make_checkpoint(path)
        records = [bytes(content) for content, _ in read_records(path, VERSION)]
        if try_one(path, rows, True) != GOES_ON:
            raise SystemExit("the walk itself does not go on")
        places = list(list_places(copy.deepcopy(split(records[0])[0]["tree"])))
        places = [("tree", *place) for place in places if place]
        for _ in range(given.tries):
            words, changed = tamper(records[0], places, rng)
            write_records(path, VERSION, [changed, *records[1:]])
            fate = try_one(path, rows, given.show)
            fates[fate] += 1
            if given.show and fate not in (SENTENCE, GOES_ON):
                print(f"{fate}: {words}", flush=True)
    figures = [
        Figure(
            "checkpoints",
            fate,
            "online",
            fates[fate],
            high=np.inf if fate in (SENTENCE, GOES_ON) else 0,
            pattern="{:.0f}",
        )
        for fate in FATES
    ]
    if given.streams:
        with tempfile.TemporaryDirectory() as name:
            tried, refused = resume_real_walks(walks.data_folder(given.data), given.streams, Path(name))
        figures.append(Figure(f"{tried} genuine", "refused", "online", refused, high=0, pattern="{:.0f}"))
    harness.print_heading(f"{given.tries} checkpoints, each with one field changed, from seed {given.first} on")
    harness.print_figures(figures)
    harness.print_verdict(figures)


if __name__ == "__main__":
    harness.run(main)
