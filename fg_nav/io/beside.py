"""Measurements in files beside a recording: truth, position fixes, satellite fixes, air pressure (docs/formats.md).

Of several columns of time of a barometer, and of units where the name has none, those count that make it and the
recording run at the same time.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.headers import find_factor, read_header
from fg_nav.columns.mapping import find_pressure
from fg_nav.columns.samples import convert_pressure
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, choose_sensor, explain_library, read_content
from fg_nav.io.matlab import mat_array
from fg_nav.io.readers.phones import put_on_recording_clock
from fg_nav.io.streams import find_nearest_rows
from fg_nav.io.tables import TextTable, find_header
from fg_nav.recording import RawRecording
from fg_nav.truth import Fix, FootprintTruth, Gnss, TrajectoryTruth

TUM_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
CSV_COLUMNS = ("stride", "x_m", "y_m")
C3D_KEY = b"\x50"  # Second byte of a C3D file.


def read_tum(content: Content) -> TrajectoryTruth:
    """Read TUM lines."""
    path = content.path
    comments = next((k for k, line in enumerate(content.lines) if not line.startswith("#")), 0)
    fields = content.lines[comments].split() if content.lines else []
    if len(fields) != len(TUM_COLUMNS):
        raise FormatError(
            f"{path.name} is no truth read here: give TUM lines (t x y z qx qy qz qw), "
            f"a CSV with stride,x_m,y_m, or a MATLAB file of footprints."
        )
    table, row = TextTable(content, TUM_COLUMNS, comments + 1, r"\s+").read_numbers(range(8))
    unit = np.zeros(len(table), dtype=np.bool_)
    small = (np.abs(table[:, 4:]) < 1.1).all(axis=1)  # and finite, so that it may be squared
    unit[small] = np.abs(np.linalg.norm(table[small, 4:], axis=1) - 1.0) < 0.01
    rising = np.concatenate(([True], table[1:, 0] > table[:-1, 0]))
    wrong = ~(np.isfinite(table).all(axis=1) & unit & rising)
    if wrong.any():
        raise FormatError(
            f"{path.name}, line {row[np.argmax(wrong)]}: stamps must rise and quaternions have length 1; "
            f"correct or delete that line."
        )
    from scipy.spatial.transform import Rotation  # slow to load, and few walks have a truth

    return TrajectoryTruth(table[:, 0], table[:, 1:4], Rotation.from_quat(table[:, 4:]).as_matrix())


def read_c3d(content: Content, marker: str | None = None) -> TrajectoryTruth:
    """Read the path of a marker of a C3D file (needs ezc3d), from 0 s at its first frame on; z is up."""
    path = content.path
    with explain_library(path.name, "a C3D file", "ezc3d", "c3d"):
        import ezc3d

        file = ezc3d.c3d(str(path))
        point, frames = file["parameters"]["POINT"], np.asarray(file["data"]["points"], dtype=np.float64)
        names, rate_hz = list(point["LABELS"]["value"]), float(point["RATE"]["value"][0])
        scale = 1.0 if point["UNITS"]["value"][:1] == ["m"] else 1e-3
    chosen = choose_sensor(names, marker, path, "markers", f"`--truth {path.name}:")
    position = scale * frames[:3, names.index(chosen)].T
    truth = pack_true_path(np.arange(len(position)) / rate_hz, position)
    if truth is None:
        raise FormatError(f"{path.name} has no frame with marker '{chosen}': name another behind the colon.")
    return truth


def read_footprint_mat(content: Content) -> FootprintTruth:
    """Footprints from `GCP_meters` (M, 2), `GCP_stride_numbers` (M,) and, where there, `numberOfStrides`."""
    path, variables = content.path, content.load_variables()
    xy = mat_array(variables, "GCP_meters", path, columns=2)
    stride = mat_array(variables, "GCP_stride_numbers", path)
    if len(stride) != len(xy):
        raise FormatError(f"{path.name} has {len(xy)} footprints but {len(stride)} stride numbers: export it again.")
    count = mat_array(variables, "numberOfStrides", path) if "numberOfStrides" in variables else np.empty(0)
    return pack_footprints(stride, xy, int(count[0]) if count.size and np.isfinite(count[0]) else None, path)


def pack_footprints(
    stride: Floats, xy: Floats, stride_count: int | None, path: Path, t: Floats | None = None
) -> FootprintTruth:
    """Check and pack footprints `xy` (M, 2) m with stride numbers `stride` (M,) and, where known, times `t` (M,) s."""
    if not all(np.isfinite(part).all() for part in (stride, xy, *([] if t is None else [t]))):
        raise FormatError(f"{path.name} has a footprint that is not finite: correct or delete it.")
    whole = (stride >= 0).all() and (stride == np.round(stride)).all() and (stride < 2**31).all()
    if not whole or (np.diff(stride) <= 0).any():
        raise FormatError(f"{path.name}: stride numbers must be whole and rising, 0 at the start: correct them.")
    return FootprintTruth(stride=stride.astype(np.int64), xy=xy, stride_count=stride_count, t=t)


def pack_true_path(t: Floats, position: Floats, nav_R_body: Floats | None = None) -> TrajectoryTruth | None:
    """Pack a true path: `t` (M,) s, `position` (M, 3) m, `nav_R_body` (M, 3, 3), NaN where the reference saw nothing.

    Rows that are not finite or not later are left out; None if not two rows are usable.
    """
    seen = np.isfinite(t) & np.isfinite(position).all(axis=1)
    if nav_R_body is not None:
        seen &= np.isfinite(nav_R_body).all(axis=(1, 2))
    before = np.concatenate(([-np.inf], np.maximum.accumulate(np.where(seen, t, -np.inf))[:-1]))
    seen &= t > before
    if np.count_nonzero(seen) < 2:
        return None
    return TrajectoryTruth(t[seen], position[seen], None if nav_R_body is None else nav_R_body[seen])


# Measurements

FIX_COLUMNS = ("time_s", "x_m", "y_m", "z_m", "sigma_m")
GEODETIC_COLUMNS = ("time_s", "latitude_deg", "longitude_deg", "height_m", "sigma_m")  # Without height_m too.

_GNSS_COLUMNS = {  # Names by their letters alone, without units, the first that is there.
    "time": ("secondselapsed", "times", "time", "t", "seconds"),
    "latitude": ("latitude", "latitudedeg", "lat", "latdeg"),
    "longitude": ("longitude", "longitudedeg", "lon", "londeg", "lng"),
    "accuracy": ("horizontalaccuracy", "horizontalaccuracym", "accuracy", "accuracym", "hacc", "haccm", "sigmam"),
}

_UNITS = re.compile(r"\(.*\)|\[.*\]")


def read_fixes(path: Path | str) -> tuple[Fix, ...]:
    """Read the fixes of a file, in m, or in degrees, which become m east, north and up of the first one.

    Raises `FormatError` if a column is missing, a field is no number or (but for heights) empty, or a sigma is not
    above 0.
    """
    content = read_content(Path(path))
    names = content.fields()
    columns = FIX_COLUMNS if "latitude_deg" not in names else GEODETIC_COLUMNS
    is_flat = "height_m" in columns and "height_m" not in names
    table, line = TextTable(content, names).read_columns([one for one in columns if not is_flat or one != "height_m"])
    table = np.insert(table, 3, np.nan, axis=1) if is_flat else table
    needed = np.isfinite(np.delete(table, 3, axis=1)).all(axis=1) & ~np.isinf(table[:, 3])
    on_earth = (columns is FIX_COLUMNS) | (np.abs(table[:, 1:3]) <= [90.0, 180.0]).all(axis=1)
    for good, what in (
        (needed, f"lacks a number (only {columns[3]} may be empty)"),
        (table[:, 4] > 0, "has no sigma above zero"),
        (on_earth, "is no place on the Earth"),
    ):
        if not good.all():
            raise FormatError(f"{content.path.name}, line {line[np.argmin(good)]} {what}: correct or delete that line.")
    origin = None
    if columns is GEODETIC_COLUMNS:
        from pymap3d import geodetic2enu

        (latitude, longitude), height = table[0, 1:3].tolist(), table[:, 3]
        seen = np.flatnonzero(np.isfinite(height))
        zero = float(height[seen[0]]) if len(seen) else 0.0
        known, origin = np.where(np.isnan(height), zero, height), (latitude, longitude, zero if len(seen) else None)
        enu = np.column_stack(geodetic2enu(table[:, 1], table[:, 2], known, latitude, longitude, zero))
        table[:, 1:4] = np.where(np.isnan(table[:, 1:4]), np.nan, enu)
    return tuple(
        Fix(t, np.array([x, y, np.nan_to_num(z)]), sigma, float("inf") if np.isnan(z) else float(sigma), origin)
        for t, x, y, z, sigma in table.tolist()
    )


def read_gnss(path: Path | str) -> Gnss:
    """Return the fixes of a receiver in level axes with their origin, from a table or the `Location.csv` of a folder.

    Raises `FormatError` if there is no such table, a column is missing, or no row is a fix.
    """
    content = read_content(Path(path))
    tables = [one for place, one in content.members.items() if re.search(r"(^|/)location\.csv$", place, re.IGNORECASE)]
    if content.members and not tables:
        raise FormatError(f"{content.path.name} holds no Location.csv: record the location too, or give a CSV of it.")
    table = tables[0] if tables else content
    # columns
    header = find_header(table, lambda names: {"latitude", "longitude"} <= _find_gnss_columns(names).keys())
    found = {} if header is None else _find_gnss_columns(header.names)
    if header is None or len(found) < len(_GNSS_COLUMNS):
        missing = ", ".join(what for what in _GNSS_COLUMNS if what not in found)
        needed = "fixes have time_s, latitude, longitude (deg) and accuracy (m)"
        raise FormatError(f"{table.path.name} has no column of {missing}: {needed}.")
    values, _ = header.read_columns([found[what] for what in _GNSS_COLUMNS])
    # rows that are fixes
    t, latitude, longitude, accuracy = values[np.isfinite(values).all(axis=1)].T
    good = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 360.0) & (accuracy > 0.0)
    if not good.any():
        raise FormatError(f"{table.path.name} holds no fix with an accuracy above zero: was there a view of the sky?")
    t, latitude, longitude, accuracy = (x[good] for x in (t, latitude, longitude, accuracy))
    if tables:
        t = put_on_recording_clock(content, t)
    # level axes of the origin
    from pymap3d import geodetic2enu

    first = int(np.argmax(accuracy <= 2.0 * np.median(accuracy)))
    origin = float(latitude[first]), float(longitude[first])
    east, north, _ = geodetic2enu(latitude, longitude, 0.0, *origin, 0.0)
    fixes = tuple(
        Fix(float(time), np.array([x, y, 0.0]), float(sigma))
        for time, x, y, sigma in zip(t, east, north, accuracy, strict=True)
    )
    return Gnss(fixes, *origin)


def _find_gnss_columns(names: Sequence[str]) -> dict[str, str]:
    """Names of the columns of fixes, by what they are."""
    letters = {re.sub(r"[^a-z]", "", _UNITS.sub("", name).lower()): name for name in names}
    known = ((what, word) for what, words in _GNSS_COLUMNS.items() for word in words[::-1])
    return {what: letters[word] for what, word in known if word in letters}  # of one quantity the first word


def add_barometer(raw: RawRecording, path: Path) -> RawRecording:
    """Return the recording with the pressure (Pa) of the file `path`, placed at the nearest of its samples."""
    content = read_content(path)
    header = find_header(content, lambda names: find_pressure(names) is not None)
    channel = None if header is None else find_pressure(header.names)
    if header is None or channel is None:
        raise FormatError(f"{path.name} names no pressure: give a table with the columns time_s and pressure_pa.")
    notes: list[str] = []
    pressure = convert_pressure(header.read_columns(channel.names)[0][:, 0], channel, notes)
    if pressure is None:
        why = notes[-1] if notes else f"'{channel.names[0]}' has no reading"
        raise FormatError(f"{path.name}: {why}; give pressures in Pa, hPa or kPa, or leave --barometer out.")
    known = np.isfinite(raw.t)
    rows, t = np.flatnonzero(known), raw.t[known]
    order = np.argsort(t, kind="stable")
    if len(t) < 2:
        return raw
    stamps = _find_stamps(header, float(t[order[0]]), float(t[order[-1]]), path)
    found = np.flatnonzero(np.isfinite(pressure) & np.isfinite(stamps))
    at, chosen = find_nearest_rows(stamps[found], t[order])
    placed = np.full(len(raw.t), np.nan)
    placed[rows[order[at]]] = pressure[found[chosen]]
    note = f"pressure of {path.name} in {int(np.isfinite(placed).sum())} rows"
    provenance = replace(raw.provenance, notes=(*raw.provenance.notes, *notes, note))
    return replace(raw, pressure=placed, provenance=provenance)


def _find_stamps(header: TextTable, first: float, last: float, path: Path) -> Floats:
    """Return stamps (N,) s of a barometer, by the column and unit that best overlap `first` to `last` (s)."""
    best, share, spans = np.empty(0), 0.0, list[str]()
    for name in header.names:
        meaning = read_header(name)
        if meaning is None or meaning.kind != "time":
            continue
        said = meaning.unit if meaning.unit and find_factor("time", meaning.unit) else None
        t = header.read_columns([name])[0][:, 0]
        for unit in ("s", "ms", "us", "ns") if said is None else (said,):
            stamps = t * (find_factor("time", unit) or 1.0)
            begins, ends = (float(edge) for edge in np.nanquantile(stamps, [0.0, 1.0]))
            common = min(ends, last) - max(begins, first)
            if common > share * (max(ends, last) - min(begins, first)):
                best, share = stamps, common / (max(ends, last) - min(begins, first))
            spans.append(f"{begins:.1f} to {ends:.1f} s")
    if not spans:
        raise FormatError(f"{path.name} has no time: give a table with the columns time_s and pressure_pa.")
    if not len(best):
        words = f"{path.name} has pressures from {spans[0]} and the recording is from {first:.1f} to {last:.1f} s"
        raise FormatError(f"{words}: give the file of the same recording, with stamps on its clock.")
    return best
