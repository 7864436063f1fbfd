"""Rows of the canonical format as they come: bytes in pieces of any length, samples out.

The first line that names canonical columns is the header; the same line again is passed over. Then each line is a row.
A row that has another number of fields than the header, or a field that is no number, is left out and counted; an empty
field is NaN. The last line waits for its end.

Where a walk is taken up again its header is known. A source that sent it before and goes on with rows is read by that;
one that begins again sends it again, and it must name the same columns, in any order.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.io.canonical import ACC, GYR, MAG, TIME
from fg_nav.io.tables import position_of

LONGEST_LINE = 1 << 16
"""Bytes; a longer one has lost its end."""

MOST_BEFORE_HEADER = 20
"""Lines that may come before the header: what was left in a device's buffer."""


class RowReader:
    """Turns bytes into samples; `bad` counts the rows that were left out.

    Parameters
    ----------
    name
        Of the source, for messages.
    remark
        Told a sentence about the first bad row.
    header
        Names of the columns, where they are known from before; None where the source must send them.

    Raises
    ------
    FormatError
        From `read`, where no header comes, or one without the columns of a recording, or with others than before.
    """

    def __init__(
        self, name: str, remark: Callable[[str], None] = lambda words: None, header: list[str] | None = None
    ) -> None:
        self.bad = 0
        self._name, self._remark = name, remark
        self._rest = b""
        self._line = 0
        self._header: list[str] | None = None
        self._positions: list[int] = []
        self._to_confirm = header is not None
        if header is not None:
            self._take_up(header)

    def read(self, piece: bytes) -> Floats:
        """Return the samples (n, 10) whose rows end in this piece: t, acc, gyr, mag (NaN without one)."""
        *lines, self._rest = (self._rest + piece).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            lines, self._rest = [*lines, self._rest], b""
        rows = [row for line in lines if (row := self._row(line)) is not None]
        return np.array(rows, dtype=np.float64).reshape(-1, 10)

    def finish(self) -> Floats:
        """Return the sample of a last line without an end, (0, 10) or (1, 10)."""
        rest, self._rest = self._rest, b""
        return self.read(rest + b"\n") if rest and self._header is not None else np.empty((0, 10))

    @property
    def header(self) -> list[str] | None:
        """Names of the columns; None before they are known."""
        return self._header

    def _row(self, line: bytes) -> list[float] | None:
        self._line += 1
        fields = [field.strip() for field in line.decode("utf-8", "replace").strip("\ufeff\r\n ").split(",")]
        if self._header is None:
            self._begin(fields)
            return None
        if self._to_confirm and not {*TIME, *ACC, *GYR}.isdisjoint(fields):
            self._confirm(fields)
            return None
        if fields == self._header or fields == [""]:
            return None
        if len(fields) == len(self._header) + 1 and not fields[-1]:
            fields.pop()  # a separator at the end of the row
        if len(fields) != len(self._header):
            self._leave_out(f"it has {len(fields)} fields and the header {len(self._header)}")
            return None
        try:
            return [float(fields[i]) if i >= 0 and fields[i] else np.nan for i in self._positions]
        except ValueError:
            self._leave_out("a field is not a number")
            return None

    def _begin(self, fields: list[str]) -> None:
        """Take the header, if it is one."""
        if {*TIME, *ACC, *GYR}.isdisjoint(fields):
            if self._line > MOST_BEFORE_HEADER:
                raise FormatError(
                    f"{self._name} sends no header: its first line must name the columns ({TIME[0]},{ACC[0]},...)."
                )
            return
        self._take_up(fields)

    def _confirm(self, fields: list[str]) -> None:
        """Take the header of a source that begins again."""
        assert self._header is not None
        names = {*TIME, *ACC, *GYR, *MAG}
        if names.intersection(fields) != names.intersection(self._header):
            raise FormatError(
                f"{self._name} names other columns than before the walk was taken up: name another checkpoint."
            )
        self._to_confirm = False
        self._take_up(fields)

    def _take_up(self, fields: list[str]) -> None:
        place = Path(self._name)
        names = TIME + ACC + GYR + (() if set(MAG).isdisjoint(fields) else MAG)
        positions = [position_of(name, fields, place) for name in names]
        self._positions = positions + [-1] * (10 - len(positions))
        self._header = fields if fields[-1] else fields[:-1]

    def _leave_out(self, why: str) -> None:
        if self.bad == 0:
            self._remark(f"rows that cannot be read are left out, the first in line {self._line}: {why}.")
        self.bad += 1
