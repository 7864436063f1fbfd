"""A path for other programs: maps, MATLAB, tables, robots, viewers; a file a format, chosen by the ending.

A `Track` (`fg_nav.report.export.track`) is what is exported, from a solution or from the folder of a result. Positions
are East-North-Up, m from where the foot first stands; maps need the place of that point on the Earth
(`fg_nav.report.export.place`). Nothing is loaded before it is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from fg_nav.errors import OutputError
from fg_nav.report.export.place import Origin
from fg_nav.report.export.track import Track
from fg_nav.report.folder import check_file_free, result_files


@dataclass(frozen=True)
class ExportFormat:
    """How a file of one kind is written.

    Attributes
    ----------
    module : of this package; its `write` takes track and file, and of a map also the origin.
    on_earth : whether it is a map.
    extra : the extra of this project that it needs, and the module that this brings.
    beside : what is put behind the name of a second file, such as `-footfalls`.
    """

    module: str
    on_earth: bool = False
    extra: tuple[str, str] | None = None
    beside: str = ""


FORMATS: dict[str, ExportFormat] = {
    ".geojson": ExportFormat("geojson", on_earth=True),
    ".kml": ExportFormat("kml", on_earth=True),
    ".gpx": ExportFormat("gpx", on_earth=True),
    ".tum": ExportFormat("tum"),
    ".mat": ExportFormat("matlab"),
    ".parquet": ExportFormat("parquet", extra=("parquet", "pyarrow"), beside="-footfalls"),
    ".mcap": ExportFormat("ros", extra=("ros", "rosbags")),
    ".rrd": ExportFormat("rerun", extra=("rerun", "rerun")),
}
"""By the ending of the file."""


def check_export(out: Path, origin: Origin | None = None, force: bool = False) -> None:
    """Say before any work whether a file can be written.

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
    """Whether the format of a file has places on the Earth; raises `OutputError` if there is no such format."""
    return _find_format(out).on_earth


def find_files(out: Path) -> list[Path]:
    """Files that an export to `out` makes: itself and, where the format has two tables, the second."""
    beside = _find_format(out).beside
    return [out, *([out.with_stem(out.stem + beside)] if beside else [])]


def export_track(track: Track, out: Path, origin: Origin | None = None, force: bool = False) -> Sequence[Path]:
    """Write a track in the format that the ending of `out` names; return the files.

    Raises `OutputError` as `check_export` does.
    """
    check_export(out, origin, force)
    format, files = _find_format(out), find_files(out)
    write: Callable[..., Any] = import_module(f"{__name__}.{format.module}").write
    with result_files(files, Path.is_file, force) as fresh:
        write(track, *fresh, *([origin] if format.on_earth else []))
    return files


def _find_format(out: Path) -> ExportFormat:
    if out.suffix.lower() not in FORMATS:
        named = f"'{out.suffix}'" if out.suffix else "a name without an ending"
        raise OutputError(f"{out.name}: nothing is written as {named}: choose one of {', '.join(FORMATS)}.")
    return FORMATS[out.suffix.lower()]
