"""The formats a recording may have, and the one way in: `read`.

A format is recognized from the content of the file, never from its name. A folder or an archive is tried first as a
recording as a whole; else it is searched for the one that it holds. Of a file that is no recording a sentence says what
it is nearest to, what it lacks, and what to type next.
"""

from __future__ import annotations

import codecs
import math
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from fg_nav.columns.headers import read_header
from fg_nav.columns.mapping import Columns, parse_columns, shorten_names
from fg_nav.errors import FormatError
from fg_nav.io.aiding import add_barometer
from fg_nav.io.content import BINARY, MATLAB, MEMBERS, TEXT, Content, read_content
from fg_nav.io.readers import known_tables as known
from fg_nav.io.readers import matlab_sets as sets
from fg_nav.io.readers import phones, ros, table, xsens
from fg_nav.io.readers import wearables as worn
from fg_nav.io.tables import ZIP_MARK, TextTable, open_table
from fg_nav.io.truth import C3D_KEY, CSV_COLUMNS, pack_footprints, read_c3d, read_footprint_mat, read_tum
from fg_nav.plugins import find_plugins
from fg_nav.recording import NOMINAL_SIGMA, RawRecording, Recording, note_nominal_rate
from fg_nav.samples.stamps import MAX_BRIDGED_S
from fg_nav.truth import Truth

RATE, SENSOR = "rate", "sensor"


@dataclass(frozen=True)
class Format:
    """A file format: how it is recognized and how it is read.

    `recognizes` returns something true for a content of the format. `read` raises `FormatError` if a sensor or a column
    is missing or doubled, a unit is not known, a field is no number, the file is damaged, or it is not said which of
    several sensors to take. `kinds` are those of content that it may have, `options` what the user may have to say: the
    rate, or a sensor.
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
    Format("canonical", known.is_canonical, known.read_canonical),
    Format("sensorconnect", known.find_sensorconnect, known.read_sensorconnect),
    Format("pyshoe", _hold("imu", "zv_shoe_opt"), sets.read_pyshoe, (MATLAB,)),
    Format("gdlbio", _hold("imu_data", "strideIndex"), sets.read_gdlbio, (MATLAB,)),
    Format("openshoe", known.is_openshoe, known.read_openshoe),
    Format("phyphox", phones.is_phyphox, phones.read_phyphox, (MEMBERS, TEXT)),
    Format("sensor-logger", phones.find_tables, phones.read_sensor_logger, (MEMBERS, TEXT)),
    *(Format(one.name, one.recognizes, one.read, options=(RATE,) * one.is_epoch) for one in phones.APPS),
    Format("gnss-logger", phones.is_gnss_logger, phones.read_gnss_logger),
    Format("xio", worn.is_xio, worn.read_xio, (TEXT, MEMBERS)),
    Format("xsens", xsens.is_mt, xsens.read_mt, options=(RATE,)),
    Format("xsens-dot", xsens.is_dot, xsens.read_dot),
    Format("metawear", worn.is_metawear, worn.read_metawear, (TEXT, MEMBERS), (SENSOR,)),
    Format("movesense", worn.is_movesense, worn.read_movesense),
    Format("shimmer", known.find_shimmer, known.read_shimmer, options=(SENSOR,)),
    Format("apdm", known.find_apdm, known.read_apdm, options=(SENSOR,)),
    Format("vectornav", known.is_vectornav, known.read_vectornav),
    Format("yei", known.find_yei, known.read_yei),
    Format("ros", ros.recognizes, ros.read, (BINARY, MEMBERS), (SENSOR,)),
    Format("broad", _hold("imu_acc", "imu_gyr"), sets.read_broad, (MATLAB,)),
    Format("table", table.recognizes, table.read, (TEXT, BINARY, MEMBERS, MATLAB), (RATE, SENSOR)),
    Format("tables", table.are_sensor_tables, table.read_sensor_tables, (MEMBERS,), (SENSOR,)),
)

FORMATS: Mapping[str, Format] = MappingProxyType({one.name: one for one in _ALL})  # Those known here, by name.


def list_formats() -> dict[str, Format]:
    """Formats by name, last those of other packages (`fg_nav.plugins`); raises `PluginError` as `find_plugins`."""
    return {**FORMATS, **find_plugins("readers", Format)}


@dataclass(frozen=True)
class Reading:
    """How a file is to be read, where its content does not say.

    Attributes
    ----------
    format : a name of `list_formats` to read it as; without one the format is recognized from the content.
    columns : of a table, which are what: `time=ts[ms],acc=ax:ay:az[g],gyr=gx:gy:gz[deg/s]` (`fg_nav.columns.mapping`).
    rate_hz : the rate of a file that has neither a clock nor a rate.
    rate_sigma : of that rate, a share of it.
    sensor : which of several sensors in the file.
    longest_gap_s : a recording is cut at a longer one.
    barometer : file with the pressure of the air, of a barometer with a file of its own.
    """

    format: str | None = None
    columns: str | Columns | None = None
    rate_hz: float | None = None
    sensor: str | None = None
    longest_gap_s: float = MAX_BRIDGED_S
    rate_sigma: float = NOMINAL_SIGMA
    barometer: Path | str | None = None

    def read(self, path: Path | str) -> Recording:
        """Read a recording, as `fg_nav.io.read`."""
        return Recording.from_raw(self.read_raw(path), self.longest_gap_s)

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


def read_raw(
    path: Path | str,
    format: str | None = None,
    *,
    columns: str | Columns | None = None,
    rate_hz: float | None = None,
    sensor: str | None = None,
    barometer: Path | str | None = None,
) -> RawRecording:
    """Read what a file says, unchecked; parameters and `FormatError` as of `read`."""
    return Reading(format, columns, rate_hz, sensor, barometer=barometer).read_raw(path)


def _find_recording(content: Content, chosen: Format | None) -> tuple[Format, Content]:
    """Return the format of the recording in `content`, and the part that holds it; a file is of the `chosen` format.

    Raises `FormatError` if there is none, or a folder or archive holds several.
    """
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

_MARKS = (
    ((b"\xd0\xcf\x11\xe0",), "an old Excel file: save it as CSV"),
    ((b"SQLite format 3",), "a database without topics of sensor_msgs/Imu: record these"),
    ((b"%PDF",), "a PDF: export the samples as CSV"),
    ((b"\x89PNG", b"\xff\xd8\xff"), "a picture: give the recording"),
    ((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE), "text in UTF-32: save it in UTF-8"),
    (
        (b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf", b"Rar!"),
        "packed by bzip2, xz, zstd, 7z or RAR: unpack it",
    ),
)


def _explain_unknown(content: Content) -> str:
    """Return a sentence for content of unknown format: the nearest format or file type, and the remedy."""
    name = content.path.name
    if content.kind == MEMBERS:
        packed = next((place for place, part in content.members.items() if part.head.startswith(ZIP_MARK)), None)
        holds = f"{shorten_names(list(content.members), 6)}, of which none is a recording; give the one that is"
        if packed is not None:
            holds = f"an archive in itself, unpack it and give '{packed}'"
        return _explain_table(content) or f"{name} is in none of the formats read here: it holds {holds}."
    words = _explain_own(content)
    if words is None:
        words = next((said for marks, said in _MARKS if content.head.startswith(marks)), None)
        # Latin text in UTF-16: every second byte is zero, and no other
        halves = (content.head[::2], content.head[1::2])
        if len(content.head) > 1 and any(not any(a) and all(b) for a, b in (halves, halves[::-1])):
            words = "text in UTF-16 without a byte-order mark: save it in UTF-8"
    if words is not None:
        return f"{name} is no recording but {words}."
    nearest = _explain_table(content) or table.explain_sensor_tables([content])
    if nearest is not None:
        return nearest
    what = "text without a table of numbers" if content.lines else "a binary file of an unknown kind"
    return (
        f"{name} is in none of the {len(list_formats())} formats read here, but {what}: export its samples as a table "
        f"with the columns t,ax,ay,az,gx,gy,gz, and type fg-nav inspect "
        f"{shlex.quote(str(content.path.with_suffix('.csv')))}."
    )


def _explain_own(content: Content) -> str | None:
    """Name a truth, fixes or calibration given as the recording, and the option for it; None for other content."""
    path, fields = shlex.quote(str(content.path)), set(content.fields())
    if "stride" in fields:
        return f"footprints: give them as the truth, fg-nav run RECORDING --truth {path}"
    if fields >= {"time_s", "x_m", "y_m", "sigma_m"}:
        return f"known positions: give them as fg-nav run RECORDING --fixes {path}"
    if any('"fg-nav calibration"' in line for line in content.lines[:20]):
        return f"a calibration: give it as fg-nav run RECORDING --calibration {path}"
    # stamps, positions and quaternions of length one
    rows = [line.split() for line in content.lines[:40] if line.strip() and not line.startswith("#")][:20]
    try:
        lengths = [math.hypot(*list(map(float, row))[4:8]) for row in rows]
    except ValueError:
        return None
    if rows and all(len(row) == 8 for row in rows) and all(abs(length - 1.0) < 5e-4 for length in lengths):
        return f"a true path (t x y z qx qy qz qw): give it as fg-nav run RECORDING --truth {path}"
    return None


def _explain_table(content: Content) -> str | None:
    """Return a sentence on what a table lacks to be read by its header; None if the content is no table."""
    name = content.path.name
    try:
        opened = open_table(content)
        if opened is None:
            return None
        is_named = not table.find_kinds(opened).isdisjoint(("acc", "gyr", "no gravity"))
        if content.variables and not is_named:
            listed = shorten_names(sorted(content.variables), 8)
            return (
                f"{name} is no recording but a MATLAB file with the variables {listed}: save the samples in arrays "
                f"t (N,), acc (N, 3) and gyr (N, 3)."
            )
        unnamed = sum(read_header(column) is None for column in opened.names)
        if opened.has_header and unnamed < 3 and (single := table.explain_sensor_tables([content])):
            return single
        if not opened.has_header or is_named:
            table.choose(content, opened)
    except FormatError as error:
        return str(error)
    return (
        f"{name} is nearest to a table, with the columns {shorten_names(opened.names, 12)}, of which none names "
        f"acceleration or angular rate: say which they are, {table.suggest_by_numbers(content)}."
    )
