"""The path that is exported, at the recording's rate, with its footfalls, from a solution or from a result folder.

Turning by a clockwise from above: p' = R p, nav'_R_body = R nav_R_body, P' = R P R^T with R = R_z(-a), heading' =
heading + a. It lays a path whose north is magnetic, or that of the sensor at the start, onto true north.

Time. Stamps that are seconds since 1970 are recognized by their size; any other clock is absolute only where the
instant of its first stamp is given.

Maps. Positions about an `Origin` become latitude, longitude and height (WGS 84); east, north and up are tangent to the
ellipsoid there. `pymap3d` does the geodesy.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import FormatError, OutputError
from fg_nav.frames import yaw_rotation
from fg_nav.io import read_truth
from fg_nav.solution import STRIDE_COLUMNS, Solution, tabulate_path
from fg_nav.truth import TrajectoryTruth

POSITION = ["x_m", "y_m", "z_m"]
SIGMA = ["sigma_x_m", "sigma_y_m", "sigma_z_m"]
BETWEEN = {"cov_xy_m2": (0, 1), "cov_xz_m2": (0, 2), "cov_yz_m2": (1, 2)}

PERSON = "person.csv"  # Table of the person's path where both feet were recorded, with the columns of `strides.csv`.
EPOCH_S = (1e9, 2.0**31)  # Seconds since 1970 of the years 2001 to 2037: beyond any clock since power-on.
LINE_STEP_S = 0.1  # Between two points of a drawn line: a foot swings for half a second.
DEGREE_DIGITS, METER_DIGITS = 9, 3  # Decimals in files: a billionth of a degree is a tenth of a millimetre.

FRAME = (
    "East-North-Up from where the foot first stands: x east, y north, z up, m. nav_R_body maps vectors of the sensor's "
    "axes to it; quaternions are of nav_R_body. Headings are of the sensor's x axis, degrees clockwise from north. "
    "Sigmas are one standard deviation, relative to the start."
)
"""Description in every file with a place for it."""


@dataclass(frozen=True)
class ExportTrack:
    """A path to export."""

    name: str
    method: str
    t: Floats  # (N,) s, stamps of the recording's own clock
    position: Floats  # (N, 3) m, navigation frame
    nav_R_body: Floats  # (N, 3, 3)
    velocity: Floats  # (N, 3) m/s, navigation frame; of a folder the central difference of `position`
    footfalls: pd.DataFrame  # a row a footfall, with the columns of `strides.csv`
    start: datetime | None = None  # instant of the first stamp, where given
    notes: tuple[str, ...] = ()  # for the user
    origin: Origin | None = None  # where fixes of the walk showed it

    @classmethod
    def of(cls, solution: Solution, name: str = "walk") -> ExportTrack:
        """Return the track of a solution."""
        path = (solution.t, solution.position, solution.nav_R_body, solution.velocity)
        return cls(_clean_name(name), solution.method, *path, solution.stances.to_dataframe())

    @cached_property
    def cov(self) -> Floats:
        """(K, 3, 3) covariances of the footfalls' positions, m^2."""
        table = self.footfalls
        found: Floats = table[SIGMA].to_numpy()[:, None, :] ** 2 * np.eye(3)
        for name, (i, j) in BETWEEN.items():
            found[:, i, j] = found[:, j, i] = table[name]
        return found

    @cached_property
    def epoch_s(self) -> float | None:
        """Offset from stamps to seconds since 1970; None where unknown."""
        if self.start is not None:
            return self.start.timestamp() - float(self.t[0])
        low, high = EPOCH_S
        return 0.0 if low < self.t[0] and self.t[-1] < high else None

    def format_utc(self, t: Floats) -> list[str] | None:
        """UTC of stamps (M,) to the millisecond, as ISO 8601; None where unknown."""
        if self.epoch_s is None:
            return None
        instants = np.round((t + self.epoch_s) * 1e3).astype("datetime64[ms]")
        return [f"{words}Z" for words in np.datetime_as_string(instants)]

    @property
    def line(self) -> Ints:
        """Samples of the path for a drawing, the last among them."""
        step = max(round(LINE_STEP_S / float(np.median(np.diff(self.t)))), 1)
        return np.unique(np.append(np.arange(0, len(self.t), step), len(self.t) - 1))

    def turn(self, clockwise_deg: float) -> ExportTrack:
        """Return the path turned about the start, clockwise seen from above."""
        if clockwise_deg == 0.0:
            return self
        R = yaw_rotation(-np.deg2rad(clockwise_deg))
        cov, table = R @ self.cov @ R.T, self.footfalls.copy()
        table[POSITION] = table[POSITION].to_numpy() @ R.T
        table[SIGMA] = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        table["heading_deg"] = (table["heading_deg"] + clockwise_deg) % 360.0
        for name, (i, j) in BETWEEN.items():
            table[name] = cov[:, i, j]
        position, nav_R_body, velocity = self.position @ R.T, R @ self.nav_R_body, self.velocity @ R.T
        return replace(self, position=position, nav_R_body=nav_R_body, velocity=velocity, footfalls=table)

    def tabulate(self) -> pd.DataFrame:
        """Table of the path, a row a sample."""
        return tabulate_path(self.t, self.position, self.velocity, self.nav_R_body)


def read_result(folder: Path) -> ExportTrack:
    """Read the path and the footfalls from the folder of a result.

    Raises `FormatError` if it is no such folder, or its files are damaged.
    """
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "is not there"
        raise FormatError(f"{folder} {what}: name the folder of a result, such as results/walk-smoother-1.")
    if (folder / "comparison.json").exists():
        methods = sorted(part.parent.name for part in folder.glob("*/trajectory.tum"))
        raise FormatError(f"{folder} is a comparison: name the folder of one method in it ({', '.join(methods)}).")
    table = folder / (PERSON if (folder / PERSON).is_file() else "strides.csv")
    for name in ("trajectory.tum", table.name, "summary.json"):
        if not (folder / name).is_file():
            raise FormatError(
                f"{folder} is no result of `fg-nav run` (it has no {name}): name the folder that it printed."
            )
    path = read_truth(folder / "trajectory.tum")
    if not isinstance(path, TrajectoryTruth) or path.nav_R_body is None or len(path.t) < 2:
        raise FormatError(f"{folder / 'trajectory.tum'} has no path in it: run the walk again.")
    footfalls = _read_footfalls(table)
    if not len(footfalls):
        raise FormatError(f"{table} has no footfall: there is nothing to export.")
    summary = _read_json(folder / "summary.json")
    config = _read_json(folder / "config.json") if (folder / "config.json").is_file() else {}
    notes: tuple[str, ...] = (_describe_north(summary, config),)
    if summary.get("mount") == "feet":
        notes += ("the path is the person's, between the feet: headings are of the direction of walking",)
    name, method = _clean_name(folder.resolve().name), str(summary.get("method", "unknown"))
    velocity = np.gradient(path.position, path.t, axis=0)
    origin = Origin(*summary["origin"]) if summary.get("origin") else None
    positions = path.t, path.position, path.nav_R_body, velocity
    return ExportTrack(name, method, *positions, footfalls, notes=notes, origin=origin)


def _clean_name(name: str) -> str:
    """Replace characters that XML cannot hold: control characters, and undecodable bytes of a file's name."""
    return "".join(letter if letter.isprintable() else "?" for letter in name)


def _read_footfalls(path: Path) -> pd.DataFrame:
    """Read `strides.csv`: numbers, empty where unknown, and words."""
    whole = ("index", "same_place_as")
    numbers = {name: "int64" if name in whole else "float64" for name in STRIDE_COLUMNS if "field" not in name}
    try:
        table = pd.read_csv(path, keep_default_na=False, na_values={name: [""] for name in numbers})
        missing = [name for name in STRIDE_COLUMNS if name not in table]
        if missing:
            raise FormatError(f"{path} has no column {missing[0]}, it is of an older version: run the walk again.")
        return table[list(STRIDE_COLUMNS)].astype(numbers)
    except (ValueError, UnicodeDecodeError, OSError) as error:  # pandas' parser errors are ValueErrors
        reason = " ".join(str(error).split())[:120]
        raise FormatError(f"{path} is damaged ({reason}): run the walk again.") from None


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        raise FormatError(f"{path} is damaged ({str(error)[:120]}): run the walk again.") from None
    if not isinstance(content, dict):
        raise FormatError(f"{path} is not that of a run: run the walk again.")
    return content


def _describe_north(summary: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """North of the path, in words."""
    if summary.get("origin") and summary.get("fixes", {}).get("count") != 1:
        return "north is true, as the fixes show it, and so is the origin of maps"
    if config.get("heading_deg") is not None:
        return f"north is that of --heading {config['heading_deg']:g}"
    if summary.get("magnetometer") == "used":
        return "north is magnetic: --turn and the declination of the place, east positive, make it true"
    if "magnetometer" not in summary:
        return "north is magnetic where the walk was followed with a compass: --turn DEG lays the path onto the map"
    pocket = config.get("given", {}).get("mount") == "pocket"
    start = "the first strides led" if pocket else "the sensor's x axis pointed at the start"
    return f"north is where {start}: --turn DEG lays the path onto the map"


def parse_start(words: str) -> datetime:
    """Read the instant of the first stamp, ISO 8601 with its zone; raises `OutputError` for anything else."""
    try:
        start = datetime.fromisoformat(words)
    except ValueError:
        raise OutputError(f"--start '{words}' is no instant: give ISO 8601, as 2026-05-04T09:30:00+02:00.") from None
    if start.tzinfo is None:
        raise OutputError(f"--start {words} has no zone: add Z for UTC, or its offset, as +02:00.")
    return start


@dataclass(frozen=True)
class Origin:
    """Position of the start on the Earth: geodetic degrees, north and east positive; None for an unknown height.

    Raises `OutputError` if it is not on the Earth.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float | None = None

    def __post_init__(self) -> None:
        latitude, longitude = self.latitude_deg, self.longitude_deg
        if abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and math.isfinite(self.height_m or 0.0):
            return
        swapped = 90.0 < abs(latitude) <= 180.0 and abs(longitude) <= 90.0
        hint = f"latitude is first, try {longitude:g},{latitude:g}" if swapped else "give degrees, latitude first"
        raise OutputError(f"latitude {latitude:g}, longitude {longitude:g} is not on the Earth: {hint}.")

    @classmethod
    def parse(cls, words: str) -> Origin:
        """Read LAT,LON or LAT,LON,HEIGHT; raises `OutputError` for anything else."""
        try:
            numbers = [float(part) for part in words.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            raise OutputError(f"--origin '{words}' is no place: give LAT,LON or LAT,LON,HEIGHT, as 48.137,11.575,520.")
        return cls(*numbers)

    def locate(self, position: Floats) -> Floats:
        """Longitude, latitude (deg) and height (m) (N, 3) of positions (N, 3) m, rounded for files.

        Heights are absolute, or above the start where that of the origin is unknown.
        """
        from pymap3d import enu2geodetic

        at = (self.latitude_deg, self.longitude_deg, self.height_m or 0.0)
        latitude, longitude, height = enu2geodetic(*position.T, *at)
        degrees = np.round(np.stack([longitude, latitude], axis=1), DEGREE_DIGITS)
        return np.column_stack([degrees, np.round(height, METER_DIGITS)])
