"""The formats a recording may have, and the one way in: `read`.

A format is recognized from the content of the file, never from its name. A folder or an archive is asked first whether
it is a recording as a whole; else it is looked through for the one that it holds.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from fg_nav.columns.mapping import Columns, parse_columns
from fg_nav.errors import FormatError
from fg_nav.io.barometer import add_barometer
from fg_nav.io.content import BINARY, MATLAB, MEMBERS, TEXT, Content, read_content
from fg_nav.io.nearest import explain_unknown
from fg_nav.io.readers import (
    apdm,
    broad,
    canonical,
    gdlbio,
    gnss_logger,
    known_tables,
    metawear,
    movesense,
    openshoe,
    phyphox,
    pyshoe,
    ros,
    sensor_logger,
    sensorconnect,
    shimmer,
    table,
    tables,
    xio,
    xsens_dot,
    xsens_mt,
    yei,
)
from fg_nav.io.truth import C3D_KEY, CSV_COLUMNS, read_c3d, read_footprint_csv, read_footprint_mat, read_tum
from fg_nav.recording import NOMINAL_SIGMA, RawRecording, Recording, note_nominal_rate
from fg_nav.samples.stamps import MAX_BRIDGED_S
from fg_nav.truth import Truth

RATE, SENSOR = "rate", "sensor"


@dataclass(frozen=True)
class Format:
    """A file format: what it is, how it is recognized and how it is read.

    `kinds` are those of content that it may have, `asks` what the user may have to say: the rate, or a sensor.
    """

    name: str
    description: str
    recognizes: Callable[[Content], bool]
    read: Callable[[Content], RawRecording]
    kinds: tuple[str, ...] = (TEXT,)
    asks: tuple[str, ...] = ()


def _by_name(*formats: Format) -> Mapping[str, Format]:
    return MappingProxyType({known.name: known for known in formats})


FORMATS: Mapping[str, Format] = _by_name(
    Format("canonical", "CSV of this project (time_s, acc_x_m_s2, ...)", canonical.recognizes, canonical.read),
    Format("sensorconnect", "LORD/MicroStrain SensorConnect CSV", sensorconnect.recognizes, sensorconnect.read),
    Format("pyshoe", "PyShoe MATLAB file", pyshoe.recognizes, pyshoe.read, (MATLAB,)),
    Format("gdlbio", "MATLAB file of surveyed walks (gdlbio)", gdlbio.recognizes, gdlbio.read, (MATLAB,)),
    Format("openshoe", "OpenShoe text", openshoe.recognizes, openshoe.read),
    Format("phyphox", "phyphox folder, zip or CSV", phyphox.recognizes, phyphox.read, (MEMBERS, TEXT)),
    Format("sensor-logger", "Sensor Logger folder, zip", sensor_logger.recognizes, sensor_logger.read, (MEMBERS, TEXT)),
    Format("sensorlog", "SensorLog CSV (iPhone)", known_tables.SENSORLOG.recognizes, known_tables.SENSORLOG.read),
    Format("androsensor", "AndroSensor CSV", known_tables.ANDROSENSOR.recognizes, known_tables.ANDROSENSOR.read),
    Format(
        "physics-toolbox",
        "Physics Toolbox CSV",
        known_tables.PHYSICS_TOOLBOX.recognizes,
        known_tables.PHYSICS_TOOLBOX.read,
    ),
    Format("hyperimu", "HyperIMU CSV", known_tables.HYPERIMU.recognizes, known_tables.HYPERIMU.read, asks=(RATE,)),
    Format("gnss-logger", "Google GnssLogger text", gnss_logger.recognizes, gnss_logger.read),
    Format("xio", "x-io NGIMU or x-IMU3 CSV", xio.recognizes, xio.read, (TEXT, MEMBERS)),
    Format("xsens", "Xsens MT Manager text (MTi, MTw)", xsens_mt.recognizes, xsens_mt.read, asks=(RATE,)),
    Format("xsens-dot", "Xsens or Movella DOT CSV", xsens_dot.recognizes, xsens_dot.read),
    Format(
        "metawear", "MetaWear CSV files of a session", metawear.recognizes, metawear.read, (TEXT, MEMBERS), (SENSOR,)
    ),
    Format("movesense", "Movesense JSON", movesense.recognizes, movesense.read),
    Format("shimmer", "Shimmer Consensys CSV", shimmer.recognizes, shimmer.read, asks=(SENSOR,)),
    Format("apdm", "APDM Opal CSV", apdm.recognizes, apdm.read, asks=(SENSOR,)),
    Format("vectornav", "VectorNav CSV of INSTINCT", known_tables.is_vectornav, known_tables.read_vectornav),
    Format("yei", "YEI 3-Space CSV", yei.recognizes, yei.read),
    Format("ros", "ROS 1 or ROS 2 bag", ros.recognizes, ros.read, (BINARY, MEMBERS), (SENSOR,)),
    Format("broad", "BROAD MATLAB file", broad.recognizes, broad.read, (MATLAB,)),
    Format(
        "table",
        "any table, by its columns' names",
        table.recognizes,
        table.read,
        (TEXT, BINARY, MEMBERS, MATLAB),
        (RATE, SENSOR),
    ),
    Format("tables", "folder or zip with a table a sensor", tables.recognizes, tables.read, (MEMBERS,), (SENSOR,)),
)
"""All formats by name."""


@dataclass(frozen=True)
class Reading:
    """How a file is to be read, where its content does not say.

    Attributes
    ----------
    format : a name of `FORMATS` to read it as; without one the format is recognized from the content.
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
        if format is not None and format not in FORMATS:
            raise FormatError(f"there is no format '{format}': choose one of {', '.join(FORMATS)}.")
        if self.columns is not None and format not in (None, "table"):
            raise FormatError(f"--columns maps a table, and the format given is '{format}': leave one of them out.")
        columns = parse_columns(self.columns) if isinstance(self.columns, str) else self.columns
        content = read_content(Path(path))
        format = "table" if columns is not None else format
        chosen, found = find_recording(content) if format is None else _as_format(content, FORMATS[format])
        for option, value in ((RATE, self.rate_hz), (SENSOR, self.sensor)):
            if value is not None and option not in chosen.asks:
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


def find_recording(content: Content) -> tuple[Format, Content]:
    """Find the recording that a path holds, and its format.

    Raises `FormatError` if there is none in one of `FORMATS`, or a folder or archive holds several.
    """
    found = _choose(content, list(_find_all(content, FORMATS.values())))
    if found is not None:
        return found
    if "GCP_meters" in content.variables:
        raise FormatError(f"{content.path.name} holds surveyed footprints, no recording: give it as the truth.")
    raise FormatError(explain_unknown(content, len(FORMATS)))


def _as_format(content: Content, chosen: Format) -> tuple[Format, Content]:
    """Take a file as of a format without asking whether it is; look for one in a folder or archive."""
    fits = content.kind in chosen.kinds
    found = None if fits and not content.members else _choose(content, list(_find_all(content, [chosen])))
    if fits or found is not None:
        return found or (chosen, content)
    kinds = " or ".join(chosen.kinds)
    raise FormatError(f"{content.path.name} is not {kinds}, so it cannot be '{chosen.name}': leave the format out.")


def _find_all(content: Content, formats: Collection[Format]) -> Iterator[tuple[Format, Content]]:
    """Recordings in a content: itself, or those of its files and folders."""
    for known in formats:
        if content.kind in known.kinds and known.recognizes(content):
            yield known, content
            return
    for part in content.parts():
        yield from _find_all(part, formats)


def _choose(content: Content, found: list[tuple[Format, Content]]) -> tuple[Format, Content] | None:
    if len(found) > 1:
        names = ", ".join(part.path.relative_to(content.path).as_posix() for _, part in found[:3])
        more = ", ..." if len(found) > 3 else ""
        unpacked = "" if content.path.is_dir() else ", unpacked"
        raise FormatError(
            f"{content.path.name} holds {len(found)} recordings ({names}{more}): give one of them{unpacked}."
        )
    return found[0] if found else None


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
    if content.variables:
        return _read_truth_of_recording(content)
    if not set(CSV_COLUMNS).isdisjoint(content.fields()):
        return read_footprint_csv(content)
    return read_tum(content)


def _read_truth_of_recording(content: Content) -> Truth:
    """Truth of a MATLAB recording that carries its own."""
    for known in FORMATS.values():
        if MATLAB in known.kinds and known.recognizes(content):
            truth = known.read(content).truth
            if truth is not None:
                return truth
    raise FormatError(f"{content.path.name} holds neither footprints nor a true path: give another file.")
