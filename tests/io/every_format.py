"""A small sample of every kind of file that is read, from one recording: each test of formats runs over all of them."""

from __future__ import annotations

import gzip
import re
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from fg_nav.recording import RawRecording
from tests.io.foreign_phones import PHONES, sensor_logger
from tests.io.foreign_sensors import SENSORS, write_bag, write_metawear, write_ximu3
from tests.io.samples import NEEDS, OWN, TABLES, Sample, write_canonical, write_zip


def _write_gzip(raw: RawRecording, path: Path) -> None:
    write_canonical(raw, path)
    path.write_bytes(gzip.compress(path.read_bytes()))


SAMPLES: Mapping[str, Sample] = {
    **OWN,
    **SENSORS,
    **PHONES,
    **{
        name: Sample(write, "table", name=name) for name, write in TABLES.items() if find_spec(NEEDS.get(name, "numpy"))
    },
    "metawear": Sample(write_metawear, "metawear", 1e-9, name="walk"),
    "x-IMU3": Sample(write_ximu3, "xio", 1e-9, name="walk"),
    "walk.zip": Sample(lambda raw, path: write_zip(path, sensor_logger(raw)), "sensor-logger", late=True),
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
