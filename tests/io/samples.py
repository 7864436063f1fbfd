"""Small valid recordings in every format, made from one physically consistent motion."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.io

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import write_canonical
from fg_nav.recording import RawRecording

AXES = "XYZ"


def tilting(
    rng: np.random.Generator, duration_s: float = 8.0, rate_hz: float = 200.0, still_s: float = 2.0
) -> RawRecording:
    """Rest, then tilt to and fro about the body's x axis: gravity, field and gyroscope agree."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    turn = 2 * np.pi * 0.7
    moving = np.maximum(t - still_s, 0.0)
    angle, rate = 0.8 * np.sin(turn * moving), np.where(t > still_s, 0.8 * turn * np.cos(turn * moving), 0.0)
    zero = np.zeros_like(t)
    up = np.stack([zero, np.sin(angle), np.cos(angle)], axis=1)
    north = np.stack([zero, np.cos(angle), -np.sin(angle)], axis=1)
    noise = rng.normal(size=(3, len(t), 3))
    return RawRecording(
        t=t,
        acc=GRAVITY_M_S2 * up + 0.02 * noise[0],
        gyr=np.stack([rate, zero, zero], axis=1) + 0.002 * noise[1],
        mag=20.0 * north - 43.0 * up + 0.1 * noise[2],
        row=np.arange(2, len(t) + 2),
    )


def write_sensorconnect(raw: RawRecording, path: Path) -> None:
    assert raw.mag is not None
    names = [f"inertial-1.2:{name}{axis}" for name in ("scaledAccel", "scaledGyro", "scaledMag") for axis in AXES]
    table = np.column_stack([raw.t, raw.acc / GRAVITY_M_S2, raw.gyr, raw.mag / 100.0])
    _write_csv(path, ["Time", *names], table)


def write_sensorconnect_estimated(raw: RawRecording, path: Path) -> None:
    header, columns = ["Time"], [raw.t]
    for name, values in (("estCompensatedAccel", raw.acc), ("estAngularRate", raw.gyr)):
        for axis in range(3):
            header += [f"inertial-1.2:{name}{AXES[axis]}", f"inertial-1.2:{name}{AXES[axis]}:valid"]
            columns += [values[:, axis], np.ones(len(raw.t))]
    _write_csv(path, header, np.column_stack(columns))


def write_xio(raw: RawRecording, path: Path) -> None:
    header = ["Time (s)"]
    for name in ("Gyroscope {} (deg/s)", "Accelerometer {} (g)", "Magnetometer {} (uT)"):
        header += [name.format(axis) for axis in AXES]
    assert raw.mag is not None
    _write_csv(path, header, np.column_stack([raw.t, np.rad2deg(raw.gyr), raw.acc / GRAVITY_M_S2, raw.mag]))


def write_openshoe(raw: RawRecording, path: Path) -> None:
    assert raw.mag is not None
    rate = 1.0 / np.median(np.diff(raw.t))
    lines = []
    for k in range(len(raw.t)):
        force = [f"{v:+.8f}" for v in (*raw.acc[k] / GRAVITY_M_S2, *raw.gyr[k])]
        field = ["+nan"] * 3 if k % 17 == 3 else [f"{v:+.8f}" for v in raw.mag[k] / 100.0]
        clock = f"{78720 * k} 0x15fd {k + 1} 1274434048.503018 1274434048.503018 1274434048.507018"
        lines.append("   ".join(["0xcb", *force, clock, f"{rate * (1 + 0.02 * np.sin(k)):.6f}", *field]))
    path.write_text("\n".join(lines) + "\n")


def write_pyshoe(raw: RawRecording, path: Path) -> None:
    gt = np.column_stack([raw.t, 2.0 * raw.t, 0.1 * np.ones_like(raw.t)])
    still = (raw.t < 2.0).astype(np.int64)
    imu = np.column_stack([raw.acc, raw.gyr])
    scipy.io.savemat(path, {"imu": imu, "ts": raw.t[None, :], "gt": gt, "zv_shoe_opt": still[None, :]})


def write_gdlbio(raw: RawRecording, path: Path, **changes: object) -> None:
    """A footprint every 100 samples; the walk goes along x and to the left, the file has its y to the right."""
    sample = np.arange(0, len(raw.t), 100)
    xy = np.column_stack([raw.t[sample], -2.0 * raw.t[sample]])
    variables = {
        "imu_data": np.column_stack([raw.acc, raw.gyr]),
        "timestamps": raw.t[None, :],
        "strideIndex": sample[None, :],
        "GCP": xy,
        "pyshoeTrajectory": np.column_stack([raw.t, -2.0 * raw.t]),
    }
    kept = {name: value for name, value in {**variables, **changes}.items() if value is not None}
    scipy.io.savemat(path, kept)


def write_broad(raw: RawRecording, path: Path) -> None:
    n = len(raw.t)
    quaternion, position = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3))
    quaternion[5:8] = np.nan
    variables = {
        "imu_acc": raw.acc,
        "imu_gyr": raw.gyr,
        "imu_mag": raw.mag,
        "opt_quat": quaternion,
        "opt_pos": position,
        "sampling_rate": (n - 1) / (raw.t[-1] - raw.t[0]),
    }
    scipy.io.savemat(path, variables, do_compression=True)


def write_table(raw: RawRecording, path: Path) -> None:
    """Of no known format, with lines above and a row of units."""
    assert raw.mag is not None
    names = ["stamp", *(f"{name}{axis}" for name in ("Accel ", "Gyro ", "Mag ") for axis in AXES)]
    table = np.column_stack([raw.t * 1e3, raw.acc / GRAVITY_M_S2, np.rad2deg(raw.gyr), raw.mag / 100.0])
    rows = [";".join(repr(value) for value in row) for row in table.tolist()]
    units = ["ms", *["g"] * 3, *["dps"] * 3, *["G"] * 3]
    path.write_text("\n".join(["logged by somebody", ";".join(names), ";".join(units), *rows]) + "\n")


def _name_columns(raw: RawRecording) -> pd.DataFrame:
    """A table in SI of plain names."""
    table = np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag])
    return pd.DataFrame(table, columns=["t", *(f"{what}{axis}" for what in "agm" for axis in "xyz")])


def _list_rows(raw: RawRecording) -> list[dict[str, object]]:
    parts = (1e3 * raw.t, raw.acc, raw.gyr, raw.mag)
    table = zip(*(part.tolist() for part in parts), strict=True)
    return [{"ts": t, "acc": dict(zip("xyz", a, strict=True)), "gyro": w, "mag_uT": m} for t, a, w, m in table]


def _write_hdf5(raw: RawRecording, path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in (("t", raw.t), ("acc", raw.acc), ("gyr", raw.gyr.T), ("mag", raw.mag)):
            file.create_dataset(f"imu/{name}", data=values)


TABLES: dict[str, Callable[[RawRecording, Path], object]] = {
    "walk.mat": lambda raw, path: scipy.io.savemat(
        path, {"time": raw.t, "accel": raw.acc, "gyro": raw.gyr, "mag": raw.mag, "fs": 100.0}
    ),
    "named.npy": lambda raw, path: np.save(path, _name_columns(raw).to_records(index=False)),
    "walk.npz": lambda raw, path: np.savez_compressed(
        path, t=raw.t * 1e3, imu=np.column_stack([raw.acc, raw.gyr]), mag_uT=raw.mag, note="x"
    ),
    "walk.parquet": lambda raw, path: _name_columns(raw).to_parquet(path),
    "lines.jsonl": lambda raw, path: path.write_text("\n".join(map(json.dumps, _list_rows(raw)))),
    "array.json": lambda raw, path: path.write_text(json.dumps({"samples": _list_rows(raw)}, indent=1)),
    "arrays.json": lambda raw, path: path.write_text(
        json.dumps({"t": raw.t.tolist(), "acc": raw.acc.tolist(), "gyr": raw.gyr.tolist(), "mag": raw.mag.tolist()})
    ),
    "walk.h5": _write_hdf5,
    "walk.xlsx": lambda raw, path: _name_columns(raw).to_excel(path, index=False, engine="openpyxl"),
}
"""Tables in files of other programs, by a name that these would give."""

NEEDS = {"walk.parquet": "pyarrow", "walk.h5": "h5py", "walk.xlsx": "openpyxl"}  # packages that are extras


WRITERS: dict[str, tuple[str, Callable[[RawRecording, Path], None]]] = {
    "canonical": ("canonical", write_canonical),
    "sensorconnect": ("sensorconnect", write_sensorconnect),
    "estimated": ("sensorconnect", write_sensorconnect_estimated),
    "xio": ("xio", write_xio),
    "openshoe": ("openshoe", write_openshoe),
    "pyshoe": ("pyshoe", write_pyshoe),
    "gdlbio": ("gdlbio", write_gdlbio),
    "broad": ("broad", write_broad),
    "table": ("table", write_table),
}
"""A writer for each kind of file, and the format it is to be recognised as."""


def _write_csv(path: Path, header: list[str], table: np.ndarray) -> None:
    rows = [",".join(repr(value) for value in row) for row in table.tolist()]
    path.write_text("\n".join([",".join(header), *rows]) + "\n")
