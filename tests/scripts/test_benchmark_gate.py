"""The gate of the benchmark, and the table beside other programs: what is judged, and how."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import OutputError
from tests.scripts import load_script
from tests.simulated import straight_walk

benchmark = load_script("benchmark")
gate = load_script("benchmark_gate")
peers = load_script("benchmark_peers")


def test_a_metric_is_worse_in_its_own_direction():
    assert gate.Metric("a", "ratio", 1.2).worse_by(1.0) == pytest.approx(0.2)
    assert gate.Metric("a", "ratio", 1.2, "higher").worse_by(1.0) == pytest.approx(-0.2)


def test_the_gate_passes_what_is_as_good_and_exits_on_what_is_worse_or_none(tmp_path, monkeypatch):
    path = tmp_path / "baseline.json"
    made = [gate.Metric("speed", "ratio", 2.0), gate.Metric("error", "m", 0.5, tolerance=0.03)]

    def run(metrics, *words):
        monkeypatch.setattr(gate, "measure_metrics", lambda *_: metrics)
        benchmark.main([*words, "--quick", "--baseline", str(path)])

    with pytest.raises(OutputError, match="there is no baseline"):
        run(made, "--gate")
    run(made, "--save")
    run([gate.Metric("speed", "ratio", 2.4), made[1], gate.Metric("new", "ratio", 9.0)], "--gate")
    with pytest.raises(OutputError, match=r"worse than the baseline: error\."):
        run([made[0], gate.Metric("error", "m", 0.52, tolerance=0.03)], "--gate")
    with pytest.raises(OutputError, match="speed"):
        run([gate.Metric("speed", "ratio", np.nan)], "--gate")
    run([gate.Metric("speed", "ratio", 3.0)], "--save")  # the other stays
    assert gate.read_baseline(path) == {"speed": 3.0, "error": 0.5}


def test_the_compiled_loop_turns_and_accelerates_as_the_true_walk_does():
    rate, force = np.tile([0.0, 0.0, 0.3], (1000, 1)), np.tile([1.0, 0.0, 9.80665], (1000, 1))
    w, x, y, z, *velocity = gate.turn_by_samples(force, rate, np.full(1000, 0.01))
    np.testing.assert_allclose([w, x, y, z], [np.cos(1.5), 0.0, 0.0, np.sin(1.5)], atol=1e-12)
    # Turning at 0.3 rad/s with 1 m/s^2 ahead: the velocity is (sin 3, 1 - cos 3) / 0.3.
    np.testing.assert_allclose(velocity, [np.sin(3.0) / 0.3, (1.0 - np.cos(3.0)) / 0.3, 0.0], atol=2e-2)
    turn = Rotation.from_rotvec([0.0, np.pi / 2, 0.0])
    quarter = np.tile([0.0, np.pi / 2 / 1000 / 0.01, 0.0], (1000, 1))
    found = gate.turn_by_samples(force, quarter, np.full(1000, 0.01))
    np.testing.assert_allclose(found[[1, 2, 3, 0]], turn.as_quat(), atol=1e-12)
    assert gate.time_compiled_loop(straight_walk(strides=4, standing_s=1.0, rate_hz=100.0).recording) > 0.0


@pytest.mark.skipif(find_spec("vqf") is None, reason="vqf is not installed: pip install '.[checks]'")
def test_programs_have_the_same_samples_and_those_that_are_missing_a_row(capsys):
    walk = straight_walk(strides=4, standing_s=1.0, rate_hz=100.0)
    truth = walk.recording.truth
    attitude = Rotation.from_matrix(truth.nav_R_body)
    ours = {"fg-nav iez": lambda: peers.Found(0.0, attitude, truth.position + np.arange(3.0))}
    names = ("vqf offline, 6D",)
    job = peers.Job("short", walk.recording, np.arange(len(truth.t)) < 100, ours, names, attitude)
    iez, vqf = peers.measure_set("simulated", [job], sys.executable, 1)
    _, missing = peers.measure_set("simulated", [job], None, 1)
    assert iez.rmse_3d_m == pytest.approx(0.0, abs=1e-9)
    assert vqf.rmse_3d_m is None
    assert 0.0 < vqf.heading_deg < 3.0
    assert vqf.inclination_deg < 5.0
    assert vqf.over_bare > 0.0
    assert "position" in vqf.leaves_out
    assert (missing.missing, missing.over_bare) == ("no --peers", None)
    peers.print_peers([iez, vqf, missing])
    assert "vqf offline, 6D" in capsys.readouterr().out


def test_a_field_is_held_between_its_samples():
    mag = np.array([[np.nan] * 3, [1.0, 2.0, 3.0], [np.nan] * 3, [4.0, 5.0, 6.0]])
    assert peers.hold_field(mag)[:, 0].tolist() == [1.0, 1.0, 1.0, 4.0]
