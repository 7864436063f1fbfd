"""Canonical CSV goes round exactly; TUM and footprints are read as they were written."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.errors import FormatError, OutputError
from fg_nav.io import read_raw, read_truth, write_canonical, write_tum
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.recording import RawRecording
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.io.samples import tilting, write_broad, write_pyshoe

RAW = tilting(np.random.default_rng(4))
SCRATCH = tempfile.TemporaryDirectory()
DOUBLES = st.floats(allow_nan=False, width=64)


@given(st.lists(st.tuples(*[DOUBLES] * 10), min_size=1, max_size=5))
def test_canonical_goes_round_to_the_last_bit(rows: list[tuple[float, ...]]) -> None:
    table = np.array(rows)
    path = Path(SCRATCH.name) / "walk.csv"
    write_canonical(RawRecording(table[:, 0], table[:, 1:4], table[:, 4:7], np.arange(len(table)), table[:, 7:]), path)
    raw = read_raw(path)
    np.testing.assert_array_equal(np.column_stack([raw.t, raw.acc, raw.gyr, raw.mag]), table)


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


def test_truth_from_matlab_files(tmp_path: Path) -> None:
    path, stride = tmp_path / "walk.mat", np.arange(2, dtype=np.uint8)
    write_pyshoe(RAW, path)
    assert isinstance(read_truth(path), TrajectoryTruth)
    write_broad(RAW, path)
    assert isinstance(read_truth(path), TrajectoryTruth)
    scipy.io.savemat(path, {"GCP_meters": np.zeros((2, 2)), "GCP_stride_numbers": stride})
    assert isinstance(read_truth(path), FootprintTruth)
    with pytest.raises(FormatError, match="surveyed footprints, no recording"):
        read_raw(path)
    scipy.io.savemat(path, {"imu": np.column_stack([RAW.acc, RAW.gyr]), "ts": RAW.t})
    with pytest.raises(FormatError, match="neither footprints nor a true path"):
        read_truth(path)


def test_footprints_as_csv_and_truth_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("stride,x_m,y_m\n0,0,0\n3,1.5,-2\n")
    truth = read_truth(path)
    assert isinstance(truth, FootprintTruth)
    assert truth.stride.tolist() == [0, 3]
    assert truth.stride.dtype == np.int64
    np.testing.assert_array_equal(truth.xy, [[0, 0], [1.5, -2]])
    for text, message in (
        ("", "is empty"),
        ("hello\n", "no truth read here: give TUM lines"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 2\n", "line 2: stamps must rise and quaternions have length 1"),
        ("0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "line 2: stamps must rise"),
        ("0 0 0 0 0 0 0 1\n1 0 x 0 0 0 0 1\n", "line 2, column 'y': 'x' is not a number"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0\n", "line 2"),
        ("stride,x_m\n0,0\n", "no column 'y_m'"),
        ("stride,x_m,y_m\n", "no samples"),
        ("stride,x_m,y_m\n0,0,0\n1.5,0,0\n", "whole and rising"),
        ("stride,x_m,y_m\n0,0,0\n2,0,0\n1,0,0\n", "whole and rising"),
        ("stride,x_m,y_m\n0,0,0\n1,,0\n", "not finite"),
    ):
        path.write_text(text)
        with pytest.raises(FormatError, match=message):
            read_truth(path)


def test_pyshoe_labels(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    write_pyshoe(RAW, path)
    np.testing.assert_array_equal(read_pyshoe_labels(path), RAW.t < 2.0)
    with pytest.raises(FormatError, match="no variable 'zv_ared_opt'"):
        read_pyshoe_labels(path, "ared")
