"""Google's GnssLogger: records of many kinds in lines that begin with the kind, below a header in lines with `#`.

============================== ============================================================================
`UncalAccel,utc,elapsed,x,..`  x y z m/s^2 with the bias in it, then the bias, which is subtracted
`UncalGyro`, `UncalMag`        the same in rad/s and uT
`Accel`, `Gyro`, `Mag`         without the bias: used where the first are absent
============================== ============================================================================

`elapsed` is in ns since the phone's start; `utc` is in whole ms.
"""

from __future__ import annotations

import io

import numpy as np
import pandas as pd

from fg_nav.errors import FormatError
from fg_nav.io.content import Content, split_lines
from fg_nav.io.streams import Sensor, Stream, join_streams
from fg_nav.recording import RawRecording

_KINDS: dict[Sensor, tuple[str, str]] = {
    "acc": ("UncalAccel", "Accel"),
    "gyr": ("UncalGyro", "Gyro"),
    "mag": ("UncalMag", "Mag"),
}
_PREFIXES = tuple(f"{kind}," for kinds in _KINDS.values() for kind in kinds)
_ELAPSED, _XYZ, _BIAS = 2, slice(3, 6), slice(6, 9)


def recognizes(content: Content) -> bool:
    """Whether a header in comments names the records of GnssLogger, or a record of a sensor comes first."""
    named = any(
        line.startswith("#") and line.lstrip("# ").startswith(("Raw,utcTimeMillis", *_PREFIXES))
        for line in content.lines[:60]
    )
    first = next((line for line in content.lines if line and not line.startswith("#")), "")
    return named or (first.startswith(_PREFIXES) and first.count(",") >= 5)


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read(content: Content) -> RawRecording:
    """Read the inertial sensors and the magnetometer of a log.

    Raises `FormatError` if accelerometer or gyroscope are absent, the rate is too low, or a field is no number.
    """
    lines = split_lines(content.read_text())
    rows: dict[str, list[int]] = {prefix: [] for prefix in _PREFIXES}
    for number, line in enumerate(lines):
        prefix = line[: line.find(",") + 1]
        if prefix in rows:
            rows[prefix].append(number)
    streams = []
    for what, kinds in _KINDS.items():
        chosen = next((kind for kind in kinds if rows[f"{kind},"]), None)
        if chosen is not None:
            streams.append(
                _read_stream(content, what, chosen, [lines[k] for k in rows[f"{chosen},"]], rows[f"{chosen},"])
            )
    return join_streams(streams, content.path, "gnss-logger")


def _read_stream(content: Content, what: Sensor, kind: str, lines: list[str], rows: list[int]) -> Stream:
    width = 9 if kind.startswith("Uncal") else 6
    try:
        table = pd.read_csv(
            io.StringIO("\n".join(lines)), header=None, names=range(width), usecols=range(width), index_col=False,
            dtype=str, quoting=3, skip_blank_lines=False,
        )  # fmt: skip
    except (ValueError, pd.errors.ParserError):
        raise FormatError(f"{content.path.name} has no whole record of {kind}: log it again.") from None
    numbers = table.iloc[:, 1:].apply(pd.to_numeric, errors="coerce")
    bad = numbers.isna().any(axis=1).to_numpy()
    if bad.any():
        raise FormatError(
            f"{content.path.name}, line {rows[int(np.argmax(bad))] + 1}: {lines[int(np.argmax(bad))][:40]!r} is no "
            f"whole record of {kind}; correct or delete that line."
        )
    values = numbers.to_numpy(dtype=np.float64)
    xyz = values[:, 2:5] - values[:, 5:8] if width == 9 else values[:, 2:5]
    elapsed = numbers[_ELAPSED]
    stamps = elapsed.to_numpy(dtype=np.int64) if elapsed.dtype.kind == "i" else values[:, 1] * 1e-9
    return Stream(what, stamps, np.ascontiguousarray(xyz), np.array(rows) + 1, kind)
