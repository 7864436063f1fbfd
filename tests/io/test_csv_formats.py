"""What SensorConnect and x-io files do that others do not: flags, held samples, units in the header."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from fg_nav.errors import FormatError
from fg_nav.io import read, read_raw
from fg_nav.io.streams import drop_held
from fg_nav.truth import FootprintTruth
from tests.io.samples import (
    WRITERS,
    tilting,
    write_openshoe,
    write_sensorconnect,
    write_sensorconnect_estimated,
    write_xio,
)

RAW = tilting(np.random.default_rng(3))
assert RAW.mag is not None


def test_invalid_estimates_are_nan(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_sensorconnect_estimated(RAW, path)
    lines = path.read_text().splitlines()
    fields = lines[50].split(",")
    fields[2] = "0"  # the flag of the x axis of acc
    lines[50] = ",".join(fields)
    path.write_text("\n".join(lines))
    raw = read_raw(path)
    assert np.isnan(raw.acc[49]).tolist() == [True, False, False]
    assert np.isnan(raw.acc).sum() == 1
    assert read(path).provenance.notes == ("left out 1 missing sample, the first in row 51",)


def test_rows_of_other_packets_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_sensorconnect(RAW, path)
    lines = path.read_text().splitlines()
    for k in range(60, 10, -10):
        lines.insert(k, f"{lines[k].split(',')[0]}1" + "," * 9)
    path.write_text("\n".join(lines))
    np.testing.assert_array_equal(read_raw(path).acc, read_raw(path).acc[: len(RAW.t)])
    assert len(read(path)) == len(RAW.t)


def test_lines_about_the_session_before_the_header(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_sensorconnect(RAW, path)
    path.write_text("SESSION_INFO\nname,rate\n3DM-GX5,200\n\nDATA_START\n" + path.read_text())
    raw = read_raw(path)
    assert raw.row[0] == 7
    np.testing.assert_allclose(raw.acc, RAW.acc)


def test_gravity_removed_by_the_sensor_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("Time,a:estLinearAccelX,a:estLinearAccelY,a:estLinearAccelZ\n0,0,0,0\n")
    with pytest.raises(FormatError, match="has no column 'scaledAccelX'"):
        read(path)


def test_two_sensors_in_one_file(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_sensorconnect(RAW, path)
    lines = path.read_text().splitlines()
    doubled = [f"{line},{line.split(',', 1)[1]}" for line in lines]
    path.write_text("\n".join(doubled).replace("1.2:", "3.4:", 9))
    with pytest.raises(FormatError, match="2 columns 'scaledAccelX': keep one"):
        read(path)


def test_footprints_beside(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_sensorconnect(RAW, path)
    stride = np.array([[0, 100, 250]], dtype=np.uint8)
    xy = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 4.0]])
    scipy.io.savemat(
        tmp_path / "walk.mat",
        {
            "GCP_meters": xy,
            "GCP_stride_numbers": stride,
            "numberOfStrides": np.array([[255]], dtype=np.uint8),
        },
    )
    truth = read(path).truth
    assert isinstance(truth, FootprintTruth)
    assert truth.stride_count == 255
    assert np.diff(truth.stride).tolist() == [100, 150]
    assert (truth.stride - 251).tolist() == [-251, -151, -1]  # would wrap in uint8
    np.testing.assert_array_equal(truth.xy, xy)


def test_damaged_footprints_beside_cost_the_truth_only(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_sensorconnect(RAW, path)
    (tmp_path / "walk.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(300))
    recording = read(path)
    assert recording.truth is None
    assert "the file next to it gave no truth: walk.mat" in recording.provenance.notes[0]


@pytest.mark.parametrize(
    ("quantity", "unit", "scale"),
    [
        ("Gyroscope", "rad/s", np.pi / 180),
        ("Gyroscope", "°/s", 1.0),
        ("Gyroscope", "dps", 1.0),
        ("Accelerometer", "m/s^2", 9.80665),
        ("Accelerometer", "m/s²", 9.80665),
        ("Accelerometer", "mg", 1000.0),
        ("Magnetometer", "µT", 1.0),
        ("Magnetometer", "gauss", 0.01),
        ("Magnetometer", "mG", 10.0),
        ("Magnetometer", "nT", 1000.0),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_units_in_the_header(quantity: str, unit: str, scale: float, encoding: str, tmp_path: Path) -> None:
    """Numbers times `scale` and another unit in the header are the same recording."""
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    header, *lines = path.read_text().splitlines()
    names = header.split(",")
    changed = [k for k, name in enumerate(names) if name.startswith(quantity)]
    for k in changed:
        names[k] = f"{names[k].split(' (')[0]} ({unit})"
    rows = [[float(v) * (scale if k in changed else 1.0) for k, v in enumerate(x.split(","))] for x in lines]
    text = "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows)])
    path.write_bytes(text.encode(encoding))
    raw = read_raw(path)
    assert raw.mag is not None
    np.testing.assert_allclose(raw.acc, RAW.acc, rtol=1e-9)
    np.testing.assert_allclose(raw.gyr, RAW.gyr, rtol=1e-9)
    np.testing.assert_allclose(raw.mag, RAW.mag, rtol=1e-9)


def test_time_in_microseconds_as_the_header_says(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    header, *lines = path.read_text().splitlines()
    rows = [f"{float(line.split(',')[0]) * 1e6:.0f},{line.split(',', 1)[1]}" for line in lines]
    path.write_text("\n".join([header.replace("Time (s)", "Timestamp (us)"), *rows]))
    np.testing.assert_allclose(read(path).t, RAW.t, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Accelerometer X (g)", "Accelerometer Y (g)", "more than one acceleration"),
        ("Gyroscope Z (deg/s)", "Gyroscope (deg/s)", "not all three axes of angular rate, only 'Gyroscope X"),
        ("Time (s)", "Temperature (C)", "has no stamps: give its rate"),
    ],
)
def test_columns_that_are_missing(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FormatError, match=message):
        read(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [("Gyroscope Y (deg/s)", "Gyroscope Y"), ("Time (s)", "Time"), ("Magnetometer Z (uT)", "Temperature (C)")],
)
def test_a_unit_of_the_other_axes_or_by_physics(old: str, new: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    path.write_text(path.read_text().replace(old, new))
    raw = read_raw(path)
    np.testing.assert_allclose(raw.gyr, RAW.gyr, rtol=1e-9)
    assert (raw.mag is None) == ("Magnetometer" in old)
    assert ("not all three axes" in " ".join(raw.provenance.notes)) == ("Magnetometer" in old)


def test_magnetometer_in_arbitrary_units_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    path.write_text(path.read_text().replace("(uT)", "(a.u.)"))
    recording = read(path)
    assert recording.mag is None
    assert recording.provenance.notes == ("the magnetometer is in arbitrary units and was left out",)


@pytest.mark.parametrize("kind", ["sensorconnect", "xio", "openshoe", "broad"])
def test_held_magnetometer_samples_are_no_samples(kind: str, tmp_path: Path) -> None:
    held = tilting(np.random.default_rng(3))
    assert held.mag is not None
    held.mag[:] = held.mag[np.arange(len(held.t)) // 4 * 4]
    path = tmp_path / "walk.mat"
    WRITERS[kind][1](held, path)
    raw = read_raw(path)
    assert raw.mag is not None
    sampled = ~np.isnan(raw.mag).any(axis=1)
    assert sampled.mean() == pytest.approx(0.25, abs=0.04)
    if kind != "openshoe":  # there every 17th sample is missing besides
        assert np.flatnonzero(sampled).tolist() == list(range(0, len(held.t), 4))


def test_repeats_of_a_coarse_magnetometer_at_rest_stay() -> None:
    gyr = np.where(np.arange(1000)[:, None] < 800, 0.01, 1.0) * np.ones(3)
    mag = np.random.default_rng(0).normal(size=(1000, 3))
    mag[:800] = np.round(mag[:800] / 20)
    assert (mag[1:] == mag[:-1]).all(axis=1).mean() > 0.5
    np.testing.assert_array_equal(drop_held(mag, gyr), mag)


def restarted(path: Path, at: int, pause_s: float) -> None:
    """Write OpenShoe text whose row numbers begin again, and whose PC clock goes on after a pause."""
    write_openshoe(RAW, path)
    lines = [line.split() for line in path.read_text().splitlines()]
    for k, fields in enumerate(lines):
        fields[9] = str(k + 1 if k < at else k - at + 1)
        fields[10] = f"{1274434048.5 + k * 0.005 + (pause_s if k >= at else 0.0):.6f}"
    path.write_text("\n".join("   ".join(fields) for fields in lines) + "\n")


def test_openshoe_row_numbers_that_begin_again_go_on(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    restarted(path, 700, 0.0)
    recording = read(path)
    np.testing.assert_allclose(np.diff(recording.t), 0.005)
    assert len(recording) == len(RAW.t)
    words = "the row numbers begin again in row 701: by the computer's clock nothing is missing there"
    assert recording.provenance.notes == (words,)


def test_openshoe_is_bridged_or_cut_by_the_clock_of_the_computer(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    restarted(path, 700, 0.3)
    bridged = read(path)
    assert len(bridged) == len(RAW.t)
    assert np.diff(bridged.t).max() == pytest.approx(0.305)
    assert "0.31 s later" in bridged.provenance.notes[0]
    restarted(path, 700, 20.0)
    cut = read(path)
    assert len(cut) == len(RAW.t) - 700
    assert "there is a gap of 20.0" in cut.provenance.notes[-1]
