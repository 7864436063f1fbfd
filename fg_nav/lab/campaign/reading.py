"""How the recordings of a folder are read: what a plan tells of them as the options of `fg-nav run` do.

    [reading.walks]                 # the folder's name
    format = "openshoe"             # without it the format is recognised from the content
    calibration = "foot.json"       # of `fg-nav calibrate`, from where the plan is

With a calibration the recordings have what simulated walks have of their loop: it is `loop` of `sources`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fg_nav.calibration.file import Calibration, read_calibration
from fg_nav.errors import CampaignError
from fg_nav.io import FORMATS

KNOWN = ("format", "calibration")


@dataclass(frozen=True)
class Reading:
    """Name of the format, None where it is to be recognised; the calibration, None without.

    The calibration itself, not its file: a worker may have another disk.
    """

    format: str | None = None
    calibration: Calibration | None = None


AS_IT_IS = Reading()
"""Of a folder of which the plan tells nothing."""


def readings(tables: Any, folder: Path) -> dict[str, Reading]:
    """Read the tables of a plan, by names of folders; files are looked for from `folder`.

    Raises
    ------
    CampaignError, CalibrationError
        If there is anything in them that cannot be.
    """
    if not isinstance(tables, Mapping) or not all(isinstance(table, Mapping) for table in tables.values()):
        raise CampaignError("reading is no table: write [reading.FOLDER] and its options below.")
    return {name: _reading(name, table, folder) for name, table in tables.items()}


def _reading(name: str, table: Mapping[str, Any], folder: Path) -> Reading:
    for option, value in table.items():
        if option not in KNOWN:
            raise CampaignError(f"there is no '{option}' in reading.{name}: it knows {', '.join(KNOWN)}.")
        if not isinstance(value, str):
            raise CampaignError(f"{option} of reading.{name} cannot be {value!r}: give a name.")
    given = table.get("format")
    if given is not None and given not in FORMATS:
        raise CampaignError(f"there is no format '{given}': choose one of {', '.join(FORMATS)}.")
    return Reading(given, _calibration(folder / table["calibration"]) if "calibration" in table else None)


def _calibration(path: Path) -> Calibration:
    calibration = read_calibration(path)
    if calibration.magnetometer is None:
        raise CampaignError(f"{path.name} tells nothing of the magnetometer: calibrate on circles, or leave it out.")
    return calibration
