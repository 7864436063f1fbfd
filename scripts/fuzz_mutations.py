"""What can be wrong with an input: each mutation takes a value and a generator, and returns another value.

========= ==========================================================================================================
samples   rows (n, 10) of t s, acc m/s^2, gyr rad/s, mag uT: axes, units, scale, stamps, losses, outliers, blocks
bytes     of any file: flips, insertions, deletions, cuts, zeros, other encodings, packed
table     text in rows and fields: fields replaced, columns and rows lost, doubled, swapped
numbers   of a text: signs, other units, beyond all bounds, none at all
tree      of JSON: leaves replaced, keys lost, added or renamed
========= ==========================================================================================================

`scripts/fuzz.py` and `scripts/online_fuzz.py` draw from here, and the tests of broken files.
"""

from __future__ import annotations

import contextlib
import copy
import gzip
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2

Rng: TypeAlias = np.random.Generator
T = TypeVar("T")
Mutation: TypeAlias = Callable[[T, Rng], T]

ACC, GYR, MAG = slice(1, 4), slice(4, 7), slice(7, 10)
SENSORS = (ACC, GYR, MAG)


def draw(rng: Rng, some: Sequence[T]) -> T:
    """Draw one of these, whatever they are."""
    return some[int(rng.integers(len(some)))]


def span(rows: Floats, rng: Rng, shortest_s: float, longest_s: float) -> slice:
    """Draw a span of samples, its duration even in the logarithm."""
    period = float(np.median(np.diff(rows[:, 0]))) if len(rows) > 1 else 1.0
    wished = np.exp(rng.uniform(np.log(shortest_s), np.log(longest_s))) / period
    count = int(np.clip(wished, 1, len(rows))) if wished > 0 else 1
    start = int(rng.integers(0, max(1, len(rows) - count)))
    return slice(start, start + count)


# --- samples: losses and stamps --------------------------------------------------------------------------------------


def lose_spans(rows: Floats, rng: Rng) -> Floats:
    """Leave out 0.05 to 5 s, one to three times."""
    for _ in range(rng.integers(1, 4)):
        rows = np.delete(rows, span(rows, rng, 0.05, 5.0), axis=0) if len(rows) > 100 else rows
    return rows


def spoil_spans(rows: Floats, rng: Rng) -> Floats:
    """Put NaN, infinity or 1e9 into acc, gyr or both for 0.02 to 3 s."""
    for _ in range(rng.integers(1, 4)):
        rows[span(rows, rng, 0.02, 3.0), draw(rng, (ACC, GYR, slice(1, 7)))] = rng.choice([np.nan, np.inf, 1e9])
    return rows


def spoil_samples(rows: Floats, rng: Rng) -> Floats:
    """Take single samples away."""
    rows[rng.integers(0, len(rows), rng.integers(1, 6)), rng.integers(1, 7)] = np.nan
    return rows


def cut_start(rows: Floats, rng: Rng) -> Floats:
    """Begin in the middle of the walk."""
    return rows[rng.integers(0, len(rows) // 3) :]


def drop_field(rows: Floats, rng: Rng) -> Floats:
    """Take the magnetometer away, for a time or throughout."""
    rows[slice(None) if rng.random() < 0.3 else span(rows, rng, 0.5, 20.0), MAG] = np.nan
    return rows


def break_stamps(rows: Floats, rng: Rng) -> Floats:
    """Repeat stamps, send samples again, send one far ahead, or begin the clock again."""
    margin = min(10, len(rows) // 4)
    at = int(rng.integers(margin, len(rows) - margin))
    kind = rng.choice(["repeated", "backward", "ahead", "restart"])
    if kind == "repeated":
        return np.repeat(rows, np.where(np.arange(len(rows)) % 41 == 3, 2, 1), axis=0)
    if kind == "backward":
        return np.concatenate([rows[:at], rows[max(0, at - 30) : at], rows[at:]])
    if kind == "ahead":
        return np.insert(rows, at, rows[at] + 1e5 * np.eye(rows.shape[1])[0], axis=0)
    rows[at:, 0] -= rows[at, 0] - rows[0, 0]
    return rows


def distort_clock(rows: Floats, rng: Rng) -> Floats:
    """Stamps in another unit, of another epoch, rounded, jittering, constant, reversed or out of order."""
    t = rows[:, 0] - rows[0, 0]
    rows[:, 0] = draw(rng, CLOCKS)(t, rng)
    return rows


CLOCKS: tuple[Mutation[Floats], ...] = (
    lambda t, rng: t * float(rng.choice([1e3, 1e6, 1e9, 1e-3])),
    lambda t, rng: (t + 1.7e9) * float(rng.choice([1.0, 1e3, 1e6, 1e9])),
    lambda t, rng: np.round(t, int(rng.integers(1, 4))),
    lambda t, rng: t + rng.normal(0.0, rng.choice([1e-3, 0.01, 0.1]), len(t)),
    lambda t, rng: np.sort(t + rng.normal(0.0, rng.choice([1e-3, 0.01, 0.1]), len(t))),
    lambda t, rng: 0.0 * t + float(rng.normal()),
    lambda t, rng: t[::-1].copy(),
    lambda t, rng: rng.permutation(t),
    lambda t, rng: t * float(rng.uniform(0.3, 3.0)),
    lambda t, rng: t - float(rng.choice([1e4, 1e9, 1e15])),
    lambda t, rng: t + np.where(t > rng.uniform(0.0, t[-1]), rng.choice([0.3, 3.0, 1e4, 1e9]), 0.0),
    lambda t, rng: np.where(rng.random(len(t)) < rng.choice([0.001, 0.1, 1.0]), np.nan, t),
)


# --- samples: what the sensors read ----------------------------------------------------------------------------------


def clip(rows: Floats, rng: Rng) -> Floats:
    """Let gyroscope and accelerometer clip at 250 to 600 deg/s and 30 to 80 m/s^2."""
    rate, force = np.radians(rng.uniform(250.0, 600.0)), rng.uniform(30.0, 80.0)
    rows[:, GYR] = np.clip(rows[:, GYR], -rate, rate)
    rows[:, ACC] = np.clip(rows[:, ACC], -force, force)
    return rows


def pass_magnet(rows: Floats, rng: Rng) -> Floats:
    """Let a magnet of up to 300 uT at the sensor pass by within 0.3 to 3 s."""
    for _ in range(rng.integers(1, 4)):
        middle = rows[rng.integers(len(rows)), 0]
        shape = np.exp(-(((rows[:, 0] - middle) / rng.uniform(0.15, 1.5)) ** 2))
        rows[:, MAG] += shape[:, None] * rng.normal(0.0, 1.0, 3) * rng.uniform(10.0, 300.0)
    return rows


def negate(rows: Floats, rng: Rng) -> Floats:
    """Negate one sensor, or one axis of one or of all of them."""
    which = draw(rng, SENSORS)
    kind, axis = rng.integers(3), int(rng.integers(3))
    columns = [which] if kind == 0 else [which.start + axis] if kind == 1 else [one.start + axis for one in SENSORS]
    for column in columns:
        rows[:, column] *= -1.0
    return rows


def swap_columns(rows: Floats, rng: Rng) -> Floats:
    """Swap two axes of one sensor or of all, or two sensors."""
    one, other = rng.choice(3, 2, replace=False)
    kind = rng.integers(3)
    if kind == 0:
        rows[:, [*range(1, 10)]] = rows[:, _swap_sensors(int(one), int(other))]
        return rows
    for sensor in SENSORS if kind == 1 else [draw(rng, SENSORS)]:
        rows[:, [sensor.start + one, sensor.start + other]] = rows[:, [sensor.start + other, sensor.start + one]]
    return rows


def _swap_sensors(one: int, other: int) -> list[int]:
    order = [0, 1, 2]
    order[one], order[other] = other, one
    return [1 + 3 * sensor + axis for sensor in order for axis in range(3)]


UNITS: Mapping[int, tuple[float, ...]] = {
    ACC.start: (1 / GRAVITY_M_S2, 1e3 / GRAVITY_M_S2, 1e3, 1e-3),
    GYR.start: (np.degrees(1.0), 1e3, 1e-3, np.radians(1.0)),
    MAG.start: (0.01, 10.0, 1e3, 1e-6),
}
"""A sensor's SI value times this is in g, mg, mm/s^2; deg/s, mrad/s; gauss, mG, nT, T."""


def change_units(rows: Floats, rng: Rng) -> Floats:
    """Give one sensor in another unit, or all but the stamps."""
    for sensor in SENSORS if rng.random() < 0.2 else [draw(rng, SENSORS)]:
        rows[:, sensor] *= rng.choice(UNITS[sensor.start])
    return rows


def scale(rows: Floats, rng: Rng) -> Floats:
    """Scale a sensor, or one axis of it, by 0.3 to 3, and offset it."""
    sensor = draw(rng, SENSORS)
    column = sensor if rng.random() < 0.5 else sensor.start + int(rng.integers(3))
    rows[:, column] *= np.exp(rng.uniform(np.log(0.3), np.log(3.0)))
    rows[:, column] += rng.choice([0.0, 0.01, 0.3, 10.0]) * rng.normal()
    return rows


def add_outliers(rows: Floats, rng: Rng) -> Floats:
    """Add to one axis of single samples, or of bursts of five."""
    sensor, many = draw(rng, SENSORS), int(rng.choice([1, 1, 3, 30]))
    for start in rng.integers(0, len(rows), many):
        stop = start + int(rng.choice([1, 5]))
        rows[start:stop, sensor.start + int(rng.integers(3))] += rng.choice([-1, 1]) * rng.choice([30.0, 100.0, 300.0])
    return rows


def put_extremes(rows: Floats, rng: Rng) -> Floats:
    """Put numbers beyond all bounds into single fields."""
    for _ in range(rng.integers(1, 10)):
        rows[rng.integers(len(rows)), rng.integers(10)] = rng.choice([np.nan, np.inf, -np.inf, 1e38, -1e200, 1e308])
    return rows


def freeze(rows: Floats, rng: Rng) -> Floats:
    """Let a sensor, or all, stay as they are for a time or from then on."""
    where = span(rows, rng, 0.1, 20.0)
    stop = len(rows) if rng.random() < 0.3 else where.stop
    columns = draw(rng, (*SENSORS, slice(1, 10)))
    rows[where.start : stop, columns] = 0.0 if rng.random() < 0.3 else rows[where.start, columns]
    return rows


def add_noise(rows: Floats, rng: Rng) -> Floats:
    """Make a sensor noisy, or coarse."""
    sensor, size = draw(rng, SENSORS), float(rng.choice([0.1, 1.0, 10.0]))
    if rng.random() < 0.5:
        rows[:, sensor] += rng.normal(0.0, size, rows[:, sensor].shape)
    else:
        rows[:, sensor] = np.round(rows[:, sensor] / size) * size
    return rows


def move_blocks(rows: Floats, rng: Rng) -> Floats:
    """Repeat, swap, reverse or shuffle a block; its stamps go with it, or stay."""
    where, t = span(rows, rng, 0.05, 5.0), rows[:, 0].copy()
    block, kind = rows[where].copy(), rng.integers(4)
    if kind == 0:
        rows = np.concatenate([rows[: where.stop], block, rows[where.stop :]])
        t = np.concatenate([t, t[-1] + t[1 : len(block) + 1] - t[0]]) if len(t) > len(block) else rows[:, 0].copy()
    elif kind == 1:
        rows = np.concatenate([block, rows[: where.start], rows[where.stop :]])
    else:
        rows[where] = block[::-1] if kind == 2 else rng.permutation(block)
    rows[:, 0] = t if rng.random() < 0.5 and len(t) == len(rows) else rows[:, 0]
    return rows


def thin(rows: Floats, rng: Rng) -> Floats:
    """Take every second to twentieth sample only."""
    return rows[:: int(rng.choice([2, 4, 20]))]


SAMPLE_MUTATIONS: Mapping[str, Mutation[Floats]] = {
    "clipped": clip, "magnet": pass_magnet, "no field": drop_field, "gap": lose_spans, "burst": spoil_spans,
    "single": spoil_samples, "cut": cut_start, "stamps": break_stamps, "clock": distort_clock, "negated": negate,
    "swapped": swap_columns, "units": change_units, "scaled": scale, "outliers": add_outliers,
    "extremes": put_extremes, "frozen": freeze, "noise": add_noise, "blocks": move_blocks, "thinned": thin,
}  # fmt: skip
"""By name."""


def mutate_samples(rows: Floats, rng: Rng) -> tuple[Floats, str]:
    """Mutate a recording in one to three ways; return it and the names of the mutations."""
    names = [str(name) for name in rng.choice(list(SAMPLE_MUTATIONS), rng.choice([1, 1, 2, 3]), replace=False)]
    rows = rows.copy()
    for name in names:
        if len(rows) >= 8:
            with np.errstate(all="ignore"):  # what the next one makes of infinity
                rows = SAMPLE_MUTATIONS[name](rows, rng)
    return rows, ", ".join(names)


# --- bytes -----------------------------------------------------------------------------------------------------------


def cut_end(data: bytes, rng: Rng) -> bytes:
    """Leave out the end."""
    return data[: _place(data, rng)]


def flip_bytes(data: bytes, rng: Rng) -> bytes:
    """Change one to eight bytes that follow each other."""
    at, changed = _place(data, rng), bytearray(data)
    for k in range(at, min(at + int(rng.integers(1, 9)), len(data))):
        changed[k] ^= int(rng.integers(1, 256))
    return bytes(changed)


def flip_head(data: bytes, rng: Rng) -> bytes:
    """Change a byte of the first 512, where binary formats say what follows."""
    return flip_bytes(data[:512], rng) + data[512:]


def insert_bytes(data: bytes, rng: Rng) -> bytes:
    """Insert up to 64 random bytes."""
    at = _place(data, rng)
    return data[:at] + rng.bytes(int(rng.integers(65))) + data[at:]


def remove_bytes(data: bytes, rng: Rng) -> bytes:
    """Leave out 1 to 1024 bytes."""
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.choice([1, 4, 64, 1024])) :]


def repeat_bytes(data: bytes, rng: Rng) -> bytes:
    """Repeat 1 to 1024 bytes."""
    at = _place(data, rng)
    return data[: at + int(rng.choice([1, 4, 64, 1024]))] + data[at:]


def fill_bytes(data: bytes, rng: Rng) -> bytes:
    """Overwrite up to 1024 bytes with one value."""
    at, length = _place(data, rng), int(rng.choice([1, 8, 64, 1024]))
    return data[:at] + bytes([int(rng.choice([0, 32, 255]))]) * len(data[at : at + length]) + data[at + length :]


def encode_otherwise(data: bytes, rng: Rng) -> bytes:
    """Encode or pack it otherwise, with other ends of lines, twice, or not at all."""
    return draw(rng, ENCODINGS)(data)


ENCODINGS: tuple[Callable[[bytes], bytes], ...] = (
    lambda data: b"\xef\xbb\xbf" + data,
    lambda data: data.decode("latin-1").encode("utf-16"),
    lambda data: data.decode("latin-1").encode("utf-16-be"),
    lambda data: data.decode("latin-1").encode("utf-32"),
    lambda data: gzip.compress(data, 1, mtime=0),
    lambda data: gzip.compress(data, 1, mtime=0)[: len(data) // 8],
    lambda data: data.replace(b"\n", b"\r\n"),
    lambda data: data.replace(b"\n", b"\r"),
    lambda data: data + data,
    lambda data: b"",
    lambda data: data.replace(b"\n", b""),
    lambda data: data.replace(b".", b","),
)

BYTE_MUTATIONS: Mapping[str, Mutation[bytes]] = {
    "cut": cut_end, "flipped": flip_bytes, "head": flip_head, "inserted": insert_bytes, "removed": remove_bytes,
    "repeated": repeat_bytes, "filled": fill_bytes, "encoding": encode_otherwise,
}  # fmt: skip
"""By name."""


def mutate_bytes(data: bytes, rng: Rng) -> tuple[bytes, str]:
    """Mutate a file in one to three ways; return it and the names of the mutations."""
    names = [str(name) for name in rng.choice(list(BYTE_MUTATIONS), rng.integers(1, 4))]
    for name in names:
        data = BYTE_MUTATIONS[name](data, rng)
    return data, ", ".join(names)


def _place(data: bytes, rng: Rng) -> int:
    return int(rng.integers(0, max(1, len(data))))


# --- text ------------------------------------------------------------------------------------------------------------

FIELDS = (
    "", "nan", "NaN", "inf", "-inf", "1e308", "-1e200", "1e400", "0x1", "1,2", '"', "\0", "١", "-", "--1", "1e", "#",
    "0", "-1", "1_000", "9" * 400, "None", "true", "=1+1", "\u2028", "1\r2",
)  # fmt: skip
"""Texts in place of a number."""

LONG = "x" * 200_000  # In place of one number only.


def scramble_table(text: str, rng: Rng, separator: str = "") -> str:
    """Break a table in one to six ways: replace fields, lose columns and rows, swap and double rows."""
    separator = separator or ("," if "," in text else "   ")
    table = [line.split(separator) for line in text.splitlines()]
    for _ in range(rng.integers(1, 7)):
        table = draw(rng, TABLE_MUTATIONS)(table, rng) if table else [[""]]
    return "\n".join(separator.join(line) for line in table)


Table: TypeAlias = list[list[str]]


def _replace_field(table: Table, rng: Rng) -> Table:
    row, column = _cell(table, rng)
    table[row] = [*table[row][:column], draw(rng, (*FIELDS, LONG)), *table[row][column + 1 :]]
    return table


def _lose_column(table: Table, rng: Rng) -> Table:
    _, column = _cell(table, rng)
    return [line[:column] + line[column + 1 :] for line in table]


def _fill_column(table: Table, rng: Rng) -> Table:
    (_, column), value = _cell(table, rng), draw(rng, FIELDS)
    return table[:1] + [[*line[:column], value, *line[column + 1 :]] for line in table[1:]]


def _swap_rows(table: Table, rng: Rng) -> Table:
    one, other = rng.integers(0, len(table), 2)
    table[one], table[other] = table[other], table[one]
    return table


def _lose_rows(table: Table, rng: Rng) -> Table:
    row, _ = _cell(table, rng)
    return table[:row] + table[row + int(rng.integers(1, 41)) :]


def _double_row(table: Table, rng: Rng) -> Table:
    row, _ = _cell(table, rng)
    return [*table[: row + 1], *table[row:]]


def _send_header_again(table: Table, rng: Rng) -> Table:
    row, _ = _cell(table, rng)
    header = [table[0][k] for k in rng.permutation(len(table[0]))] if rng.random() < 0.5 else table[0]
    return [*table[:row], header, *table[row:]]


def _cut_lines(table: Table, rng: Rng) -> Table:
    row, column = _cell(table, rng)
    return [*table[:row], table[row][:column], *table[row + 1 :]]


TABLE_MUTATIONS: tuple[Mutation[Table], ...] = (
    _replace_field, _lose_column, _fill_column, _swap_rows, _lose_rows, _double_row, _send_header_again, _cut_lines,
)  # fmt: skip


def _cell(table: Table, rng: Rng) -> tuple[int, int]:
    row = int(rng.integers(len(table)))
    return row, int(rng.integers(max(1, len(table[row]))))


def scale_columns(text: str, rng: Rng, separator: str) -> str:
    """Multiply one to three neighboring columns by a factor, as by another unit."""
    table = [line.split(separator) for line in text.splitlines()]
    first, count, factor = int(rng.integers(max(map(len, table), default=1))), rng.integers(1, 4), rng.choice(FACTORS)
    for row in table:
        for k in range(first, min(first + int(count), len(row))):
            with contextlib.suppress(ValueError):
                row[k] = repr(float(row[k]) * float(factor))
    return "\n".join(separator.join(row) for row in table)


NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")

FACTORS = (1e3, 1e-3, -1.0, 100.0, 1e9, 1e300, 0.0, 1e-300, 57.3, 5.0)


def change_numbers(text: str, rng: Rng) -> str:
    """Multiply all numbers, or one in ten, or replace a few, as by another unit."""
    share, factor = rng.choice([1.0, 0.1]), float(rng.choice(FACTORS))
    if rng.random() < 0.5:
        return NUMBER.sub(lambda found: repr(float(found[0]) * factor) if rng.random() < share else found[0], text)
    places = list(NUMBER.finditer(text))
    some = [draw(rng, places) for _ in range(rng.integers(1, 4))] if places else []
    for found in sorted(some, key=lambda one: -one.start()):
        text = text[: found.start()] + draw(rng, FIELDS) + text[found.end() :]
    return text


# --- JSON ------------------------------------------------------------------------------------------------------------

LEAVES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 2**63, 10**400, 1e300, -1e-300, float("nan"), float("inf"), "", "x", "smoother", "../..",
    "\0", [], {}, [[]], [1.0, 2.0], {"x": 1}, "9" * 5000,
)  # fmt: skip
"""What a leaf becomes; and it is scaled where it is a number."""


def mutate_tree(tree: Any, rng: Rng) -> Any:
    """Change one to three places of what JSON holds."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice([1, 1, 2, 3])):
        places = list(list_places(tree))
        if places:
            _change(*draw(rng, places), rng)
    return tree


def list_places(tree: Any, depth: int = 50) -> Any:
    """Yield each place in what JSON holds, as what holds it and its key there."""
    keys = tree if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) and depth else ()
    for key in keys:
        yield tree, key
        yield from list_places(tree[key], depth - 1)


def _change(holder: Any, key: Any, rng: Rng) -> None:
    kind = rng.integers(4)
    if kind == 0 and isinstance(holder, dict):
        holder[draw(rng, ("", "unknown", str(key) + "_", "__class__"))] = holder.pop(key)
    elif kind == 1:
        del holder[key]
    elif kind == 2 and isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
        number = holder[key] if abs(holder[key]) <= sys.float_info.max else np.inf
        holder[key] = float(rng.choice(FACTORS)) * number
    else:
        holder[key] = _nest(1000) if rng.random() < 0.03 else copy.deepcopy(draw(rng, LEAVES))


def _nest(depth: int) -> list[Any]:
    nested: list[Any] = []
    for _ in range(depth):
        nested = [nested]
    return nested
