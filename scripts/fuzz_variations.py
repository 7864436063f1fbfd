"""Changes after which an input can still be read: what is wrong then shows in its numbers alone, behind the readers.

========= ==========================================================================================================
table     text in rows and fields: columns scaled, offset, noisy, held or exchanged, stamps moved, rows left out
tree      of JSON: numbers somewhat else, switches turned, words that mean something elsewhere; matrices symmetric
words     numbers of 8 bytes, as arrays hold them: somewhat else, or one in the place of another
numbers   of a text: a few of them, by up to three times
========= ==========================================================================================================
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from fuzz_mutations import NUMBER, Rng, Table, draw, list_places

FACTORS = (0.3, 0.5, 0.9, 0.999, 1.001, 1.1, 2.0, 3.0, -1.0, 0.0)
STEPS = (0.0, 0.0, 1e-3, 0.1, 1.0, 30.0, 1e3)
"""A number becomes a factor times itself, and a normal deviate times a step."""


def vary_number(number: float, rng: Rng) -> float:
    """Return a number that is somewhat else."""
    return float(draw(rng, FACTORS) * number + draw(rng, STEPS) * rng.normal())


# --- tables ----------------------------------------------------------------------------------------------------------


def vary_table(text: str, rng: Rng, separator: str) -> str:
    """Change the numbers of a table in one to three ways; what is no number stays."""
    table = [line.split(separator) for line in text.splitlines()]
    for _ in range(rng.integers(1, 4)):
        table = draw(rng, TABLE_VARIATIONS)(table, rng)
    return "\n".join([separator.join(row) for row in table] + [""])


def _change_column(table: Table, rng: Rng) -> Table:
    """Change a column, or three, from a row on or up to it."""
    factor, offset, noise = draw(rng, FACTORS), draw(rng, STEPS) * rng.normal(), draw(rng, STEPS)
    return _change_cells(table, rng, lambda number: factor * number + offset + noise * rng.normal())


def _move_stamps(table: Table, rng: Rng) -> Table:
    """Let the clock of the first column begin elsewhere, or go faster or slower."""
    factor, offset = draw(rng, (1.0, 1.0, 0.9, 1.001, 2.0)), draw(rng, STEPS) * rng.normal()
    return [[_change_field(row[0], lambda number: factor * number + offset), *row[1:]] for row in table]


def _hold_column(table: Table, rng: Rng) -> Table:
    """Let a column stay at a number that stands in it."""
    value = vary_number(float(rng.normal()), rng)
    return _change_cells(table, rng, lambda _: value)


def _jump(table: Table, rng: Rng) -> Table:
    """Change single fields."""
    for row in rng.integers(0, len(table), rng.integers(1, 6)) if table else ():
        column = int(rng.integers(len(table[row])))
        table[row][column] = _change_field(table[row][column], lambda number: vary_number(number, rng))
    return table


def _exchange_columns(table: Table, rng: Rng) -> Table:
    """Exchange the numbers of two columns under their headers."""
    one, other = rng.integers(0, max(map(len, table), default=1), 2)
    for row in table[1:]:
        if max(one, other) < len(row):
            row[one], row[other] = row[other], row[one]
    return table


def _leave_out_rows(table: Table, rng: Rng) -> Table:
    """Leave out rows here and there, or all before or behind one."""
    if len(table) < 4:
        return table
    at, kind = int(rng.integers(2, len(table))), rng.integers(3)
    if kind == 0:
        share = rng.choice([0.05, 0.5, 0.9])
        return table[:1] + [row for row in table[1:] if rng.random() > share]
    return table[:at] if kind == 1 else table[:1] + table[at:]


TABLE_VARIATIONS: tuple[Callable[[Table, Rng], Table], ...] = (
    _change_column, _change_column, _move_stamps, _hold_column, _jump, _exchange_columns, _leave_out_rows,
)  # fmt: skip


def _change_cells(table: Table, rng: Rng, change: Callable[[float], float]) -> Table:
    """Change a column or three, mostly of the left, but the first, which has a change of its own."""
    others = max(1, max(map(len, table), default=1) - 1)
    first, many = 1 + int(rng.integers(others, size=2).min()), int(rng.choice([1, 3]))
    start, stop = (0, len(table)) if rng.random() < 0.5 else np.sort(rng.integers(0, len(table) + 1, 2))
    for row in table[start:stop]:
        for k in range(first, min(first + many, len(row))):
            row[k] = _change_field(row[k], change)
    return table


def _change_field(text: str, change: Callable[[float], float]) -> str:
    """Change what stands in a field, written as it was: a whole number stays one."""
    with contextlib.suppress(ValueError, OverflowError):
        number = change(float(text))
        return str(round(number)) if text.strip().lstrip("+-").isdigit() else repr(number)
    return text


def vary_numbers(text: str, rng: Rng) -> str:
    """Change one to four numbers of a text, by up to three times."""
    places = list(NUMBER.finditer(text))
    some = {draw(rng, places) for _ in range(rng.integers(1, 5))} if places else set()
    for found in sorted(some, key=lambda one: -one.start()):
        text = (
            text[: found.start()]
            + _change_field(found[0], lambda number: vary_number(number, rng))
            + text[found.end() :]
        )
    return text


# --- trees and words -------------------------------------------------------------------------------------------------

NAMES = (
    "smoother", "inertial", "iez", "iqsf-rts", "ma2018", "online", "pocket", "foot", "yaw", "se3", "none", "tuned",
    "as-printed", "physical", "x,y,z", "-y,x,z", "shoe", "acceleration magnitude", "levelled", "chi squared",
)  # fmt: skip
"""Words that mean something in one place or another."""


def vary_tree(tree: Any, rng: Rng) -> Any:
    """Change one to three leaves of what JSON holds to others of their type, mostly."""
    tree = copy.deepcopy(tree)
    leaves = [(holder, key) for holder, key in list_places(tree) if not isinstance(holder[key], dict | list)]
    for _ in range(rng.integers(1, 4) if leaves else 0):
        holder, key = draw(rng, leaves)
        holder[key] = _vary_leaf(holder[key], rng)
    if rng.random() < 0.8:
        for matrix in _list_matrices(tree):
            for row in range(len(matrix)):
                matrix[row][:row] = [matrix[k][row] for k in range(row)]
    return tree


def _vary_leaf(leaf: Any, rng: Rng) -> Any:
    if isinstance(leaf, bool):
        return not leaf
    if isinstance(leaf, int):
        return leaf + int(rng.choice([-1, 1, 2, 100])) if rng.random() < 0.7 else leaf * 2
    if isinstance(leaf, float):
        return vary_number(leaf, rng)
    return draw(rng, NAMES) if isinstance(leaf, str) else draw(rng, (*NAMES, 1, 0.5, 10.0, True))


def _list_matrices(tree: Any) -> Iterator[list[list[float]]]:
    for holder, key in list_places(tree):
        found = holder[key]
        if isinstance(found, list) and found and all(isinstance(row, list) and len(row) == len(found) for row in found):
            yield found


def vary_words(data: bytes, rng: Rng) -> bytes:
    """Change one to three of the numbers of 8 bytes that some bytes are, floating or whole."""
    changed, many = bytearray(data), len(data) // 8
    for _ in range(rng.integers(1, 4) if many else 0):
        at, other = (8 * int(place) for place in rng.integers(0, many, 2))
        changed[at : at + 8] = draw(rng, WORD_VARIATIONS)(data[at : at + 8], data[other : other + 8], rng)
    return bytes(changed)


WORD_VARIATIONS: tuple[Callable[[bytes, bytes, Rng], bytes], ...] = (
    lambda word, other, rng: other,
    lambda word, other, rng: (int.from_bytes(word, "little") + int(rng.choice([1, 2, 50]))).to_bytes(9, "little")[:8],
    lambda word, other, rng: np.float64(vary_number(float(np.frombuffer(word)[0]), rng)).tobytes(),
)
"""What becomes of one, given another."""
