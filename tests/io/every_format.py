"""A small sample of every kind of file that is read, from one recording: each test of formats runs over all of them."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from fg_nav.recording import RawRecording
from tests.io.foreign_phones import PHONES, sensor_logger, write_files, zip_files
from tests.io.foreign_sensors import FOREIGN, write_bag, write_metawear, write_ximu3
from tests.io.samples import NEEDS, TABLES, WRITERS, write_canonical


@dataclass(frozen=True)
class Sample:
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


def _write_gzip(raw: RawRecording, path: Path) -> None:
    write_canonical(raw, path)
    path.write_bytes(gzip.compress(path.read_bytes()))


SAMPLES: Mapping[str, Sample] = {
    **{kind: Sample(write, format) for kind, (format, write) in WRITERS.items()},
    **{kind: Sample(*one) for kind, one in FOREIGN.items()},
    **{
        kind: Sample(lambda raw, path, p=p: write_files(p.files(raw), path), p.format, p.digits, None, p.own_clocks)
        for kind, p in PHONES.items()
    },
    **{
        name: Sample(write, "table", name=name) for name, write in TABLES.items() if find_spec(NEEDS.get(name, "numpy"))
    },
    "metawear": Sample(write_metawear, "metawear", 1e-9, name="walk"),
    "x-IMU3": Sample(write_ximu3, "xio", 1e-9, name="walk"),
    "walk.zip": Sample(lambda raw, path: zip_files(sensor_logger(raw), path), "sensor-logger", late=True),
    "walk.csv.gz": Sample(_write_gzip, "canonical"),
    **{
        kind: Sample(write_bag, "ros", 1e-9, name=name)
        for kind, name in (("bag", "walk.bag"), ("mcap", "walk.mcap"), ("db3", "walk"))
        if find_spec("rosbags")
    },
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
