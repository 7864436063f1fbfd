"""Movesense: the log of its app as JSON, `{"Meas": {"IMU9": [{"Timestamp": ..., "ArrayAcc": [...], ...}, ...]}}`.

=================== =====================================================================
`Timestamp`         ms of the sensor, whole: of the first of the 4 to 16 samples below it
`ArrayAcc`          m/s^2, one `{"x": ..., "y": ..., "z": ...}` a sample
`ArrayGyro`         deg/s
`ArrayMagn`         uT, not calibrated: with the field of the sensor itself in it
=================== =====================================================================

Samples within a block are spread evenly up to the stamp of the next one. Where blocks are missing, they come as in the
blocks around. Blocks are taken wherever they stand in the file: apps nest them differently, and sensors that were not
recorded as IMU6 or IMU9 have blocks and stamps of their own.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.counters import TICKS_32_BIT, continue_counter
from fg_nav.io.streams import Sensor, Stream, join_streams
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import RawRecording
from fg_nav.samples.plausibility import find_mag_problem, measure_field_strength
from fg_nav.samples.stamps import LOST_PERIODS

_STAMPS = ("Timestamp", "timestamp")
_ARRAYS: Mapping[Sensor, tuple[str, float]] = MappingProxyType({
    "acc": ("ArrayAcc", 1.0), "gyr": ("ArrayGyro", np.pi / 180.0), "mag": ("ArrayMagn", 1.0),
})  # fmt: skip
"""Names of the sensors' arrays, and how much of m/s^2, rad/s or uT they are in."""

_NAMES = frozenset(name for name, _ in _ARRAYS.values())
_DEEPEST = 12  # Blocks stand three to five levels deep; a file made of brackets is none.


def recognizes(content: Content) -> bool:
    """Whether it begins as JSON, and blocks of Movesense's samples are in the beginning."""
    head = "\n".join(content.lines)
    return head.lstrip()[:1] in ("{", "[") and any(f'"{name}"' in head for name in _NAMES)


def read(content: Content) -> RawRecording:
    """Read a Movesense log.

    Raises `FormatError` if the file is no whole JSON, a block is damaged, or acceleration or rate is not in it.
    """
    path = content.path
    blocks = list(_find_blocks(_load(content), 0))
    streams = {what: _read_stream(blocks, what, path.name) for what in _ARRAYS}
    notes = []
    mag = streams["mag"].xyz
    if len(mag) and find_mag_problem(mag) is not None:
        median = np.nanmedian(measure_field_strength(mag))
        notes.append(f"the magnetometer is not calibrated (median {median:.0f} uT), and was left out")
        del streams["mag"]
    notes.insert(0, "each stamp stands for a block of samples: they are spread evenly up to the next")
    return join_streams([stream for stream in streams.values() if len(stream.t)], path, "movesense", notes)


def _read_stream(blocks: Sequence[dict[str, Any]], what: Sensor, name: str) -> Stream:
    """Samples of one sensor, of all blocks that have them."""
    array, unit = _ARRAYS[what]
    own = [block for block in blocks if array in block]
    parts = [_read_block(block[array], k, name) for k, block in enumerate(own)]
    stamps, _ = continue_counter(np.array([_read_stamp(block, name) for block in own]), TICKS_32_BIT)
    xyz = scale_values(np.concatenate([np.empty((0, 3)), *parts]), unit)
    t = spread_blocks(stamps * 1e-3, np.array([len(part) for part in parts], dtype=np.int64))
    return Stream(what, t, xyz, np.arange(1, len(t) + 1), array)


def spread_blocks(stamps: Floats, sizes: np.ndarray) -> Floats:
    """Stamps (N,) s of samples in blocks, from those (B,) s of their first samples and the sizes (B,) of the blocks."""
    whole = sizes > 0
    stamps, sizes = stamps[whole], sizes[whole]
    if not len(stamps):
        return stamps
    period = np.diff(stamps) / sizes[:-1]
    known = period[period > 0]
    usual = float(np.median(known)) if known.size else np.nan
    step = np.append(period, usual)
    step[~((step > 0) & (step < LOST_PERIODS * usual))] = usual
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.asarray(np.repeat(stamps, sizes) + within * np.repeat(step, sizes))


def _load(content: Content) -> Any:
    try:
        return json.loads(content.read_text())
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:80]
        raise FormatError(f"{content.path.name} is no whole JSON ({reason}): export it again.") from None


def _find_blocks(value: Any, depth: int) -> Iterator[dict[str, Any]]:
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        if not _NAMES.isdisjoint(value):
            yield value
            return
        for part in value.values():
            yield from _find_blocks(part, depth + 1)
    elif isinstance(value, list):
        for part in value:
            yield from _find_blocks(part, depth + 1)


def _read_stamp(block: dict[str, Any], name: str) -> float:
    stamp = next((block[key] for key in _STAMPS if key in block), None)
    if isinstance(stamp, bool) or not isinstance(stamp, int | float) or not np.abs(float(min(stamp, 1e300))) < 1e300:
        raise FormatError(f"{name}: a block has no Timestamp that is a number: export it again.")
    return float(stamp)


def _read_block(samples: Any, index: int, name: str) -> Floats:
    """Samples (n, 3) of a block."""
    try:
        return np.array([[p["x"], p["y"], p["z"]] for p in samples], dtype=np.float64).reshape(-1, 3)
    except (TypeError, KeyError, ValueError, OverflowError):
        raise FormatError(f"{name}: block {index + 1} holds something other than x, y, z: export it again.") from None
