"""`fg-nav lab allan` from end to end."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from fg_nav import cli
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.recording import Recording


@pytest.fixture
def fg_nav(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["fg-nav", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        said = capsys.readouterr()
        return left.value.code, said.out, said.err

    return call


@pytest.fixture(scope="module")
def table():
    """A minute of a sensor on a table; its magnetometer has every second row."""
    scenario = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(65.0)])
    return simulate(scenario, 1, Choices(sensor="mpu-9250", rate_hz=200.0))


def test_table_picture_and_figures(fg_nav, table, tmp_path):
    write_canonical(table.recording, tmp_path / "table.csv")
    code, said, _ = fg_nav("lab", "allan", "table.csv", "--out", "noise")
    assert code == 0
    code, again, _ = fg_nav("lab", "allan", "table.csv", "--out", "noise", "--force", "--json")
    assert code == 0
    assert json.loads(again) == {"folder": "noise", **json.loads((tmp_path / "noise" / "allan.json").read_text())}
    assert {path.name for path in (tmp_path / "noise").iterdir()} == {"allan.json", "allan.png"}
    found = json.loads((tmp_path / "noise" / "allan.json").read_text())
    assert found["seconds"] == pytest.approx(65.0, abs=1.5)
    gyr, density = found["sensors"]["gyr"], table.scenario.prior.gyr.noise_density
    assert gyr["x"]["N"]["value"] == pytest.approx(density, rel=0.05)
    assert len(gyr["z"]["tau_s"]) == len(gyr["z"]["deviation"]) == len(gyr["z"]["low"])
    assert found["sensors"]["mag"]["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    for words in ("gyroscope, 200 Hz", "deg/s/√Hz", "accelerometer", "magnetometer, 100 Hz", "nT/√Hz", "< "):
        assert words in said
    line = next(line for line in said.splitlines() if line.startswith("x"))
    assert float(line.split()[1]) == pytest.approx(np.degrees(density), rel=0.05)


def test_an_older_result_is_kept_unless_told_otherwise(fg_nav, table, tmp_path):
    write_canonical(table.recording, tmp_path / "table.csv")
    (tmp_path / "noise").mkdir()
    (tmp_path / "noise" / "allan.json").write_text("{}")
    code, _, error = fg_nav("lab", "allan", "table.csv", "--out", "noise")
    assert code == 1
    assert "--force" in error
    assert (tmp_path / "noise" / "allan.json").read_text() == "{}"
    assert fg_nav("lab", "allan", "table.csv", "--out", "noise", "--force")[0] == 0
    assert json.loads((tmp_path / "noise" / "allan.json").read_text())["sensors"]


def test_a_sensor_without_magnetometer_and_with_a_dead_axis(fg_nav, table, tmp_path):
    acc = table.recording.acc.copy()
    acc[:, 0] = acc[0, 0]
    write_canonical(Recording(table.recording.t, acc, table.recording.gyr), tmp_path / "dead.csv")
    code, said, _ = fg_nav("lab", "allan", "dead.csv", "--out", "noise")
    assert code == 0
    assert "magnetometer" not in said
    assert json.loads((tmp_path / "noise" / "allan.json").read_text())["sensors"]["acc"]["x"]["N"]["seen"] is False


def test_a_walk_is_refused_in_a_sentence(fg_nav, tmp_path):
    write_canonical(simulate("demo", 1).recording, tmp_path / "walk.csv")
    code, said, error = fg_nav("lab", "allan", "walk.csv", "--out", "noise")
    assert (code, said) == (1, "")
    assert "too short for an Allan deviation" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "noise").exists()
