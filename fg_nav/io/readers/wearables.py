"""Exports of worn sensors: MetaWear, Movesense, x-io and Xsens. Units and clocks: docs/formats.md.

MetaWear, a file a sensor: only the file's name says that an acceleration is linear, or gravity alone: these are left
out. What stands in it before the sensor is one a session.

Movesense, `{"Meas": {"IMU9": [{"Timestamp": ..., "ArrayAcc": [{"x": ..., ...}, ...], ...}, ...]}}`: the stamp is of the
first of the 4 to 16 samples of a block; where blocks are missing, they come as in the blocks around. Blocks are taken
wherever they stand: apps nest them differently.

Xsens, MT Manager and DOT: samples; or in their place the changes of velocity (m/s) and the turns (quaternions) over
each, which over its period are the mean specific force and rate.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.headers import find_factor, find_quantity
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, choose_sensor, split_fields
from fg_nav.io.readers import table
from fg_nav.io.readers.known_tables import LOCAL_FIELD, Axes, pack_samples, read_sensors
from fg_nav.io.streams import NAMES, Sensor, Stream, continue_counter, join_streams
from fg_nav.io.tables import TextTable, find_header
from fg_nav.recording import RawRecording
from fg_nav.samples.gaps import LOST_PERIODS
from fg_nav.samples.plausibility import (
    find_gyr_unit,
    find_mag_problem,
    find_median_strength,
    median_period_s,
)

# MetaWear

_EPOCHS, _ELAPSED = ("epoch (ms)", "epoc (ms)"), "elapsed (s)"
_LATEST = (9e12, 3e9)  # Of the clocks, ms and s: later ones are damaged, and too large in ns for 64 bits.
_AXIS = re.compile(r"^([xyz])-axis \((.+)\)$")
_SENSOR = re.compile(r"[_ -]*(accelerometer|gyroscope|magnetometer)", re.IGNORECASE)
_FUSED = re.compile(r"linear|gravity|euler|quaternion|fusion", re.IGNORECASE)


def is_metawear(content: Content) -> bool:
    """Whether it is a file of a session, or a folder or archive right with such files."""
    return any(map(_find_sensor, content.files()))


def _find_sensor(file: Content) -> Sensor | None:
    """Which sensor a file is of, by the unit of its axes; None for those of a filter and of others."""
    header = file.fields()
    units = {match[2] for match in map(_AXIS.match, header) if match}
    if _ELAPSED not in header or len(units) != 1 or _FUSED.search(file.path.name):
        return None
    quantity = find_quantity(units.pop())
    return None if quantity == "time" else quantity


def read_metawear(content: Content) -> RawRecording:
    """Read a session, with stamps in whole ns."""
    sessions = dict[str, dict[Sensor, Content]]()
    for file in content.files():
        if (what := _find_sensor(file)) is not None:
            name = _SENSOR.split(file.path.name)
            sessions.setdefault((name[0] if len(name) > 1 else "") or "session", {})[what] = file
    chosen, streams = choose_sensor(list(sessions), content.sensor, content.path, "sessions"), list[Stream]()
    for what, file in sessions[chosen].items():
        header = TextTable(file, file.fields())
        epoch = next((name for name in _EPOCHS if name in header), _EPOCHS[0])
        axes = [next((name for name in header.names if name.startswith(f"{a}-axis")), f"{a}-axis") for a in "xyz"]
        values, row = header.read_columns([epoch, _ELAPSED, *axes])
        factor = find_factor(what, axes[0].split("(", 1)[1].rstrip(")"))
        whole = (np.abs(values[:, :2]) < _LATEST).all(axis=1)
        values, row = values[whole], row[whole]
        if not len(row) or factor is None:
            raise FormatError(f"{file.path.name} has no row with both clocks: export it again.")
        elapsed = np.rint(values[:, 1] * 1e9 - values[0, 1] * 1e9).astype(np.int64)
        t = np.rint(values[0, 0] * 1e6).astype(np.int64) + elapsed
        streams.append(Stream(what, t, values[:, 2:] * factor, row, file.path.name))
    notes = [f"the session is '{chosen}'"] if len(sessions) > 1 else []
    streams.sort(key=lambda stream: list(NAMES).index(stream.what))
    return join_streams(streams, content.path, "metawear", notes, is_part=not content.members)


# Movesense

_ARRAYS: dict[Sensor, tuple[str, float]] = {
    "acc": ("ArrayAcc", 1.0), "gyr": ("ArrayGyro", np.pi / 180.0), "mag": ("ArrayMagn", 1.0),
}  # fmt: skip
_ARRAY_NAMES = frozenset(name for name, _ in _ARRAYS.values())
_MAX_DEPTH = 12  # Blocks stand three to five levels deep; a file made of brackets is none.


def is_movesense(content: Content) -> bool:
    """Whether it begins as JSON, and blocks of Movesense's samples are in the beginning."""
    head = "\n".join(content.lines)
    return head.lstrip()[:1] in ("{", "[") and any(f'"{name}"' in head for name in _ARRAY_NAMES)


def read_movesense(content: Content) -> RawRecording:
    """Read a Movesense log."""
    name = content.path.name
    try:
        logged = json.loads(content.read_text())
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:80]
        raise FormatError(f"{name} is no whole JSON ({reason}): export it again.") from None
    blocks = list(_find_blocks(logged, 0))
    streams = {what: _read_blocks(blocks, what, name) for what in _ARRAYS}
    notes = ["each stamp stands for a block of samples: they are spread evenly up to the next"]
    mag = streams["mag"].xyz
    if len(mag) and find_mag_problem(mag) is not None:
        median = find_median_strength(mag)
        notes.append(f"the magnetometer is not calibrated (median {median:.0f} uT), and was left out")
        del streams["mag"]
    return join_streams([stream for stream in streams.values() if len(stream.t)], content.path, "movesense", notes)


def _find_blocks(value: Any, depth: int) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict) and not _ARRAY_NAMES.isdisjoint(value) and depth <= _MAX_DEPTH:
        yield value
    elif isinstance(value, dict | list) and depth <= _MAX_DEPTH:
        for part in value.values() if isinstance(value, dict) else value:
            yield from _find_blocks(part, depth + 1)


def _read_blocks(blocks: list[dict[str, Any]], what: Sensor, name: str) -> Stream:
    """Return the stream of one sensor, joined from all blocks with its samples."""
    (array, unit), parts, begins = _ARRAYS[what], [np.empty((0, 3))], list[float]()
    for k, block in enumerate(block for block in blocks if array in block):
        try:
            xyz = np.array([[p["x"], p["y"], p["z"]] for p in block[array]], dtype=np.float64)
            stamp = block["Timestamp"] if "Timestamp" in block else block["timestamp"]
            if type(stamp) not in (int, float) or not np.isfinite(float(stamp)):
                raise ValueError
            begins.append(float(stamp))
            parts.append(xyz.reshape(-1, 3))
        except (TypeError, KeyError, ValueError, OverflowError):
            raise FormatError(f"{name}: block {k + 1} has no stamp, or other than x, y, z: export it again.") from None
    stamps = continue_counter(np.array(begins), 2.0**32, "Timestamp")[0] * 1e-3
    sizes = np.array([len(part) for part in parts[1:]], dtype=np.int64)
    stamps, sizes = stamps[sizes > 0], sizes[sizes > 0]
    # sample period in each block: up to the next one, or the usual one where blocks are missing
    period = np.diff(stamps) / sizes[:-1]
    known = period[period > 0]
    usual = float(np.median(known)) if known.size else np.nan
    step = np.append(period, usual)[: len(stamps)]
    step[~((step > 0) & (step < LOST_PERIODS * usual))] = usual
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    t = np.repeat(stamps, sizes) + within * np.repeat(step, sizes)
    return Stream(what, t, np.concatenate(parts) * unit, np.arange(1, len(t) + 1), array)


# x-io

_XIO_AXIS = re.compile(r"(gyroscope|accelerometer|magnetometer)\s+[xyz]\b", re.IGNORECASE)


def _name_sensors(content: Content) -> set[str]:
    return {match[1].lower() for match in map(_XIO_AXIS.match, content.fields()) if match}


def _find_parts(content: Content) -> tuple[Content | None, Content | None]:
    """Files right in a folder or archive with force and rate, and with the field; None where there is not one."""
    kinds, files = ({"gyroscope", "accelerometer"}, {"magnetometer"}), content.files()
    found = [[file for file in files if _name_sensors(file) == kind] for kind in kinds]
    inertial, magnetic = (own[0] if len(own) == 1 else None for own in found)
    return inertial, magnetic


def is_xio(content: Content) -> bool:
    """Whether the first line names a gyroscope or accelerometer axis as x-io does; a folder or archive, both parts."""
    if content.members:
        return None not in _find_parts(content)
    return not _name_sensors(content).isdisjoint({"gyroscope", "accelerometer"})


def read_xio(content: Content) -> RawRecording:
    """Read an x-io CSV, or the folder of an x-IMU3."""
    if not content.members:
        return table.read(content, "xio")
    inertial, magnetic = _find_parts(content)
    field = None if magnetic is None else table.find_sensor_table(magnetic)
    if inertial is None or magnetic is None or field is None:
        raise FormatError(f"{content.path.name} has no Inertial.csv beside Magnetometer.csv: give the one that it has.")
    raw, mag, name = table.read(inertial, "xio"), field.read(), inertial.path.name
    if np.isnan(mag.xyz).all():
        notes = (f"{magnetic.path.name} is in arbitrary units and was left out",)
        return replace(raw, provenance=replace(raw.provenance, path=content.path, notes=notes))
    streams = [Stream("acc", raw.t, raw.acc, raw.row, name), Stream("gyr", raw.t, raw.gyr, raw.row, name), mag]
    return join_streams(streams, content.path, "xio")


# Xsens

_ACC, _GYR, _MAG = (tuple(f"{sensor}_{axis}" for axis in "XYZ") for sensor in ("Acc", "Gyr", "Mag"))
_VELOCITIES = (("dv[1]", "dv[2]", "dv[3]"), tuple(f"VelInc_{axis}" for axis in "XYZ"))
_TURNS = (
    ("dq_W", "dq_X", "dq_Y", "dq_Z"),
    tuple(f"OriInc_q{k}" for k in range(4)),
    tuple(f"OriInc_{axis}" for axis in "wxyz"),
)
_FINE, _COUNTERS = "SampleTimeFine", ("PacketCounter", "Counter")

_TICKS_A_DAY, _TICK_S = 864_000_000.0, 1e-4  # Of an MTi.
_MAX_MTI_HZ = 2000.0  # Of the rate and the force; the fastest output of any MTi.
_RATE = re.compile(r"(?:update|sample|sampling|output)\s+rate\s*:\s*([0-9.]+)\s*hz", re.IGNORECASE)

_OWN = frozenset({"Roll", "Pitch", "Yaw", "Quat_q0", "Quat_w", "Mat[1][1]", "VelInc_X", "OriInc_q0", "OriInc_w"})
"""Columns that no DOT has: its angles are `Euler_X`, its quaternions `Quat_W`."""

_RATES_HZ = (7.0, 130.0)  # A DOT has 1 to 120 Hz, for a walk 10 or more: there the steps of its two units are apart.
_UNITS_S = {"us": 1e-6, "0.1 ms": 1e-4}

_DEGREE = np.pi / 180.0


def _find_columns(header: TextTable, content: Content) -> dict[Sensor, Axes]:
    """Return the columns of specific force or changes of velocity, of rate or turns, and of field."""
    acc, gyr = (
        next((group for group in groups if not set(group).isdisjoint(header.names)), ())
        for groups in ((_ACC, *_VELOCITIES), (_GYR, *_TURNS))
    )
    if acc and gyr:
        magnetic: dict[Sensor, Axes] = {"mag": Axes(_MAG, LOCAL_FIELD)} if set(_MAG) <= set(header.names) else {}
        return {"acc": Axes(acc), "gyr": Axes(gyr), **magnetic}
    missing = " and no ".join(name for name, found in (("accelerometer", acc), ("gyroscope", gyr)) if not found)
    raise FormatError(
        f"{content.path.name} has no {missing} (FreeAcc is without gravity): export or record it with the inertial "
        f"data (Acc_X, _Y, _Z and Gyr_X, _Y, _Z; of a DOT in 'Custom Mode 5')."
    )


def _divide_by_period(samples: dict[Sensor, Floats], sensors: Mapping[Sensor, Axes], t: Floats) -> list[str]:
    """Make force and rate of changes over each sample, in place; return notes."""
    per_s, remarks = 1.0 / median_period_s(t), []
    if sensors["acc"].names != _ACC:
        samples["acc"] *= per_s
        remarks.append("the specific force is from the changes of velocity over each sample")
    if sensors["gyr"].names != _GYR:
        samples["gyr"] = _find_turns(samples["gyr"]) * per_s
        remarks.append("the rate of turn is from the turns over each sample")
    return remarks


def _find_turns(wxyz: Floats) -> Floats:
    """Rotation vectors (N, 3) rad of turns (N, 4); NaN where there is none."""
    from scipy.spatial.transform import Rotation  # slow to load

    known = np.abs(np.linalg.norm(wxyz, axis=1) - 1.0) < 0.01
    rotation = Rotation.from_quat(np.where(known[:, None], wxyz, [1.0, 0.0, 0.0, 0.0]), scalar_first=True)
    return np.where(known[:, None], rotation.as_rotvec(), np.nan)


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
    header = _find_mt_header(content) or TextTable(content, content.fields())
    sensors = _find_columns(header, content)
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
            words = f"{content.path.name} holds packet numbers but neither time nor rate"
            raise FormatError(f"{words}: give the rate it was recorded at in Hz, such as `--rate 100`.")
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
    header = find_header(content, lambda names: _FINE in names) or TextTable(content, content.fields())
    sensors = _find_columns(header, content)
    clock, samples, row = read_sensors(header, [_FINE], sensors)
    # unit of the clock, in which the samples come at a rate of a DOT
    ticks, remarks = continue_counter(clock[:, 0], 2.0**32, _FINE)
    step = median_period_s(ticks)
    fitting = [unit for unit, size in _UNITS_S.items() if _RATES_HZ[0] <= 1.0 / (step * size) <= _RATES_HZ[1]]
    if len(fitting) != 1:
        remedy = "export it again"
        if _RATES_HZ[0] <= 1.0 / (step * _TICK_S) <= _MAX_MTI_HZ:
            remedy = f"read it as an MTi's, fg-nav inspect {shlex.quote(str(content.path))} --format xsens, or {remedy}"
        raise FormatError(
            f"{content.path.name}: {_FINE} steps by {step:.6g}, which is no rate of a DOT in us nor in "
            f"0.1 ms: {remedy}."
        )
    if fitting == ["0.1 ms"]:
        remarks = (f"{_FINE} is in 0.1 ms, as its steps of {step:g} show", *remarks)
    t = ticks * _UNITS_S[fitting[0]]
    # force and rate
    done, judged = _divide_by_period(samples, sensors, t), tuple[str, ...]()
    if sensors["gyr"].names == _GYR:
        scale, judged = _judge_rate_unit(t, samples["acc"], samples["gyr"], content)
        samples["gyr"] *= scale
    return pack_samples(content, "xsens-dot", t, samples, sensors, row, [*remarks, *done, *judged])


def _judge_rate_unit(t: Floats, acc: Floats, gyr: Floats, content: Content) -> tuple[float, tuple[str, ...]]:
    """Return the factor from the file's rate to rad/s, and a note if it was judged as that of any table."""
    top = [line for line in content.lines[:12] if "DeviceTag" in line]
    if top and not any("FirmwareVersion" in line for line in top):  # of the app: the SDK has the keys in one line
        return _DEGREE, ()
    period_s = median_period_s(t)
    unit = find_gyr_unit(acc, gyr, period_s)
    if unit is not None:
        note = f"the gyroscope is in {unit}: its size shows it, or gravity, which turns as it says"
        return (1.0 if unit == "rad/s" else _DEGREE), (note,)
    if not top:
        return _DEGREE, ()
    raise FormatError(
        f"{content.path.name} does not show whether its gyroscope is in deg/s or rad/s (the SDK logs both): give it, "
        f"such as `--columns 'acc=Acc_X:Acc_Y:Acc_Z[m/s^2],gyr=Gyr_X:Gyr_Y:Gyr_Z[deg/s]' --rate {1.0 / period_s:.0f}`."
    )
