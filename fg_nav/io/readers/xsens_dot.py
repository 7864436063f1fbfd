"""Xsens DOT, Movella DOT: CSV of the app, of its recordings, and of the PC SDK.

======================= ======================================================================================
app                     lines `DeviceTag:,LF-3` below `sep=,`, then a blank one, then the header
PC SDK                  the same keys in one line, `DeviceTag: LF-3,FirmwareVersion: ...`, then the header
`SampleTimeFine`        us in the app, 0.1 ms in the PC SDK; 32 bits, so us begin again after 71.6 min
`Acc_X` ...             m/s^2
`Gyr_X` ...             deg/s; of some modes of the PC SDK rad/s
`dq_W` ..., `dv[1]` ... turn and change of velocity, m/s, since the sample before
`Mag_X` ...             of the local field, which is 1, taken for 48 uT
`FreeAcc_X` ...         without gravity, in another frame
======================= ======================================================================================

The modes for real time, "Extended" and "Complete", hold attitude and `FreeAcc` alone: nothing can be navigated from
that. The unit of time is the one in which the samples come at a rate that the sensor has. The app gives deg/s. What the
PC SDK gives is judged: against the turn from sample to sample where it is in the file; by size, since a limb does not
turn at 40 rad/s; by gravity, which turns in the body as the gyroscope says (`fg_nav.samples.plausibility`) and stands
still where it reads its bias alone. Where nothing of this decides, the file is refused.
"""

from __future__ import annotations

import shlex

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FgNavError, FormatError
from fg_nav.io.content import Content
from fg_nav.io.counters import TICKS_32_BIT, continue_counter
from fg_nav.io.delimited import Header, find_header
from fg_nav.io.readers import xsens_mt
from fg_nav.io.readers.xsens_columns import (
    GYR,
    MAG,
    TURN,
    find_inertial,
    find_rotations,
    find_turns,
    scale_local_field,
)
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import Provenance, RawRecording, Recording
from fg_nav.samples.plausibility import measure_gravity_transport, measure_turning_period, median_period_s
from fg_nav.text import format_count

_FINE = "SampleTimeFine"
_CLOCK = (_FINE,)
_ATTITUDE = ("Quat_W", "Quat_X", "Quat_Y", "Quat_Z")

_RATES_HZ = (7.0, 130.0)
"""A DOT samples at 1 to 120 Hz, for a walk at 10 or more: there the steps of its two units of time are apart."""

_UNITS_S = {"us": 1e-6, "0.1 ms": 1e-4}
_DEGREE = np.pi / 180.0

_LIMB_RAD_S = 40.0
_BIAS = 0.3  # A gyroscope whose bias reads more than this at rest reads in deg/s: 17 deg/s would be a broken one.


def recognizes(content: Content) -> bool:
    """Whether a key of the sensor stands at the top, or a header with the sensor's time and commas."""
    top = any(line.lstrip('"').startswith("DeviceTag") for line in content.lines[:12])
    header = _find_header(content)
    return header is not None and (top or (header.separator == "," and not content.lines[0].startswith("//")))


def read(content: Content) -> RawRecording:
    """Read an export of the app or a log of the PC SDK.

    Raises `FormatError` if there is no acceleration or no rate, the unit of either clock or rate cannot be told, or a
    field is no number.
    """
    path, header = content.path, _find_header(content)
    if header is None:
        raise FormatError(f"{path.name} has no header with {_FINE}: export it again from the app.")
    _refuse_attitude_alone(header, content)
    inertial = find_inertial(header, path)
    there = [group for group in (MAG, TURN, _ATTITUDE) if set(group) <= set(header.names) and group != inertial.gyr]
    groups = [_CLOCK, inertial.acc, inertial.gyr, *there]
    table, row = header.read(content, [name for group in groups for name in group])
    columns = dict(zip(groups, np.split(table, np.cumsum([len(group) for group in groups])[:-1], axis=1), strict=True))
    t, remarks = _make_time(columns[_CLOCK][:, 0], content)
    acc, gyr, done = inertial.to_samples(columns[inertial.acc], columns[inertial.gyr], t)
    scale, judged = (1.0, ()) if inertial.gyr != GYR else _judge_rate_unit(t, acc, columns, content)
    gyr = scale_values(gyr, scale)
    mag, field = scale_local_field(columns.get(MAG), gyr)
    return RawRecording(
        t=t,
        acc=acc,
        gyr=gyr,
        mag=mag,
        row=row,
        provenance=Provenance(path=path, format="xsens-dot", notes=(*remarks, *done, *judged, *field)),
    )


def _find_header(content: Content) -> Header | None:
    return find_header(content, lambda names: _FINE in names)


def _refuse_attitude_alone(header: Header, content: Content) -> None:
    inertial = any(name.startswith(("Acc_", "Gyr_", "dv[", "dq_")) for name in header.names)
    if not inertial and {"FreeAcc_X", "Euler_X", "Quat_W"} & set(header.names):
        removed = "FreeAcc, from which gravity is removed," if "FreeAcc_X" in header else "the attitude"
        raise FormatError(
            f"{content.path.name} holds {removed} and no rate of turn: record in a mode with acceleration and angular "
            f"velocity, such as 'Rate quantities (with mag)' or 'Custom Mode 5'."
        )


def _make_time(fine: Floats, content: Content) -> tuple[Floats, tuple[str, ...]]:
    ticks, rounds = continue_counter(fine, TICKS_32_BIT)
    step = median_period_s(ticks)
    fitting = [unit for unit, size in _UNITS_S.items() if _RATES_HZ[0] <= 1.0 / (step * size) <= _RATES_HZ[1]]
    if len(fitting) != 1:
        raise FormatError(
            f"{content.path.name}: {_FINE} steps by {step:.6g}, which is no rate of a DOT in us nor in 0.1 ms: "
            f"{_name_neighbour(content)}."
        )
    unit = fitting[0]
    words = (f"{_FINE} is in 0.1 ms, as its steps of {step:g} show",) if unit == "0.1 ms" else ()
    again = (f"{_FINE} began again at its end {format_count(rounds, 'time')}: set on",) if rounds else ()
    return ticks * _UNITS_S[unit], (*words, *again)


def _name_neighbour(content: Content) -> str:
    """Say what to try: the format of an MTi, if that reads it."""
    try:
        Recording.from_raw(xsens_mt.read(content))
    except FgNavError:
        return "export it again"
    return f"read it as an MTi's, fg-nav inspect {shlex.quote(str(content.path))} --format xsens"


def _has_keys(content: Content) -> bool:
    return any("DeviceTag" in line for line in content.lines[:12])


def _is_of_sdk(content: Content) -> bool:
    """Whether the keys stand in one line, as in the logs of the PC SDK."""
    return any("DeviceTag" in line and "FirmwareVersion" in line for line in content.lines[:12])


def _judge_rate_unit(
    t: Floats, acc: Floats, columns: dict[tuple[str, ...], Floats], content: Content
) -> tuple[float, tuple[str, ...]]:
    """Find what one unit of the rate is in rad/s, and say why if it is not what the app gives."""
    if _has_keys(content) and not _is_of_sdk(content):
        return _DEGREE, ()
    for unit, why in (
        _judge_by_turn(t, columns),
        _judge_by_size(columns[GYR]),
        _judge_by_gravity(t, acc, columns[GYR]),
    ):
        if unit:
            return {"rad/s": 1.0, "deg/s": _DEGREE}[unit], (f"the gyroscope is in {unit}: {why}",)
    if not _has_keys(content):
        return _DEGREE, ()
    raise FormatError(
        f"{content.path.name} does not show whether its gyroscope is in deg/s or rad/s (the SDK logs both): give it, "
        f"such as `--columns 'acc=Acc_X:Acc_Y:Acc_Z[m/s^2],gyr=Gyr_X:Gyr_Y:Gyr_Z[deg/s]' "
        f"--rate {1.0 / median_period_s(t):.0f}`."
    )


def _judge_by_turn(t: Floats, columns: dict[tuple[str, ...], Floats]) -> tuple[str, str]:
    """Set the rate against the turn since the sample before, or against the change of the attitude."""
    gyr = columns[GYR]
    if TURN in columns:
        turned = find_turns(columns[TURN])
    elif _ATTITUDE in columns and len(t) > 1:
        attitude, known = find_rotations(columns[_ATTITUDE])
        turned = np.vstack([np.full(3, np.nan), (attitude[:-1].inv() * attitude[1:]).as_rotvec()])
        turned[~known] = turned[1:][~known[:-1]] = np.nan
    else:
        return "", ""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rate = turned / np.diff(t, prepend=np.nan)[:, None]
    usable = np.isfinite(rate).all(axis=1) & (np.abs(gyr) < 1e5).all(axis=1)
    rate, gyr = rate[usable], gyr[usable]
    power = float(np.sum(gyr**2))
    if not power > 0.0 or not np.sum(rate**2) > 0.0:
        return "", ""
    product = float(np.sum(rate * gyr))
    gain, correlation = product / power, product / np.sqrt(power * float(np.sum(rate**2)))
    if correlation < 0.7:
        return "", ""
    return "rad/s" if gain > np.sqrt(_DEGREE) else "deg/s", "it fits the turn from sample to sample"


def _judge_by_size(gyr: Floats) -> tuple[str, str]:
    gyr = gyr[(np.abs(gyr) < 1e5).all(axis=1)]
    if len(gyr) and np.quantile(np.linalg.norm(gyr, axis=1), 0.99) > _LIMB_RAD_S:
        return "deg/s", "no limb turns as fast in rad/s"
    return "", ""


def _judge_by_gravity(t: Floats, acc: Floats, gyr: Floats) -> tuple[str, str]:
    transport = measure_gravity_transport(acc, gyr, median_period_s(t))
    turning_s = measure_turning_period(acc, gyr)
    if turning_s > 0.0:
        return "rad/s" if turning_s > np.sqrt(_DEGREE) * median_period_s(t) else "deg/s", "gravity turns as it says"
    if transport.is_telling and transport.gain > 0:
        return "rad/s" if transport.gain > np.sqrt(_DEGREE) else "deg/s", "gravity turns in the body as it says"
    finite = gyr[(np.abs(gyr) < 1e5).all(axis=1)]
    if transport.n_windows >= 100 and abs(transport.gain) < 0.1 and np.median(np.linalg.norm(finite, axis=1)) > _BIAS:
        return "deg/s", "gravity stands still in the body"
    return "", ""
