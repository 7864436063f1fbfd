"""What stands in messages and files: counts in sentences, values as JSON knows them, small files, the version."""

from __future__ import annotations

import errno
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

MAX_BYTES = 2**23  # Of a configuration, a calibration or a scenario, which are some kilobytes.


def format_count(count: int, thing: str) -> str:
    """Put a count before a thing, and an s behind it if there is not one of it."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def format_ratio(ratio: float) -> str:
    """Write a ratio with two digits that count, and without an exponent below a million: 0.031, 4.1, 410."""
    return f"{float(f'{ratio:.2g}'):g}"


def to_json(value: object) -> Any:
    """Return `value` for JSON: dataclasses and arrays as dicts and lists, non-finite as None, the rest as text."""
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: to_json(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_json(value.tolist())
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)


def read_small(path: Path) -> bytes:
    """Return the bytes of a small file; bounded, because the path may be a device that never ends.

    Raises `OSError` if it cannot be read, or holds more than `MAX_BYTES`.
    """
    with path.open("rb") as file:
        content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise OSError(errno.EFBIG, f"it holds more than {MAX_BYTES >> 20} MiB", str(path))
    return content


def find_version() -> str:
    """Version of the installed distribution, or words that say there is none."""
    try:
        return metadata.version("fg-nav")
    except metadata.PackageNotFoundError:
        return "unknown (not installed)"
