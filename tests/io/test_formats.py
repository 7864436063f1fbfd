"""Known formats: what is refused, the truths that some hold, and flags, held samples, units and clocks of others."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read, read_raw, write_canonical
from fg_nav.io.streams import drop_held
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.io.every_format import write_changed
from tests.io.samples import (
    WRITERS,
    tilting,
    write_broad,
    write_openshoe,
    write_pyshoe,
    write_sensorconnect,
    write_xio,
)

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
