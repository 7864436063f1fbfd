"""Every format: recognised from its content, read in SI units, and refused with one sentence."""

from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read, read_raw, write_canonical
from fg_nav.truth import TrajectoryTruth
from tests.io.samples import WRITERS, tilting, write_broad, write_openshoe, write_pyshoe, write_xio

RAW = tilting(np.random.default_rng(1))


def test_format_overrides_recognition(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    assert read_raw(path, "xio").provenance.format == "xio"
    with pytest.raises(FormatError, match="no column 'time_s'"):
        read_raw(path, "canonical")
    with pytest.raises(FormatError, match="not a MATLAB file"):
        read_raw(path, "pyshoe")
    with pytest.raises(FormatError, match=r"no format 'gaitup'.*canonical, sensorconnect"):
        read_raw(path, "gaitup")


def test_matlab_file_read_as_text_format(tmp_path: Path) -> None:
    path = tmp_path / "walk.mat"
    write_pyshoe(RAW, path)
    with pytest.raises(FormatError, match="not a text file"):
        read_raw(path, "xio")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"  \n \n", "is empty"),
        (b"hello,world\n1,2\n", "none of the .* formats.*fg-nav inspect"),
        (bytes(range(256)) * 40, "none of the .* formats"),
        (b"MATLAB 5.0 MAT-file" + bytes(2000), "damaged MATLAB file|none of the .* formats"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + b" " * 86 + b"\x00\x02IM" + bytes(500), "7.3"),
    ],
)
def test_unknown_content(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=message) as caught:
        read(path)
    _is_one_sentence(str(caught.value))


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"nowhere\.csv does not exist"):
        read(tmp_path / "nowhere.csv")
    with pytest.raises(FormatError, match="holds no file that is not empty"):
        read(tmp_path)
    with pytest.raises(FormatError, match="cannot be opened"):
        read("a\0b")


def test_file_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("time_s\n")

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)  # the tests may run as root, who may read all
    with pytest.raises(FormatError, match=r"cannot be opened.*Permission denied.*check its permissions"):
        read(path)


def test_footprints_are_not_a_recording(tmp_path: Path) -> None:
    import scipy.io

    path = tmp_path / "walk.mat"
    scipy.io.savemat(path, {"GCP_meters": np.zeros((3, 2)), "GCP_stride_numbers": np.arange(3)})
    with pytest.raises(FormatError, match="surveyed footprints, no recording"):
        read(path)


@pytest.mark.parametrize("kind", ["canonical", "sensorconnect", "estimated"])
def test_each_missing_column_is_named(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    WRITERS[kind][1](RAW, path)
    lines = [line.split(",") for line in path.read_text().splitlines()[:40]]
    needed = [k for k, name in enumerate(lines[0]) if "ag" not in name and not name.endswith(":valid")]
    assert len(needed) == 7
    for column in needed:
        path.write_text("\n".join(",".join(line[:column] + line[column + 1 :]) for line in lines))
        with pytest.raises(FormatError, match="no column") as caught:
            read(path)
        _is_one_sentence(str(caught.value))
        plain = lines[0][column].split(":")[-1].split(" (")[0]
        assert plain.lower() in str(caught.value).lower()


@pytest.mark.parametrize("kind", ["canonical", "sensorconnect", "estimated", "xio"])
def test_text_in_a_number_is_named_by_line_and_column(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    WRITERS[kind][1](RAW, path)
    lines = path.read_text().splitlines()
    fields = lines[30].split(",")
    fields[3] = "oops"
    lines[30] = ",".join(fields)
    path.write_text("\n".join(lines))
    with pytest.raises(FormatError, match=r"walk\.csv, line 31, column '.+': 'oops' is not a number") as caught:
        read(path)
    assert lines[0].split(",")[3].split(":")[-1] in str(caught.value)


@pytest.mark.parametrize("kind", ["canonical", "sensorconnect", "estimated", "xio"])
@pytest.mark.parametrize("end", ["", "\n", "\n\n\n", "\r\n"])
def test_header_only(kind: str, end: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    WRITERS[kind][1](RAW, path)
    header = path.read_text().splitlines()[0]
    path.write_text(header + end)
    with pytest.raises(FormatError, match="has a header but no samples"):
        read(path)


def test_rows_of_other_lengths(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xio(RAW, path)
    lines = path.read_text().splitlines()
    lines[10] += ",1,2,3"
    path.write_text("\n".join(lines))
    with pytest.raises(FormatError, match=r"not a regular table.*line 11"):
        read(path)


def test_lines_are_counted_past_blank_ones_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_canonical(RAW, path)
    lines = path.read_text().splitlines()
    lines.insert(5, "")
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(lines).encode() + b"\r\n\r\n")
    raw = read_raw(path)
    assert raw.row[:6].tolist() == [2, 3, 4, 5, 7, 8]
    np.testing.assert_array_equal(raw.acc, RAW.acc)


def test_cut_off_last_line_costs_one_sample(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    write_openshoe(RAW, path)
    path.write_text(path.read_text()[:-120])
    recording = read(path)
    assert len(recording) == len(RAW.t) - 1
    assert recording.provenance.notes == (f"left out 1 missing sample, the first in row {len(RAW.t)}",)


def test_openshoe_rate_is_nominal(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    write_openshoe(tilting(np.random.default_rng(2), rate_hz=249.75), path)
    assert np.diff(read(path).t) == pytest.approx(1 / 250)
    write_openshoe(tilting(np.random.default_rng(2), rate_hz=123.0), path)
    assert np.diff(read(path).t) == pytest.approx(1 / 123, rel=1e-3)


def test_openshoe_of_another_width(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    path.write_text("0xcb 1 2 3 4 5 6\n" * 50)
    with pytest.raises(FormatError, match="7 columns, not 17"):
        read(path)


def test_pyshoe_truth_is_made_right_handed(tmp_path: Path) -> None:
    path = tmp_path / "walk.mat"
    write_pyshoe(RAW, path)
    truth = read(path).truth
    assert isinstance(truth, TrajectoryTruth)
    np.testing.assert_allclose(truth.position, np.column_stack([RAW.t, -2 * RAW.t, 0.1 + 0 * RAW.t]))


def test_pyshoe_points_passed_at_some_samples(tmp_path: Path) -> None:
    import scipy.io

    path = tmp_path / "walk.mat"
    imu = np.column_stack([RAW.acc, RAW.gyr])
    points = np.array([[0.0, 0, 0], [1, 2, 0], [3, 1, 0]])
    scipy.io.savemat(path, {"imu": imu, "ts": RAW.t, "gt": points, "gt_idx": np.array([[0, 400, 800]])})
    truth = read(path).truth
    assert isinstance(truth, TrajectoryTruth)
    np.testing.assert_allclose(truth.t, RAW.t[[0, 400, 800]])
    np.testing.assert_allclose(truth.position, points * [1, -1, 1])


def test_broad_truth_leaves_out_what_was_not_seen(tmp_path: Path) -> None:
    path = tmp_path / "walk.mat"
    write_broad(RAW, path)
    truth = read(path).truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    assert len(truth.t) == len(RAW.t) - 3
    assert np.isfinite(truth.nav_R_body).all()


def test_broad_quaternions_are_w_x_y_z_from_sensor_to_nav(tmp_path: Path) -> None:
    """A sensor turned about the diagonal: its x axis points north, its y axis up and its z axis east."""
    import scipy.io

    path, n = tmp_path / "turned.mat", len(RAW.t)
    quaternion = np.tile([0.5, 0.5, 0.5, 0.5], (n, 1))
    quaternion[n // 2 :] = [np.cos(0.3), 0.0, 0.0, np.sin(0.3)]  # 0.6 rad to the left about up
    variables = {"imu_acc": RAW.acc, "imu_gyr": RAW.gyr, "opt_quat": quaternion, "opt_pos": np.zeros((n, 3))}
    scipy.io.savemat(path, {**variables, "sampling_rate": 100.0})
    truth = read_raw(path).truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    north, up, east = [0, 1, 0], [0, 0, 1], [1, 0, 0]
    axes = truth.nav_R_body[0].T
    np.testing.assert_allclose(axes, [north, up, east], atol=1e-12)
    left = [[np.cos(0.6), -np.sin(0.6), 0.0], [np.sin(0.6), np.cos(0.6), 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(truth.nav_R_body[-1], left, atol=1e-12)


def _is_one_sentence(message: str) -> None:
    assert "\n" not in message
    assert message.endswith(".")
    assert message.count(": ") >= 1  # what is wrong: what to try


def test_files_are_made_of_a_motion_that_is_physical() -> None:
    """Gravity and field turn in the body as the gyroscope says, so a reader that gives them back keeps every sign."""
    raw = tilting(np.random.default_rng(2))
    assert raw.mag is not None
    angle = np.cumsum(raw.gyr, axis=0) * np.diff(raw.t)[0]
    for vector in (raw.acc, raw.mag):
        turned = -np.cross(angle[10:] - angle[:-10], 0.5 * (vector[10:] + vector[:-10]))
        gain = np.sum(turned * (vector[10:] - vector[:-10])) / np.sum(turned**2)
        assert gain == pytest.approx(1.0, abs=0.02)
    assert raw.acc[0, 2] == pytest.approx(GRAVITY_M_S2, abs=0.1)
