"""`fg-nav convert` and `export`: samples and paths written for other programs.

`convert`: the samples of any file read here, in SI and not judged, as canonical CSV or Parquet.
`export`: the path of a result.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from fg_nav.commands.requests import ConvertRequest, ExportRequest
from fg_nav.commands.shared import Answer, choose_reading
from fg_nav.errors import OutputError, RecordingError
from fg_nav.io.writing import choose_writer
from fg_nav.recording import Recording
from fg_nav.report.export import check_export, export_track, find_export
from fg_nav.report.export.track import Origin, parse_start, read_result
from fg_nav.report.folder import RESULT_FILES, check_file_free, result_file
from fg_nav.report.terminal import console, listing


def convert(request: ConvertRequest) -> Answer:
    """Read a recording and write its samples; refuse to write over the file that is read."""
    file, out = request.recording, request.out
    write = choose_writer(out)
    if out.exists() and file.exists() and out.samefile(file):
        raise OutputError(f"{out} is the file to read: choose another one to write.")
    check_file_free(out, Path.is_file, request.force)
    raw = choose_reading(request).read_raw(file)
    with result_file(out, Path.is_file, request.force) as fresh:
        write(raw, fresh)
    # Notes: why the samples cannot be navigated with; that the truth is not converted.
    remarks = [*raw.provenance.notes, *([] if raw.truth is None else ["the truth in the file is not written"])]
    try:
        Recording.from_raw(raw)
    except RecordingError as error:
        remarks.append(f"these samples cannot be navigated with: {error}")
    content = {
        "recording": str(file),
        "file": str(out),
        "format": raw.provenance.format,
        "samples": len(raw.t),
        "magnetometer": raw.mag is not None,
        "barometer": raw.pressure is not None,
        "remarks": remarks,
    }
    mag = "without a magnetometer" if raw.mag is None else "with the magnetometer"
    air = "" if raw.pressure is None else " and the barometer"
    rows = [("read", f"{len(raw.t)} samples of format {raw.provenance.format}, {mag}{air}"), ("written", str(out))]
    rows += [("remark", remark) for remark in remarks]
    return Answer(content, lambda: console().print(listing(rows)))


def export(request: ExportRequest) -> Answer:
    """Read the path of a result and write it to each file, all checked first."""
    folder, out, force = request.folder, request.out, request.force
    if not math.isfinite(request.turn):
        raise OutputError(f"--turn {request.turn} is no angle: give degrees, clockwise.")
    place = None if request.origin is None else Origin.parse(request.origin)
    began = None if request.start is None else parse_start(request.start)
    if place is not None and not any(find_export(file).needs_origin for file in out):
        raise OutputError(f"{out[0].name} holds meters, no places on the Earth: leave --origin out.")
    own = [file for file in out if file.name in RESULT_FILES and file.parent.resolve() == folder.resolve()]
    if own:
        raise OutputError(f"{own[0]} is a file of the result itself: choose another name.")
    found = read_result(folder)
    place = place or found.origin
    for file in out:
        check_export(file, place, force)
    track = replace(found, start=began).turn(request.turn)
    if request.turn:
        track = replace(track, notes=())  # whoever turns a path knows its north
    files = [made for file in out for made in export_track(track, file, place, force)]
    times = track.format_utc(track.t[:1])
    content = {
        "result": str(folder),
        "files": [str(file) for file in files],
        "method": track.method,
        "samples": len(track.t),
        "footfalls": len(track.footfalls),
        "start_utc": None if times is None else times[0],
        "remarks": list(track.notes),
    }
    rows = [
        ("read", f"{len(track.t)} samples and {len(track.footfalls)} footfalls of {track.method}"),
        ("time", f"from {times[0]}" if times else "of the recording's own clock; --start makes it absolute"),
        *(("written", str(file)) for file in files),
        *(("remark", remark) for remark in track.notes),
    ]
    return Answer(content, lambda: console().print(listing(rows)))
