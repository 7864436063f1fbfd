"""The formats a recording may have, and the one way in: `read`.

A format is recognized from the content of the file, never from its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from fg_nav.errors import FormatError
from fg_nav.io.content import Content, read_content
from fg_nav.io.readers import broad, canonical, gdlbio, openshoe, pyshoe, sensorconnect, xio, xsens_mt
from fg_nav.io.truth import CSV_COLUMNS, read_footprint_csv, read_footprint_mat, read_tum
from fg_nav.recording import RawRecording, Recording, Truth


@dataclass(frozen=True)
class Format:
    """A file format: what it is, how it is recognized and how it is read."""

    name: str
    description: str
    recognizes: Callable[[Content], bool]
    read: Callable[[Content], RawRecording]
    is_mat: bool = False


def _by_name(*formats: Format) -> Mapping[str, Format]:
    return MappingProxyType({known.name: known for known in formats})


FORMATS: Mapping[str, Format] = _by_name(
    Format("canonical", "CSV of this project (time_s, acc_x_m_s2, ...)", canonical.recognizes, canonical.read),
    Format("sensorconnect", "LORD/MicroStrain SensorConnect CSV", sensorconnect.recognizes, sensorconnect.read),
    Format("pyshoe", "PyShoe MATLAB file", pyshoe.recognizes, pyshoe.read, is_mat=True),
    Format("gdlbio", "MATLAB file of surveyed walks (gdlbio)", gdlbio.recognizes, gdlbio.read, is_mat=True),
    Format("openshoe", "OpenShoe text", openshoe.recognizes, openshoe.read),
    Format("xio", "x-io NGIMU or x-IMU3 CSV", xio.recognizes, xio.read),
    Format("xsens", "Xsens MT Manager text (MTi, MTw)", xsens_mt.recognizes, xsens_mt.read),
    Format("broad", "BROAD MATLAB file", broad.recognizes, broad.read, is_mat=True),
)
"""All formats by name."""


def read(
    path: Path | str, format: str | None = None, *, rate_hz: float | None = None, sensor: str | None = None
) -> Recording:
    """Read a recording that estimators can use.

    Parameters
    ----------
    path : the file.
    format : a name of `FORMATS` to read it as; without one the format is recognized from the content.
    rate_hz : the rate of a file that has neither a clock nor a rate.
    sensor : which of several sensors in the file.

    Raises `FormatError` if the file cannot be read, or its format is not known; raises `RecordingError` if what it
    holds cannot be navigated with (`Recording.from_raw`).
    """
    return Recording.from_raw(read_raw(path, format, rate_hz=rate_hz, sensor=sensor))


def read_raw(
    path: Path | str, format: str | None = None, *, rate_hz: float | None = None, sensor: str | None = None
) -> RawRecording:
    """Read what a file says, unchecked; parameters and `FormatError` as of `read`."""
    if format is not None and format not in FORMATS:
        raise FormatError(f"there is no format '{format}': choose one of {', '.join(FORMATS)}.")
    content = replace(read_content(Path(path)), rate_hz=rate_hz, sensor=sensor)
    chosen = recognize_format(content) if format is None else FORMATS[format]
    if chosen.is_mat != bool(content.variables):
        kind = "a MATLAB file" if chosen.is_mat else "a text file"
        raise FormatError(f"{content.path.name} is not {kind}, so it cannot be '{chosen.name}': leave the format out.")
    return chosen.read(content)


def recognize_format(content: Content) -> Format:
    """Find the format of a file.

    Raises `FormatError` if it is none of `FORMATS`.
    """
    for known in FORMATS.values():
        if known.recognizes(content):
            return known
    if "GCP_meters" in content.variables:
        raise FormatError(f"{content.path.name} holds surveyed footprints, no recording: give it as the truth.")
    raise FormatError(
        f"{content.path.name} is in none of the formats read here ({', '.join(FORMATS)}): "
        f"name its format, or write it as canonical CSV."
    )


def read_truth(path: Path | str) -> Truth:
    """Read a true path or surveyed footprints; which it is, the content says.

    Raises `FormatError` if the file holds neither, or is damaged.
    """
    content = read_content(Path(path))
    if "GCP_meters" in content.variables:
        return read_footprint_mat(content.path)
    if content.variables:
        return _read_truth_of_recording(content)
    if not set(CSV_COLUMNS).isdisjoint(content.fields()):
        return read_footprint_csv(content)
    return read_tum(content)


def _read_truth_of_recording(content: Content) -> Truth:
    """Truth of a MATLAB recording that carries its own."""
    for known in FORMATS.values():
        if known.is_mat and known.recognizes(content):
            truth = known.read(content).truth
            if truth is not None:
                return truth
    raise FormatError(f"{content.path.name} holds neither footprints nor a true path: give another file.")
