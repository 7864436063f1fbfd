"""A path for other programs: maps, MATLAB, tables, robots, viewers; one format for each ending.

An `ExportTrack` is made from a solution or from the folder of a result. Positions are East-North-Up, m from where the
foot first stands; maps need the position of that point on the Earth (`Origin`). Nothing is loaded before it is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fg_nav.errors import OutputError
from fg_nav.report.folder import check_file_free, result_files
from fg_nav.text import suggest_install

if TYPE_CHECKING:
    from fg_nav.report.export.track import ExportTrack, Origin


@dataclass(frozen=True)
class Export:
    """A format of exports, by the ending of its files.

    `write` writes a track to a file, of a map with the origin, of two tables to two files: `write(track, path)`,
    `write(track, path, origin)`, `write(track, path, second)`; as text `module:function` it is loaded when it is used.
    """

    ending: str
    name: str
    write: Callable[..., Any] | str
    needs_origin: bool = False  # It is a map.
    extra: tuple[str, str] | None = None  # The extra of this project that it needs, and the module that this brings.
    second: str = ""  # Suffix of the name of a second file, such as `-footfalls`.

    def __str__(self) -> str:
        return f"{self.ending} ({self.name})"


_MAPS, _PROGRAMS = "fg_nav.report.export.maps", "fg_nav.report.export.programs"
EXPORTS = {
    one.ending: one
    for one in (
        Export(".geojson", "GeoJSON", f"{_MAPS}:write_geojson", needs_origin=True),
        Export(".kml", "KML", f"{_MAPS}:write_kml", needs_origin=True),
        Export(".gpx", "GPX", f"{_MAPS}:write_gpx", needs_origin=True),
        Export(".tum", "TUM", f"{_PROGRAMS}:write_tum"),
        Export(".mat", "MATLAB", f"{_PROGRAMS}:write_matlab"),
        Export(".parquet", "Parquet", f"{_PROGRAMS}:write_parquet", False, ("parquet", "pyarrow"), "-footfalls"),
        Export(".mcap", "ROS 2", f"{_PROGRAMS}:write_ros", False, ("ros", "rosbags")),
        Export(".rrd", "Rerun", f"{_PROGRAMS}:write_rerun", False, ("rerun", "rerun")),
    )
}
"""By ending; other packages add to them by the entry points `fg_nav.exports`."""


def find_export(out: Path) -> Export:
    """Return the format of a file; raises `OutputError` if its ending is that of none."""
    ending = out.suffix.lower()
    if ending in EXPORTS:
        return EXPORTS[ending]
    from fg_nav.plugins import find_plugins  # slow to load, and the help needs the table alone

    added: dict[str, Export] = {one.ending: one for one in find_plugins("exports", Export).values()}
    if ending not in added:
        named = f"'{out.suffix}'" if out.suffix else "a name without an ending"
        known = ", ".join([*EXPORTS, *added])
        raise OutputError(f"{out.name}: nothing is written as {named}: choose one of {known}.")
    return added[ending]


def check_export(out: Path, origin: Origin | None = None, force: bool = False) -> None:
    """Refuse early, before any work, a file that cannot be written.

    Raises `OutputError` if no format has its ending, it is a map and there is no origin, the extra is not installed, or
    the file is there and `force` is not set.
    """
    format = find_export(out)
    if format.needs_origin and origin is None:
        raise OutputError(
            f"{out.name} is a map: say where the walk starts, as latitude and longitude: --origin 48.137,11.575."
        )
    if format.extra is not None:
        extra, module = format.extra
        try:
            import_module(module)
        except ImportError:
            raise OutputError(f"{out.suffix} needs {module}: install it, `{suggest_install(extra)}`.") from None
    for file in find_files(out):
        check_file_free(file, Path.is_file, force)


def find_files(out: Path) -> list[Path]:
    """Files of an export to `out`: itself and, where the format has two tables, the second."""
    second = find_export(out).second
    return [out, *([out.with_stem(out.stem + second)] if second else [])]


def export_track(track: ExportTrack, out: Path, origin: Origin | None = None, force: bool = False) -> Sequence[Path]:
    """Write a track in the format of the ending of `out`; return the files. Raises `OutputError` as `check_export`."""
    check_export(out, origin, force)
    format, files = find_export(out), find_files(out)
    write = format.write
    if isinstance(write, str):
        module, _, function = write.partition(":")
        write = getattr(import_module(module), function)
    with result_files(files, Path.is_file, force) as fresh:
        write(track, *fresh, *([origin] if format.needs_origin else []))
    return files
