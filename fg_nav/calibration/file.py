"""The calibration file: what one recording showed of its sensors, for other recordings of the same sensor and shoe.

JSON, laid down in `docs/formats.md`. Numbers are written so that they are read back to the last bit; a part that the
recording did not show is null, and so is an infinite sigma. Units are those of the parts' own types.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np

from fg_nav.calibration.at_rest import AccelerometerCalibration, GyroscopeCalibration
from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.errors import CalibrationError
from fg_nav.text import find_version, to_json

FORMAT = "fg-nav calibration"
VERSION = 1
"""Of the file; a reader refuses what is newer."""

LARGEST_BYTES = 2**20
"""A calibration is a few kilobytes: anything larger is something else, and is not read."""

Part = TypeVar("Part")
AtRest = TypeVar("AtRest", GyroscopeCalibration | None, AccelerometerCalibration | None)


@dataclass(frozen=True)
class Calibration:
    """What a recording showed of its sensors; None for a part that it did not show.

    `recording` is the name of the file it came from.
    """

    recording: str | None = None
    magnetometer: MagnetometerCalibration | None = None
    gyroscope: GyroscopeCalibration | None = None
    accelerometer: AccelerometerCalibration | None = None

    def corrects(self, with_mag: bool) -> tuple[str, ...]:
        """Say what it corrects; `with_mag` where the magnetometer is used."""
        words = []
        if self.magnetometer is not None and with_mag:
            words.append(f"magnetometer ({self.magnetometer.method})")
        if self.accelerometer is not None and self.accelerometer.separable:
            words.append("accelerometer")
        return tuple(words)


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration; an older file is replaced."""
    content = {"format": FORMAT, "version": VERSION, "made_by": f"fg-nav {find_version()}", **to_json(calibration)}
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def is_calibration(path: Path) -> bool:
    """Whether a file was written here, even if it is damaged since."""
    with path.open("rb") as file:
        return FORMAT.encode() in file.read(100)


def read_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises `CalibrationError` if the file cannot be read, is no calibration, is of a newer version, or lacks what it
    should have.
    """
    content = _read_json(path)
    recording = content.get("recording")
    return Calibration(
        recording if isinstance(recording, str) else None,
        _read_part(path, content, "magnetometer", MagnetometerCalibration),
        _check_at_rest(path, "gyroscope", _read_part(path, content, "gyroscope", GyroscopeCalibration)),
        _check_at_rest(path, "accelerometer", _read_part(path, content, "accelerometer", AccelerometerCalibration)),
    )


def _read_json(path: Path) -> Mapping[str, Any]:
    content = _parse(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CalibrationError(f"{path.name} is no calibration: give a file that `fg-nav calibrate` wrote.")
    if content.get("version") != VERSION:
        raise CalibrationError(
            f"{path.name} is a calibration of version {content.get('version')}, and version {VERSION} is read here: "
            "calibrate again, or use a newer fg-nav."
        )
    return content


def _parse(path: Path) -> object:
    try:
        if path.stat().st_size > LARGEST_BYTES:
            return None
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CalibrationError(f"{path} does not exist: check the path of the calibration.") from None
    except IsADirectoryError:
        raise CalibrationError(f"{path} is a directory: give the calibration in it.") from None
    except OSError as error:
        reason = (error.strerror or type(error).__name__).lower()
        raise CalibrationError(f"{path} cannot be read ({reason}): check its permissions.") from None
    except (ValueError, RecursionError):
        raise CalibrationError(f"{path.name} is no JSON, or damaged: calibrate again.") from None


def _read_part(path: Path, content: Mapping[str, Any], name: str, kind: type[Part]) -> Part | None:
    part = content.get(name)
    if part is None:
        return None
    try:
        return _restore(kind, part)
    except CalibrationError as error:
        raise CalibrationError(f"{path.name}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        where = f" at {error}" if isinstance(error, KeyError) else ""
        raise CalibrationError(f"{path.name} is damaged in its part '{name}'{where}: calibrate again.") from None


def _check_at_rest(path: Path, name: str, part: AtRest) -> AtRest:
    """Refuse a bias that is no vector, and a scale that would turn a sensor round."""
    if part is not None:
        scale = part.scale if isinstance(part, AccelerometerCalibration) else 1.0
        vectors = part.bias.shape == (3,)
        if not (vectors and np.isfinite(part.bias).all() and 0.0 < scale < np.inf):
            raise CalibrationError(f"{path.name} has values in its part '{name}' that cannot be: calibrate again.")
    return part


def _restore(kind: type[Part], part: Mapping[str, Any]) -> Part:
    """Build a dataclass of numbers, arrays and texts from what JSON made of it."""
    hints = get_type_hints(kind)
    return kind(**{item.name: _value(hints[item.name], part[item.name]) for item in fields(kind)})  # type: ignore[arg-type]


def _value(kind: object, value: Any) -> object:
    """A value as its type hint has it; null is an infinite sigma."""
    if kind is str:
        return _text(value)
    if kind == tuple[str, ...]:
        return tuple(_text(item) for item in value)
    if kind is int or kind is bool:
        return _whole(value, kind)
    return _number(value) if kind is float else np.array(_numbers(value), dtype=np.float64)


def _numbers(value: Any) -> Any:
    """Numbers in lists of any depth."""
    return [_numbers(item) for item in value] if isinstance(value, list) else _number(value)


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(value)
    return value


def _whole(value: object, kind: type[int]) -> int:
    if not isinstance(value, int):
        raise TypeError(value)
    return kind(value)


def _number(value: Any) -> float:
    if isinstance(value, str | bool):
        raise TypeError(value)
    return float("inf") if value is None else float(value)
