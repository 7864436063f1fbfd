"""What can be wrong with an input: a mutation takes a value and a generator, and returns another value.

========= ==========================================================================================================
samples   rows (n, 10) of t s, acc m/s^2, gyr rad/s, mag uT: axes, units, stamps, losses, outliers, blocks
bytes     of any file: flips, insertions, deletions, cuts, zeros, other encodings, numbers of 8 bytes exchanged
table     text in rows and fields: broken (fields, columns, rows replaced, lost, doubled), or varied: still readable,
          with other numbers
tree      of JSON: leaves replaced or varied, keys lost or renamed
========= ==========================================================================================================

The campaign (`scripts/fuzz/run.py`) draws from here, and so do the tests of broken files.
"""

from __future__ import annotations

import copy
import gzip
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2

Rng: TypeAlias = np.random.Generator
T = TypeVar("T")
Mutation: TypeAlias = Callable[[T, Rng], T]
Table: TypeAlias = list[list[str]]
TableChange: TypeAlias = Callable[[Table, int, int, Rng], Table]


def draw(rng: Rng, some: Sequence[T]) -> T:
    """Draw one of these, whatever they are."""
    return some[int(rng.integers(len(some)))]


# --- samples ---------------------------------------------------------------------------------------------------------

COLUMNS = (slice(1, 4), slice(4, 7), slice(7, 10), slice(1, 7), slice(1, 10), *(slice(k, k + 1) for k in range(1, 10)))
"""Accelerometer, gyroscope, magnetometer, two or all of them, one axis."""
G = GRAVITY_M_S2
UNITS = (1 / G, 1e3 / G, 1e3, 1e-3, np.degrees(1.0), np.radians(1.0), 0.01, 10.0, 1e-6)
"""An SI value times this is in g, mg, mm/s^2, deg/s, mrad/s, or uT in gauss, mG, nT, T; or was taken to be."""

CHANGES: Mapping[str, Mutation[Floats]] = {
    "lost": lambda x, rng: np.full_like(x, draw(rng, (np.nan, np.nan, np.inf, -np.inf, 1e9, 1e38, -1e200, 1e308))),
    "held": lambda x, rng: np.repeat(x[:1] * draw(rng, (0.0, 1.0, 1.0)), len(x), axis=0),
    "clipped": lambda x, rng: np.clip(x, *draw(rng, ((-4.4, 4.4), (-10.0, 10.0), (-30.0, 30.0), (-80.0, 80.0)))),
    "turned": lambda x, rng: x[:, rng.permutation(x.shape[1])] * rng.choice([-1.0, 1.0], x.shape[1]),
    "unit": lambda x, rng: x * draw(rng, UNITS),
    "scaled": lambda x, rng: x * np.exp(rng.uniform(-1.2, 1.2)) + draw(rng, (0.0, 0.01, 0.3, 10.0)) * rng.normal(),
    "outlier": lambda x, rng: x + draw(rng, (-300.0, -100.0, -30.0, 30.0, 100.0, 300.0)),
    "noisy": lambda x, rng: x + rng.normal(0.0, draw(rng, (0.1, 1.0, 10.0)), x.shape),
    "coarse": lambda x, rng: np.round(x * (steps := draw(rng, (0.1, 1.0, 10.0)))) / steps,
    "magnet": lambda x, rng: x + np.hanning(len(x))[:, None] * rng.normal(0.0, draw(rng, (10.0, 150.0)), x.shape[1]),
    "shuffled": lambda x, rng: rng.permutation(x),
}
"""Of the samples (m, k) of some columns in a stretch."""

STRETCHES: Mapping[str, Callable[[Floats, slice, Rng], Floats]] = {
    "gap": lambda rows, of, rng: np.delete(rows, of, axis=0),
    "cut": lambda rows, of, rng: rows[min(of.start, len(rows) // 3) :],
    "thinned": lambda rows, of, rng: rows[:: draw(rng, (2, 4, 20))],
    "doubled": lambda rows, of, rng: np.repeat(rows, np.where(np.arange(len(rows)) % 41 == 3, 2, 1), axis=0),
    "sent again": lambda rows, of, rng: np.concatenate([rows[: of.stop], rows[of.start :]]),
    "moved": lambda rows, of, rng: np.concatenate([rows[of], rows[: of.start], rows[of.stop :]]),
    "far ahead": lambda rows, of, rng: np.insert(rows, of.start, rows[of.start] + 1e5 * np.eye(1, 10)[0], axis=0),
    "restart": lambda rows, of, rng: np.concatenate(
        [rows[: of.start], rows[of.start :] - np.eye(1, 10) * (rows[of.start, 0] - rows[0, 0])]
    ),
}
"""Of the rows (n, 10), given a stretch."""

CLOCKS: Mapping[str, Mutation[Floats]] = {
    "unit of time": lambda t, rng: t * draw(rng, (1e3, 1e6, 1e9, 1e-3)),
    "epoch": lambda t, rng: (t + draw(rng, (1.7e9, -1e4, -1e9, -1e15))) * draw(rng, (1.0, 1e3, 1e6, 1e9)),
    "rounded": lambda t, rng: np.round(t, int(rng.integers(1, 4))),
    "jitter": lambda t, rng: t + rng.normal(0.0, draw(rng, (1e-3, 0.01, 0.1)), len(t)),
    "sorted jitter": lambda t, rng: np.sort(t + rng.normal(0.0, draw(rng, (1e-3, 0.01, 0.1)), len(t))),
    "no time": lambda t, rng: 0.0 * t + rng.normal(),
    "out of order": lambda t, rng: rng.permutation(t),
    "another rate": lambda t, rng: t * rng.uniform(0.3, 3.0),
    "step": lambda t, rng: t + np.where(t > t[rng.integers(len(t))], draw(rng, (0.3, 3.0, 1e4, 1e9)), 0.0),
    "no stamps": lambda t, rng: np.where(rng.random(len(t)) < draw(rng, (0.001, 0.1, 1.0)), np.nan, t),
}
"""Of the stamps (n,) from 0 on."""

SAMPLE_MUTATIONS = (*CHANGES, *STRETCHES, *CLOCKS)


def draw_stretch(rows: Floats, rng: Rng) -> slice:
    """Draw one sample, a span of 0.02 to 20 s with its duration uniform in the logarithm, all from there on, or all."""
    period_s = float(np.median(np.diff(rows[:, 0])))
    count = int(np.clip(np.exp(rng.uniform(-3.9, 3.0)) / period_s if period_s > 0.0 else 1, 1, len(rows) - 1))
    start = int(rng.integers(len(rows) - count))
    return draw(rng, (slice(start, start + 1), *[slice(start, start + count)] * 3, slice(start, None), slice(0, None)))


def mutate_samples(rows: Floats, rng: Rng, some: Sequence[str] = SAMPLE_MUTATIONS) -> tuple[Floats, str]:
    """Mutate a recording in one to three ways of these; return it and their names."""
    names, rows = [draw(rng, some) for _ in range(draw(rng, (1, 1, 2, 3)))], rows.copy()
    for name in names if len(rows) >= 8 else ():
        with np.errstate(all="ignore"):  # what the next one makes of infinity
            if name in CLOCKS:
                rows[:, 0] = CLOCKS[name](rows[:, 0] - rows[0, 0], rng)
            elif name in CHANGES:
                for _ in range(rng.integers(1, 4)):
                    place = draw_stretch(rows, rng), draw(rng, COLUMNS)
                    rows[place] = CHANGES[name](rows[place], rng)
            elif len(shorter := STRETCHES[name](rows, draw_stretch(rows, rng), rng)) >= 8:
                rows = shorter
    return rows, ", ".join(names)


# --- numbers ---------------------------------------------------------------------------------------------------------

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
FACTORS = (0.3, 0.5, 0.9, 0.999, 1.001, 1.1, 2.0, 3.0, -1.0, 0.0, 57.3, 1e3, 1e-3, 1e300)
STEPS = (0.0, 0.0, 1e-3, 0.1, 1.0, 30.0, 1e3)
"""A number that is varied becomes a factor times itself, as in another unit, and a normal deviate times a step."""
FIELDS = (
    "", "nan", "NaN", "inf", "-inf", "1e308", "-1e200", "1e400", "0x1", "1,2", '"', "\0", "١", "-", "--1", "1e", "#",
    "0", "-1", "1_000", "9" * 400, "None", "true", "=1+1", "\u2028", "1\r2",
)  # fmt: skip
"""Texts in place of a number."""


def vary_number(number: float, rng: Rng) -> float:
    """Return a number that is somewhat else."""
    return float(draw(rng, FACTORS) * number + draw(rng, STEPS) * rng.normal())


def change_numbers(text: str, change: Callable[[float], float]) -> str:
    """Change the numbers in a text, each written as it was: a whole number stays one."""

    def write(found: re.Match[str]) -> str:
        number = change(float(found[0]))
        return str(round(number)) if found[0].lstrip("+-").isdigit() and np.isfinite(number) else repr(number)

    return NUMBER.sub(write, text)


# --- bytes -----------------------------------------------------------------------------------------------------------

ENCODINGS: tuple[Callable[[bytes], bytes], ...] = (
    lambda data: b"\xef\xbb\xbf" + data,
    lambda data: data.decode("latin-1").encode("utf-16"),
    lambda data: data.decode("latin-1").encode("utf-32"),
    lambda data: gzip.compress(data, 1, mtime=0),
    lambda data: gzip.compress(data, 1, mtime=0)[: len(data) // 8],
    lambda data: data.replace(b"\n", b"\r\n"),
    lambda data: data + data,
    lambda data: b"",
    lambda data: data.replace(b"\n", b""),
    lambda data: data.replace(b".", b","),
)


def put_word(data: bytes, at: int, word: bytes) -> bytes:
    """Put 8 bytes in the place of others, as arrays hold numbers."""
    return data[:at] + word + data[at + 8 :]


def flip(data: bytes, at: int, stop: int, rng: Rng) -> bytes:
    """Change the bytes of a range."""
    return data[:at] + bytes(one ^ int(rng.integers(1, 256)) for one in data[at:stop]) + data[stop:]


BYTE_MUTATIONS: Mapping[str, Callable[[bytes, int, int, Rng], bytes]] = {
    "cut": lambda data, at, n, rng: data[:at],
    "flipped": lambda data, at, n, rng: flip(data, at, at + min(n, 8), rng),
    "head": lambda data, at, n, rng: flip(data, at % 512, at % 512 + min(n, 8), rng),  # that says what follows
    "inserted": lambda data, at, n, rng: data[:at] + rng.bytes(min(n, 64)) + data[at:],
    "removed": lambda data, at, n, rng: data[:at] + data[at + n :],
    "repeated": lambda data, at, n, rng: data[: at + n] + data[at:],
    "filled": lambda data, at, n, rng: data[:at] + bytes([draw(rng, (0, 32, 255))]) * n + data[at + n :],
    "encoding": lambda data, at, n, rng: draw(rng, ENCODINGS)(data),
    "word": lambda data, at, n, rng: put_word(data, at // 8 * 8, data[rng.integers(len(data) // 8 or 1) * 8 :][:8]),
    "number": lambda data, at, n, rng: put_word(data, at // 8 * 8, np.float64(vary_number(1.0, rng)).tobytes()),
    "count": lambda data, at, n, rng: put_word(data, at // 8 * 8, draw(rng, (1, 2, 50, 2**40)).to_bytes(8, "little")),
}
"""By name: of the data, a place, and 1 to 1024 bytes from there on."""


def mutate_bytes(data: bytes, rng: Rng) -> tuple[bytes, str]:
    """Mutate a file in one to three ways; return it and their names."""
    names = [str(name) for name in rng.choice(list(BYTE_MUTATIONS), rng.integers(1, 4))]
    for name in names:
        at, length = int(rng.integers(max(1, len(data)))), int(rng.choice([1, 4, 64, 1024]))
        data = BYTE_MUTATIONS[name](data, at, length, rng)
    return data, ", ".join(names)


# --- tables ----------------------------------------------------------------------------------------------------------

BREAKS: Sequence[TableChange] = (
    lambda table, row, k, rng: _put(table, slice(row, row + 1), k, draw(rng, (*FIELDS, "x" * 200_000))),
    lambda table, row, k, rng: [line[:k] + line[k + 1 :] for line in table],
    lambda table, row, k, rng: _put(table, slice(1, None), k, draw(rng, FIELDS)),
    lambda table, row, k, rng: [*table[:row], *table[row + 1 :], table[row]],
    lambda table, row, k, rng: table[:row] + table[row + int(rng.integers(1, 41)) :],
    lambda table, row, k, rng: [*table[: row + 1], *table[row:]],
    lambda table, row, k, rng: [*table[:row], rng.permutation(table[0]).tolist(), *table[row:]],
    lambda table, row, k, rng: [*table[:row], table[0], *table[row:]],
    lambda table, row, k, rng: [*table[:row], table[row][:k], *table[row + 1 :]],
)
"""Given a row and a field: replace it, its column, its place; lose, double, shorten rows; send the header again."""


def _put(table: Table, rows: slice, k: int, value: str) -> Table:
    for line in table[rows]:
        line[k : k + 1] = [value]
    return table


def _vary(table: Table, rows: slice, k: int, rng: Rng) -> Table:
    """Scale, offset and blur a column or three in some rows, or hold them at a number."""
    factor, offset, noise = draw(rng, FACTORS), draw(rng, STEPS) * rng.normal(), draw(rng, STEPS)
    stop = k + int(rng.choice([1, 3]))
    for line in table[rows]:
        line[k:stop] = [change_numbers(f, lambda x: factor * x + offset + noise * rng.normal()) for f in line[k:stop]]
    return table


VARIATIONS: Sequence[TableChange] = (
    lambda table, row, k, rng: _vary(table, slice(row, None), k, rng),
    lambda table, row, k, rng: _vary(table, slice(row), k, rng),
    lambda table, row, k, rng: _vary(table, slice(row, row + int(rng.integers(1, 6))), k, rng),
    lambda table, row, k, rng: [*table[:1], *(line for line in table[1:] if rng.random() > 0.1 * (k + 1))],
    lambda table, row, k, rng: table[: max(row, 2)],
    lambda table, row, k, rng: [*table[:1], *table[max(row, 1) :]],
    lambda table, row, k, rng: [*table[:1], *([*f[:k], *f[k + 1 :], *f[k : k + 1]] for f in table[1:])],
)
"""Given a row and a field: change numbers from it on, up to it or about it, lose rows, move a column's numbers."""


def scramble_table(
    text: str, rng: Rng, separator: str = "", ways: Sequence[TableChange] = BREAKS, most: int = 6
) -> str:
    """Break a table in one to six ways, or change it in so many of others."""
    separator = separator or ("," if "," in text else "   ")
    table = [line.split(separator) for line in text.splitlines()]
    for _ in range(rng.integers(1, most + 1)):
        if table:
            row = int(rng.integers(len(table)))
            table = draw(rng, ways)(table, row, int(rng.integers(max(1, len(table[row])))), rng)
    return "\n".join(separator.join(line) for line in table)


# --- JSON ------------------------------------------------------------------------------------------------------------

LEAVES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 2**63, 10**400, 1e300, -1e-300, float("nan"), float("inf"), "", "x", "smoother", "../..",
    "\0", [], {}, [[]], [1.0, 2.0], {"x": 1}, "9" * 5000,
)  # fmt: skip
NAMES = (
    "smoother", "inertial", "iez", "iqsf-rts", "ma2018", "online", "pocket", "foot", "yaw", "se3", "none", "tuned",
    "as-printed", "physical", "x,y,z", "-y,x,z", "shoe", "acceleration magnitude", "levelled", "chi squared",
)  # fmt: skip
"""What a leaf becomes where its type does not matter; words that mean something in one place or another."""


def change_tree(tree: Any, rng: Rng, breaks: bool) -> Any:
    """Vary one to three leaves of JSON within their type, matrices symmetric; or break it: any leaf, no key."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.integers(1, 4)):
        places = [(h, k) for h, k in list_places(tree) if breaks or not isinstance(h[k], dict | list)]
        if not places:
            break
        holder, key = draw(rng, places)
        leaf, kind = holder[key], rng.integers(5) if breaks else 9
        if kind == 0 and isinstance(holder, dict):
            holder[draw(rng, ("", "unknown", str(key) + "_", "__class__"))] = holder.pop(key)
        elif kind == 1:
            del holder[key]
        elif kind < 9:
            holder[key] = copy.deepcopy(draw(rng, LEAVES))
        elif isinstance(leaf, bool | int):
            holder[key] = (not leaf) if isinstance(leaf, bool) else leaf + draw(rng, (-1, 1, 2, 100))
        else:
            holder[key] = vary_number(leaf, rng) if isinstance(leaf, float) else draw(rng, NAMES)
    for matrix in [h[k] for h, k in list_places(tree) if isinstance(h[k], list) and not breaks]:
        for row in range(len(matrix) if all(isinstance(r, list) and len(r) == len(matrix) for r in matrix) else 0):
            matrix[row][:row] = [matrix[k][row] for k in range(row)]
    return tree


def list_places(tree: Any, depth: int = 50) -> Iterator[tuple[Any, Any]]:
    """Yield each place in JSON, as what holds it and its key there."""
    keys = tree if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) and depth else ()
    for key in keys:
        yield tree, key
        yield from list_places(tree[key], depth - 1)
