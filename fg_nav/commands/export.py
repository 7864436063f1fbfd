"""`fg-nav export`: the path of a result, written for other programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fg_nav.commands import Answer
from fg_nav.errors import OutputError
from fg_nav.report.export import check_export, export_track, is_map
from fg_nav.report.export.track import ExportTrack, Origin, parse_start, read_result
from fg_nav.report.folder import RESULT_FILES
from fg_nav.report.terminal import console, listing


def export(
    folder: Path, out: Sequence[Path], origin: str | None, turn_deg: float, start: str | None, force: bool
) -> Answer:
    """Read the path in the folder of a result and write it into each file, which are all checked before."""
    if not math.isfinite(turn_deg):
        raise OutputError(f"--turn {turn_deg} is no angle: give degrees, clockwise.")
    place = None if origin is None else Origin.parse(origin)
    began = None if start is None else parse_start(start)
    if place is not None and not any(is_map(file) for file in out):
        raise OutputError(f"{out[0].name} holds meters, no places on the Earth: leave --origin out.")
    own = [file for file in out if file.name in RESULT_FILES and file.parent.resolve() == folder.resolve()]
    if own:
        raise OutputError(f"{own[0]} is a file of the result itself: choose another name.")
    for file in out:
        check_export(file, place, force)
    found = read_result(folder)
    track = replace(found, start=began).turn(turn_deg)
    if turn_deg:
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
    return Answer(content, partial(_print_export, track, files))


def _print_export(track: ExportTrack, files: Sequence[Path]) -> None:
    times = track.format_utc(track.t[:1])
    rows = [
        ("read", f"{len(track.t)} samples and {len(track.footfalls)} footfalls of {track.method}"),
        ("time", f"from {times[0]}" if times else "of the recording's own clock; --start makes it absolute"),
        *(("written", str(file)) for file in files),
        *(("remark", remark) for remark in track.notes),
    ]
    console().print(listing(rows))
