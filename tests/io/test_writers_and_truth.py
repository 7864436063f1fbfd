"""Canonical CSV goes round exactly; TUM and footprints are read as they were written."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import FormatError, OutputError
from fg_nav.io import read_raw, read_truth, write_canonical, write_tum
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.recording import RawRecording
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.io.samples import RAW, write_pyshoe


def test_canonical_goes_round_to_the_last_bit(tmp_path: Path) -> None:
    bits = np.random.default_rng(1).integers(0, 2**64, (400, 10), dtype=np.uint64).view(np.float64)
    bits[:7, 0] = [0.0, -0.0, 5e-324, np.finfo(float).max, -np.inf, np.inf, 0.1 + 0.2]
    table = bits[~np.isnan(bits).any(axis=1)]
    write_canonical(
        RawRecording(table[:, 0], table[:, 1:4], table[:, 4:7], np.arange(len(table)), table[:, 7:]),
        tmp_path / "walk.csv",
    )
    raw = read_raw(tmp_path / "walk.csv")
    found = np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag])
    np.testing.assert_array_equal(found.view(np.uint64), table.view(np.uint64))


def test_canonical_without_magnetometer_samples(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    sparse = np.where(np.arange(len(RAW.t))[:, None] % 4 == 0, RAW.mag, np.nan)
    write_canonical(RawRecording(RAW.t, RAW.acc, RAW.gyr, RAW.row, sparse), path)
    assert path.read_text().splitlines()[2].endswith(",,,")
    np.testing.assert_array_equal(read_raw(path).mag, sparse)
    write_canonical(RawRecording(RAW.t, RAW.acc, RAW.gyr, RAW.row), path)
    assert read_raw(path).mag is None
    with pytest.raises(OutputError, match="cannot be written"):
        write_canonical(RAW, tmp_path / "nowhere" / "walk.csv")


def test_tum_goes_round_in_its_field_order(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    t = np.arange(50) / 200 + 1.5e9
    position, nav_R_body = rng.normal(size=(50, 3)), Rotation.random(50, rng=rng).as_matrix()
    path = tmp_path / "truth.tum"
    write_tum(path, t, position, nav_R_body)
    for _ in range(2):
        truth = read_truth(path)
        assert isinstance(truth, TrajectoryTruth)
        np.testing.assert_allclose(truth.t, t, atol=3e-7)
        np.testing.assert_allclose(truth.position, position, atol=1e-9)
        np.testing.assert_allclose(truth.nav_R_body, nav_R_body, atol=1e-8)
        path.write_text("# timestamp tx ty tz qx qy qz qw\n" + path.read_text())
    quarter_turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    write_tum(path, np.array([0.5]), np.array([[1.0, 2.0, 3.0]]), quarter_turn[None])
    numbers = [float(field) for field in path.read_text().split()]
    np.testing.assert_allclose(numbers, [0.5, 1, 2, 3, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-9)


def test_footprints_as_csv(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("stride,x_m,y_m\n0,0,0\n3,1.5,-2\n")
    truth = read_truth(path)
    assert isinstance(truth, FootprintTruth)
    assert truth.stride.tolist() == [0, 3]
    assert truth.stride.dtype == np.int64
    np.testing.assert_array_equal(truth.xy, [[0, 0], [1.5, -2]])


def test_pyshoe_labels(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    write_pyshoe(RAW, path)
    np.testing.assert_array_equal(read_pyshoe_labels(path), RAW.t < 2.0)
    with pytest.raises(FormatError, match="no variable 'zv_ared_opt'"):
        read_pyshoe_labels(path, "ared")
