"""The benchmarks: what is timed, and how it is judged; no time is asked for."""

import pytest

from fg_nav.errors import SimulationError
from tests.scripts import load_script
from tests.simulated import straight_walk

benchmark = load_script("bench.benchmark")
online = load_script("bench.online")
commands = load_script("bench.commands")


def test_ratios_are_judged_within_one_run() -> None:
    us = {"bare loop": 2.0, "smooth": 2.8, "iez": 1.0, "with": 3.0, "without": 1.0}
    figures = {figure.name: figure for figure in benchmark.judge_costs({"1 min": us, "2 min": {**us, "smooth": 5.6}})}
    assert figures["smooth over bare loop, 1 min"].mark == "ok"
    assert figures["smooth over bare loop, 2 min"].mark == "missed"
    assert figures["smooth a sample, 2 min over 1 min"].measured == pytest.approx(2.0)
    assert figures["with over without, 1 min"].mark == "missed"


def test_the_bare_loop_takes_every_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, taken = straight_walk(strides=4, standing_s=1.0, rate_hz=100.0).recording, []

    class Counting:
        def __init__(self, params: object) -> None:
            pass

        def integrateMeasurement(self, acc: object, gyr: object, h: float) -> None:
            taken.append(h)

    monkeypatch.setattr(benchmark.gtsam, "PreintegratedImuMeasurementsG", Counting)
    benchmark.run_bare_loop(recording)
    assert sum(taken) == pytest.approx(recording.duration_s)


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
