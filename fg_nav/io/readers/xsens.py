"""Xsens and Movella: text of MT Manager (MTi, MTx, MTw Awinda), CSV of the DOT's app, its recordings and its PC SDK.

Both have `Acc_X` ... m/s^2, `Gyr_X` ..., and `Mag_X` ... in units of the local field; or in their place the changes of
velocity (m/s) and the turns (quaternions) over each sample: over its period these are the mean specific force and rate,
which is what strapdown integration needs. `FreeAcc` is without gravity and in another frame.

MT Manager: one file a sensor, rad/s, below lines that begin with `//`. Fields are separated by tab, comma, semicolon or
a blank, as the user chose, and may be empty. `SampleTimeFine`, 0.1 ms, begins again after a day; where the exporter
left it empty, the packet counter over the rate of a line above the table is the time. A lost packet becomes a gap.

DOT: in the app lines `DeviceTag:,LF-3` below `sep=,`, in the PC SDK the same keys in one line. `SampleTimeFine` is in
us in the app, in 0.1 ms in the PC SDK, of 32 bits: its unit is the one in which the samples come at a rate that a DOT
has. The modes for real time hold attitude and `FreeAcc` alone: nothing can be navigated from that. The app gives deg/s.
What the PC SDK gives is judged: against the turn from sample to sample where it is in the file; by size, since a limb
does not turn at 40 rad/s; by gravity, which turns in the body as the gyroscope says (`fg_nav.samples.plausibility`) and
stands still where it reads its bias alone. Where nothing of this decides, the file is refused.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import FgNavError, FormatError
from fg_nav.io.content import Content, split_fields
from fg_nav.io.readers.known_tables import LOCAL_FIELD, Axes, pack_samples, read_sensors
from fg_nav.io.streams import Sensor, continue_counter
from fg_nav.io.tables import TextTable, find_header, scale_values
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.plausibility import (
    measure_gravity_transport,
    measure_turning_period,
    median_period_s,
)

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

_ACC, _GYR, _MAG = (tuple(f"{sensor}_{axis}" for axis in "XYZ") for sensor in ("Acc", "Gyr", "Mag"))
_VELOCITIES = (("dv[1]", "dv[2]", "dv[3]"), tuple(f"VelInc_{axis}" for axis in "XYZ"))
_TURN, _ATTITUDE = ("dq_W", "dq_X", "dq_Y", "dq_Z"), ("Quat_W", "Quat_X", "Quat_Y", "Quat_Z")
_TURNS = (_TURN, tuple(f"OriInc_q{k}" for k in range(4)), tuple(f"OriInc_{axis}" for axis in "wxyz"))
_FINE, _COUNTERS = "SampleTimeFine", ("PacketCounter", "Counter")

_TICKS_A_DAY, _TICK_S = 864_000_000.0, 1e-4  # Of an MTi.
_RATE = re.compile(r"(?:update|sample|sampling|output)\s+rate\s*:\s*([0-9.]+)\s*hz", re.IGNORECASE)

_OWN = frozenset({"Roll", "Pitch", "Yaw", "Quat_q0", "Quat_w", "Mat[1][1]", "VelInc_X", "OriInc_q0", "OriInc_w"})
"""Columns that no DOT has: its angles are `Euler_X`, its quaternions `Quat_W`."""

_RATES_HZ = (7.0, 130.0)  # A DOT has 1 to 120 Hz, for a walk 10 or more: there the steps of its two units are apart.
_UNITS_S = {"us": 1e-6, "0.1 ms": 1e-4}

_DEGREE = np.pi / 180.0
_LIMB_RAD_S = 40.0
_BIAS = 0.3  # A gyroscope whose bias reads more than this at rest reads in deg/s: 17 deg/s would be a broken one.


def _find_sensors(header: TextTable, content: Content) -> dict[Sensor, Axes]:
    """Return the columns of specific force, rate and field; a missing column of a group raises when it is read.

    Force may come as changes of velocity, the rate as turns.
    """
    acc, gyr = (
        next((group for group in groups if not set(group).isdisjoint(header.names)), ())
        for groups in ((_ACC, *_VELOCITIES), (_GYR, *_TURNS))
    )
    if acc and gyr:
        magnetic: dict[Sensor, Axes] = {"mag": Axes(_MAG, LOCAL_FIELD)} if set(_MAG) <= set(header.names) else {}
        return {"acc": Axes(acc), "gyr": Axes(gyr), **magnetic}
    missing = [*(() if acc else ("accelerometer",)), *(() if gyr else ("gyroscope",))]
    names = [*(() if acc else ("Acc_X, _Y, _Z",)), *(() if gyr else ("Gyr_X, _Y, _Z",))]
    removed = " (FreeAcc is without gravity)" if "FreeAcc_X" in header and not acc else ""
    raise FormatError(
        f"{content.path.name} has no {' and no '.join(missing)}{removed}: export it again with the inertial data "
        f"({' and '.join(names)})."
    )


def _divide_by_period(samples: dict[Sensor, Floats], sensors: Mapping[Sensor, Axes], t: Floats) -> list[str]:
    """Make force and rate of changes over each sample, in place; return notes."""
    per_s, remarks = 1.0 / median_period_s(t), []
    if sensors["acc"].names != _ACC:
        samples["acc"] = scale_values(samples["acc"], per_s)
        remarks.append("the specific force is from the changes of velocity over each sample")
    if sensors["gyr"].names != _GYR:
        samples["gyr"] = scale_values(_find_turns(samples["gyr"]), per_s)
        remarks.append("the rate of turn is from the turns over each sample")
    return remarks


def _find_turns(wxyz: Floats) -> Floats:
    """Rotation vectors (N, 3) rad of quaternions (N, 4); NaN where they are not of unit length."""
    rotation, known = _find_rotations(wxyz)
    turned = np.asarray(rotation.as_rotvec())
    turned[~known] = np.nan
    return turned


def _find_rotations(wxyz: Floats) -> tuple[Rotation, Bools]:
    """Rotations of quaternions (N, 4), and which (N,) are of unit length; the others are none."""
    from scipy.spatial.transform import Rotation  # slow to load

    known = np.zeros(len(wxyz), dtype=np.bool_)
    small = (np.abs(wxyz) < 2.0).all(axis=1)
    known[small] = np.abs(np.linalg.norm(wxyz[small], axis=1) - 1.0) < 0.01
    return Rotation.from_quat(np.where(known[:, None], wxyz, [1.0, 0.0, 0.0, 0.0]), scalar_first=True), known


# MT Manager


def is_mt(content: Content) -> bool:
    """Whether a table with a packet counter stands below lines that begin with `//`, or without a clock or commas.

    Other such tables are those of a DOT, but where columns are named as MT Manager alone does.
    """
    header = _find_mt_header(content)
    if header is None or any("DeviceTag" in line for line in content.lines[: header.line]):
        return False
    if content.lines[0].startswith("//") or not _OWN.isdisjoint(header.names) or header.separator != ",":
        return True
    # whether the sensor's time is in the first row
    row = split_fields(content.lines[header.line + 1]) if header.line + 1 < len(content.lines) else []
    position = header.names.index(_FINE) if _FINE in header else len(row)
    return position >= len(row) or row[position].lower() in ("", "nan")


def _find_mt_header(content: Content) -> TextTable | None:
    sensors = {*_ACC, *_GYR, *_MAG, "FreeAcc_X", "Mat[1][1]", "Quat_q0", "Quat_w", "Roll", "VelInc_X"}
    is_commented = bool(content.lines) and content.lines[0].startswith("//")
    return find_header(
        content,
        lambda names: not sensors.isdisjoint(names) and (is_commented or not set(_COUNTERS).isdisjoint(names)),
    )


def read_mt(content: Content) -> RawRecording:
    """Read an export of MT Manager."""
    header = _find_mt_header(content)
    if header is None:
        raise FormatError(f"{content.path.name} has no header with PacketCounter: export it again from MT Manager.")
    sensors = _find_sensors(header, content)
    clocks = [name for name in (_FINE, *_COUNTERS) if name in header]
    clock, samples, row = read_sensors(header, clocks, sensors)
    t, notes = _make_mt_time(dict(zip(clocks, clock.T, strict=True)), len(row), content)
    remarks = _divide_by_period(samples, sensors, t)
    return pack_samples(content, "xsens", t, samples, sensors, row, [*notes, *remarks])


def _make_mt_time(clocks: dict[str, Floats], count: int, content: Content) -> tuple[Floats, tuple[str, ...]]:
    """Return the time (N,) s from the best of `clocks`, else from `count` rows at the file's rate; and notes on it."""
    fine = clocks.get(_FINE)
    if fine is not None and np.isfinite(fine).mean() > 0.5 and np.nanmax(fine) > np.nanmin(fine):
        end = _TICKS_A_DAY if np.nanmax(fine) < _TICKS_A_DAY else 2.0**32
        ticks, notes = continue_counter(fine, end, _FINE)
        return ticks * _TICK_S, notes
    # rate
    rate_hz = content.rate_hz
    if rate_hz is None:
        said = next((match for match in map(_RATE.search, content.lines[:60]) if match), None)
        rate_hz = float(said[1]) if said else 0.0
        if not 1.0 <= rate_hz <= 1e4:
            raise FormatError(
                f"{content.path.name} holds packet numbers but neither time nor rate: give the rate it was recorded at "
                f"in Hz, such as `--rate 100`."
            )
    # packets
    packets = next((clocks[name] for name in _COUNTERS if name in clocks and np.isfinite(clocks[name]).any()), None)
    if packets is None:
        return np.arange(count) / rate_hz, (f"there is no clock: time is the row number at {rate_hz:g} Hz",)
    packets, notes = continue_counter(packets, 2.0**16, "the packet counter")
    t = (packets - packets[np.isfinite(packets)][0]) / rate_hz
    return t, (f"time is the packet counter at {rate_hz:g} Hz", *notes)


# DOT


def is_dot(content: Content) -> bool:
    """Whether a key of the sensor stands at the top, or a header with the sensor's time and commas."""
    top = any(line.lstrip('"').startswith("DeviceTag") for line in content.lines[:12])
    header = find_header(content, lambda names: _FINE in names)
    return header is not None and (top or (header.separator == "," and not content.lines[0].startswith("//")))


def read_dot(content: Content) -> RawRecording:
    """Read an export of the app or a log of the PC SDK."""
    path, header = content.path, find_header(content, lambda names: _FINE in names)
    if header is None:
        raise FormatError(f"{path.name} has no header with {_FINE}: export it again from the app.")
    is_inertial = any(name.startswith(("Acc_", "Gyr_", "dv[", "dq_")) for name in header.names)
    if not is_inertial and {"FreeAcc_X", "Euler_X", "Quat_W"} & set(header.names):
        removed = "FreeAcc, from which gravity is removed," if "FreeAcc_X" in header else "the attitude"
        raise FormatError(
            f"{path.name} holds {removed} and no rate of turn: record in a mode with acceleration and angular "
            f"velocity, such as 'Rate quantities (with mag)' or 'Custom Mode 5'."
        )
    sensors = _find_sensors(header, content)
    known = [group for group in (_TURN, _ATTITUDE) if group != sensors["gyr"].names]
    turned = next((group for group in known if set(group) <= set(header.names)), ())
    values, samples, row = read_sensors(header, [_FINE, *turned], sensors)
    t, remarks = _make_dot_time(values[:, 0], content)
    done, judged = _divide_by_period(samples, sensors, t), tuple[str, ...]()
    if sensors["gyr"].names == _GYR:
        turns = _find_turns_between(values[:, 1:], turned == _ATTITUDE) if turned else None
        scale, judged = _judge_rate_unit(t, samples["acc"], samples["gyr"], turns, content)
        samples["gyr"] = scale_values(samples["gyr"], scale)
    return pack_samples(content, "xsens-dot", t, samples, sensors, row, [*remarks, *done, *judged])


def _make_dot_time(fine: Floats, content: Content) -> tuple[Floats, tuple[str, ...]]:
    ticks, notes = continue_counter(fine, 2.0**32, _FINE)
    step = median_period_s(ticks)
    fitting = [unit for unit, size in _UNITS_S.items() if _RATES_HZ[0] <= 1.0 / (step * size) <= _RATES_HZ[1]]
    if len(fitting) == 1:
        said = (f"{_FINE} is in 0.1 ms, as its steps of {step:g} show",) if fitting == ["0.1 ms"] else ()
        return ticks * _UNITS_S[fitting[0]], (*said, *notes)
    try:  # as of an MTi
        Recording.from_raw(read_mt(content))
        advice = f"read it as an MTi's, fg-nav inspect {shlex.quote(str(content.path))} --format xsens"
    except FgNavError:
        advice = "export it again"
    raise FormatError(
        f"{content.path.name}: {_FINE} steps by {step:.6g}, which is no rate of a DOT in us nor in 0.1 ms: {advice}."
    )


def _judge_rate_unit(
    t: Floats, acc: Floats, gyr: Floats, turns: Floats | None, content: Content
) -> tuple[float, tuple[str, ...]]:
    """Return the factor from the file's rate to rad/s, and a note if it was judged by the data, not the app's deg/s."""
    top = [line for line in content.lines[:12] if "DeviceTag" in line]
    if top and not any("FirmwareVersion" in line for line in top):  # of the app: the SDK has the keys in one line
        return _DEGREE, ()
    gain, why = None if turns is None else _compare_turns(t, gyr, turns), "it fits the turn from sample to sample"
    whole = gyr[(np.abs(gyr) < 1e5).all(axis=1)]
    if gain is None and len(whole) and np.quantile(np.linalg.norm(whole, axis=1), 0.99) > _LIMB_RAD_S:
        gain, why = _DEGREE, "no limb turns as fast in rad/s"
    if gain is None:
        period_s = median_period_s(t)
        transport, turning_s = measure_gravity_transport(acc, gyr, period_s), measure_turning_period(acc, gyr)
        if turning_s > 0.0:
            gain, why = turning_s / period_s, "gravity turns as it says"
        elif transport.is_telling and transport.gain > 0:
            gain, why = transport.gain, "gravity turns in the body as it says"
        elif (
            transport.n_windows >= 100
            and abs(transport.gain) < 0.1
            and np.median(np.linalg.norm(whole, axis=1)) > _BIAS
        ):
            gain, why = _DEGREE, "gravity stands still in the body"
    if gain is not None:
        is_rad = gain > np.sqrt(_DEGREE)
        return 1.0 if is_rad else _DEGREE, (f"the gyroscope is in {'rad/s' if is_rad else 'deg/s'}: {why}",)
    if not top:
        return _DEGREE, ()
    raise FormatError(
        f"{content.path.name} does not show whether its gyroscope is in deg/s or rad/s (the SDK logs both): give it, "
        f"such as `--columns 'acc=Acc_X:Acc_Y:Acc_Z[m/s^2],gyr=Gyr_X:Gyr_Y:Gyr_Z[deg/s]' "
        f"--rate {1.0 / median_period_s(t):.0f}`."
    )


def _find_turns_between(wxyz: Floats, is_attitude: bool) -> Floats:
    """Rotation vectors (N, 3) rad from sample to sample, of turns (N, 4) or of attitudes; NaN where there is none."""
    if not is_attitude or len(wxyz) < 2:
        return _find_turns(wxyz)
    attitude, known = _find_rotations(wxyz)
    turned = np.vstack([np.full(3, np.nan), (attitude[:-1].inv() * attitude[1:]).as_rotvec()])
    turned[~known] = turned[1:][~known[:-1]] = np.nan
    return turned


def _compare_turns(t: Floats, gyr: Floats, turned: Floats) -> float | None:
    """Return the scale of the rate by turns (N, 3) against the gyroscope (least squares); None if unclear."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rate = turned / np.diff(t, prepend=np.nan)[:, None]
    usable = np.isfinite(rate).all(axis=1) & (np.abs(gyr) < 1e5).all(axis=1)
    rate, gyr = rate[usable], gyr[usable]
    power, turned_power, product = float(np.sum(gyr**2)), float(np.sum(rate**2)), float(np.sum(rate * gyr))
    if not power > 0.0 or not turned_power > 0.0 or product / np.sqrt(power * turned_power) < 0.7:
        return None
    return product / power
