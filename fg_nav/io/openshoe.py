"""OpenShoe's text recordings of a MicroStrain sensor: 17 blank-separated columns, every row begins with 0xcb.

======= ===============================================================
1       the packet's header, 0xcb
2-4     acc, g
5-7     gyr, rad/s
8, 9    the sensor's tick counter, checksum
10      row number: the clock, since the sensor samples evenly
11-13   times of the logging PC, s
14      sample rate, estimated from packet to packet, Hz
15-17   mag, gauss; nan where the packet brought none
======= ===============================================================

Time is the row number over the nominal rate. The nominal rate is the median of column 14, taken to the next
multiple of 5 Hz when that is within half a percent: sensors are set to such rates.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content, drop_held, read_table, scale_values
from fg_nav.io.sensorconnect import GAUSS_UT
from fg_nav.recording import Provenance, RawRecording

COLUMNS = (
    *("header", "acc x", "acc y", "acc z", "gyr x", "gyr y", "gyr z", "ticks", "checksum", "row number"),
    *("PC time 1", "PC time 2", "PC time 3", "rate", "mag x", "mag y", "mag z"),
)

_WANTED = [COLUMNS.index(name) for name in COLUMNS if name.startswith(("acc", "gyr", "mag", "row", "rate"))]


def recognizes(content: Content) -> bool:
    """Whether the first line that is not empty begins with the packet header."""
    first = next((line.split() for line in content.lines if line.strip()), [])
    return bool(first) and first[0].lower() == "0xcb"


def read(content: Content) -> RawRecording:
    """Read an OpenShoe recording.

    Raises `FormatError` if a field is no number, columns are missing, or no rate is given.
    """
    path = content.path
    width = len(next((line.split() for line in content.lines if line.strip()), []))
    if width != len(COLUMNS):
        raise FormatError(
            f"{path.name}: the first row has {width} columns, not {len(COLUMNS)}: copy the recording again."
        )
    table, row = read_table(path, COLUMNS, _WANTED, first_line=1, separator=r"\s+")
    acc, gyr, number, rate, mag = np.split(table, [3, 6, 7, 8], axis=1)
    return RawRecording(
        t=scale_values(number[:, 0], 1.0 / find_nominal_rate_hz(rate[:, 0], path.name)),
        acc=scale_values(acc, GRAVITY_M_S2),
        gyr=np.ascontiguousarray(gyr),
        mag=drop_held(scale_values(mag, GAUSS_UT), gyr),
        row=row,
        provenance=Provenance(path=path, format="openshoe"),
    )


def find_nominal_rate_hz(estimates: Floats, name: str) -> float:
    """Find the rate a sensor was set to, from noisy estimates (N,) Hz of it.

    Raises `FormatError` if no estimate is between 1 Hz and 100 kHz.
    """
    usable = estimates[(estimates >= 1.0) & (estimates <= 1e5)]
    if not usable.size:
        raise FormatError(f"{name} holds no sample rate in column 14: export the recording as canonical CSV.")
    median = float(np.median(usable))
    nominal = 5.0 * round(median / 5.0)
    return nominal if abs(nominal - median) <= 0.005 * median else median
