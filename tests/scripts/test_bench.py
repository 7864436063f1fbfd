"""The benchmarks: what is timed, and how it is judged; no time is asked for."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import SimulationError
from tests.scripts import load_script
from tests.simulated import straight_walk

benchmark = load_script("bench.benchmark")
online = load_script("bench.online")
commands = load_script("bench.commands")
peers = load_script("bench.peers")


def test_ratios_are_judged_within_one_run() -> None:
    us = {"bare loop": 2.0, "smooth": 2.8, "compiled loop": 0.1, "iez": 1.0, "with": 3.0, "without": 1.0}
    figures = {figure.name: figure for figure in benchmark.judge_costs({"1 min": us, "2 min": {**us, "smooth": 5.6}})}
    assert figures["smooth over bare loop, 1 min"].mark == "ok"
    assert figures["smooth over bare loop, 2 min"].mark == "missed"
    assert figures["smooth a sample, 2 min over 1 min"].measured == pytest.approx(2.0)
    assert figures["with over without, 1 min"].mark == "missed"


def test_the_loops_take_every_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, taken = straight_walk(strides=4, standing_s=1.0, rate_hz=100.0).recording, []

    class Counting:
        def __init__(self, params: object) -> None:
            pass

        def integrateMeasurement(self, acc: object, gyr: object, h: float) -> None:
            taken.append(h)

    monkeypatch.setattr(benchmark.gtsam, "PreintegratedImuMeasurementsG", Counting)
    benchmark.run_bare_loop(recording)
    assert sum(taken) == pytest.approx(recording.duration_s)
    # Turning at 0.3 rad/s with 1 m/s^2 ahead: the velocity is (sin 3, 1 - cos 3) / 0.3.
    rate, force = np.tile([0.0, 0.0, 0.3], (1000, 1)), np.tile([1.0, 0.0, 9.80665], (1000, 1))
    w, x, y, z, *velocity = benchmark.turn_by_samples(force, rate, np.full(1000, 0.01))
    np.testing.assert_allclose([w, x, y, z], [np.cos(1.5), 0.0, 0.0, np.sin(1.5)], atol=1e-12)
    np.testing.assert_allclose(velocity, [np.sin(3.0) / 0.3, (1.0 - np.cos(3.0)) / 0.3, 0.0], atol=2e-2)


def test_the_cost_of_a_footfall_is_printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SimulationError, match="too few for a trend"):
        online.main(["--minutes", "0.3"])
    monkeypatch.setattr(online, "EARLY", slice(5, 20))
    monkeypatch.setattr(online, "EVERY", 20)
    online.main(["--minutes", "0.6"])
    assert "memory at the end over that at half" in capsys.readouterr().out


def test_a_command_that_fails_is_named() -> None:
    cpu, wall, mb = commands.run_command("--help")
    assert min(cpu, wall, mb) > 0.0
    with pytest.raises(SimulationError, match="nowhere"):
        commands.run_command("run", "nowhere.csv")


@pytest.mark.skipif(find_spec("vqf") is None, reason="vqf is not installed: pip install '.[checks]'")
def test_programs_have_the_same_samples_and_those_that_are_missing_a_row() -> None:
    recording = straight_walk(strides=4, standing_s=1.0, rate_hz=100.0).recording
    some = [(recording, peers.detect_stances(recording))]
    rows = {row["method"]: row for row in peers.measure_set("simulated", some, sys.executable, 1)}
    assert rows["vqf offline"]["heading_deg"] < 3.0
    assert rows["vqf offline"]["rmse_3d_m"] is None
    assert rows["gaitmap"]["missing"]


def test_attitude_errors_are_those_of_a_turn() -> None:
    recording = straight_walk(strides=4, standing_s=1.0, rate_hz=100.0).recording
    true = Rotation.from_matrix(recording.truth.nav_R_body)
    turned = Rotation.from_euler("z", 20.0, degrees=True) * Rotation.from_euler("x", 3.0, degrees=True) * true
    errors = peers.measure_errors(recording, turned, recording.truth.position + np.arange(3.0))
    assert errors["heading_deg"] == pytest.approx(0.0, abs=1e-6)  # its mean is off
    assert errors["inclination_deg"] == pytest.approx(3.0)
    assert errors["rmse_3d_m"] == pytest.approx(0.0, abs=1e-9)
