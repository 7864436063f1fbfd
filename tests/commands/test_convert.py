"""`fg-nav convert`, and `--columns` and `--rate` of the verbs that read a file."""

import json

import numpy as np
import pytest

from fg_nav.io import read_raw, write_canonical
from fg_nav.recording import RawRecording
from tests.command_line import FgNav
from tests.io.samples import tilting, write_sensorconnect, write_table

RAW = tilting(np.random.default_rng(31), duration_s=3.0, rate_hz=100.0, still_s=1.0)


def is_equal(one: RawRecording, other: RawRecording) -> bool:
    for name in ("t", "acc", "gyr", "mag"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    return True


@pytest.mark.parametrize("ending", [".csv", ".csv.gz", ".parquet"])
def test_what_is_written_is_read_back_to_the_last_bit(fg_nav: FgNav, ending: str, tmp_path) -> None:
    if ending == ".parquet":
        pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    assert RAW.mag is not None
    RAW.mag[5] = np.nan
    write_sensorconnect(RAW, tmp_path / "walk.csv")
    out = tmp_path / "new" / f"out{ending}"
    ran = fg_nav("convert", tmp_path / "walk.csv", out)
    assert (ran.code, ran.err) == (0, "")
    assert "300 samples of format sensorconnect, with the magnetometer" in ran.out
    assert is_equal(read_raw(out), read_raw(tmp_path / "walk.csv"))
    before = out.read_bytes()
    assert fg_nav("convert", out, tmp_path / "again.csv").code == 0
    assert is_equal(read_raw(tmp_path / "again.csv"), read_raw(out))
    assert fg_nav("convert", tmp_path / "walk.csv", out).refused("already exists", "--force")
    assert out.read_bytes() == before
    assert fg_nav("convert", tmp_path / "walk.csv", out, "--force").code == 0
    assert out.read_bytes() == before
    (tmp_path / f"folder{ending}").mkdir()
    assert fg_nav("convert", out, tmp_path / f"folder{ending}").refused("is a folder")


def test_remarks_are_said_and_a_sensor_without_use_is_written(fg_nav: FgNav, tmp_path) -> None:
    write_canonical(RawRecording(RAW.t, RAW.acc - [0, 0, 9.8], RAW.gyr, RAW.row), tmp_path / "walk.csv")
    ran = fg_nav("convert", tmp_path / "walk.csv", "out.csv", "--json")
    said = json.loads(ran.out)
    assert said["samples"] == 300
    assert "these samples cannot be navigated with" in said["remarks"][0]
    write_table(RAW, tmp_path / "table.csv")
    assert "remark" not in fg_nav("convert", tmp_path / "table.csv", "table.csv").out


def test_columns_and_rate_for_a_file_without_a_header(fg_nav: FgNav, tmp_path) -> None:
    table = np.column_stack([RAW.acc / 9.80665, np.degrees(RAW.gyr)])
    np.savetxt(tmp_path / "walk.txt", table, fmt="%.10g")
    assert fg_nav("inspect", tmp_path / "walk.txt").refused("no header", "--columns")
    columns = ("--columns", "acc=1:2:3[g],gyr=4:5:6[deg/s]")
    assert fg_nav("inspect", tmp_path / "walk.txt", *columns).refused("no stamps", "--rate")
    said = json.loads(fg_nav("inspect", tmp_path / "walk.txt", *columns, "--rate", 100, "--json").out)
    assert said["usable"]
    assert said["stamps"]["rate_hz"] == pytest.approx(100.0)
    assert fg_nav("convert", tmp_path / "walk.txt", "out.csv", *columns, "--rate", 100).code == 0
    np.testing.assert_allclose(read_raw("out.csv").gyr, RAW.gyr, atol=1e-9)
