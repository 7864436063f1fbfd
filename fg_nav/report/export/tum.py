"""TUM lines `t x y z qx qy qz qw`, for evo and its kin."""

from __future__ import annotations

from pathlib import Path

from fg_nav.io import write_tum
from fg_nav.report.export.track import Track


def write(track: Track, path: Path) -> None:
    """Write the path."""
    write_tum(path, track.t, track.position, track.nav_R_body)
