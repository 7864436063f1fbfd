"""Movesense: the log of its app as JSON, `{"Meas": {"IMU9": [{"Timestamp": ..., "ArrayAcc": [...], ...}, ...]}}`.

=================== =====================================================================
`Timestamp`         ms of the sensor, whole: of the first of the 4 to 16 samples below it
`ArrayAcc`          m/s^2, one `{"x": ..., "y": ..., "z": ...}` a sample
`ArrayGyro`         deg/s
`ArrayMagn`         uT, not calibrated: with the field of the sensor itself in it
=================== =====================================================================

Samples within a block are spread evenly up to the stamp of the next one. Where blocks are missing, they come as in the
blocks around. Blocks are taken wherever they stand in the file: apps nest them differently.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, drop_held, scale_values
from fg_nav.io.counters import TICKS_32_BIT, continue_counter
from fg_nav.recording import Provenance, RawRecording
from fg_nav.samples.plausibility import find_mag_problem, measure_field_strength
from fg_nav.samples.stamps import LOST_PERIODS

_ACC, _GYR, _MAG = "ArrayAcc", "ArrayGyro", "ArrayMagn"
_STAMPS = ("Timestamp", "timestamp")
_DEGREE = np.pi / 180.0
_DEEPEST = 12
"""Blocks stand three to five levels deep; a file made of brackets is none."""


def recognizes(content: Content) -> bool:
    """Whether it begins as JSON, and blocks of Movesense's samples are in the beginning."""
    head = "\n".join(content.lines)
    return head.lstrip()[:1] in ("{", "[") and any(f'"{name}"' in head for name in (_ACC, _GYR))


def read(content: Content) -> RawRecording:
    """Read a Movesense log.

    Raises `FormatError` if the file is no whole JSON, a block is damaged, or acceleration or rate are not in it.
    """
    path = content.path
    blocks = [block for block in _find_blocks(_load(content), 0) if {_ACC, _GYR} <= block.keys()]
    if not blocks:
        raise FormatError(
            f"{path.name} has no blocks with both {_ACC} and {_GYR}: record IMU6 or IMU9, where they are together."
        )
    has_mag = all(_MAG in block for block in blocks)
    names = (_ACC, _GYR, _MAG) if has_mag else (_ACC, _GYR)
    parts = [_read_block(block, names, k, path.name) for k, block in enumerate(blocks)]
    samples = np.concatenate(parts)
    sizes = np.array([len(part) for part in parts])
    stamps, _ = continue_counter(np.array([_read_stamp(block, path.name) for block in blocks]), TICKS_32_BIT)
    gyr = scale_values(samples[:, 3:6], _DEGREE)
    mag, field = _judge_field(samples[:, 6:])
    return RawRecording(
        t=spread_blocks(stamps * 1e-3, sizes),
        acc=np.ascontiguousarray(samples[:, :3]),
        gyr=gyr,
        mag=None if mag is None else drop_held(mag, gyr),
        row=np.arange(1, len(samples) + 1),
        provenance=Provenance(
            path=path,
            format="movesense",
            notes=(f"one stamp stands for {np.median(sizes):g} samples: they are spread evenly up to the next", *field),
        ),
    )


def _judge_field(mag: Floats) -> tuple[Floats | None, tuple[str, ...]]:
    """Leave out a magnetometer whose own iron is more than any field on Earth, and say so."""
    if not mag.size or find_mag_problem(mag) is None:
        return mag if mag.size else None, ()
    median = np.nanmedian(measure_field_strength(mag))
    return None, (f"the magnetometer is not calibrated (median {median:.0f} uT), and was left out",)


def spread_blocks(stamps: Floats, sizes: np.ndarray) -> Floats:
    """Stamps (N,) s of samples in blocks, from those (B,) s of their first samples and the sizes (B,) of the blocks."""
    whole = sizes > 0
    stamps, sizes = stamps[whole], sizes[whole]
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
        if not {_ACC, _GYR, _MAG}.isdisjoint(value):
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


def _read_block(block: dict[str, Any], names: tuple[str, ...], index: int, name: str) -> Floats:
    """Samples (n, 3 K) of a block; those that some of its arrays lack are left out."""
    try:
        arrays = [np.array([[p["x"], p["y"], p["z"]] for p in block[key]], dtype=np.float64) for key in names]
    except (TypeError, KeyError, ValueError, OverflowError):
        raise FormatError(f"{name}: block {index + 1} holds something other than x, y, z: export it again.") from None
    least = min(len(array) for array in arrays)
    return np.hstack([array.reshape(-1, 3)[:least] for array in arrays])
