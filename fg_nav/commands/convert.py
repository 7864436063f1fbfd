"""`fg-nav convert`: the samples of any file read here, in SI and not judged, as canonical CSV or Parquet."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from fg_nav.commands import Answer
from fg_nav.errors import OutputError, RecordingError
from fg_nav.io import Reading
from fg_nav.io.writing import choose_writer
from fg_nav.recording import RawRecording, Recording
from fg_nav.report.folder import check_file_free, result_file
from fg_nav.report.terminal import console, listing


def convert(file: Path, out: Path, reading: Reading, force: bool) -> Answer:
    """Read a recording and write its samples; refuse to write over the file that is read."""
    write = choose_writer(out)
    if out.exists() and file.exists() and out.samefile(file):
        raise OutputError(f"{out} is the file to read: choose another one to write.")
    check_file_free(out, Path.is_file, force)
    raw = reading.read_raw(file)
    with result_file(out, Path.is_file, force) as fresh:
        write(raw, fresh)
    remarks = [*raw.provenance.notes, *_find_refusal(raw)]
    content = {
        "recording": str(file),
        "file": str(out),
        "format": raw.provenance.format,
        "samples": len(raw.t),
        "magnetometer": raw.mag is not None,
        "barometer": raw.pressure is not None,
        "remarks": remarks,
    }
    return Answer(content, partial(_print_conversion, raw, out, remarks))


def _find_refusal(raw: RawRecording) -> list[str]:
    """Say why the samples cannot be navigated with, and that a truth is left behind, where it is so."""
    said = [] if raw.truth is None else ["the truth in the file is not written"]
    try:
        Recording.from_raw(raw)
    except RecordingError as error:
        said.append(f"these samples cannot be navigated with: {error}")
    return said


def _print_conversion(raw: RawRecording, out: Path, remarks: list[str]) -> None:
    mag = "without a magnetometer" if raw.mag is None else "with the magnetometer"
    air = "" if raw.pressure is None else " and the barometer"
    rows = [("read", f"{len(raw.t)} samples of format {raw.provenance.format}, {mag}{air}"), ("written", str(out))]
    console().print(listing([*rows, *(("remark", remark) for remark in remarks)]))
