"""Air pressure in a file of its own beside a recording (`--barometer`), put on the recording's clock.

Its columns are found by their names (`fg_nav.columns.choice.find_pressure`); without a unit of pressure in the name the
size of the readings says it. Stamps are in the recording's clock. Their unit, where the name has none, and which of
several columns of time, are those that make both run at the same time.

A reading is put at the row of the recording that is nearest in time, and of several at one row the nearest: rows
without one are NaN.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.choice import find_pressure
from fg_nav.columns.headers import read_header
from fg_nav.columns.samples import convert_pressure
from fg_nav.columns.units import find_factor
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, read_content
from fg_nav.io.delimited import Header, find_header
from fg_nav.io.streams import find_nearest_rows
from fg_nav.recording import RawRecording

TIME_UNITS = ("s", "ms", "us", "ns")


def add_barometer(raw: RawRecording, path: Path) -> RawRecording:
    """Return a recording with the pressure of a file.

    Raises `FormatError` if the file has no time or no pressure of air, or ran at another time.
    """
    content = read_content(path)
    header = find_header(content, lambda names: find_pressure(names) is not None)
    channel = None if header is None else find_pressure(header.names)
    if header is None or channel is None:
        raise FormatError(f"{path.name} names no pressure: give a table with the columns time_s and pressure_pa.")
    notes: list[str] = []
    pressure = convert_pressure(header.read(content, [*channel.names])[0][:, 0], channel, notes)
    if pressure is None:
        why = notes[-1] if notes else f"'{channel.names[0]}' has no reading"
        raise FormatError(f"{path.name}: {why}; give pressures in Pa, hPa or kPa, or leave --barometer out.")
    known = np.isfinite(raw.t)
    rows, t = np.flatnonzero(known), raw.t[known]
    order = np.argsort(t, kind="stable")
    if len(t) < 2:
        return raw
    stamps = _find_stamps(content, header, float(t[order[0]]), float(t[order[-1]]), path)
    found = np.flatnonzero(np.isfinite(pressure) & np.isfinite(stamps))
    at, chosen = find_nearest_rows(stamps[found], t[order])
    placed = np.full(len(raw.t), np.nan)
    placed[rows[order[at]]] = pressure[found[chosen]]
    note = f"pressure of {path.name} in {int(np.isfinite(placed).sum())} rows"
    provenance = replace(raw.provenance, notes=(*raw.provenance.notes, *notes, note))
    return replace(raw, pressure=placed, provenance=provenance)


def _find_stamps(content: Content, header: Header, first: float, last: float, path: Path) -> Floats:
    """Stamps (N,) s of a barometer beside a recording from `first` to `last`, s."""
    best, share, spans = np.empty(0), 0.0, list[str]()
    for name in header.names:
        meaning = read_header(name)
        if meaning is None or meaning.kind != "time":
            continue
        said = meaning.unit if meaning.unit and find_factor("time", meaning.unit) else None
        t = header.read(content, [name])[0][:, 0]
        for unit in TIME_UNITS if said is None else (said,):
            stamps = t * (find_factor("time", unit) or 1.0)
            begins, ends = (float(edge) for edge in np.nanquantile(stamps, [0.0, 1.0]))
            common = min(ends, last) - max(begins, first)
            if common > share * (max(ends, last) - min(begins, first)):
                best, share = stamps, common / (max(ends, last) - min(begins, first))
            spans.append(f"{begins:.1f} to {ends:.1f} s")
    if not spans:
        raise FormatError(f"{path.name} has no time: give a table with the columns time_s and pressure_pa.")
    if not len(best):
        raise FormatError(
            f"{path.name} has pressures from {spans[0]} and the recording is from {first:.1f} to {last:.1f} s: give "
            "the file of the same recording, with stamps on its clock."
        )
    return best
