"""The places of a walk in a file, for later walks in the same building (docs/formats.md#saved-places has its table).

What is kept is the signature of the solved walk (`signature`), some hundred bytes a meter, and how well its places are
known: with them a later walk recognizes where it is (`location`). No sample of the recording is in the file, an archive
of numpy arrays (.npz) that is read without pickle.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fg_nav.arrays import Brief, Floats, interpolate_columns
from fg_nav.errors import PlacesError, describe_reason
from fg_nav.places.signature import MIN_POINTS, Signature, trace_signature
from fg_nav.text import find_version

FORMAT = "fg-nav places"
VERSION = 1

MAX_POINTS = 200_000  # A walk of 100 km.
MAX_BYTES = 200 * MAX_POINTS  # Of all arrays as they are unpacked: a point takes 97.

COLUMNS: dict[str, tuple[tuple[int, ...], float]] = {  # Shapes of the rows, and what no walk, clock or field exceeds.
    "distance_m": ((), 1e6), "t": ((), 1e11), "position": ((3,), 1e6), "heading": ((), 1e6), "field": ((3,), 1e4),
    "seen": ((), 1.0), "sigma_m": ((3,), 1e6),
}  # fmt: skip

Arrays: TypeAlias = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class SavedPlaces(Brief):
    """The places of a walk: its signature, the sigmas (K, 3) m of its positions, and the name of its recording."""

    path: Signature
    sigma_m: Floats
    recording: str = ""


def trace_places(
    t: Floats, position: Floats, nav_R_body: Floats, mag: Floats, footfall_t: Floats, footfall_sigma_m: Floats
) -> SavedPlaces:
    """Return field and position along a solved walk; arguments as `trace_signature`; sigmas (F, 3) m at F footfalls.

    Raises `PlacesError` if the walk is too short to be recognized.
    """
    path = trace_signature(t, position, nav_R_body, mag)
    if len(path) < MIN_POINTS:
        raise PlacesError("the walk is too short for its places to be saved: it has to lead over 20 m or more.")
    return SavedPlaces(path, interpolate_columns(path.t, footfall_t, footfall_sigma_m))


def write_places(file: Path, places: SavedPlaces) -> None:
    """Write places; an older file is replaced. Raises `PlacesError` if `read_places` would refuse them."""
    about = {"format": FORMAT, "version": VERSION, "made_by": f"fg-nav {find_version()}", "recording": places.recording}
    arrays: Arrays = {name: np.array(value) for name, value in about.items()} | {"sigma_m": places.sigma_m}
    arrays |= {one.name: getattr(places.path, one.name) for one in fields(Signature)}
    fault = _find_fault(arrays)
    if fault is not None:
        raise PlacesError(f"the places of this walk cannot be saved, for {file.name} could not be read: it {fault}.")
    with file.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **arrays)


def is_places(file: Path) -> bool:
    """Whether a file holds places."""
    try:
        return str(_load(file, ("format",))["format"]) == FORMAT
    except (PlacesError, KeyError, OSError):
        return False


def read_places(file: Path) -> SavedPlaces:
    """Read places, and check them.

    Raises `PlacesError` if the file cannot be read, holds no places, is of a newer version, or has values that cannot
    be.
    """
    try:
        arrays = _load(file)
    except FileNotFoundError:
        raise PlacesError(f"{file} does not exist: check the path of the places.") from None
    except IsADirectoryError:
        raise PlacesError(f"{file} is a directory: give the file of places in it.") from None
    except OSError as error:
        reason = describe_reason(error)
        raise PlacesError(f"{file} cannot be read ({reason}): give one of `fg-nav run --save-places`.") from None
    if str(arrays.get("format")) != FORMAT:
        raise PlacesError(f"{file.name} holds no places: give a file that `fg-nav run --save-places` wrote.")
    if str(arrays.get("version")) != str(VERSION):
        raise PlacesError(
            f"{file.name} holds places of version {arrays.get('version')}, and version {VERSION} is read here: save "
            "them again, or use a newer fg-nav."
        )
    fault = _find_fault(arrays)
    if fault is not None:
        raise PlacesError(f"{file.name} {fault}: save the places again.")
    columns = {name: np.ascontiguousarray(arrays[name]) for name in COLUMNS}
    return SavedPlaces(
        sigma_m=columns.pop("sigma_m"), path=Signature(**columns), recording=str(arrays.get("recording", ""))
    )


def _load(file: Path, names: tuple[str, ...] = ()) -> Arrays:
    """Load the arrays `names`, or all if empty, of an archive; without pickle, and none larger than any walk."""
    try:
        with zipfile.ZipFile(file) as archive:
            if sum(member.file_size for member in archive.infolist()) > MAX_BYTES:
                raise PlacesError(f"{file.name} is larger than places can be: save them again.")
        with np.load(file, allow_pickle=False) as content:
            return {name: content[name] for name in names or content.files}
    except (OSError, PlacesError, KeyError):
        raise
    except Exception:  # whatever zip, zlib and numpy make of damaged bytes
        raise PlacesError(f"{file.name} holds no places, or is damaged: save them again.") from None


def _find_fault(arrays: Arrays) -> str | None:
    """Return the first fault of the columns, to follow the file's name in an error; None if valid."""
    count = len(np.atleast_1d(arrays.get("t", np.zeros(0))))
    for name, (shape, largest) in COLUMNS.items():
        column, kind = arrays.get(name), np.bool_ if name == "seen" else np.float64
        if column is None or column.shape != (count, *shape) or column.dtype != kind:
            return f"is damaged at '{name}'"
        if not (np.abs(column) <= largest).all():
            return f"has numbers in '{name}' that cannot be"
    if not MIN_POINTS <= count <= MAX_POINTS:
        return f"has {count} points, and places have {MIN_POINTS} to {MAX_POINTS}"
    goes_on = (np.diff(arrays["distance_m"]) > 0.0).all() and (np.diff(arrays["t"]) >= 0.0).all()
    if not goes_on or (arrays["sigma_m"] < 0.0).any():
        return "has places whose order or sigmas cannot be"
    return None
