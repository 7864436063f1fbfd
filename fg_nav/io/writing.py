"""Recordings and paths out: canonical CSV, plain or in gzip, Parquet with the same columns, and TUM lines.

Recordings are written so that they are read back the same to the last bit.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from types import MappingProxyType

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.mapping import ACC, GYR, MAG, PRESSURE, TIME
from fg_nav.errors import OutputError
from fg_nav.frames import quaternion_xyzw
from fg_nav.recording import RawRecording, Recording
from fg_nav.text import suggest_install

_BLOCK_ROWS = 20_000


def tabulate_samples(recording: Recording | RawRecording) -> tuple[tuple[str, ...], Floats]:
    """Return the names (C,) of the columns that a recording has, and its samples (N, C)."""
    parts = {TIME: recording.t[:, None], ACC: recording.acc, GYR: recording.gyr}
    if recording.mag is not None:
        parts[MAG] = recording.mag
    if recording.pressure is not None:
        parts[PRESSURE] = recording.pressure[:, None]
    return tuple(name for names in parts for name in names), np.concatenate(list(parts.values()), axis=1)


def format_rows(table: Floats, number: str, separator: str) -> Iterator[str]:
    """Format the rows of a table (N, C), one number by `%`, in blocks: three times faster than row by row."""
    template = separator.join([number] * table.shape[1]) + "\n"
    for begin in range(0, len(table), _BLOCK_ROWS):
        block = table[begin : begin + _BLOCK_ROWS]
        yield (template * len(block)) % tuple(block.ravel().tolist())


def _write_text(path: Path, header: str, blocks: Iterator[str]) -> None:
    """Write a file; raises `OutputError` if it cannot be written."""
    try:
        with path.open("w", encoding="ascii", newline="\n") as file:
            file.write(header)
            file.writelines(blocks)
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}): check the path and its permissions.") from None


def write_canonical(recording: Recording | RawRecording, path: Path | str) -> None:
    """Write a recording as canonical CSV; reading it back gives the same numbers.

    Raises `OutputError` if the file cannot be written.
    """
    names, table = tabulate_samples(recording)
    _write_text(Path(path), ",".join(names) + "\n", (text.replace("nan", "") for text in format_rows(table, "%r", ",")))


def write_gzip(recording: Recording | RawRecording, path: Path) -> None:
    """Write a recording as canonical CSV in gzip; raises `OutputError` if the file cannot be written."""
    plain = path.with_suffix("")
    write_canonical(recording, plain)
    path.write_bytes(gzip.compress(plain.read_bytes(), compresslevel=6, mtime=0))
    plain.unlink()


def write_parquet(recording: Recording | RawRecording, path: Path) -> None:
    """Write a recording as Parquet; raises `OutputError` if pyarrow is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise OutputError(
            f"{path.name}: pyarrow writes Parquet, and is not installed: {suggest_install('parquet')}."
        ) from None
    names, samples = tabulate_samples(recording)
    pyarrow.parquet.write_table(pyarrow.table(dict(zip(names, samples.T, strict=True))), path)


WRITERS: Mapping[str, Callable[[Recording | RawRecording, Path], None]] = MappingProxyType(  # Writer for each ending.
    {".csv": write_canonical, ".csv.gz": write_gzip, ".parquet": write_parquet}
)


def choose_writer(path: Path) -> Callable[[Recording | RawRecording, Path], None]:
    """Choose the writer by the ending of a file's name; raises `OutputError` if there is none for it."""
    for ending, writer in WRITERS.items():
        if path.name.lower().endswith(ending):
            return writer
    raise OutputError(f"{path.name} has no ending that is written here: choose one of {', '.join(WRITERS)}.")


def write_tum(path: Path | str, t: Floats, position: Floats, nav_R_body: Floats) -> None:
    """Write a trajectory as TUM lines `t x y z qx qy qz qw`, to the nanosecond and nanometer.

    `t` (N,) s, `position` (N, 3) m, `nav_R_body` (N, 3, 3).

    Raises `OutputError` if the file cannot be written.
    """

    def tabulate(rows: slice) -> Floats:  # the quaternions of a block are in memory together
        return np.column_stack([t[rows], position[rows], quaternion_xyzw(nav_R_body[rows])])

    blocks = (slice(start, start + _BLOCK_ROWS) for start in range(0, len(t), _BLOCK_ROWS))
    _write_text(Path(path), "", chain.from_iterable(format_rows(tabulate(block), "%.9f", " ") for block in blocks))
