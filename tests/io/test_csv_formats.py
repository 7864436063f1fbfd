"""What SensorConnect, x-io and OpenShoe files do that others do not: flags, held samples, units in the header."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from fg_nav.io import read, read_raw
from fg_nav.io.streams import drop_held
from fg_nav.truth import FootprintTruth
from tests.io.every_format import write_changed
from tests.io.samples import WRITERS, tilting, write_openshoe, write_sensorconnect, write_xio

RAW = tilting(np.random.default_rng(3))


def test_what_is_not_valid_or_not_there_is_no_sample(tmp_path: Path) -> None:
    """An estimate that is flagged, and a number that is missing: the others of the row stay."""
    for kind, found, instead in (
        ("estimated", r"(?m)^(0\.245,[^,]*),1.0", r"\1,0"),
        ("sensorconnect", r"(?m)^0\.245,[^,]*", "0.245,"),
    ):
        path = write_changed(kind, RAW, tmp_path, ("", found, instead))
        raw = read_raw(path)
        assert np.isnan(raw.acc[49]).tolist() == [True, False, False]
        assert np.isnan(raw.acc).sum() == 1
        assert read(path).provenance.notes == ("left out 1 missing sample, the first in row 51",)


def test_footprints_beside_and_damaged_ones_which_cost_the_truth_only(tmp_path: Path) -> None:
    path, xy = tmp_path / "walk.csv", np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 4.0]])
    write_sensorconnect(RAW, path)
    stride, count = np.array([[0, 100, 250]], dtype=np.uint8), np.array([[255]], dtype=np.uint8)
    beside = {"GCP_meters": xy, "GCP_stride_numbers": stride, "numberOfStrides": count}
    scipy.io.savemat(tmp_path / "walk.mat", beside)
    truth = read(path).truth
    assert isinstance(truth, FootprintTruth)
    assert truth.stride_count == 255
    assert (truth.stride - 251).tolist() == [-251, -151, -1]  # would wrap in uint8
    np.testing.assert_array_equal(truth.xy, xy)
    (tmp_path / "walk.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(300))
    recording = read(path)
    assert recording.truth is None
    assert "the file next to it gave no truth: walk.mat" in recording.provenance.notes[0]


def test_units_in_the_header(tmp_path: Path) -> None:
    """Numbers times a scale and another unit in the header are the same recording."""
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    header, *lines = path.read_text().splitlines()
    table = np.array([line.split(",") for line in lines], dtype=float)
    for quantity, unit, scale in (
        ("Gyroscope", "rad/s", np.pi / 180),
        ("Gyroscope", "°/s", 1.0),
        ("Accelerometer", "m/s²", 9.80665),
        ("Accelerometer", "mg", 1000.0),
        ("Magnetometer", "µT", 1.0),
        ("Magnetometer", "mG", 10.0),
        ("Time", "us", 1e6),
    ):
        names = header.split(",")
        changed = [k for k, name in enumerate(names) if name.startswith(quantity)]
        for k in changed:
            names[k] = f"{names[k].split(' (')[0]} ({unit})"
        scaled = table * np.where(np.isin(np.arange(table.shape[1]), changed), scale, 1.0)
        path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in scaled.tolist())]))
        raw = read_raw(path)
        np.testing.assert_allclose(raw.t, RAW.t, atol=1e-9)
        for name in ("acc", "gyr", "mag"):
            np.testing.assert_allclose(getattr(raw, name), getattr(RAW, name), rtol=1e-9)


def test_a_magnetometer_without_a_unit_or_an_axis_is_left_out(tmp_path: Path) -> None:
    for found, instead, words in (
        (r"\(uT\)", "(a.u.)", "the magnetometer is in arbitrary units and was left out"),
        (r"Magnetometer Z \(uT\)", "Temperature (C)", "not all three axes"),
    ):
        recording = read(write_changed("xio", RAW, tmp_path, ("", found, instead)))
        assert recording.mag is None
        assert words in " ".join(recording.provenance.notes)


@pytest.mark.parametrize("kind", ["sensorconnect", "xio", "openshoe", "broad"])
def test_held_magnetometer_samples_are_no_samples(kind: str, tmp_path: Path) -> None:
    held = tilting(np.random.default_rng(3))
    held.mag[:] = held.mag[np.arange(len(held.t)) // 4 * 4]
    path = tmp_path / "walk.mat"
    WRITERS[kind][1](held, path)
    sampled = ~np.isnan(read_raw(path).mag).any(axis=1)
    assert sampled.mean() == pytest.approx(0.25, abs=0.04)
    if kind != "openshoe":  # there every 17th sample is missing besides
        assert np.flatnonzero(sampled).tolist() == list(range(0, len(held.t), 4))


def test_repeats_of_a_coarse_magnetometer_at_rest_stay() -> None:
    gyr = np.where(np.arange(1000)[:, None] < 800, 0.01, 1.0) * np.ones(3)
    mag = np.random.default_rng(0).normal(size=(1000, 3))
    mag[:800] = np.round(mag[:800] / 20)
    assert (mag[1:] == mag[:-1]).all(axis=1).mean() > 0.5
    np.testing.assert_array_equal(drop_held(mag, gyr), mag)


@pytest.mark.parametrize(
    ("pause_s", "words"),
    [
        (0.0, "the row numbers begin again in row 701: by the computer's clock nothing is missing there"),
        (0.3, "0.31 s later"),
        (20.0, "there is a gap of 20.0"),
    ],
)
def test_openshoe_row_numbers_that_begin_again_go_on_by_the_clock_of_the_computer(
    pause_s: float, words: str, tmp_path: Path
) -> None:
    """Bridged, or cut where the pause is long."""
    path, at = tmp_path / "walk.txt", 700
    write_openshoe(RAW, path)
    lines = [line.split() for line in path.read_text().splitlines()]
    for k, fields in enumerate(lines):
        fields[9] = str(k + 1 if k < at else k - at + 1)
        fields[10] = f"{1274434048.5 + k * 0.005 + (pause_s if k >= at else 0.0):.6f}"
    path.write_text("\n".join("   ".join(fields) for fields in lines) + "\n")
    recording = read(path)
    assert words in " ".join(recording.provenance.notes)
    assert len(recording) == len(RAW.t) - (at if pause_s > 1.0 else 0)
    longest = 0.005 if pause_s > 1.0 else 0.005 + pause_s
    assert np.diff(recording.t).max() == pytest.approx(longest)
