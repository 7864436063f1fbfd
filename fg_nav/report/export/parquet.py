"""Parquet: a table of the path, a row a sample, and beside it one of the footfalls, with the columns of `strides.csv`.

What the columns mean stands in the attributes of the tables (`DataFrame.attrs`). `time_utc` is there where it is known.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from fg_nav.report.export.track import FRAME, Track


def write(track: Track, path: Path, beside: Path) -> None:
    """Write the path, and the footfalls beside it."""
    _write_table(track, track.tabulate(), path)
    _write_table(track, track.footfalls.copy(), beside)


def _write_table(track: Track, table: pd.DataFrame, path: Path) -> None:
    if track.epoch_s is not None:
        instants = pd.to_datetime((table["time_s"] + track.epoch_s) * 1e6, unit="us", utc=True)
        table.insert(1, "time_utc", instants.dt.as_unit("us"))
    table.attrs = {"name": track.name, "method": track.method, "frame": FRAME}
    table.to_parquet(path, engine="pyarrow", index=False)
