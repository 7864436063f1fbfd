"""A small sample of every kind of file that is read, from one recording: each test of formats runs over all of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from fg_nav.recording import RawRecording
from tests.io.foreign_phones import PHONES, Phone, write_files
from tests.io.foreign_sensors import FOREIGN, write_metawear, write_ximu3
from tests.io.samples import NEEDS, TABLES, WRITERS


@dataclass(frozen=True)
class Sample:
    """How a sample is written into a folder, as what it is to be read, within which digits, and what is to be said."""

    write: Callable[[RawRecording, Path], Path]  # returns what is read
    format: str
    digits: float = 2e-7
    sensor: str | None = None
    late: bool = False  # whether the accelerometer has a clock of its own, as `foreign_phones` writes it


def _write_one(write: Callable[[RawRecording, Path], None], raw: RawRecording, folder: Path) -> Path:
    path = folder / "walk.mat"  # a name that scipy does not change
    write(raw, path)
    return path.rename(folder / "walk.dat")


def _write_named(name: str, write: Callable[[RawRecording, Path], object], raw: RawRecording, folder: Path) -> Path:
    write(raw, folder / name)
    return folder / name


def _write_folder(write: Callable[[RawRecording, Path], None], raw: RawRecording, folder: Path) -> Path:
    write(raw, folder / "walk")
    return folder / "walk"


def _write_phone(phone: Phone, raw: RawRecording, folder: Path) -> Path:
    return write_files(phone.files(raw), folder / "walk.dat")


SAMPLES: Mapping[str, Sample] = {
    **{kind: Sample(partial(_write_one, write), format) for kind, (format, write) in WRITERS.items()},
    **{
        kind: Sample(partial(_write_one, one.write), one.format, one.digits, one.sensor)
        for kind, one in FOREIGN.items()
    },
    **{
        kind: Sample(partial(_write_phone, phone), phone.format, phone.digits, late=phone.own_clocks)
        for kind, phone in PHONES.items()
    },
    **{
        name: Sample(partial(_write_named, name, write), "table")
        for name, write in TABLES.items()
        if find_spec(NEEDS.get(name, "numpy"))
    },
    "metawear": Sample(partial(_write_folder, write_metawear), "metawear", 1e-9),
    "x-IMU3": Sample(partial(_write_folder, write_ximu3), "xio", 1e-9),
}


def files_of(path: Path) -> list[Path]:
    return sorted(place for place in path.rglob("*") if place.is_file()) if path.is_dir() else [path]


Change = tuple[str, str, str | None]
"""In files whose names begin like this, what is found by this expression becomes that; None deletes the file."""


def write_changed(kind: str, raw: RawRecording, folder: Path, *changes: Change) -> Path:
    """Write a sample, then change its text; each change finds something."""
    path = SAMPLES[kind].write(raw, folder)
    for begins, found, instead in changes:
        places = [place for place in files_of(path) if begins in place.name]
        assert places
        for place in places:
            if instead is None:
                place.unlink()
                continue
            text, count = re.subn(found, instead, place.read_bytes().decode())
            assert count
            place.write_bytes(text.encode())
    return path
