"""Several sensors with stamps and rates of their own, brought onto one clock: that of the gyroscope.

A phone delivers each sensor when it has it: other rates, other starts, gaps of its own. Of streams (t_k, x_k)

* acc at a gyroscope's stamp t is the straight line between the samples of acc before and after it; the error is at most
  h^2/8 max|x''| over the step h between them. Across a gap of acc there is no line: such rows are NaN;
  where acc is faster than the gyroscope, the mean of these lines over its period keeps the velocity;
* mag is put at the gyroscope's row that is nearest in time, each sample once: estimators count samples as measurements,
  and all other rows are NaN. It moves by half a period of the gyroscope at most;
* pressure is put there likewise;
* rows are those of the gyroscope from where both began to where one of them ended.

Stamps are s, or whole ns (int64), of which the first is subtracted before they become s: a double resolves the
nanoseconds since 1970 to 256 ns only. What was done stands in the notes of the recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints, interpolate_columns
from fg_nav.errors import FormatError
from fg_nav.recording import Provenance, RawRecording
from fg_nav.samples.stamps import GAP_PERIODS
from fg_nav.text import format_count

Sensor = Literal["acc", "gyr", "mag", "pressure"]

NAMES: dict[Sensor, str] = {"acc": "accelerometer", "gyr": "gyroscope", "mag": "magnetometer", "pressure": "barometer"}
UNCALIBRATED_FIELD = "the magnetometer is uncalibrated: the field of the phone is still in it"

MIN_RATE_HZ, SLOW_HZ = 9.0, 20.0  # A leg swings once or twice a second: little of a swing is seen; not enough of it.
MAX_FIELD_UT = 200.0  # The Earth's field is 25 to 65 uT; buildings make up to this of it.
_SAME_SHARE = 0.9  # Stamps of which more than this are the same are those of one clock; at its ends one may miss some.
_FASTER = 1.5  # An accelerometer that is faster than the gyroscope by this is averaged.
_END_OF_TIME_S = 1e11  # Seconds since 1970 are 2e9.
_NONSENSE = 1e9  # No sensor reads as much in m/s^2, rad/s or uT.
_RESTART_S = 1.0  # A step backward by more is a clock that began again, not a sample that came late.
_FROZEN_S = 2.0  # A sensor that wakes up repeats its first sample for less; longer, it rests without noise.
_FROZEN_ROWS = 3  # Two equal samples are quantization.
_HELD_PERIODS = 3.0  # A value that lasts longer than so many samples was measured again.
_MOVING_RAD_S = 0.5  # Turning this fast, no real magnetometer gives the same three numbers twice by chance.
_HELD_SHARE = 0.1  # More repeats than this in motion are the logger's doing, not the quantization's.


@dataclass(frozen=True)
class Stream:
    """Samples of one sensor."""

    what: Sensor  # the sensor
    t: Floats | Ints  # (N,) s, or whole ns as int64; the streams of a recording have the same zero and the same unit
    xyz: Floats  # (N, 3) m/s^2, rad/s or uT, or (N, 1) Pa, NaN where there is none
    row: Ints  # (N,) lines in its file
    source: str  # what people call it, such as its file

    @property
    def name(self) -> str:
        """The sensor in words."""
        return NAMES[self.what]

    @property
    def period_s(self) -> float:
        """Median step between stamps that rise."""
        return float(np.median(np.diff(self.t)))

    def take(self, chosen: Bools | Ints | slice) -> Stream:
        """Return some of the samples."""
        return replace(self, t=self.t[chosen], xyz=self.xyz[chosen], row=self.row[chosen])


def join_streams(
    streams: Sequence[Stream], path: Path, format: str, notes: Sequence[str] = (), is_part: bool = False
) -> RawRecording:
    """Return one recording from a stream per sensor: force interpolated, field nearest, at the gyroscope's stamps.

    `path`, `format`, `notes` and remarks on the processing become the provenance; `is_part` where the sensors are in
    files of their own, and `path` is one of them.
    """
    remarks = list(notes)
    there = [stream.name for stream in streams]
    if len(set(there)) < len(there):
        listed = ", ".join(f"{stream.name}: {stream.source}" for stream in streams)
        raise FormatError(f"{path.name} holds two tables of a sensor ({listed}): give those of one recording.")
    cleaned = {stream.what: _clean(stream, remarks) for stream in _subtract_start(streams, remarks)}
    for needed in ("acc", "gyr"):
        if needed not in cleaned:
            remedy = "record the accelerometer, with gravity in it, and the gyroscope together"
            if is_part and len(streams) == 1:
                remedy = "give the folder or zip with the files of all sensors"
            only = f", only {' and '.join(there)}" if there else ""
            raise FormatError(f"{path.name} has no {NAMES[needed]}{only}: {remedy}.")
        if len(cleaned[needed].t) < 2:
            found = f"{cleaned[needed].source} has {format_count(len(cleaned[needed].t), 'sample')}"
            raise FormatError(f"{path.name}: {found} of the {NAMES[needed]}: record it again.")
    acc, gyr, mag, air = cleaned["acc"], cleaned["gyr"], cleaned.get("mag"), cleaned.get("pressure")
    if mag is not None and len(mag.t) < 2:
        remarks.append(f"the magnetometer ({mag.source}) has no samples: left out")
        mag = None
    elif mag is not None and not (strength := float(np.median(np.linalg.norm(mag.xyz, axis=1)))) < MAX_FIELD_UT:
        remarks.append(f"the magnetometer reads {strength:.0f} uT, most of it the device's own field: left out")
        mag = None
    slowest = max((acc, gyr), key=lambda stream: stream.period_s)
    few = f"the {slowest.name} has {1.0 / slowest.period_s:.3g} samples a second, too few to follow a"
    if 1.0 / slowest.period_s < MIN_RATE_HZ:
        raise FormatError(f"{path.name}: {few} walk: record at 50 Hz or more, 100 Hz for a foot.")
    if 1.0 / slowest.period_s < SLOW_HZ:
        remarks.append(f"{few} step well: record at 50 Hz or more")
    rates = _describe([acc, gyr, *(one for one in (mag, air) if one is not None and len(one.t) > 1)])
    gyr = _cut_to_shared(acc, gyr, path, remarks)
    force = _interpolate(acc, gyr, remarks)
    field = None if mag is None else _place(mag, gyr)
    pressure = None if air is None else _place(air, gyr)[:, 0]
    remarks.append(rates)
    provenance = Provenance(path=path, format=format, notes=tuple(remarks))
    t = np.asarray(gyr.t, dtype=np.float64)
    return RawRecording(t, force, gyr.xyz, gyr.row, field, provenance=provenance, pressure=pressure)


def keep_changes(stream: Stream) -> Stream:
    """Drop rows that repeat the last sample, from a table with a row for each event of any sensor.

    A value held for long is a sensor at rest: a row is kept every `_HELD_PERIODS` sample periods.
    """
    changed = np.concatenate(([True], (np.diff(stream.xyz, axis=0) != 0).any(axis=1)))
    at = np.flatnonzero(changed)
    if len(at) < 3:
        return stream
    last = at[np.cumsum(changed) - 1]
    age = (stream.t - stream.t[last]) / (_HELD_PERIODS * max(float(np.median(np.diff(stream.t[at]))), 1e-9))
    again = np.concatenate(([False], np.diff(np.floor(age)) > 0))
    return stream.take(changed | again)


def _subtract_start(streams: Sequence[Stream], remarks: list[str]) -> list[Stream]:
    """Convert stamps to s; subtract the first first where they are integer ns: a later one may be damaged."""
    streams = [stream for stream in streams if len(stream.t)]
    if not streams or any(stream.t.dtype.kind == "f" for stream in streams):
        units = [1.0 if stream.t.dtype.kind == "f" else 1e-9 for stream in streams]
        return [replace(s, t=s.t.astype(np.float64) * unit) for s, unit in zip(streams, units, strict=True)]
    start = min(int(stream.t[0]) for stream in streams if stream.what != "pressure" or len(streams) == 1)
    if start > 10**18:
        day = datetime.fromtimestamp(start // 10**9, UTC)
        remarks.append(f"time 0 is {day:%Y-%m-%d %H:%M:%S}.{start // 10**6 % 1000:03d} UTC")
    return [replace(stream, t=np.asarray(stream.t - start, dtype=np.float64) * 1e-9) for stream in streams]


def _clean(stream: Stream, remarks: list[str]) -> Stream:
    """Keep finite samples in order of time, without duplicates and the constant ones of a sensor waking up."""
    whole = (np.abs(stream.t) < _END_OF_TIME_S) & (np.abs(stream.xyz) < _NONSENSE).all(axis=1)
    if stream.what == "mag":  # which is zero until it is calibrated
        whole &= stream.xyz.any(axis=1)
    stream = stream.take(whole)
    # the longest part between stamps that begin again
    restarts = np.flatnonzero(np.diff(stream.t) < -_RESTART_S) + 1
    if len(restarts):
        edges = [0, *restarts.tolist(), len(stream.t)]
        longest = int(np.argmax(np.diff(edges)))
        remarks.append(
            f"the stamps of the {stream.name} begin again in row {stream.row[restarts[0]]}: of {len(edges) - 1} parts "
            f"the longest is taken"
        )
        stream = stream.take(slice(edges[longest], edges[longest + 1]))
    # late and repeated samples
    late = int(np.count_nonzero(np.diff(stream.t) < 0))
    in_order = np.unique(stream.t, return_index=True)[1]
    again = len(stream.t) - len(in_order)
    if late:
        remarks.append(f"{format_count(late, 'sample')} of the {stream.name} came late: sorted")
    if again:
        remarks.append(f"{format_count(again, 'sample')} of the {stream.name} with the stamp of another left out")
    stream = stream.take(in_order)
    # zeros, or repeats of one sample, before the sensor is awake
    if len(stream.t) < 2:
        return stream
    count = int(np.argmax((stream.xyz != stream.xyz[0]).any(axis=1)))  # 0 where none is other
    zero = not stream.xyz[0].any()
    frozen = count >= _FROZEN_ROWS and stream.t[count - 1] - stream.t[0] < _FROZEN_S
    if not count or not (zero or frozen):
        return stream
    what, rows = "zero" if zero else "one sample repeated", f"{count} rows" if count > 1 else "row"
    remarks.append(f"the first {rows} of the {stream.name}, {what}, left out")
    return stream.take(slice(count, None))


def _cut_to_shared(acc: Stream, gyr: Stream, path: Path, remarks: list[str]) -> Stream:
    """Return the gyroscope stream cut to the time shared with the accelerometer."""
    first, last = max(acc.t[0], gyr.t[0]), min(acc.t[-1], gyr.t[-1])
    if last - first < 0.5 * min(acc.t[-1] - acc.t[0], gyr.t[-1] - gyr.t[0]):
        spans = " and ".join(f"{one.name} ({one.t[0]:.1f} to {one.t[-1]:.1f} s)" for one in (acc, gyr))
        raise FormatError(f"{path.name}: {spans} ran at different times: give the files of one recording.")
    before, after = first - min(acc.t[0], gyr.t[0]), max(acc.t[-1], gyr.t[-1]) - last
    if max(before, after) > GAP_PERIODS * gyr.period_s:
        remarks.append(
            f"cut to the time in which accelerometer and gyroscope ran: {before:.3f} s left out at the start, "
            f"{after:.3f} s at the end"
        )
    shared = gyr.take((gyr.t >= first) & (gyr.t <= last))
    if len(shared.t) < 2:
        count = format_count(len(shared.t), "sample")
        raise FormatError(f"{path.name}: {gyr.source} has {count} while the accelerometer ran: record it again.")
    return shared


def find_gap_s(t: Floats | Ints) -> float:
    """Return the least step between rising stamps (N,) s that is a gap; bursts on the way are none."""
    steps = np.diff(t)
    near = steps[steps <= 0.5]
    return GAP_PERIODS * max(float(np.median(steps)), float(near.mean()) if near.size else 0.0)


def interpolate_rows(stream: Stream, t: Floats | Ints) -> Floats:
    """Values (M, 3) of a stream on straight lines at the stamps (M,) of another, in the same unit."""
    if not len(stream.t):
        return np.full((len(t), 3), np.nan)
    zero = stream.t[0]
    stream = stream.take(np.argsort(stream.t, kind="stable"))
    return interpolate_columns(t - zero, stream.t - zero, stream.xyz)


def _interpolate(acc: Stream, gyr: Stream, remarks: list[str]) -> Floats:
    """Return specific force (N, 3) at the gyroscope's stamps, averaged if acc is faster; NaN in a gap of acc."""
    force = interpolate_rows(acc, gyr.t)
    if acc.period_s * _FASTER < gyr.period_s:  # mean of the straight lines over one period about each stamp
        steps = np.diff(acc.t)[:, None]
        velocity = np.vstack([np.zeros(3), np.cumsum(0.5 * steps * (acc.xyz[1:] + acc.xyz[:-1]), axis=0)])
        integral = replace(acc, xyz=velocity)
        first = np.maximum(gyr.t - 0.5 * gyr.period_s, acc.t[0])
        last = np.minimum(gyr.t + 0.5 * gyr.period_s, acc.t[-1])
        force = (interpolate_rows(integral, last) - interpolate_rows(integral, first)) / (last - first)[:, None]
        remarks.append("the accelerometer is faster than the gyroscope: averaged over the gyroscope's period")
    after = np.clip(np.searchsorted(acc.t, gyr.t), 1, len(acc.t) - 1)
    steps = acc.t[after] - acc.t[after - 1]
    lost = (steps > max(find_gap_s(acc.t), gyr.period_s)) & (gyr.t != acc.t[after]) & (gyr.t != acc.t[after - 1])
    if lost.any():
        force[lost] = np.nan
        remarks.append(
            f"{format_count(int(lost.sum()), 'row')} in gaps of the accelerometer, up to {steps[lost].max():.3f} s, "
            f"left out"
        )
    return force


def _place(mag: Stream, gyr: Stream) -> Floats:
    """Field (N, 3) or pressure (N, 1), each sample at the nearest of the gyroscope's rows, and there the nearest."""
    xyz = drop_held(mag.xyz, interpolate_rows(gyr, mag.t)) if mag.what == "mag" else mag.xyz
    usable = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    row, which = find_nearest_rows(mag.t[usable], gyr.t)
    field = np.full((len(gyr.t), xyz.shape[1]), np.nan)
    field[row] = xyz[usable[which]]
    return field


def find_nearest_rows(t: Floats | Ints, t_row: Floats | Ints) -> tuple[Ints, Ints]:
    """Return rows (K,) of the rising clock `t_row` (N,) s, and the index (K,) of the stamp in `t` (M,) s nearest each.

    Stamps in a gap of the clock, or beyond its ends, have no row.
    """
    reach = 0.5 * float(np.median(np.diff(t_row)))
    after = np.clip(np.searchsorted(t_row, t), 1, len(t_row) - 1)
    row = np.where(t - t_row[after - 1] < t_row[after] - t, after - 1, after)
    distance = np.abs(t_row[row] - t)
    within = (t >= t_row[0] - reach) & (t <= t_row[-1] + reach)
    usable = np.flatnonzero(within & (distance <= 0.5 * find_gap_s(t_row)))
    far_first = usable[np.argsort(-distance[usable], kind="stable")]
    nearest = np.full(len(t_row), -1)
    nearest[row[far_first]] = far_first
    taken = np.flatnonzero(nearest >= 0)
    return taken, nearest[taken]


def drop_held(mag: Floats, gyr: Floats) -> Floats:
    """Set rows of `mag` (N, D) that repeat the row before exactly to NaN, if the logger holds samples at all.

    Many loggers repeat a sample until there is a new one; an estimator would count each repeat as a measurement.
    `gyr` (N, 3) rad/s shows the motion: repeats at rest alone are quantization, and stay.
    """
    repeated = np.concatenate(([False], (mag[1:] == mag[:-1]).all(axis=1)))
    moving = (np.abs(gyr) > _MOVING_RAD_S).any(axis=1)
    judged = repeated[moving] if np.count_nonzero(moving) >= 100 else repeated
    if judged.mean() < _HELD_SHARE:
        return mag
    return np.where(repeated[:, None], np.nan, mag)


def continue_counter(count: Floats, end: float, name: str) -> tuple[Floats, tuple[str, ...]]:
    """Return the counter or clock `count` (N,) unwrapped where it restarts at `end`, and a note if it does.

    A step of more than half of `end`, up or down, counts as a wrap: packets out of order stay so, and after a pause of
    more than half a cycle the time is wrong by whole cycles. NaN stays NaN; a column with numbers beyond `end` is no
    such counter, and is returned unchanged.
    """
    known = np.flatnonzero(np.isfinite(count))
    if not known.size or count[known].max() >= end or count[known].min() < 0:
        return count, ()
    whole = count.copy()
    whole[known] = np.unwrap(count[known], period=end)
    rounds = int(np.count_nonzero(np.diff(whole[known] - count[known]) > 0.5 * end))
    return whole, (f"{name} began again at its end {format_count(rounds, 'time')}: set on",) if rounds else ()


def _describe(streams: Sequence[Stream]) -> str:
    """Rates, and what is joined, if the stamps are not the same."""
    rates = ", ".join(f"{stream.name} {1.0 / stream.period_s:.1f} Hz" for stream in streams)
    acc, gyr = streams[0], streams[1]
    if np.isin(gyr.t, acc.t).mean() > _SAME_SHARE:
        return f"{rates}, on one clock"
    starts = [stream.t[0] for stream in streams]
    apart = 1e3 * (max(starts) - min(starts))
    return f"{rates}, begun {apart:.0f} ms apart: put on the gyroscope's clock, the accelerometer by straight lines"
