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

Time is the row number over the nominal rate. Where the row numbers begin again, they go on by the time that has passed
on the logging PC: by one, if that is within the delays of its packets.

The nominal rate is the median of column 14, taken to the next multiple of 5 Hz when that is within half a percent:
sensors are set to such rates.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.units import GAUSS_UT
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content
from fg_nav.io.text_columns import drop_held, read_table, scale_values
from fg_nav.recording import Provenance, RawRecording

COLUMNS = (
    *("header", "acc x", "acc y", "acc z", "gyr x", "gyr y", "gyr z", "ticks", "checksum", "row number"),
    *("PC time 1", "PC time 2", "PC time 3", "rate", "mag x", "mag y", "mag z"),
)

_WANTED = [
    COLUMNS.index(name) for name in COLUMNS if name.startswith(("acc", "gyr", "mag", "row", "rate", "PC time 1"))
]

_PACKET_DELAY_S = 0.05  # Packets come up to 15 ms late; a step of the PC's clock within this shows no lost sample.
_MAX_PAUSE_S = 1e4  # A clock that shows more was set.


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
    table, row = read_table(content, COLUMNS, _WANTED, first_line=1, separator=r"\s+")
    acc, gyr, number, pc, rate, mag = np.split(table, [3, 6, 7, 8, 9], axis=1)
    rate_hz = find_nominal_rate_hz(rate[:, 0], path.name)
    number, notes = continue_numbers(number[:, 0], pc[:, 0], rate_hz, row)
    return RawRecording(
        t=scale_values(number, 1.0 / rate_hz),
        acc=scale_values(acc, GRAVITY_M_S2),
        gyr=np.ascontiguousarray(gyr),
        mag=drop_held(scale_values(mag, GAUSS_UT), gyr),
        row=row,
        provenance=Provenance(path=path, format="openshoe", notes=notes),
    )


def continue_numbers(number: Floats, pc_s: Floats, rate_hz: float, row: Ints) -> tuple[Floats, tuple[str, ...]]:
    """Row numbers (N,) that go on where those of the file begin again, by the PC's clock (N,) s, and a note for each.

    Where that clock shows no time between, they are left as they are.
    """
    number, notes = number.copy(), []
    for at in (np.flatnonzero(np.diff(number) < 0) + 1).tolist():
        passed_s = float(pc_s[at]) - float(pc_s[at - 1])
        if not 0.0 < passed_s < _MAX_PAUSE_S:
            continue
        steps = 1.0 if passed_s <= _PACKET_DELAY_S else round(passed_s * rate_hz)
        number[at:] += number[at - 1] + steps - number[at]
        words = "nothing is missing there" if steps == 1.0 else f"{passed_s:.2f} s later"
        notes.append(f"the row numbers begin again in row {row[at]}: by the computer's clock {words}")
    return number, tuple(notes)


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
