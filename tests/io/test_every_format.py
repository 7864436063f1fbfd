"""Every format: of its sample no row is lost and none invented; a change of the file alters nothing, or is said."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from fg_nav.io import FORMATS, read_raw
from fg_nav.io.content import read_content
from fg_nav.recording import Recording
from tests.io.every_format import SAMPLES, Change, files_of, write_changed
from tests.io.foreign_phones import expected_force
from tests.io.samples import RAW

ANY_TABLE = {"xio", "table", "tables"}  # Tried after the others: they are recognized by names that others have too.
LOST = {"xsens": [7], "dot": [0], "hyperimu": [0], "physics-toolbox": [399]}  # Rows the file itself lacks or zeroes.
FIELDS = {  # Samples of the magnetometer in the file, where it has not one in each row that is read.
    **dict.fromkeys(("estimated", "pyshoe", "gdlbio", "dot", "dot-increments", "x-IMU3"), 0),
    **{"openshoe": 376, "phyphox in one": 380, "walk.zip": 199},
    **dict.fromkeys(("metawear", "bag", "mcap", "db3"), 100),
    **{kind: 199 for kind in SAMPLES if kind.startswith(("phyphox,", "sensor-logger")) or kind == "phyphox"},
}


def find_rows(recording: Recording) -> np.ndarray:
    """Rows of `RAW` that the samples are: they begin where the first rates are most alike."""
    apart = [np.abs(RAW.gyr[k : k + 5] - recording.gyr[:5]).sum() for k in range(30)]
    return int(np.argmin(apart)) + np.rint((recording.t - recording.t[0]) * 100).astype(int)


def test_every_format_has_a_sample() -> None:
    assert {sample.format for sample in SAMPLES.values()} | {"ros", "tables"} == set(FORMATS)  # ros is an extra


@pytest.mark.parametrize("kind", SAMPLES)
def test_no_row_is_lost_and_none_invented(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    path = sample.write(RAW, tmp_path)
    content = read_content(path)
    found = [name for name, one in FORMATS.items() if content.kind in one.kinds and one.recognizes(content)]
    assert found[0] == sample.format
    assert set(found) <= {sample.format, *ANY_TABLE}
    raw = read_raw(path, sensor=sample.sensor)
    assert (raw.provenance.format, raw.provenance.path) == (sample.format, path)
    # samples
    recording = Recording.from_raw(raw)
    k = find_rows(recording)
    lost = [0, 399] if sample.late else LOST.get(kind, [])
    assert k.tolist() == np.delete(np.arange(len(RAW.t)), lost).tolist()
    np.testing.assert_allclose(recording.t - recording.t[0], RAW.t[k] - RAW.t[k[0]], atol=2e-3)
    np.testing.assert_allclose(recording.gyr, RAW.gyr[k], atol=sample.digits)
    force = expected_force(RAW, RAW.t[k]) if sample.late else RAW.acc[k]
    np.testing.assert_allclose(recording.acc, force, atol=max(sample.digits, 1e-6))
    field = np.full_like(RAW.gyr[k], np.nan) if recording.mag is None else recording.mag
    sampled = np.isfinite(field).all(axis=1)
    assert sampled.sum() == FIELDS.get(kind, len(k))
    np.testing.assert_allclose(field[sampled], RAW.mag[k][sampled], atol=max(1e-4, 100 * sample.digits))
    # lines of the file
    assert raw.row.shape == raw.t.shape
    assert (np.diff(raw.row) > 0).all()
    assert 1 <= raw.row[0] <= 12
    assert raw.row[-1] <= max(*(place.read_bytes().count(b"\n") for place in files_of(path)), len(RAW.t) + 1)
    # the same in an archive
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as archive:
        for place in files_of(path):
            archive.write(place, place.relative_to(path.parent))
    if kind not in ("walk.npz", "walk.zip"):  # which are archives
        np.testing.assert_array_equal(read_raw(tmp_path / "packed.zip", sensor=sample.sensor).acc, raw.acc)


NOTES = [
    ("xsens", "time is the packet counter at 100 Hz"),
    ("xsens", "the packet counter began again at its end 1 time: set on"),
    ("xsens", "the magnetometer is in units of the local field (median 0.99): 1 is taken for 48 uT"),
    ("dot", "SampleTimeFine began again at its end 1 time: set on"),
    ("dot", "left out 1 missing sample, the first in row 9"),
    ("dot-sdk-rad", "SampleTimeFine is in 0.1 ms, as its steps of 100 show"),
    ("dot-sdk-rad", "the gyroscope is in rad/s: its size shows it, or gravity, which turns as it says"),
    ("shimmer", "of two accelerometers the one of low noise (LN) is taken: it is in the gyroscope's frame"),
    ("shimmer-wide", "the accelerometer is that of wide range (WR): the file has no other"),
    ("apdm", "the sensor is 'Left Foot'"),
    ("phyphox", "recorded by phyphox 1.1.16 on P1"),
    ("phyphox", "accelerometer 100.0 Hz, gyroscope 100.0 Hz, magnetometer 50.0 Hz, begun 2 ms apart: put on the "
     "gyroscope's clock, the accelerometer by straight lines"),
    ("sensor-logger, iPhone", "specific force is -(Accelerometer + Gravity), as an iPhone has the sign turned"),
    ("sensor-logger, iPhone", "time 0 is 2022-09-16 11:15:47.248 UTC"),
    ("sensor-logger, Android", "specific force is TotalAcceleration"),
    ("sensor-logger, standardised", "specific force is (Accelerometer + Gravity)"),
    ("sensor-logger, uncalibrated", "specific force is -9.80665 * AccelerometerUncalibrated, as an iPhone has the "
     "sign turned"),
    ("sensor-logger, uncalibrated", "the gyroscope is uncalibrated: its bias is still in it"),
    *((kind, "the topic is /left/imu") for kind in ("bag", "mcap", "db3")),
    *((kind, "the magnetometer is /left/mag") for kind in ("bag", "mcap", "db3")),
    ("x-IMU3", "Magnetometer.csv is in arbitrary units and was left out"),
]  # fmt: skip


@pytest.mark.parametrize("kind", [kind for kind in dict(NOTES) if kind in SAMPLES])
def test_what_was_taken_for_what_is_said(kind: str, tmp_path: Path) -> None:
    sample = SAMPLES[kind]
    notes = Recording.from_raw(read_raw(sample.write(RAW, tmp_path), sensor=sample.sensor)).provenance.notes
    for words in (words for own, words in NOTES if own == kind):
        assert words in notes


SAME: list[tuple[str, list[Change]]] = [
    ("canonical", [("", r"(?m)^([^,]+,[^,]+),(.*)$", r"\2,\1")]),
    ("canonical", [("", r"(?m)^(.*)$(?!\Z)", r"\1,x"), ("", r",x\n", ",note\n")]),
    ("sensorconnect", [("", r"\A", "SESSION_INFO\nname,rate\n3DM-GX5,200\n\nDATA_START\n")]),
    ("sensorconnect", [("", r"(?m)^0\.(\d\d),(.*)$", r"0.\1,\2" + "\n" + r"0.\g<1>1,,,,,,,,,")]),
    ("xio", [("", r"Gyroscope Y \(deg/s\)", "Gyroscope Y")]),
    ("xio", [("", r"Time \(s\)", "Time")]),
    ("xsens", [("", "\t", ";")]),
    ("xsens", [("", "\t", ",")]),
    ("xsens", [("", "\t", " ")]),
    ("dot", [("", r", ?", ";")]),
    ("dot", [("", r"(?s)\A.*?(?=PacketCounter)", "")]),
    ("shimmer", [("", r"\.", ",")]),
    ("shimmer", [("", r"\.", ","), ("", ";", "\t")]),
    ("phyphox", [("Linear", "", None)]),
    ("sensor-logger, iPhone", [("Gyroscope", r"\Z", "16633269472")]),
]


@pytest.mark.parametrize(("kind", "changes"), SAME)
def test_changes_that_alter_nothing(kind: str, changes: list[Change], tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    whole = read_raw(SAMPLES[kind].write(RAW, tmp_path / "whole"))
    changed = read_raw(write_changed(kind, RAW, tmp_path, *changes))
    assert changed.provenance.format == whole.provenance.format
    for name in ("t", "acc", "gyr", "mag"):
        if getattr(whole, name) is not None:
            np.testing.assert_allclose(getattr(changed, name), getattr(whole, name), atol=1e-9)
