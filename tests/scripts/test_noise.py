"""The script that prints what an Allan deviation finds of the simulated sensors."""

import numpy as np
import pytest

from fg_nav.lab.simulation.sensors import preset
from tests.scripts import load_script

script = load_script("calibration")


def test_it_prints_a_row_for_each_sensor(capsys, monkeypatch):
    monkeypatch.setattr(script, "AT_REST", ("xsens-mtw",))
    script.main(["noise", "--seeds", "1", "--minutes", "2"])
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("xsens-mtw")]
    assert len(rows) == 2
    assert all(float(row.split()[3]) == pytest.approx(1.0, abs=0.03) for row in rows)


def test_the_true_deviation_of_a_drift_has_its_hump_where_the_module_says():
    """A Gauss-Markov process peaks with 0.62 of its spread at 1.9 times its correlation time."""
    prior = preset("kvh-1750").gyr
    tau = np.geomspace(100.0, 20_000.0, 2000)
    only = script.true_deviation(tau, type(prior)(drift=prior.drift))
    assert only.max() / prior.drift.sd == pytest.approx(0.62, abs=0.01)
    assert tau[np.argmax(only)] / prior.drift.time_s == pytest.approx(1.9, abs=0.05)
