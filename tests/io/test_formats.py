"""Recognition and refusal of files of known formats in one sentence, and the truths that some formats hold."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

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
    write_pyshoe(RAW, tmp_path / "walk.mat")
    for name, format, words in (
        ("walk.csv", "canonical", "no column 'time_s'"),
        ("walk.csv", "pyshoe", "not a MATLAB file"),
        ("walk.csv", "gaitup", r"no format 'gaitup'.*canonical, sensorconnect"),
        ("walk.mat", "xio", "not a text file"),
    ):
        with pytest.raises(FormatError, match=words):
            read_raw(tmp_path / name, format)


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


def test_no_file_or_one_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path, words in (
        (tmp_path / "nowhere.csv", r"nowhere\.csv does not exist"),
        (tmp_path, "holds no file that is not empty"),
        ("a\0b", "cannot be opened"),
    ):
        with pytest.raises(FormatError, match=words):
            read(path)
    path = tmp_path / "walk.csv"
    path.write_text("time_s\n")

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)  # the tests may run as root, who may read all
    with pytest.raises(FormatError, match=r"cannot be opened.*Permission denied.*check its permissions"):
        read(path)


@pytest.mark.parametrize("kind", ["canonical", "sensorconnect", "estimated", "xio"])
def test_a_table_that_lacks_something_is_refused_with_what_and_where(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    WRITERS[kind][1](RAW, path)
    lines = [line.split(",") for line in path.read_text().splitlines()[:40]]
    needed = [k for k, name in enumerate(lines[0]) if "ag" not in name and not name.endswith(":valid")]
    assert len(needed) == 7
    for column in needed if kind != "xio" else []:
        path.write_text("\n".join(",".join(line[:column] + line[column + 1 :]) for line in lines))
        with pytest.raises(FormatError, match="no column") as caught:
            read(path)
        _is_one_sentence(str(caught.value))
        plain = lines[0][column].split(":")[-1].split(" (")[0]
        assert plain.lower() in str(caught.value).lower()
    for end in ("", "\n", "\n\n\n", "\r\n"):
        path.write_text(",".join(lines[0]) + end)
        with pytest.raises(FormatError, match="has a header but no samples"):
            read(path)
    lines[30][3] = "oops"
    path.write_text("\n".join(map(",".join, lines)))
    with pytest.raises(FormatError, match=r"walk\.csv, line 31, column '.+': 'oops' is not a number") as caught:
        read(path)
    assert lines[0][3].split(":")[-1] in str(caught.value)


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
    for rate_hz, nominal_hz in ((249.75, 250.0), (123.0, 123.0)):
        write_openshoe(tilting(np.random.default_rng(2), rate_hz=rate_hz), path)
        assert np.diff(read(path).t) == pytest.approx(1 / nominal_hz, rel=1e-3 if rate_hz == nominal_hz else 1e-6)


def test_truth_of_pyshoe_is_made_right_handed_at_all_samples_or_some(tmp_path: Path) -> None:
    path = tmp_path / "walk.mat"
    write_pyshoe(RAW, path)
    truth = read(path).truth
    assert isinstance(truth, TrajectoryTruth)
    np.testing.assert_allclose(truth.position, np.column_stack([RAW.t, -2 * RAW.t, 0.1 + 0 * RAW.t]))
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
    assert len(truth.t) == len(RAW.t) - 3
    assert np.isfinite(truth.nav_R_body).all()


def test_broad_quaternions_are_w_x_y_z_from_sensor_to_nav(tmp_path: Path) -> None:
    """A sensor turned about the diagonal: its x axis points north, its y axis up and its z axis east."""
    path, n = tmp_path / "turned.mat", len(RAW.t)
    quaternion = np.tile([0.5, 0.5, 0.5, 0.5], (n, 1))
    quaternion[n // 2 :] = [np.cos(0.3), 0.0, 0.0, np.sin(0.3)]  # 0.6 rad to the left about up
    variables = {"imu_acc": RAW.acc, "imu_gyr": RAW.gyr, "opt_quat": quaternion, "opt_pos": np.zeros((n, 3))}
    scipy.io.savemat(path, {**variables, "sampling_rate": 100.0})
    truth = read_raw(path).truth
    north, up, east = [0, 1, 0], [0, 0, 1], [1, 0, 0]
    np.testing.assert_allclose(truth.nav_R_body[0].T, [north, up, east], atol=1e-12)
    left = [[np.cos(0.6), -np.sin(0.6), 0.0], [np.sin(0.6), np.cos(0.6), 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(truth.nav_R_body[-1], left, atol=1e-12)


def _is_one_sentence(message: str) -> None:
    assert "\n" not in message
    assert message.endswith(".")
    assert message.count(": ") >= 1  # what is wrong: what to try


def test_files_are_made_of_a_motion_that_is_physical() -> None:
    """Gravity and field turn in the body as the gyroscope says, so a reader that gives them back keeps every sign."""
    raw = tilting(np.random.default_rng(2))
    angle = np.cumsum(raw.gyr, axis=0) * np.diff(raw.t)[0]
    for vector in (raw.acc, raw.mag):
        turned = -np.cross(angle[10:] - angle[:-10], 0.5 * (vector[10:] + vector[:-10]))
        gain = np.sum(turned * (vector[10:] - vector[:-10])) / np.sum(turned**2)
        assert gain == pytest.approx(1.0, abs=0.02)
    assert raw.acc[0, 2] == pytest.approx(GRAVITY_M_S2, abs=0.1)
