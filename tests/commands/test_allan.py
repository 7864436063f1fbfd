"""`fg-nav lab allan` from end to end."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.io import write_canonical
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.recording import Recording
from tests.command_line import names


def test_table_picture_and_figures(fg_nav):
    """Of a minute of a sensor on a table; its magnetometer has every second row."""
    scenario = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(65.0)])
    table = simulate(scenario, 1, Choices(sensor="mpu-9250", rate_hz=200.0))
    write_canonical(table.recording, Path("table.csv"))
    allan = ("lab", "allan", "table.csv", "--out", "noise")
    ran = fg_nav(*allan)
    assert ran.code == 0
    said = ran.out
    assert fg_nav(*allan).refused("--force")
    again = fg_nav(*allan, "--force", "--json")
    found = json.loads(Path("noise/allan.json").read_text())
    assert json.loads(again.out) == {"folder": "noise", **found}
    assert names(Path("noise")) == {"allan.json", "allan.png"}
    assert found["seconds"] == pytest.approx(65.0, abs=1.5)
    gyr, density = found["sensors"]["gyr"], table.scenario.prior.gyr.noise_density
    assert gyr["x"]["N"]["value"] == pytest.approx(density, rel=0.05)
    assert len(gyr["z"]["tau_s"]) == len(gyr["z"]["deviation"]) == len(gyr["z"]["low"])
    assert found["sensors"]["mag"]["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    for words in ("gyroscope, 200 Hz", "deg/s/√Hz", "accelerometer", "magnetometer, 100 Hz", "nT/√Hz", "< "):
        assert words in said
    line = next(line for line in said.splitlines() if line.startswith("x"))
    assert float(line.split()[1]) == pytest.approx(np.degrees(density), rel=0.05)
    # without a magnetometer, and with a dead axis
    acc = table.recording.acc.copy()
    acc[:, 0] = acc[0, 0]
    write_canonical(Recording(table.recording.t, acc, table.recording.gyr), Path("dead.csv"))
    ran = fg_nav("lab", "allan", "dead.csv", "--out", "dead")
    assert ran.code == 0
    assert "magnetometer" not in ran.out
    assert json.loads(Path("dead/allan.json").read_text())["sensors"]["acc"]["x"]["N"]["seen"] is False
    write_canonical(table.recording.slice(0, 2000), Path("short.csv"))
    assert fg_nav("lab", "allan", "short.csv", "--out", "walk").refused("too short for an Allan deviation")
