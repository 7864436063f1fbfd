"""Files of sensor makers' tools: read equal within their digits, or refused with what to do."""

from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.io import read, read_raw
from tests.io.foreign_sensors import write_xsens_mt
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
    assert raw.mag is None
    assert raw.row[0] == 8
    remarks = " ".join(raw.provenance.notes)
    assert "time is the packet counter at 100 Hz" in remarks
    assert "began again at its end 1 times" in remarks
    assert "units of the local field (median 0.99), not in uT, and was left out" in remarks


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
