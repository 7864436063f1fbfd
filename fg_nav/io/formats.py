"""The formats a recording may have, and the one way in: `read`.

A folder or an archive is tried first as a recording as a whole; else it is searched for the one that it holds. Of a
file that is no recording a sentence says what it is or lacks, and what to type next.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fg_nav.columns.headers import read_header
from fg_nav.columns.mapping import ACC, GYR, MAG, TIME, Columns, find_pressure, parse_columns, shorten_names
from fg_nav.columns.samples import convert_pressure
from fg_nav.errors import FormatError
from fg_nav.io.beside import (
    C3D_KEY,
    CSV_COLUMNS,
    add_barometer,
    pack_footprints,
    read_c3d,
    read_footprint_mat,
    read_tum,
)
from fg_nav.io.content import BINARY, MATLAB, MEMBERS, TEXT, Content, read_content
from fg_nav.io.readers import binary, phones, table
from fg_nav.io.readers import known_tables as known
from fg_nav.io.readers import wearables as worn
from fg_nav.io.tables import TextTable, open_table
from fg_nav.plugins import find_plugins
from fg_nav.recording import NOMINAL_SIGMA, Provenance, RawRecording, Recording, note_nominal_rate
from fg_nav.samples.stamps import MAX_BRIDGED_S
from fg_nav.truth import Truth

RATE, SENSOR = "rate", "sensor"


def is_canonical(content: Content) -> bool:
    """Whether the first line names at least one of the format's acc or gyr columns, and none that names sensors."""
    names = content.fields()
    return not {*ACC, *GYR}.isdisjoint(names) and not any(map(table.SENSOR_WORD.search, names))


def read_canonical(content: Content) -> RawRecording:
    """Read a CSV of this project; mag and pressure may be absent, and empty where there is no sample."""
    rows, notes = TextTable(content, content.fields()), list[str]()
    magnetic = () if set(MAG).isdisjoint(rows.names) else MAG
    further = [name for name in rows.names if name not in (*TIME, *ACC, *GYR, *MAG)]
    air = find_pressure(further) if further else None
    values, row = rows.read_columns([*TIME, *ACC, *GYR, *magnetic, *(air.names if air else ())])
    pressure = convert_pressure(values[:, -1], air, notes) if air else None
    mag, provenance = values[:, 7:10] if magnetic else None, Provenance(content.path, "canonical", tuple(notes))
    return RawRecording(
        values[:, 0], values[:, 1:4], values[:, 4:7], row, mag, provenance=provenance, pressure=pressure
    )


@dataclass(frozen=True)
class Format:
    """A file format: how it is recognized and how it is read.

    `recognizes` returns something true for a content of the format. `read` raises `FormatError` if the content is
    incomplete, damaged or leaves a choice. `kinds` are those of content that it may have, `options` what the user may
    have to say: the rate, or a sensor.
    """

    name: str
    recognizes: Callable[[Content], object]
    read: Callable[[Content], RawRecording]
    kinds: tuple[str, ...] = (TEXT,)
    options: tuple[str, ...] = ()


def _hold(*names: str) -> Callable[[Content], bool]:
    """Whether a MATLAB file holds a variable of one of these names."""
    return lambda content: not content.variables.isdisjoint(names)


_ALL = (
    Format("canonical", is_canonical, read_canonical),
    Format("sensorconnect", known.find_sensorconnect, known.read_sensorconnect),
    Format("pyshoe", _hold("imu", "zv_shoe_opt"), binary.read_pyshoe, (MATLAB,)),
    Format("gdlbio", _hold("imu_data", "strideIndex"), binary.read_gdlbio, (MATLAB,)),
    Format("openshoe", known.is_openshoe, known.read_openshoe),
    Format("phyphox", phones.is_phyphox, phones.read_phyphox, (MEMBERS, TEXT)),
    Format("sensor-logger", phones.find_tables, phones.read_sensor_logger, (MEMBERS, TEXT)),
    *(Format(one.name, one.recognizes, one.read, options=(RATE,) * one.is_epoch) for one in phones.APPS),
    Format("gnss-logger", phones.is_gnss_logger, phones.read_gnss_logger),
    Format("xio", worn.is_xio, worn.read_xio, (TEXT, MEMBERS)),
    Format("xsens", worn.is_mt, worn.read_mt, options=(RATE,)),
    Format("xsens-dot", worn.is_dot, worn.read_dot),
    Format("metawear", worn.is_metawear, worn.read_metawear, (TEXT, MEMBERS), (SENSOR,)),
    Format("movesense", worn.is_movesense, worn.read_movesense),
    Format("shimmer", known.find_shimmer, known.read_shimmer, options=(SENSOR,)),
    Format("apdm", known.find_apdm, known.read_apdm, options=(SENSOR,)),
    Format("vectornav", known.is_vectornav, known.read_vectornav),
    Format("yei", known.find_yei, known.read_yei),
    Format("ros", binary.is_bag, binary.read_bag, (BINARY, MEMBERS), (SENSOR,)),
    Format("broad", _hold("imu_acc", "imu_gyr"), binary.read_broad, (MATLAB,)),
    Format("table", table.recognizes, table.read, (TEXT, BINARY, MEMBERS, MATLAB), (RATE, SENSOR)),
    Format("tables", table.are_sensor_tables, table.read_sensor_tables, (MEMBERS,), (SENSOR,)),
)

FORMATS: Mapping[str, Format] = MappingProxyType({one.name: one for one in _ALL})  # Those known here, by name.


def list_formats() -> dict[str, Format]:
    """Formats by name, last those of other packages (`fg_nav.plugins`); raises `PluginError` as `find_plugins`."""
    return {**FORMATS, **find_plugins("readers", Format)}


@dataclass(frozen=True)
class Reading:
    """How a file is to be read, where its content does not say."""

    format: str | None = None  #: A name of `list_formats` to read it as; without one it is recognized from the content.
    columns: str | Columns | None = None  #: Of a table: `acc=ax:ay:az[g],...` (`fg_nav.columns.mapping`).
    rate_hz: float | None = None  #: The rate of a file that has neither a clock nor a rate.
    sensor: str | None = None  #: Which of several sensors in the file.
    longest_gap_s: float = MAX_BRIDGED_S  #: A recording is cut at a longer one.
    rate_sigma: float = NOMINAL_SIGMA  #: Of the rate that is given, a share of it.
    barometer: Path | str | None = None  #: File with the pressure of the air, of a barometer with a file of its own.

    def read(self, path: Path | str) -> Recording:
        """Read a recording, as `fg_nav.io.read`."""
        return Recording.from_raw(self.read_raw(path), self.longest_gap_s)

    @np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
    def read_raw(self, path: Path | str) -> RawRecording:
        """Read what a file says, unchecked; raises `FormatError` as `fg_nav.io.read`."""
        format = self.format
        if format is not None and format not in FORMATS and format not in list_formats():
            raise FormatError(f"there is no format '{format}': choose one of {', '.join(list_formats())}.")
        if self.columns is not None and format not in (None, "table"):
            raise FormatError(f"--columns maps a table, and the format given is '{format}': leave one of them out.")
        columns = parse_columns(self.columns) if isinstance(self.columns, str) else self.columns
        content = read_content(Path(path))
        format = "table" if columns is not None else format
        wanted = None if format is None else FORMATS.get(format) or list_formats()[format]
        chosen, found = _find_recording(content, wanted)
        for option, value in ((RATE, self.rate_hz), (SENSOR, self.sensor)):
            if value is not None and option not in chosen.options:
                raise FormatError(
                    f"{found.path.name} is of format '{chosen.name}', which has no {option} to choose: "
                    f"leave --{option} out."
                )
        raw = chosen.read(replace(found, columns=columns, rate_hz=self.rate_hz, sensor=self.sensor))
        if self.rate_hz is not None:
            raw = note_nominal_rate(raw, self.rate_sigma)
        return raw if self.barometer is None else add_barometer(raw, Path(self.barometer))


def read(
    path: Path | str,
    format: str | None = None,
    *,
    columns: str | Columns | None = None,
    rate_hz: float | None = None,
    sensor: str | None = None,
    barometer: Path | str | None = None,
) -> Recording:
    """Read a recording that estimators can use: a file, folder or archive; the other parameters are those of `Reading`.

    Raises `FormatError` if the file cannot be read, or its format is not known; raises `RecordingError` if what it
    holds cannot be navigated with (`Recording.from_raw`).

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> recording.provenance.format
    'canonical'
    """
    return Reading(format, columns, rate_hz, sensor, barometer=barometer).read(path)


def read_raw(path: Path | str, format: str | None = None, **how: Any) -> RawRecording:
    """Read what a file says, unchecked; parameters and `FormatError` as of `read`."""
    return Reading(format, **how).read_raw(path)


def _find_recording(content: Content, chosen: Format | None) -> tuple[Format, Content]:
    """Return the format of the recording in `content`, and the part that holds it; a file is of the `chosen` format."""
    name, fits = content.path.name, chosen is not None and content.kind in chosen.kinds
    if chosen is not None and fits and not content.members:
        return chosen, content
    found = list(_find_all(content, FORMATS.values() if chosen is None else [chosen]))
    if chosen is None and not found:
        found = list(_find_all(content, find_plugins("readers", Format).values()))
    if len(found) > 1:
        names = ", ".join(part.path.relative_to(content.path).as_posix() for _, part in found[:3])
        more = ", ..." if len(found) > 3 else ""
        unpacked = "" if content.path.is_dir() else ", unpacked"
        raise FormatError(f"{name} holds {len(found)} recordings ({names}{more}): give one of them{unpacked}.")
    if found:
        return found[0]
    if chosen is not None and fits:
        return chosen, content
    if chosen is not None:
        kinds = " or ".join(chosen.kinds)
        raise FormatError(f"{name} is not {kinds}, so it cannot be '{chosen.name}': leave the format out.")
    if "GCP_meters" in content.variables:
        raise FormatError(f"{name} holds surveyed footprints, no recording: give it as the truth.")
    raise FormatError(_explain_unknown(content))


def _find_all(content: Content, formats: Collection[Format]) -> Iterator[tuple[Format, Content]]:
    """Recordings in a content: itself, or those of its files and folders."""
    for one in formats:
        if content.kind in one.kinds and one.recognizes(content):
            yield one, content
            return
    for part in content.parts():
        found = list(_find_all(part, formats))
        if not found:
            part.opened.clear()
        yield from found


def read_truth(path: Path | str) -> Truth:
    """Read a true path or surveyed footprints, by the content; a marker of a C3D file stands behind a colon.

    Raises `FormatError` if the file holds neither, or is damaged.

    Examples
    --------
    >>> type(fg_nav.read_truth("truth.tum")).__name__
    'TrajectoryTruth'
    """
    marker, path = None, Path(path)
    if not path.exists() and ".c3d:" in path.name.lower():
        name, _, marker = path.name.rpartition(":")
        path = path.with_name(name)
    content = read_content(path)
    if content.head[1:2] == C3D_KEY and path.suffix.lower() == ".c3d":
        return read_c3d(content, marker)
    if "GCP_meters" in content.variables:
        return read_footprint_mat(content)
    if content.variables:  # a recording that carries its truth
        of_matlab = (one for one in FORMATS.values() if MATLAB in one.kinds and one.recognizes(content))
        truth = next((raw.truth for one in of_matlab if (raw := one.read(content)).truth is not None), None)
        if truth is None:
            raise FormatError(f"{path.name} holds neither footprints nor a true path: give another file.")
        return truth
    if not set(CSV_COLUMNS).isdisjoint(content.fields()):
        footprints, _ = TextTable(content, content.fields()).read_columns(CSV_COLUMNS)
        return pack_footprints(footprints[:, 0], footprints[:, 1:], None, path)
    return read_tum(content)


# What is no recording

_PACKED = (b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf", b"Rar!")  # bzip2, xz, zstd, 7z, RAR.


def _explain_unknown(content: Content) -> str:
    """Return a sentence for content of unknown format: what it is or lacks, and the remedy."""
    name, path, fields = content.path.name, shlex.quote(str(content.path)), set(content.fields())
    # a truth, fixes or a calibration given as the recording
    if "stride" in fields:
        return f"{name} is no recording but footprints: give them as the truth, fg-nav run RECORDING --truth {path}."
    if fields >= {"time_s", "sigma_m"} and not fields.isdisjoint({"x_m", "latitude_deg"}):
        return f"{name} is no recording but known positions: give them as fg-nav run RECORDING --fixes {path}."
    if any('"fg-nav calibration"' in line for line in content.lines[:20]):
        return f"{name} is no recording but a calibration: give it as fg-nav run RECORDING --calibration {path}."
    with suppress(FormatError):
        if content.lines and read_tum(content):
            return f"{name} is no recording but a true path (TUM): give it as fg-nav run RECORDING --truth {path}."
    # a table without the columns of a sensor
    try:
        opened = open_table(content)
        unnamed = 0 if opened is None else sum(read_header(column) is None for column in opened.names)
        if unnamed < 3 and (alone := table.explain_sensor_tables([content])) is not None:
            return alone
        if opened is not None:
            table.choose(content, opened)
    except FormatError as error:
        return str(error)
    what = "text without a table of numbers"
    if content.kind == MEMBERS:
        what = f"a folder with {shorten_names(list(content.members), 6)}, none of them a recording (archives stay shut)"
    elif content.head.startswith(_PACKED):
        return f"{name} is packed in a way that is not read here: unpack it."
    elif not content.lines:
        what = "a binary file of an unknown kind, or text that is not in UTF-8, UTF-16 with a mark or Latin-1"
    return (
        f"{name} is in none of the {len(list_formats())} formats read here, but {what}: export its samples as a table "
        f"with the columns t,ax,ay,az,gx,gy,gz, and type fg-nav inspect "
        f"{shlex.quote(str(content.path.with_suffix('.csv')))}."
    )
