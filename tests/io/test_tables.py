"""Any table: its layout, the words of its header, units that the samples show, and what is asked where they do not."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.errors import FormatError, RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read, read_raw
from fg_nav.lab.simulation import simulate
from fg_nav.recording import RawRecording
from tests.io.samples import axes, tilting
from tests.io.samples import write_columns as write

RAW = tilting(np.random.default_rng(12), duration_s=6.0, rate_hz=100.0, still_s=1.0)
SHORT = ["t", "ax", "ay", "az", "gx", "gy", "gz"]


def table_of(raw: RawRecording = RAW, time: float = 1.0, acc: float = 1.0, gyr: float = 1.0) -> list[np.ndarray]:
    return [raw.t * time, raw.acc * acc, raw.gyr * gyr]


def is_the_same(raw: RawRecording, mag: bool = False) -> bool:
    np.testing.assert_allclose(raw.t - raw.t[0], RAW.t, atol=1e-6)
    for name in ("acc", "gyr", *(["mag"] if mag else [])):
        np.testing.assert_allclose(getattr(raw, name), getattr(RAW, name), atol=1e-6)
    return raw.provenance.format == "table"


DEG = 180 / np.pi
UNITS = ["Time [ms]", *axes("Acc {} [g]"), *axes("gyro_{} (deg/s)", letters="xyz")]
IN_UNITS = table_of(RAW, 1e3, 1 / GRAVITY_M_S2, DEG)


def test_separators_one_at_the_end_decimal_commas_and_gzip(tmp_path: Path) -> None:
    path, nothing = tmp_path / "walk.csv", [""] * len(RAW.t)
    for separator in (",", ";", "\t", "|", ", "):
        assert is_the_same(read_raw(write(path, UNITS, IN_UNITS, separator)))
        assert is_the_same(read_raw(write(path, [*UNITS, ""], [*IN_UNITS, nothing], separator)))
    assert is_the_same(read_raw(write(path, SHORT, table_of(gyr=DEG), "  ")))
    for separator in (";", "\t", " "):
        path.write_text(write(path, SHORT, table_of(), separator).read_text().replace(".", ","))
        assert is_the_same(read_raw(path))
    path.write_bytes(gzip.compress(write(path, UNITS, IN_UNITS).read_bytes()))
    assert is_the_same(read_raw(path))


def test_lines_above_a_row_of_units_and_comments(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.csv", [*SHORT, "note"], [*IN_UNITS, RAW.t])
    header, *rows = path.read_text().splitlines()
    top = ["Logger 3, of somebody", "started,yesterday", "", header, "ms,g,g,g,dps,dps,dps,"]
    path.write_text("\n".join([*top, *rows[:10], "# a comment", *rows[10:]]))
    raw = read_raw(path)
    assert is_the_same(raw)
    assert raw.row[[0, 9, 10]].tolist() == [6, 15, 17]
    np.savetxt(path, np.column_stack(table_of()), header=" ".join(SHORT))  # in a comment
    assert is_the_same(read_raw(path))


def test_header_of_two_rows(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.csv", ["t", "acc", "acc", "acc", "gyr", "gyr", "gyr"], table_of())
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, ",x,y,z,x,y,z", *rows]))
    assert is_the_same(read_raw(path))
    path.write_text("\n".join(["t,acc,,,gyr,,", ",x,y,z,x,y,z", "s,g,g,g,rad/s,rad/s,rad/s", *rows]))
    with pytest.raises(RecordingError, match="acc measures"):
        read(path)

    # of both feet
    path = write(tmp_path / "feet.csv", SHORT + SHORT[1:], [*table_of(), 2.0 * RAW.acc, RAW.gyr])
    axis = ",".join(["time", *axes("acc_{}", "gyr_{}", "acc_{}", "gyr_{}", letters="xyz")])
    feet = ",".join(["sensor", *["left_foot"] * 6, *["right_foot"] * 6])
    path.write_text("\n".join([feet, axis, path.read_text().split("\n", 1)[1]]))
    with pytest.raises(FormatError, match=r"more than one acceleration .*'left_foot acc_x'.*--sensor"):
        read_raw(path)
    assert is_the_same(read_raw(path, sensor="left"))


@pytest.mark.parametrize("time", [1.0, 1e3, 1e4, 1e6, 1e9])
def test_units_that_the_samples_show(time: float, tmp_path: Path) -> None:
    for acc, unit in ((1.0, "m/s^2"), (1 / GRAVITY_M_S2, "g"), (1e3 / GRAVITY_M_S2, "mg")):
        for gyr, rate_unit in ((1.0, "rad/s"), (DEG, "deg/s")):
            raw = read_raw(write(tmp_path / "walk.csv", SHORT, table_of(RAW, time, acc, gyr)))
            assert is_the_same(raw)
            notes = " ".join(raw.provenance.notes)
            assert f"acc is taken for {unit}" in notes
            assert f"gyr is taken for {rate_unit}" in notes
            assert ("the stamps 't' are taken for" in notes) == (time != 1.0)


def test_the_gyroscope_of_a_walking_foot_shows_its_unit(tmp_path: Path) -> None:
    walk = simulate("demo", 1).recording.slice(3000, 7000)
    for gyr, unit in ((1.0, "rad/s"), (DEG, "deg/s")):
        raw = read_raw(write(tmp_path / "walk.csv", SHORT, [walk.t, walk.acc, walk.gyr * gyr]))
        assert f"gyr is taken for {unit}, by its peak" in raw.provenance.notes[-1]
        np.testing.assert_allclose(raw.gyr, walk.gyr, atol=1e-6)


def test_counts_have_the_scale_of_a_data_sheet(tmp_path: Path) -> None:
    names = [f"c{k}" for k in range(7)]
    path = write(tmp_path / "walk.csv", names, table_of(RAW, 1.0, 16384 / GRAVITY_M_S2, 16.4 * DEG))
    assert is_the_same(read_raw(path, columns="time=c0[s],acc=c1:c2:c3[1/16384 g],gyr=5:6:7[1/16.4 deg/s]"))


def test_a_table_without_a_header(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.csv", SHORT, [RAW.gyr, RAW.acc, RAW.t])
    path.write_text(path.read_text().split("\n", 1)[1])
    np.save(tmp_path / "walk.npy", np.column_stack([RAW.gyr, RAW.acc, RAW.t]))
    for one in (path, tmp_path / "walk.npy"):
        raw = read_raw(one, columns="time=7[s],acc=4:5:6[m/s^2],gyr=1:2:3[rad/s]")
        assert is_the_same(raw)
    assert raw.row[0] == 1


def test_counters_and_no_clock_at_all(tmp_path: Path) -> None:
    kept = np.delete(np.arange(len(RAW.t)), [7, 8])
    path = write(tmp_path / "walk.csv", ["sample", *SHORT[1:]], [kept + 40, RAW.acc[kept], RAW.gyr[kept]])
    with pytest.raises(FormatError, match=r"no stamps but 'sample', which counts samples: .*--rate"):
        read_raw(path)
    raw = read_raw(path, rate_hz=100.0)
    np.testing.assert_allclose(raw.t, RAW.t[kept], atol=1e-9)
    assert "time is 'sample' at 100 Hz" in raw.provenance.notes
    path = write(tmp_path / "none.csv", SHORT[1:], table_of()[1:])
    assert is_the_same(read_raw(path, rate_hz=100.0))
    with pytest.raises(FormatError, match="has stamps, 't'"):
        read_raw(write(path, SHORT, table_of()), rate_hz=100.0)
    with pytest.raises(FormatError, match="rises by ones"):
        read_raw(write(path, SHORT, [np.arange(len(RAW.t)), RAW.acc, RAW.gyr]))
    assert is_the_same(read_raw(path, columns="acc=ax:ay:az,gyr=gx:gy:gz", rate_hz=100.0))


def test_a_counter_that_begins_again_keeps_what_was_lost(tmp_path: Path) -> None:
    kept = np.delete(np.arange(len(RAW.t)), 450)
    for bits in (8, 16):
        columns = [(kept + 2**bits - 50) % 2**bits, *(column[kept] for column in IN_UNITS[1:])]
        path = write(tmp_path / "walk.csv", ["packet_counter", *UNITS[1:]], columns)
        raw = read_raw(path, rate_hz=100.0)
        np.testing.assert_allclose(raw.t, RAW.t[kept], atol=1e-9)
        assert raw.provenance.notes[0] == "time is 'packet_counter' at 100 Hz"
        assert raw.provenance.rate_sigma == 0.02


@pytest.mark.parametrize(
    ("form", "is_dated"),
    [
        *((form, True) for form in ("%Y-%m-%d %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ")),
        *((form, False) for form in ("%d/%m/%Y %H:%M:%S.%f", "%H:%M:%S.%f", "%m-%d-%Y %I:%M:%S.%f %p")),
        ("%Y-%m-%d %H:%M:%S:%f", False),
    ],
)
def test_stamps_that_are_dates_or_times_of_day(form: str, is_dated: bool, tmp_path: Path) -> None:
    """Over midnight; of a date in another form the time of day counts alone: which number is the month is open."""
    start = 1.6e9 - 1.6e9 % 86400 - 3.0
    stamps = pd.to_datetime(start + RAW.t, unit="s").round("ms").strftime(form)
    path = write(tmp_path / "dated.csv", ["Time", *UNITS[1:]], [list(stamps), *IN_UNITS[1:]])
    raw = read_raw(path)
    assert is_the_same(raw)
    assert "stamps" not in " ".join(raw.provenance.notes)  # they need no unit
    assert not is_dated or raw.t[0] == pytest.approx(start, abs=1e-3)
    without = "acc=Acc X:Acc Y:Acc Z[g],gyr=gyro_x:gyro_y:gyro_z[deg/s]"
    assert is_the_same(read_raw(path, columns=without, rate_hz=100.0))


def test_magnetometers(tmp_path: Path) -> None:
    names, path = [*SHORT, "mx", "my", "mz"], tmp_path / "walk.csv"
    assert is_the_same(read_raw(write(path, names, [*table_of(), RAW.mag])), mag=True)
    raw = read_raw(write(path, names, [*table_of(), RAW.mag / 47.4]))
    assert raw.mag is None
    assert "the magnetometer names no unit" in raw.provenance.notes[-1]
    mapped = "time=t[s],acc=ax:ay:az,gyr=gx:gy:gz[rad/s],mag=mx:my:mz"
    assert read_raw(path, columns=f"{mapped}[a.u.]").mag is None
    assert is_the_same(read_raw(path, columns=f"{mapped}[47.4 uT]"), mag=True)


def test_arrays_without_names_of_axes_and_an_index_of_instants(tmp_path: Path) -> None:
    path = tmp_path / "walk.npz"
    np.savez(path, ts=RAW.t, one=RAW.acc, two=RAW.gyr)
    with pytest.raises(FormatError, match=r"no column for acceleration among 'ts', 'one 1'"):
        read_raw(path)
    assert is_the_same(read_raw(path, columns="time=ts,acc=one 1:one 2:one 3[m/s^2],gyr=two 1:two 2:two 3[rad/s]"))
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    frame, path = pd.DataFrame(np.column_stack(table_of()), columns=SHORT), tmp_path / "walk.parquet"
    frame.assign(t=pd.to_datetime(frame["t"], unit="s")).set_index("t").to_parquet(path)
    assert is_the_same(read_raw(path))
