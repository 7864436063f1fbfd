"""Known formats and what is written: the truths that some hold, and flags, held samples and clocks of others."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from fg_nav.errors import FormatError, OutputError
from fg_nav.io import read, read_raw, read_truth, write_canonical, write_tum
from fg_nav.io.streams import drop_held
from fg_nav.lab.pyshoe import read_pyshoe_labels, read_pyshoe_track
from fg_nav.recording import RawRecording
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.io.every_format import SAMPLES, write_changed
from tests.io.samples import (
    tilting,
    write_broad,
    write_gdlbio,
    write_openshoe,
    write_pyshoe,
    write_sensorconnect,
)

RAW = tilting(np.random.default_rng(1))
IMU = np.column_stack([RAW.acc, RAW.gyr])


def test_lines_are_counted_past_blank_ones_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_canonical(RAW, path)
    lines = path.read_text().splitlines()
    lines.insert(5, "")
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(lines).encode() + b"\r\n\r\n")
    raw = read_raw(path)
    assert raw.row[:6].tolist() == [2, 3, 4, 5, 7, 8]
    np.testing.assert_array_equal(raw.acc, RAW.acc)


def test_what_is_not_valid_or_not_there_is_no_sample(tmp_path: Path) -> None:
    for kind, found, instead in (
        ("estimated", r"(?m)^(0\.245,[^,]*),1.0", r"\1,0"),
        ("sensorconnect", r"(?m)^0\.245,[^,]*", "0.245,"),
    ):
        path = write_changed(kind, RAW, tmp_path, ("", found, instead))
        raw = read_raw(path)
        assert len(raw.t) == len(RAW.t)
        assert np.argwhere(np.isnan(raw.acc)).tolist() == [[49, 0]]
        np.testing.assert_allclose(raw.gyr, RAW.gyr)
        assert read(path).provenance.notes == ("left out 1 missing sample, the first in row 51",)


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
    sampled = ~np.isnan(read_raw(SAMPLES[kind].write(held, tmp_path)).mag).any(axis=1)
    assert sampled.mean() == pytest.approx(0.25, abs=0.04)
    if kind != "openshoe":  # there every 17th sample is missing besides
        assert np.flatnonzero(sampled).tolist() == list(range(0, len(held.t), 4))


def test_repeats_of_a_coarse_magnetometer_at_rest_stay() -> None:
    gyr = np.where(np.arange(1000)[:, None] < 800, 0.01, 1.0) * np.ones(3)
    mag = np.random.default_rng(0).normal(size=(1000, 3))
    mag[:800] = np.round(mag[:800] / 20)
    assert (mag[1:] == mag[:-1]).all(axis=1).mean() > 0.5
    np.testing.assert_array_equal(drop_held(mag, gyr), mag)


# OpenShoe


def test_openshoe_rate_is_nominal_and_a_cut_off_last_line_costs_one_sample(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    for rate_hz, nominal_hz in ((249.75, 250.0), (123.0, 123.0)):
        write_openshoe(tilting(np.random.default_rng(2), rate_hz=rate_hz), path)
        assert np.diff(read(path).t) == pytest.approx(1 / nominal_hz, rel=1e-3 if rate_hz == nominal_hz else 1e-6)
    write_openshoe(RAW, path)
    path.write_text(path.read_text()[:-120])
    recording = read(path)
    assert len(recording) == len(RAW.t) - 1
    assert recording.provenance.notes == (f"left out 1 missing sample, the first in row {len(RAW.t)}",)


def test_openshoe_row_numbers_that_begin_again_go_on_by_the_clock_of_the_computer(tmp_path: Path) -> None:
    path, k = tmp_path / "walk.txt", np.arange(len(RAW.t))
    write_openshoe(RAW, path)
    lines = [line.split() for line in path.read_text().splitlines()]
    for pause_s, step_s, words in (
        (0.04, 0.005, "nothing is missing there"),
        (0.05, 0.055, "0.06 s later"),  # packets are late by less
        (9990.0, 9990.005, "9990.01 s later"),
        (10010.0, -3.495, ""),  # the clock was set: the row numbers are left as they are
        (-5.0, -3.495, ""),
    ):
        for row, fields in enumerate(lines):
            fields[9], fields[10] = str(row % 700 + 1), f"{1.3e9 + row * 0.005 + (pause_s if row >= 700 else 0.0):.6f}"
        path.write_text("\n".join("   ".join(fields) for fields in lines[:1400]) + "\n")
        raw = read_raw(path)
        np.testing.assert_allclose(np.diff(raw.t), np.where(k[1:1400] == 700, step_s, 0.005), atol=1e-9)
        begun = "the row numbers begin again in row 701: by the computer's clock "
        assert raw.provenance.notes == ((begun + words,) if words else ())


# truths


def test_truth_of_pyshoe_is_made_right_handed_at_all_samples_or_some(tmp_path: Path) -> None:
    path = tmp_path / "walk.mat"
    write_pyshoe(RAW, path)
    for truth in (read(path).truth, read_truth(path)):
        assert isinstance(truth, TrajectoryTruth)
        np.testing.assert_allclose(truth.position, np.column_stack([RAW.t, -2 * RAW.t, 0.1 + 0 * RAW.t]))
    points = np.array([[0.0, 0, 0], [1, 2, 0], [9, 9, 9], [3, 1, 0]])  # the third comes no later
    scipy.io.savemat(path, {"imu": IMU, "ts": RAW.t, "gt": points, "gt_idx": np.array([[0, 400, 400, 800]])})
    truth = read(path).truth
    assert isinstance(truth, TrajectoryTruth)
    np.testing.assert_allclose(truth.t, RAW.t[[0, 400, 800]])
    np.testing.assert_allclose(truth.position, points[[0, 1, 3]] * [1, -1, 1])


def test_broad_quaternions_are_w_x_y_z_from_sensor_to_nav_where_it_was_seen(tmp_path: Path) -> None:
    """A sensor turned about the diagonal: its x axis points north, its y axis up and its z axis east."""
    path, n = tmp_path / "turned.mat", len(RAW.t)
    write_broad(RAW, path)
    truth = read(path).truth
    assert len(truth.t) == n - 3
    assert np.isfinite(truth.nav_R_body).all()
    quaternion = np.tile([0.5, 0.5, 0.5, 0.5], (n, 1))
    quaternion[n // 2 :] = [np.cos(0.3), 0.0, 0.0, np.sin(0.3)]  # 0.6 rad to the left about up
    variables = {"imu_acc": RAW.acc, "imu_gyr": RAW.gyr, "opt_quat": quaternion, "opt_pos": np.zeros((n, 3))}
    scipy.io.savemat(path, {**variables, "sampling_rate": 100.0})
    truth = read_truth(path)
    north, up, east = [0, 1, 0], [0, 0, 1], [1, 0, 0]
    np.testing.assert_allclose(truth.nav_R_body[0].T, [north, up, east], atol=1e-12)
    left = [[np.cos(0.6), -np.sin(0.6), 0.0], [np.sin(0.6), np.cos(0.6), 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(truth.nav_R_body[-1], left, atol=1e-12)


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
    np.testing.assert_array_equal(read_truth(tmp_path / "walk.mat").xy, xy)
    with pytest.raises(FormatError, match="surveyed footprints, no recording"):
        read_raw(tmp_path / "walk.mat")
    (tmp_path / "walk.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(300))
    recording = read(path)
    assert recording.truth is None
    assert "the file next to it gave no truth: walk.mat" in recording.provenance.notes[0]


def test_footprints_of_gdlbio_are_made_right_handed_and_their_times_are_the_recordings(tmp_path: Path) -> None:
    path, middle = tmp_path / "walk.mat", len(RAW.t) // 2
    write_gdlbio(RAW, path)
    truth, t = read(path).truth, RAW.t[::100]
    assert isinstance(truth, FootprintTruth)
    np.testing.assert_allclose(truth.t, t)
    np.testing.assert_allclose(truth.xy, np.column_stack([t, 2.0 * t]))
    np.testing.assert_array_equal(truth.stride, np.arange(len(t)))
    assert truth.stride_count == len(t) - 1
    np.testing.assert_allclose(read_pyshoe_track(path), np.column_stack([RAW.t, 2.0 * RAW.t]))
    np.testing.assert_allclose(read_truth(path).xy, truth.xy)
    # stamps that are evened out take them along
    write_gdlbio(RAW, path, timestamps=RAW.t + np.random.default_rng(2).uniform(0.0, 1e-3, len(RAW.t)))
    recording = read(path)
    np.testing.assert_allclose(recording.truth.t, recording.t[::100], atol=1e-9)
    # a clock that begins again loses them
    write_gdlbio(RAW, path, timestamps=np.concatenate([RAW.t[:middle], RAW.t[: len(RAW.t) - middle]]))
    recording = read(path)
    assert recording.truth.t is None
    assert any("the clock beg" in note for note in recording.provenance.notes)


def test_a_walk_of_gdlbio_may_have_no_footprints_and_each_defect_is_one_sentence(tmp_path: Path) -> None:
    path, count = tmp_path / "walk.mat", len(RAW.t[::100])
    write_gdlbio(RAW, path, GCP=None, pyshoeTrajectory=None)
    assert read(path).truth is None
    for reader, words in ((read_truth, "neither footprints nor a true path"), (read_pyshoe_track, "no variable 'pysh")):
        with pytest.raises(FormatError, match=words):
            reader(path)
    rising = "rising samples of the recording"
    for changes, message in (
        ({"imu_data": None}, "no variable 'imu_data'"),
        ({"timestamps": None}, "no variable 'timestamps'"),
        ({"imu_data": np.zeros((900, 5))}, r"shape \(900, 5\), not \(N, 6\)"),
        ({"timestamps": RAW.t[:-1]}, "'timestamps' has"),
        ({"GCP": np.zeros((3, 2))}, "'GCP' has 3 rows, 'strideIndex'"),
        ({"GCP": np.full((count, 2), np.nan)}, "a footprint that is not finite"),
        ({"strideIndex": np.arange(count) * 1000}, rising),
        ({"strideIndex": -np.ones(count)}, rising),
        ({"strideIndex": np.full(count, 7)}, rising),
        ({"strideIndex": np.arange(count) + 0.5}, rising),
    ):
        write_gdlbio(RAW, path, **changes)
        with pytest.raises(FormatError, match=rf"^walk\.mat[^\n]*{message}[^\n]*\.$"):
            read_raw(path, "gdlbio")


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
