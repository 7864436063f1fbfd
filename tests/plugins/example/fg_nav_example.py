"""What a package of somebody else adds to fg-nav: a method, a format of recordings, one of exports, a detector."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fg_nav.estimators import Method, find_method
from fg_nav.io.content import TEXT, Content
from fg_nav.io.formats import Format
from fg_nav.magnetic.detectors import Channel, Detector
from fg_nav.recording import Provenance, RawRecording
from fg_nav.report.export import Export
from fg_nav.report.export.track import POSITION, ExportTrack

MARK = "example log"


def is_example(content: Content) -> bool:
    """Whether the first line is that of the format."""
    return content.lines[:1] == (MARK,)


def read_example(content: Content) -> RawRecording:
    """Read seven numbers a line in hexadecimal, as no table has them."""
    lines = content.read_text().splitlines()[1:]
    values = np.array([[float.fromhex(word) for word in line.split("|")] for line in lines])
    row = np.arange(2, len(values) + 2)
    return RawRecording(
        values[:, 0], values[:, 1:4], values[:, 4:], row, provenance=Provenance(content.path, "example")
    )


example_format = Format("example", is_example, read_example, (TEXT,))
example_detector = Detector("strict", (Channel("strength", sigma=0.1, matters=1.0),))


def stand_still(walk, progress):
    """Solve a walk by the plain filter, and leave out where it went."""
    solution = find_method("iez").run(walk, progress)
    stances = replace(solution.stances, position=np.zeros_like(solution.stances.position))
    return replace(solution, position=np.zeros_like(solution.position), stances=stances)


standing = Method("standing", stand_still, uses_field=False)


def write_wkt(track: ExportTrack, path: Path) -> None:
    """Write the footfalls as a line of Well-Known Text, m."""
    points = ", ".join(" ".join(f"{value:.3f}" for value in row) for row in track.footfalls[POSITION].to_numpy())
    path.write_text(f"LINESTRING Z ({points})\n", encoding="utf-8")


WKT = Export(".wkt", "Well-Known Text", write_wkt)
