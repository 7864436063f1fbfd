"""The pressure of the air: a column of a table, a phone's own table, a file beside a recording, and out again."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.columns.mapping import find_pressure
from fg_nav.errors import FormatError
from fg_nav.io import read_raw, write_canonical
from tests.io.samples import tilting

RAW = tilting(np.random.default_rng(4))

AIR = replace(RAW, pressure=np.where(np.arange(len(RAW.t)) % 4 == 0, 101_300.0 + np.arange(len(RAW.t)), np.nan))


@pytest.mark.parametrize(("name", "factor"), [("pressure_pa", 1.0), ("pressure_hpa", 0.01), ("baro", 0.01)])
def test_a_column_is_read_in_its_unit_or_by_its_size(name, factor, tmp_path):
    write_canonical(replace(AIR, pressure=factor * AIR.pressure), tmp_path / "walk.csv")
    text = (tmp_path / "walk.csv").read_text().replace("pressure_pa", name, 1)
    (tmp_path / "walk.csv").write_text(text)
    np.testing.assert_allclose(read_raw(tmp_path / "walk.csv").pressure, AIR.pressure, rtol=1e-12)


def test_other_columns_are_no_pressure_of_air():
    assert find_pressure(["time_s", "relativeAltitude", "sea level pressure", "heel_pressure", "temperature"]) is None


@pytest.mark.parametrize("stamps", ["time_s", "time_ms", "time"])
def test_a_file_beside_is_put_on_the_clock_of_the_recording(stamps, tmp_path):
    write_canonical(RAW, tmp_path / "walk.csv")
    rows = np.flatnonzero(np.isfinite(AIR.pressure))
    unit = 1e3 if stamps == "time_ms" else 1.0
    lines = [f"{unit * (RAW.t[k] + 1e-3):.9f},{0.01 * AIR.pressure[k]:.9f}" for k in rows]
    (tmp_path / "baro.csv").write_text("\n".join([f"{stamps},pressure_hpa", *lines]) + "\n")
    found = read_raw(tmp_path / "walk.csv", barometer=tmp_path / "baro.csv").pressure
    np.testing.assert_allclose(found, AIR.pressure, rtol=1e-12)


def test_a_file_that_is_of_no_use_is_refused(tmp_path):
    write_canonical(RAW, tmp_path / "walk.csv")
    for text, words in (
        ("time_s,x\n0,1\n", "names no pressure"),
        ("x,pressure_pa\n0,101325\n", "has no time"),
        ("time_s,pressure_pa\n0,-5\n1,-5\n", "no pressure of air"),
        ("time_s,pressure_pa\n9000,101325\n9001,101325\n", "on its clock"),
    ):
        (tmp_path / "baro.csv").write_text(text)
        with pytest.raises(FormatError, match=words):
            read_raw(tmp_path / "walk.csv", barometer=tmp_path / "baro.csv")
