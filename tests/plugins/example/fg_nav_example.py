"""A package of somebody else that adds to fg-nav by the entry points of its metadata."""

from pathlib import Path

from fg_nav.report.export import Export
from fg_nav.report.export.track import POSITION, ExportTrack


def write_wkt(track: ExportTrack, path: Path) -> None:
    """Write the footfalls as a line of Well-Known Text, m."""
    points = ", ".join(" ".join(f"{value:.3f}" for value in row) for row in track.footfalls[POSITION].to_numpy())
    path.write_text(f"LINESTRING Z ({points})\n", encoding="utf-8")


WKT = Export(".wkt", "Well-Known Text", write_wkt)
