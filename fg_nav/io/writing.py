"""Recordings out: canonical CSV, plain or in gzip, or Parquet with the same columns, by the ending of the file's name.

Numbers are written so that they are read back the same to the last bit.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from fg_nav.errors import OutputError
from fg_nav.io.readers.canonical import tabulate_samples, write_canonical
from fg_nav.recording import RawRecording, Recording


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
            f"{path.name}: pyarrow writes Parquet, and is not installed: pip install 'fg-nav[parquet]'."
        ) from None
    names, samples = tabulate_samples(recording)
    pyarrow.parquet.write_table(pyarrow.table(dict(zip(names, samples.T, strict=True))), path)


WRITERS: Mapping[str, Callable[[Recording | RawRecording, Path], None]] = MappingProxyType(
    {".csv": write_canonical, ".csv.gz": write_gzip, ".parquet": write_parquet}
)
"""Writer for each ending."""


def choose_writer(path: Path) -> Callable[[Recording | RawRecording, Path], None]:
    """Choose the writer by the ending of a file's name; raises `OutputError` if there is none for it."""
    for ending, writer in WRITERS.items():
        if path.name.lower().endswith(ending):
            return writer
    raise OutputError(f"{path.name} has no ending that is written here: choose one of {', '.join(WRITERS)}.")
