"""Measurements in files beside a recording: fixes of a receiver, known positions, and the pressure of the air."""

from dataclasses import replace

import numpy as np
import pytest
from pymap3d import enu2geodetic

from fg_nav.columns.mapping import find_pressure
from fg_nav.errors import FormatError
from fg_nav.io import read_fixes, read_gnss, read_raw, write_canonical
from tests.io.samples import tabulate, tilting
from tests.real_data import DATA, needs_data

PHYPHOX = '"Time (s)","Latitude (°)","Longitude (°)","Height (m)","Velocity (m/s)","Horizontal Accuracy (m)"\n'
ROWS = [(0.5, 48.1, 11.5, 9.0), (1.5, 48.1001, 11.5, 4.0), (2.5, 48.1002, 11.5001, 4.0), (3.5, 48.1003, 11.5, 4.0)]
NORTH_M = 11.12  # of 1e-4 deg


def write_phyphox(folder, separator=",", decimal="."):
    numbers = [(t, latitude, longitude, 500.0, 1.2, accuracy) for t, latitude, longitude, accuracy in ROWS]
    rows = tabulate([], [numbers], separator, "{:.9E}").replace(".", decimal)
    (folder / "Location.csv").write_text(PHYPHOX.replace(",", separator).strip() + rows, encoding="utf-8")


def test_phyphox(tmp_path):
    for separator, decimal in ((",", "."), (";", ","), ("\t", ",")):
        write_phyphox(tmp_path, separator, decimal)
        gnss = read_gnss(tmp_path)
        assert [fix.time_s for fix in gnss.fixes] == [0.5, 1.5, 2.5, 3.5]
        assert (gnss.latitude_deg, gnss.longitude_deg) == pytest.approx((48.1001, 11.5))  # the first good one
        north = [fix.position[1] for fix in gnss.fixes]
        np.testing.assert_allclose(north, [-NORTH_M, 0.0, NORTH_M, 2 * NORTH_M], atol=0.02)
        assert gnss.fixes[2].position[0] == pytest.approx(7.44, abs=0.02)
        assert [fix.horizontal_sigma_m for fix in gnss.fixes] == [9.0, 4.0, 4.0, 4.0]
        assert np.isinf(gnss.fixes[0].vertical_sigma_m)
    found = enu2geodetic(*gnss.fixes[3].position[:2], 0.0, gnss.latitude_deg, gnss.longitude_deg, 0.0)
    assert found[:2] == pytest.approx((48.1003, 11.5))


def test_a_pause_of_phyphox_goes_by(tmp_path):
    write_phyphox(tmp_path)
    (tmp_path / "meta").mkdir()
    rows = ["event,experiment time,system time", "START,0,100", "PAUSE,2,102", "START,2,110", "PAUSE,4,112"]
    (tmp_path / "meta" / "time.csv").write_text("\n".join(rows) + "\n")
    assert [fix.time_s for fix in read_gnss(tmp_path).fixes] == [0.5, 1.5, 10.5, 11.5]


def test_sensor_logger_counts_from_its_first_sample(tmp_path):
    header = "time,seconds_elapsed,bearingAccuracy,verticalAccuracy,horizontalAccuracy,latitude,longitude"
    rows = [f"{k},{t},1,1,{a},{lat},{lon}" for k, (t, lat, lon, a) in enumerate(ROWS)]
    (tmp_path / "Location.csv").write_text("\n".join([header, *rows, "9,9.0,1,1,-1,48.0,11.5"]) + "\n")
    (tmp_path / "Gyroscope.csv").write_text("time,seconds_elapsed,z,y,x\n10,0.25,0,0,0\n20,0.26,0,0,0\n")
    found = read_gnss(tmp_path)
    assert [fix.time_s for fix in found.fixes] == [0.25, 1.25, 2.25, 3.25]  # the last has no accuracy


def test_a_table_of_ones_own_and_what_holds_no_fixes(tmp_path):
    table = tmp_path / "fixes.csv"
    table.write_text("time_s,lat_deg,lon_deg,hacc_m\n1,48.1,11.5,3\n2,,,\n3,48.1001,11.5,3\n")
    assert [fix.time_s for fix in read_gnss(table).fixes] == [1.0, 3.0]


@needs_data
def test_real_phones():
    for path in sorted((DATA / "pocket_gnss").glob("*.zip")):
        gnss = read_gnss(path)
        assert len(gnss.fixes) > 200
        assert np.abs([fix.position[:2] for fix in gnss.fixes]).max() < 1000.0
    own = next((DATA / "mtig710").glob("*.gnss.csv.gz"))
    assert len(read_gnss(own).fixes) > 50


HEADER = "time_s,x_m,y_m,z_m,sigma_m"


def written(folder, *lines):
    path = folder / "fixes.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_fixes_are_read_by_name_an_empty_height_is_not_known_and_what_is_none_is_refused(tmp_path):
    flat, full = read_fixes(written(tmp_path, HEADER, "12.5,3,-4,,0.2", "20,1,2,3.5,1"))
    assert (flat.time_s, flat.horizontal_sigma_m, flat.vertical_sigma_m) == (12.5, 0.2, np.inf)
    np.testing.assert_array_equal(flat.position, [3.0, -4.0, 0.0])
    assert (full.time_s, full.horizontal_sigma_m, full.vertical_sigma_m) == (20.0, 1.0, 1.0)
    np.testing.assert_array_equal(full.position, [1.0, 2.0, 3.5])
    (fix,) = read_fixes(written(tmp_path, "sigma_m,point,z_m,y_m,x_m,time_s", "0.1,A,7,6,5,4"))
    assert (fix.time_s, *fix.position, fix.horizontal_sigma_m) == (4.0, 5.0, 6.0, 7.0, 0.1)


def test_fixes_in_degrees_are_meters_about_the_first_one(tmp_path):
    """At 60 degrees north a degree of longitude is half as long; the first known height is that of the zero."""
    head = "time_s,latitude_deg,longitude_deg,height_m,sigma_m"
    one, two, three = read_fixes(written(tmp_path, head, "1,60,10,,2", "2,60.001,10,100,2", "3,60,10.001,103,1"))
    assert {fix.origin for fix in (one, two, three)} == {(60.0, 10.0, 100.0)}
    np.testing.assert_allclose([one.position, two.position], [[0, 0, 0], [0, 111.4, 0]], atol=0.05)
    np.testing.assert_allclose(three.position, [55.8, 0, 3], atol=0.05)
    assert [fix.vertical_sigma_m for fix in (one, two, three)] == [np.inf, 2.0, 1.0]
    flat = read_fixes(written(tmp_path, "sigma_m,longitude_deg,latitude_deg,time_s", "2,10,60,1", "1,10,60.001,2"))
    assert (flat[0].origin, flat[1].vertical_sigma_m) == ((60.0, 10.0, None), np.inf)
    np.testing.assert_allclose(flat[1].position, [0, 111.4, 0], atol=0.05)
    for row, words in (
        ("1,95,10,,2", "line 2 is no place on the Earth"),
        ("1,60,,,2", "line 2 lacks a number .only height_m"),
        ("1,60,10,5,0", "line 2 has no sigma"),
    ):
        with pytest.raises(FormatError, match=words):
            read_fixes(written(tmp_path, head, row))


RAW = tilting(np.random.default_rng(4))

AIR = replace(RAW, pressure=np.where(np.arange(len(RAW.t)) % 4 == 0, 101_300.0 + np.arange(len(RAW.t)), np.nan))


def test_a_column_of_pressure_is_read_in_its_unit_or_by_its_size(tmp_path):
    for name, factor in (("pressure_pa", 1.0), ("pressure_hpa", 0.01), ("baro", 0.01)):
        write_canonical(replace(AIR, pressure=factor * AIR.pressure), tmp_path / "walk.csv")
        text = (tmp_path / "walk.csv").read_text().replace("pressure_pa", name, 1)
        (tmp_path / "walk.csv").write_text(text)
        np.testing.assert_allclose(read_raw(tmp_path / "walk.csv").pressure, AIR.pressure, rtol=1e-12)
    assert find_pressure(["time_s", "relativeAltitude", "sea level pressure", "heel_pressure", "temperature"]) is None


def test_a_file_beside_is_put_on_the_clock_of_the_recording(tmp_path):
    write_canonical(RAW, tmp_path / "walk.csv")
    rows = np.flatnonzero(np.isfinite(AIR.pressure))
    for stamps, unit in (("time_s", 1.0), ("time_ms", 1e3), ("time", 1.0)):
        columns = [unit * (RAW.t[rows] + 1e-3), 0.01 * AIR.pressure[rows]]
        (tmp_path / "baro.csv").write_text(tabulate([stamps, "pressure_hpa"], columns))
        found = read_raw(tmp_path / "walk.csv", barometer=tmp_path / "baro.csv").pressure
        np.testing.assert_allclose(found, AIR.pressure, rtol=1e-12)
