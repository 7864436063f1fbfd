"""Whether what a checkpoint holds can be: its bytes are whole, but somebody may have changed them.

Every object of a record is checked, by the annotations of its class and the names of its attributes:

    types           those of the annotations of dataclasses and named tuples
    counts          whole numbers are below `MAX_COUNT`, but keys of variables and sums over samples
    numbers         below `MAX_NUMBER`; places, velocities, biases and what the graph knows are no NaN
    `nav_R_body`    a rotation: orthonormal to `ORTHONORMAL`, determinant 1
    covariances     symmetric, no variance below zero
    tables          parts of one length, numbers of samples in order and not beyond the last
    samples         (n, 11), their stamps in order; what was bad of each is nothing, or one of two sensors

What is believable and still another walk is not found: a checkpoint is as trusted as a recording.
"""

from __future__ import annotations

import traceback
import types
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
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

MAX_COUNT = 10**10  # samples of half a year at 400 Hz; no count is larger
MAX_NUMBER = 1e12  # of any number in SI units; the stamps of a clock in seconds are 2e9
ORTHONORMAL = 1e-5  # that a product of rotations stays within, over any walk
NEGATIVE = -1e-9  # of the largest variance: by so much rounding makes one negative

# Names of what holds whole numbers of another kind, or raw readings as they came.
UNBOUNDED = frozenset(
    {"keys", "left", "waits", "held", "gate", "fields", "behind", "tail", "head", "window", "seen", "_still_since_hole"}
)
# Names of arrays in which every number is known; others hold NaN where there was no field, say.
WITHOUT_GAPS = frozenset({"position", "velocity", "gyro_bias", "acc_bias", "A", "b", "values", "extreme"})
ROTATIONS = frozenset({"nav_R_body"})
COVARIANCES = frozenset({"covariance", "cov", "position_cov", "pose_cov"})


def find_fault(value: object, name: str = "", stop: int = MAX_COUNT) -> str:
    """Return the name of what cannot be in a value, read from a checkpoint of a walk of `stop` samples; "" for none."""
    if isinstance(value, np.ndarray):
        return "" if _is_valid_array(value, name) else name
    if isinstance(value, int | np.integer):
        return "" if name in UNBOUNDED or abs(int(value)) < MAX_COUNT else name
    if isinstance(value, float):
        return "" if name in UNBOUNDED or not abs(value) < np.inf or abs(value) < MAX_NUMBER else name
    kind: Any = type(value)
    hints = _hints_of(kind)
    attributes = dict(_list_parts(value, name))
    wrong = (key for key, hint in hints.items() if key not in attributes or not _fits(attributes[key], hint))
    parts = (find_fault(part, key.split("[")[0], stop) for key, part in attributes.items())
    # The parts are bounded before they are compared.
    found = next(wrong, "") or next(filter(None, parts), "")
    return found or ("" if _is_valid_table(value, stop) else str(kind.__name__))


def is_in_order(rows: object, columns: int) -> bool:
    """Whether samples (n, columns) are rising stamps, bounded force, rate and field, and which of the first was bad."""
    if not (isinstance(rows, np.ndarray) and rows.ndim == 2 and rows.shape[1] == columns and rows.dtype == float):
        return False
    known = bool(np.isin(rows[:, COLUMNS:], (0, ACC_OUT, GYR_OUT)).all())
    bounded = bool(find_squarable(np.nan_to_num(rows[:, 1:COLUMNS])).all())  # NaN is no field
    return known and bounded and bool(np.isfinite(rows[:, :7]).all() and (np.diff(rows[:, 0]) > 0).all())


def refuse_damaged(path: Path, records: Sequence[Record], stop: int) -> None:
    """Raise `FormatError` if something in the records of a walk of `stop` samples cannot be."""
    for record, before in zip(records, (None, *records), strict=False):
        fault = find_fault(record, stop=stop)
        # numbers that do not fit the others, or the record before
        if not fault and not 0 <= record.kept_from <= record.first + len(record.rows):
            fault = "kept_from"
        if not fault and (record.first < 0 or record.n_reported < 0):
            fault = "first"
        if not fault and before is not None:
            behind = before.first + len(before.rows)
            adjacent = record.first == behind and len(record.rows) > 0 and len(before.rows) > 0
            if record.first < behind or (adjacent and not record.rows[0, 0] > before.rows[-1, 0]):
                fault = "order of its records"
        if not fault and record.changes is not None and not record.changes.stances.is_sound():
            fault = "stances"
        if fault:
            raise _damaged(path, fault)


@contextmanager
def report_damaged(path: Path) -> Iterator[None]:
    """Raise `FormatError` if values that each can be cannot be together, whatever that raises in the block."""
    try:
        yield
    except (FgNavError, OSError):
        raise
    except Exception as error:
        raise _damaged(path, type(error).__name__) from error


@contextmanager
def doubt_resumed(path: Path | None) -> Iterator[None]:
    """Raise `EstimationError` if a walk that was resumed from a checkpoint cannot go on: its values may be wrong.

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
        # the last module and line of this package that the error passed
        frames = traceback.extract_tb(error.__traceback__)
        place = [frame for frame in frames if "fg_nav" in Path(frame.filename).parts][-1]
        what = f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}"
        raise EstimationError(
            f"the walk resumed from {path.name} cannot go on ({what}): the checkpoint was changed or damaged, or this "
            "is a bug; begin again without it."
        ) from error


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
    if not (is_dataclass(kind) or hasattr(kind, "_fields")):
        return {}
    try:
        hints = get_type_hints(kind)
    except NameError:  # what is imported for the type checker alone
        return {}
    names = [field.name for field in fields(kind)] if is_dataclass(kind) else kind._fields
    return {name: hints[name] for name in names if name in hints}


def _fits(value: object, hint: Any) -> bool:
    """Whether a value is of a type, as far as that can be seen."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is np.ndarray:
        (number,) = get_args(parts[1]) or (None,)
        known = {np.floating: "f", np.integer: "iu", np.bool_: "b"}.items() if isinstance(number, type) else ()
        kinds = next((kind for base, kind in known if issubclass(number, base)), "biuf")
        return isinstance(value, np.ndarray) and value.dtype.kind in kinds
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


def _is_valid_array(array: np.ndarray[Any, Any], name: str) -> bool:
    if array.dtype.kind != "f":
        return array.dtype.kind != "c" and (
            name in UNBOUNDED or not array.size or bool((np.abs(array) < MAX_COUNT).all())
        )
    if name in UNBOUNDED:
        return True
    finite = array[np.isfinite(array)]
    known = ~np.isnan(array) if name == "extreme" else np.isfinite(array)
    if (name in WITHOUT_GAPS and not known.all()) or (finite.size and np.abs(finite).max() > MAX_NUMBER):
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


def _is_valid_table(value: object, stop: int) -> bool:
    """Whether the parts of a table belong together."""
    if isinstance(value, PathNodes):
        n, sample = len(value.sample), value.sample
        if [part.shape for part in value] != [(n,), (n, 3), (n, 3), (n, 3, 3), (n, 3), (n, 3)]:
            return False
        inside = bool(((sample >= 0) & (sample < stop)).all())
        return sample.dtype.kind == "i" and inside and bool((np.diff(sample) > 0).all())
    if isinstance(value, RowTable):
        n = len(value.which)
        if n == 0:
            return value.first >= 0
        if value.numbers.shape != (n, 40) or value.first < 0 or not (value.which >= 0).all():
            return False
        at = value.numbers[:, 0]  # inf and NaN are no whole numbers
        if value.which.max() >= len(value.words) or not ((at >= 0) & (at < stop)).all():
            return False
        rows = split_rows(value.rows())
        ordered = bool((np.diff(rows.t) >= 0).all())
        return ordered and _is_rotation(rows.nav_R_body) and all(map(_is_covariance, rows.pose_cov))
    if isinstance(value, FootfallTable):
        n, intervals = len(value.counts), len(value.start)
        columns = value.stillest, value.continues, value.line, value.until
        if any(len(column) != n for column in columns) or not len(value.stop) == len(value.threshold) == intervals:
            return False
        if value.first < 0 or (value.counts < 1).any() or int(value.counts.sum()) != intervals:
            return False
        within = (value.start >= 0) & (value.start < value.stop) & (value.stop <= stop)
        return bool(within.all()) and bool(((value.stillest >= 0) & (value.stillest < stop)).all())
    if isinstance(value, Return):
        n = value.t.size
        parts = value.t, value.earlier_t, value.field_uT, value.earlier_field_uT
        if n == 0 or [part.shape for part in parts] != [(n,), (n,), (n, 3), (n, 3)]:
            return False
        known = all(bool(np.isfinite(part).all()) for part in (*parts, value.score, value.expected_false))
        return known and bool(np.isfinite(value.length_m)) and bool((np.diff(value.t) >= 0).all())
    return True
