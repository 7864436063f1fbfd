"""Small valid recordings in every format, made from one physically consistent motion."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy.io

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import write_canonical
from fg_nav.recording import RawRecording

AXES = "XYZ"


class Sample(NamedTuple):
    """How a sample is written, as what it is to be read, within which digits, and what is to be said."""

    write_to: Callable[[RawRecording, Path], object]
    format: str
    digits: float = 2e-7
    sensor: str | None = None
    late: bool = False  # whether the accelerometer has a clock of its own, as `foreign_phones` writes it
    name: str = ""  # of the file or folder, where it matters

    def write(self, raw: RawRecording, folder: Path) -> Path:
        """Write it into a folder; return what is read."""
        path = folder / (self.name or "walk.mat")  # a name that scipy does not change
        self.write_to(raw, path)
        return path if self.name else path.rename(folder / "walk.dat")


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


RAW = tilting(np.random.default_rng(3), duration_s=4.0, rate_hz=100.0, still_s=1.0)
"""What the samples hold, unless a test makes its own."""


def axes(*patterns: str, letters: str = AXES) -> list[str]:
    """Names of the axes of each sensor, by patterns such as `Acc_{}`."""
    return [pattern.format(axis) for pattern in patterns for axis in letters]


def tabulate(names: Sequence[str], columns: Sequence[object], separator: str = ",", form: str = "{!r}") -> str:
    """Text of a table: columns of numbers (N,) or (N, K), or of words (N,), below their names."""
    fields = list[list[str]]()
    for column in columns:
        for part in np.atleast_2d(np.asarray(column).T).tolist():
            fields.append([one if isinstance(one, str) else form.format(one) for one in part])
    return "\n".join([separator.join(names), *map(separator.join, zip(*fields, strict=True))]) + "\n"


def write_zip(path: Path, files: Mapping[str, str | bytes], packed: bool = True) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def write_columns(path: Path, names: Sequence[str], columns: Sequence[object], separator: str = ",") -> Path:
    path.write_text(tabulate(names, columns, separator, "{:.10g}"), encoding="utf-8")
    return path


def write_sensorconnect(raw: RawRecording, path: Path) -> None:
    assert raw.mag is not None
    names = axes(*(f"inertial-1.2:scaled{name}{{}}" for name in ("Accel", "Gyro", "Mag")))
    path.write_text(tabulate(["Time", *names], [raw.t, raw.acc / GRAVITY_M_S2, raw.gyr, raw.mag / 100.0]))


def write_sensorconnect_estimated(raw: RawRecording, path: Path) -> None:
    names = axes("inertial-1.2:estCompensatedAccel{}", "inertial-1.2:estAngularRate{}")
    flagged = [column for samples in (*raw.acc.T, *raw.gyr.T) for column in (samples, np.ones(len(raw.t)))]
    names = [name for axis in names for name in (axis, f"{axis}:valid")]
    path.write_text(tabulate(["Time", *names], [raw.t, *flagged]))


def write_xio(raw: RawRecording, path: Path) -> None:
    assert raw.mag is not None
    names = ["Time (s)", *axes("Gyroscope {} (deg/s)", "Accelerometer {} (g)", "Magnetometer {} (uT)")]
    path.write_text(tabulate(names, [raw.t, np.rad2deg(raw.gyr), raw.acc / GRAVITY_M_S2, raw.mag]))


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
    sample, xy = np.arange(0, len(raw.t), 100), np.column_stack([raw.t, -2.0 * raw.t])
    variables = {
        "imu_data": np.column_stack([raw.acc, raw.gyr]), "timestamps": raw.t[None, :], "strideIndex": sample[None, :],
        "GCP": xy[sample], "pyshoeTrajectory": xy, **changes,
    }  # fmt: skip
    scipy.io.savemat(path, {name: value for name, value in variables.items() if value is not None})


def write_broad(raw: RawRecording, path: Path) -> None:
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (len(raw.t), 1))
    quaternion[5:8] = np.nan
    variables = {
        "imu_acc": raw.acc, "imu_gyr": raw.gyr, "imu_mag": raw.mag, "opt_quat": quaternion,
        "opt_pos": np.zeros_like(raw.acc), "sampling_rate": (len(raw.t) - 1) / (raw.t[-1] - raw.t[0]),
    }  # fmt: skip
    scipy.io.savemat(path, variables, do_compression=True)


def write_table(raw: RawRecording, path: Path) -> None:
    """Of no known format, with lines above and a row of units."""
    assert raw.mag is not None
    columns = [raw.t * 1e3, raw.acc / GRAVITY_M_S2, np.rad2deg(raw.gyr), raw.mag / 100.0]
    names, *rows = tabulate(["stamp", *axes("Accel {}", "Gyro {}", "Mag {}")], columns, ";").splitlines()
    units = ";".join(["ms", *["g"] * 3, *["dps"] * 3, *["G"] * 3])
    path.write_text("\n".join(["logged by somebody", names, units, *rows]) + "\n")


def _name_columns(raw: RawRecording) -> pd.DataFrame:
    """A table in SI of plain names."""
    table = np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag])
    return pd.DataFrame(table, columns=["t", *axes("a{}", "g{}", "m{}", letters="xyz")])


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
        json.dumps({name: getattr(raw, name).tolist() for name in ("t", "acc", "gyr", "mag")})
    ),
    "walk.h5": _write_hdf5,
    "walk.xlsx": lambda raw, path: _name_columns(raw).to_excel(path, index=False, engine="openpyxl"),
}
"""Tables in files of other programs, by a name that these would give."""

NEEDS = {"walk.parquet": "pyarrow", "walk.h5": "h5py", "walk.xlsx": "openpyxl"}  # packages that are extras


OWN = {
    "canonical": Sample(write_canonical, "canonical"),
    "sensorconnect": Sample(write_sensorconnect, "sensorconnect"),
    "estimated": Sample(write_sensorconnect_estimated, "sensorconnect"),
    "xio": Sample(write_xio, "xio"),
    "openshoe": Sample(write_openshoe, "openshoe"),
    "pyshoe": Sample(write_pyshoe, "pyshoe"),
    "gdlbio": Sample(write_gdlbio, "gdlbio"),
    "broad": Sample(write_broad, "broad"),
    "table": Sample(write_table, "table"),
}
"""Kinds of files of this library, of sensors on shoes and of data sets."""
