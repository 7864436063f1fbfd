"""Files of sensor makers' tools: read equal within their digits, or refused with what to do."""

import re
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.io import read, read_raw
from tests.io.foreign_sensors import (
    write_apdm,
    write_dot_sdk,
    write_metawear,
    write_movesense,
    write_shimmer,
    write_ximu3,
    write_xsens_dot,
    write_xsens_mt,
)
from tests.io.samples import tilting
from tests.real_data import DATA, needs_data

RAW = tilting(np.random.default_rng(3), duration_s=4.0, rate_hz=100.0, still_s=1.0)


@pytest.mark.parametrize("separator", ["\t", ",", ";", " "])
def test_xsens_is_read_whatever_separates_it(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    write_xsens_mt(RAW, path, separator)
    raw = read_raw(path)
    assert raw.provenance.format == "xsens"
    kept = np.arange(len(RAW.t)) != 7
    np.testing.assert_allclose(raw.t, RAW.t[kept], atol=1e-9)
    np.testing.assert_allclose(raw.acc, RAW.acc[kept], atol=1e-6)
    np.testing.assert_allclose(raw.gyr, RAW.gyr[kept], atol=1e-6)
    np.testing.assert_allclose(raw.mag, RAW.mag[kept], atol=1e-4)
    assert raw.row[0] == 8
    remarks = " ".join(raw.provenance.notes)
    assert "time is the packet counter at 100 Hz" in remarks
    assert "began again at its end 1 time" in remarks
    assert "units of the local field (median 0.99): 1 is taken for 48 uT" in remarks


def test_xsens_time_of_the_sensor_is_preferred(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    write_xsens_mt(RAW, path, fine=True)
    raw = read_raw(path)
    np.testing.assert_allclose(raw.t - raw.t[0], RAW.t[np.arange(len(RAW.t)) != 7], atol=1e-4)
    assert len(read(path)) == len(RAW.t) - 1


def test_xsens_without_a_rate_asks_for_it(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    write_xsens_mt(RAW, path)
    path.write_text("\n".join(line for line in path.read_text().splitlines() if "Update Rate" not in line))
    with pytest.raises(FormatError, match=r"neither time nor rate.*--rate 100"):
        read(path)
    np.testing.assert_allclose(np.diff(read_raw(path, rate_hz=50.0).t[:7]), 0.02)


def test_xsens_without_a_gyroscope_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walk.txt"
    path.write_text("// Update Rate: 100.0Hz\nPacketCounter\tFreeAcc_X\tMat[1][1]\n" + "1\t2\t3\n" * 30)
    with pytest.raises(FormatError, match=r"no accelerometer and no gyroscope .FreeAcc is without gravity"):
        read(path)


@needs_data
def test_real_xsens_files() -> None:
    folder = DATA / "formats" / "xsens-mt-manager"
    old = read(folder / "old_data_xsens.txt")
    assert old.period_s == pytest.approx(1 / 50)
    assert read_raw(folder / "MT2022_ACC_GYRO_ROT_MAT_SPACE_00B42D4B.txt", rate_hz=100.0).acc[0, 2] > 9.8


def test_xsens_and_dot_are_told_apart_without_the_lines_on_top(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xsens_dot(RAW, path)
    dot = path.read_text().replace(", ", ",")
    bare = "\n".join(dot.splitlines()[7:])
    path.write_text(dot.replace(",", ";"))
    assert read_raw(path).provenance.format == "xsens-dot"
    path.write_text(bare)
    raw = read_raw(path)
    assert raw.provenance.format == "xsens-dot"
    np.testing.assert_allclose(raw.gyr[1:], RAW.gyr[1:], atol=1e-9)
    write_xsens_mt(RAW, path, ",")
    path.write_text("\n".join(path.read_text().splitlines()[6:]))
    assert read_raw(path, rate_hz=100.0).provenance.format == "xsens"


def test_dot_says_what_it_took_for_what(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_xsens_dot(RAW, path)
    assert read(path).provenance.notes == (
        "SampleTimeFine began again at its end 1 time: set on",
        "left out 1 missing sample, the first in row 9",
    )
    write_dot_sdk(RAW, path, rad=True)
    assert read_raw(path).provenance.notes == (
        "SampleTimeFine is in 0.1 ms, as its steps of 100 show",
        "the gyroscope is in rad/s: its size shows it, or gravity, which turns as it says",
        "the magnetometer is in units of the local field (median 0.99): 1 is taken for 48 uT",
    )


def test_dot_at_rest_shows_no_unit(tmp_path: Path) -> None:
    path, still = tmp_path / "walk.csv", tilting(np.random.default_rng(4), 4.0, 100.0, still_s=9.0)
    write_dot_sdk(still, path)
    with pytest.raises(FormatError, match=r"deg/s or rad/s.*--columns '.*Gyr_X:Gyr_Y:Gyr_Z\[deg/s\]' --rate 100`"):
        read(path)
    mapped = "acc=Acc_X:Acc_Y:Acc_Z[m/s^2],gyr=Gyr_X:Gyr_Y:Gyr_Z[deg/s]"
    np.testing.assert_allclose(read(path, columns=mapped, rate_hz=100.0).gyr, still.gyr, atol=1e-4)


def test_dot_without_acceleration_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("sep=,\nDeviceTag:,LF\n\nPacketCounter,SampleTimeFine,Quat_W,FreeAcc_X\n" + "1,2,3,4\n" * 30)
    with pytest.raises(FormatError, match=r"no accelerometer and no gyroscope .FreeAcc is without .*'Custom Mode 5'"):
        read(path)


def test_one_of_several_sensors_must_be_named(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_apdm(RAW, path)
    with pytest.raises(FormatError, match=r"2 sensors \(Lumbar, Left Foot\): name one, such as `--sensor 'Left Foot'`"):
        read(path)
    with pytest.raises(FormatError, match="no one 'right' among its sensors: choose one of Lumbar, Left Foot"):
        read(path, sensor="right")
    assert read(path, sensor="LUMBAR").provenance.notes[0] == "the sensor is 'Lumbar'"


def test_shimmer_says_which_accelerometer_it_took(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_shimmer(RAW, path)
    both, field = read_raw(path).provenance.notes
    assert both == "of two accelerometers the one of low noise (LN) is taken: it is in the gyroscope's frame"
    assert "local field (median 0.99): 1 is taken for 48 uT" in field
    write_shimmer(RAW, path, wide=True)
    assert "wide range (WR)" in read_raw(path).provenance.notes[0]


@pytest.mark.parametrize("separator", ["\t", ";"])
def test_shimmer_with_a_decimal_comma(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_shimmer(RAW, path)
    path.write_text(path.read_text().replace(".", ",").replace(";", separator))
    np.testing.assert_allclose(read_raw(path).gyr, RAW.gyr, atol=1e-9)


def test_shimmer_leaves_out_a_time_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    write_shimmer(RAW, path, formatted=True)
    path.write_bytes(path.read_bytes().replace(b"2020/07/28 10:56:50.044", b"yesterday"))
    assert np.isnan(read_raw(path).t[1])
    assert "left out 1 missing sample, the first in row 5" in read(path).provenance.notes


@pytest.mark.parametrize(
    ("found", "instead", "words"),
    [
        ("ArrayGyro", "ArrayTemp", "no gyroscope, only accelerometer and magnetometer"),
        (r"(?s).{5000}$", "", "no whole JSON"),
        *(
            (r'"Timestamp": \d+', f'"Timestamp": {stamp}', "has no stamp")
            for stamp in ("true", '"500"', "NaN", "1e999")
        ),
    ],
)
def test_movesense_that_is_cut_or_without_rate_or_stamps_is_refused(
    found: str, instead: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "walk.json"
    write_movesense(RAW, path)
    whole = path.read_text()
    path.write_text(whole.replace("ArrayMagn", "ArrayTemp"))
    assert read(path).mag is None
    path.write_text(re.sub(found, instead, whole))
    with pytest.raises(FormatError, match=words):
        read(path)


def test_metawear_joins_the_files_of_a_session(tmp_path: Path) -> None:
    write_metawear(RAW, tmp_path / "walk")
    raw = read_raw(tmp_path / "walk")
    assert raw.provenance.format == "metawear"
    np.testing.assert_allclose(raw.t, RAW.t, atol=1e-9)
    np.testing.assert_allclose(raw.acc, RAW.acc, atol=1e-9)
    np.testing.assert_allclose(raw.gyr, RAW.gyr, atol=1e-9)
    assert raw.mag is not None
    np.testing.assert_allclose(raw.mag[::4], RAW.mag[::4], atol=1e-6)
    assert np.isnan(raw.mag[1::4]).all()


def test_metawear_leaves_out_rows_whose_clocks_are_damaged(tmp_path: Path) -> None:
    write_metawear(RAW, tmp_path)
    path = next(tmp_path.glob("*_Gyroscope*"))
    lines = path.read_text().splitlines()
    for row, (column, value) in enumerate([(2, "9.5e9"), (0, "9.5e12"), (2, "-1e12")], start=3):
        cells = lines[row].split(",")
        cells[column] = value
        lines[row] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    raw = read_raw(tmp_path)
    np.testing.assert_allclose(raw.gyr, np.delete(RAW.gyr, [2, 3, 4], axis=0), atol=1e-9)


def test_metawear_asks_for_the_other_file_and_for_the_session(tmp_path: Path) -> None:
    write_metawear(RAW, tmp_path)
    one = next(tmp_path.glob("*_Accelerometer*"))
    with pytest.raises(FormatError, match="has no gyroscope, only accelerometer: give the folder or zip"):
        read(one)
    write_metawear(RAW, tmp_path, "Right_MetaWear_2019-01-11T16.10.08.270_C5")
    with pytest.raises(FormatError, match=r"2 sessions \(Left_MetaWear.*, Right_MetaWear.*\): name one"):
        read(tmp_path)
    assert "the session is 'Right" in read_raw(tmp_path, sensor="right").provenance.notes[0]


def test_ximu3_folder_says_what_became_of_its_magnetometer(tmp_path: Path) -> None:
    write_ximu3(RAW, tmp_path / "walk")
    raw = read_raw(tmp_path / "walk")
    np.testing.assert_allclose(raw.gyr, RAW.gyr, atol=1e-9)
    assert raw.provenance.notes == ("Magnetometer.csv is in arbitrary units and was left out",)
    write_ximu3(RAW, tmp_path / "walk", "uT")
    raw = read_raw(tmp_path / "walk")
    assert raw.mag is not None
    np.testing.assert_allclose(raw.mag[::5], RAW.mag[::5], rtol=1e-9)
    assert np.isnan(raw.mag[1::5]).all()
    np.testing.assert_allclose(read_raw(tmp_path / "walk" / "Inertial.csv").acc, RAW.acc, atol=1e-9)


@needs_data
def test_real_files_of_sensor_makers() -> None:
    folder = DATA / "formats"
    dot = read(folder / "xsens-dot/recording_bei_D4CA6EF17860_20210830_170505.csv")
    assert dot.period_s == pytest.approx(1 / 120, rel=1e-3)
    with pytest.raises(FormatError, match="does not show whether its gyroscope is in deg/s or rad/s"):  # on a desk
        read(folder / "xsens-dot-pcsdk/logfile_CustomMode4.csv")
    assert read(folder / "movesense/MovesenseLog_3_786.json").period_s == pytest.approx(1 / 102.6, rel=1e-3)
    assert read(folder / "shimmer-consensys/devicely_read_test_data.csv").period_s == pytest.approx(1 / 51.2, rel=1e-2)
    assert np.linalg.norm(read(folder / "shimmer-consensys/Accelerometre_Carre.csv").acc[0]) == pytest.approx(
        9.8, abs=0.2
    )
    assert len(read_raw(folder / "apdm-csv/apdm_format7.csv", sensor="Left Foot").t) == 3
    vectornav = read(folder / "vectornav-vn310/Static-vn310-imu.csv")
    assert vectornav.mag is not None
    assert np.linalg.norm(vectornav.mag[0]) == pytest.approx(22.0, abs=1.0)
    assert read(folder / "metawear").period_s == pytest.approx(1 / 25)
    assert read(folder / "yei-3space/data_yei.txt").period_s == pytest.approx(9.1e-3, abs=1e-4)
