"""A path for other programs: maps, MATLAB, tables, robots, viewers; one format for each ending.

An `ExportTrack` is made from a solution or from the folder of a result. Positions are East-North-Up, m from where the
foot first stands; maps need the position of that point on the Earth (`Origin`). Nothing is loaded before it is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from fg_nav.errors import OutputError
from fg_nav.report.export.track import ExportTrack, Origin
from fg_nav.report.folder import check_file_free, result_files


@dataclass(frozen=True)
class ExportFormat:
    """Writer of one kind of file."""

    module: str  # Of this package,
    function: str  # of track and file, and of a map also the origin.
    on_earth: bool = False  # It is a map.
    extra: tuple[str, str] | None = None  # The extra of this project that it needs, and the module that this brings.
    second: str = ""  # Suffix of the name of a second file, such as `-footfalls`.


FORMATS: dict[str, ExportFormat] = {
    ".geojson": ExportFormat("maps", "write_geojson", on_earth=True),
    ".kml": ExportFormat("maps", "write_kml", on_earth=True),
    ".gpx": ExportFormat("maps", "write_gpx", on_earth=True),
    ".tum": ExportFormat("tables", "write_tum"),
    ".mat": ExportFormat("tables", "write_matlab"),
    ".parquet": ExportFormat("tables", "write_parquet", extra=("parquet", "pyarrow"), second="-footfalls"),
    ".mcap": ExportFormat("viewers", "write_ros", extra=("ros", "rosbags")),
    ".rrd": ExportFormat("viewers", "write_rerun", extra=("rerun", "rerun")),
}
"""By the ending of the file."""


def check_export(out: Path, origin: Origin | None = None, force: bool = False) -> None:
    """Refuse early, before any work, a file that cannot be written.

    Raises `OutputError` if its ending is none of `FORMATS`, it is a map and there is no origin, the extra is not
    installed, or the file is there and `force` is not set.
    """
    format = _find_format(out)
    if format.on_earth and origin is None:
        raise OutputError(
            f"{out.name} is a map: say where the walk starts, as latitude and longitude: --origin 48.137,11.575."
        )
    if format.extra is not None:
        extra, module = format.extra
        try:
            import_module(module)
        except ImportError:
            raise OutputError(f"{out.suffix} needs {module}: install it, `pip install 'fg-nav[{extra}]'`.") from None
    for file in find_files(out):
        check_file_free(file, Path.is_file, force)


def is_map(out: Path) -> bool:
    """Whether the format of a file has positions on the Earth; raises `OutputError` if there is no such format."""
    return _find_format(out).on_earth


def find_files(out: Path) -> list[Path]:
    """Files of an export to `out`: itself and, where the format has two tables, the second."""
    second = _find_format(out).second
    return [out, *([out.with_stem(out.stem + second)] if second else [])]


def export_track(track: ExportTrack, out: Path, origin: Origin | None = None, force: bool = False) -> Sequence[Path]:
    """Write a track in the format of the ending of `out`; return the files.

    Raises `OutputError` as `check_export` does.
    """
    check_export(out, origin, force)
    format, files = _find_format(out), find_files(out)
    write: Callable[..., Any] = getattr(import_module(f"{__name__}.{format.module}"), format.function)
    with result_files(files, Path.is_file, force) as fresh:
        write(track, *fresh, *([origin] if format.on_earth else []))
    return files


def _find_format(out: Path) -> ExportFormat:
    if out.suffix.lower() not in FORMATS:
        named = f"'{out.suffix}'" if out.suffix else "a name without an ending"
        raise OutputError(f"{out.name}: nothing is written as {named}: choose one of {', '.join(FORMATS)}.")
    return FORMATS[out.suffix.lower()]
