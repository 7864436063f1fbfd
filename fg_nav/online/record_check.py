"""Whether what a checkpoint holds can be: its bytes are whole, but somebody may have changed them.

Every object of a record is looked at, by what its class says of itself and by what its attributes are called:

    types           those of the annotations of dataclasses and named tuples
    counts          whole numbers are below `MOST`, but keys of variables and sums over samples
    numbers         below `LARGEST`; places, velocities, biases and what the graph knows are no NaN
    `nav_R_body`    a rotation: orthonormal to `ORTHONORMAL`, determinant 1
    covariances     symmetric, no variance below zero
    tables          parts of one length, numbers of samples in order and not beyond the last
    samples         (n, 11), their stamps in order; what was bad of each is nothing, or one of two sensors

What is believable and still another walk is not found: a checkpoint is as trusted as a recording. Where a walk that was
resumed cannot go on, `doubt_resumed` says so.
"""

from __future__ import annotations

import traceback
import types
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError, FgNavError, FormatError
from fg_nav.online.anchor import PathNodes
from fg_nav.online.buffer import COLUMNS
from fg_nav.online.estimates import split_rows
from fg_nav.online.saved_state import FootfallTable, RowTable
from fg_nav.samples.outliers import ACC_OUT, GYR_OUT
from fg_nav.samples.plausibility import find_squarable
from fg_nav.solution import Return

if TYPE_CHECKING:
    from fg_nav.online.checkpoint import Record

MOST = 10**10  # Samples of half a year at 400 Hz; no count is larger.

UNBOUNDED = frozenset(
    {"keys", "left", "waits", "held", "gate", "fields", "behind", "tail", "head", "window", "seen", "_still_since_hole"}
)
"""Names of what holds whole numbers of another kind, or raw readings as they came."""

WITHOUT_GAPS = frozenset({"position", "velocity", "gyro_bias", "acc_bias", "A", "b", "values", "extreme"})
"""Names of arrays in which every number is known; others hold NaN where there was no field, say."""

ROTATIONS = frozenset({"nav_R_body"})
COVARIANCES = frozenset({"covariance", "cov", "position_cov", "pose_cov"})

ORTHONORMAL = 1e-5  # That a product of rotations stays within, over any walk.
NEGATIVE = -1e-9  # Of the largest variance: by so much rounding makes one negative.
LARGEST = 1e12  # Of any number in SI units; the stamps of a clock in seconds are 2e9.


def find_fault(value: object, name: str = "", stop: int = MOST) -> str:
    """Return the name of what cannot be in a value, read from a checkpoint of a walk of `stop` samples; "" for none."""
    if isinstance(value, np.ndarray):
        return "" if _is_sound_array(value, name) else name
    if isinstance(value, int | np.integer):
        return "" if name in UNBOUNDED or abs(int(value)) < MOST else name
    if isinstance(value, float):
        return "" if name in UNBOUNDED or not abs(value) < np.inf or abs(value) < LARGEST else name
    kind: Any = type(value)
    hints = _hints_of(kind)
    attributes = dict(_list_parts(value, name))
    wrong = (key for key, hint in hints.items() if key not in attributes or not _fits(attributes[key], hint))
    parts = (find_fault(part, key.split("[")[0], stop) for key, part in attributes.items())
    # The parts are bounded before they are compared.
    found = next(wrong, "") or next(filter(None, parts), "")
    return found or ("" if _is_sound_table(value, stop) else str(kind.__name__))


def is_in_order(rows: object, columns: int) -> bool:
    """Whether samples (n, columns) are rising stamps, bounded force, rate and field, and which of the first was bad."""
    if not (isinstance(rows, np.ndarray) and rows.ndim == 2 and rows.shape[1] == columns and rows.dtype == float):
        return False
    known = bool(np.isin(rows[:, COLUMNS:], (0, ACC_OUT, GYR_OUT)).all())
    bounded = bool(find_squarable(np.nan_to_num(rows[:, 1:COLUMNS])).all())  # NaN is no field
    return known and bounded and bool(np.isfinite(rows[:, :7]).all() and (np.diff(rows[:, 0]) > 0).all())


def refuse_damaged(path: Path, records: Sequence[Record], stop: int) -> None:
    """Raise `FormatError` where something in the records of a walk of `stop` samples cannot be."""
    for record, before in zip(records, (None, *records), strict=False):
        fault = find_fault(record, stop=stop) or find_misfit(record, before)
        if fault:
            raise _damaged(path, fault)


def find_misfit(record: Record, before: Record | None) -> str:
    """Return the name of a number of a record that does not fit the others, or the record before; "" for none."""
    stop = record.first + len(record.rows)
    if not 0 <= record.kept_from <= stop:
        return "kept_from"
    if record.first < 0 or record.n_reported < 0:
        return "first"
    if before is not None and not _is_behind(record, before):
        return "order of its records"
    return "" if record.changes is None or record.changes.stances.is_sound() else "stances"


def _is_behind(record: Record, before: Record) -> bool:
    stop = before.first + len(before.rows)
    adjacent = record.first == stop and len(record.rows) > 0 and len(before.rows) > 0
    return record.first >= stop and (not adjacent or bool(record.rows[0, 0] > before.rows[-1, 0]))


@contextmanager
def say_damaged(path: Path) -> Iterator[None]:
    """Say so where values that each can be cannot be together, whatever that raises in the block."""
    try:
        yield
    except (FgNavError, OSError):
        raise
    except Exception as error:
        raise _damaged(path, type(error).__name__) from error


@contextmanager
def doubt_resumed(path: Path | None) -> Iterator[None]:
    """Say where a walk cannot go on that was resumed from a checkpoint, if it was: values may be wrong that can be.

    That may be a bug as well, and so the sentence names the place in the program.
    """
    was_resumed = path is not None and path.exists()
    try:
        yield
    except (FgNavError, OSError, MemoryError):
        raise
    except Exception as error:
        if path is None or not was_resumed:
            raise
        what = f"{type(error).__name__} in {_find_place(error)}"
        raise EstimationError(
            f"the walk resumed from {path.name} cannot go on ({what}): the checkpoint was changed or damaged, or this "
            "is a bug; begin again without it."
        ) from error


def _find_place(error: Exception) -> str:
    """Return the last module and line of this package that an error passed."""
    places = [frame for frame in traceback.extract_tb(error.__traceback__) if "fg_nav" in Path(frame.filename).parts]
    return f"{Path(places[-1].filename).name}:{places[-1].lineno}"


def _damaged(path: Path, what: str) -> FormatError:
    return FormatError(f"{path.name} is a checkpoint that was changed or damaged ({what}): name another, or remove it.")


def _list_parts(value: Any, name: str) -> Iterator[tuple[str, object]]:
    """Yield the parts of a value, under their names, those of a list under its own."""
    if isinstance(value, Mapping):
        yield from ((str(key), part) for key, part in value.items())
    elif hasattr(value, "_fields"):
        yield from zip(value._fields, value, strict=True)
    elif isinstance(value, str | bytes | type(None)):
        return
    elif hasattr(value, "__iter__"):
        yield from ((f"{name}[{k}]", part) for k, part in enumerate(value))
    else:
        yield from vars(value).items() if hasattr(value, "__dict__") else ()


@cache
def _hints_of(kind: type[Any]) -> dict[str, Any]:
    """Return the annotations of a dataclass or a named tuple of this package; none of other classes."""
    if not (hasattr(kind, "__dataclass_fields__") or hasattr(kind, "_fields")):
        return {}
    try:
        hints = get_type_hints(kind)
    except NameError:  # what is imported for the type checker alone
        return {}
    names = kind.__dataclass_fields__ if hasattr(kind, "__dataclass_fields__") else kind._fields
    return {name: hints[name] for name in names if name in hints}


def _fits(value: object, hint: Any) -> bool:
    """Whether a value is of a type, as far as that can be seen."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is np.ndarray:
        return isinstance(value, np.ndarray) and (value.dtype.kind in _kinds_of(parts))
    if origin is tuple:
        same = len(parts) == 2 and parts[1] is Ellipsis
        expected = [parts[0]] * len(value) if same and isinstance(value, tuple) else list(parts)
        return isinstance(value, tuple) and len(value) == len(expected) and all(map(_fits, value, expected))
    if origin is not None:
        return not isinstance(origin, type) or isinstance(value, origin)
    if hint is float:
        return isinstance(value, float | int | np.floating | np.integer) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int | np.integer) and not isinstance(value, bool)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    return not isinstance(hint, type) or isinstance(value, hint)


def _kinds_of(parts: tuple[Any, ...]) -> str:
    """Return the kinds of number that an array of some type holds."""
    (number,) = get_args(parts[1]) or (None,)
    if not isinstance(number, type):
        return "biuf"
    return {np.floating: "f", np.integer: "iu", np.bool_: "b"}.get(
        next((base for base in (np.floating, np.integer, np.bool_) if issubclass(number, base)), object), "biuf"
    )


def _is_sound_array(array: np.ndarray[Any, Any], name: str) -> bool:
    if array.dtype.kind != "f":
        return array.dtype.kind != "c" and (name in UNBOUNDED or not array.size or bool((np.abs(array) < MOST).all()))
    if name in UNBOUNDED:
        return True
    finite = array[np.isfinite(array)]
    known = ~np.isnan(array) if name == "extreme" else np.isfinite(array)
    if (name in WITHOUT_GAPS and not known.all()) or (finite.size and np.abs(finite).max() > LARGEST):
        return False
    if name == "values" and array.shape == (4, 4):  # a pose of an anchor
        return bool((array[3] == [0.0, 0.0, 0.0, 1.0]).all()) and _is_rotation(array[:3, :3])
    if name in ROTATIONS:
        return array.shape[-2:] == (3, 3) and _is_rotation(array)
    return name not in COVARIANCES or (array.ndim >= 2 and _is_covariance(array))


def _is_rotation(R: Floats) -> bool:
    R = R.reshape(-1, 3, 3)
    R = R[~np.isnan(R).all(axis=(1, 2))]  # of a footfall without a field
    if not (np.abs(R) < 1.0 + ORTHONORMAL).all():
        return False
    product = R @ np.swapaxes(R, -1, -2)
    return bool((np.abs(product - np.eye(3)) < ORTHONORMAL).all() and (np.linalg.det(R) > 0).all())


def _is_covariance(P: Floats) -> bool:
    if P.shape[-1] != P.shape[-2] or not np.isfinite(P).all():
        return False
    scale = np.abs(P).max(initial=0.0)
    symmetric = bool((np.abs(P - np.swapaxes(P, -1, -2)) <= 1e-6 * scale).all())
    return symmetric and bool((np.linalg.eigvalsh(P) >= NEGATIVE * scale).all())


def _is_sound_table(value: object, stop: int) -> bool:
    """Whether the parts of a table belong together."""
    if isinstance(value, PathNodes):
        shapes = [part.shape for part in value]
        n = len(value.sample)
        return shapes == [(n,), (n, 3), (n, 3), (n, 3, 3), (n, 3), (n, 3)] and _rises(value.sample, stop)
    if isinstance(value, RowTable):
        return _is_sound_row_table(value, stop)
    if isinstance(value, FootfallTable):
        return _is_sound_footfall_table(value, stop)
    if isinstance(value, Return):
        return _is_sound_return(value)
    return True


def _is_sound_row_table(table: RowTable, stop: int) -> bool:
    n = len(table.which)
    if n == 0:
        return table.first >= 0
    if table.numbers.shape != (n, 40) or table.first < 0 or not (table.which >= 0).all():
        return False
    if table.which.max() >= len(table.words):
        return False
    sample = table.numbers[:, 0]  # inf and NaN are no whole numbers
    if not ((sample >= 0) & (sample < stop)).all():
        return False
    rows = split_rows(table.rows())
    ordered = bool((np.diff(rows.t) >= 0).all())
    return ordered and _is_rotation(rows.nav_R_body) and all(map(_is_covariance, rows.pose_cov))


def _is_sound_footfall_table(table: FootfallTable, stop: int) -> bool:
    n, intervals = len(table.counts), len(table.start)
    columns = table.stillest, table.continues, table.told, table.until
    if any(len(column) != n for column in columns) or len(table.stop) != intervals or len(table.threshold) != intervals:
        return False
    if table.first < 0 or (table.counts < 1).any() or int(table.counts.sum()) != intervals:
        return False
    inside = (table.start >= 0) & (table.start < table.stop) & (table.stop <= stop)
    return bool(inside.all()) and bool(((table.stillest >= 0) & (table.stillest < stop)).all())


def _is_sound_return(value: Return) -> bool:
    n = value.t.size
    columns = value.t, value.earlier_t, value.field_uT, value.earlier_field_uT
    if n == 0 or [column.shape for column in columns] != [(n,), (n,), (n, 3), (n, 3)]:
        return False
    known = all(bool(np.isfinite(column).all()) for column in (*columns, value.score, value.expected_false))
    return known and bool(np.isfinite(value.length_m)) and bool((np.diff(value.t) >= 0).all())


def _rises(sample: np.ndarray[Any, Any], stop: int) -> bool:
    inside = bool(((sample >= 0) & (sample < stop)).all())
    return sample.dtype.kind == "i" and inside and bool((np.diff(sample) > 0).all())
