"""The benchmarks: what is timed, and how it is judged; no time is asked for."""

import pytest

from fg_nav.errors import SimulationError
from tests.scripts import load_script
from tests.simulated import straight_walk

cost = load_script("experiments.cost")
online = load_script("experiments.online")
experiments = load_script("experiments")


def test_ratios_are_judged_within_one_run() -> None:
    us = {"bare loop": 2.0, "smooth": 2.8, "iez": 1.0, "with": 3.0, "without": 1.0}
    rows = [
        {"section": walk, "walk": "1", "variant": name, "us": {**us, **more}[name]}
        for walk, more in (("1 min", {}), ("2 min", {"smooth": 5.6}))
        for name in us
    ]
    table = experiments.Table(rows)
    figures = [one for asked in cost.EXPERIMENTS["cost"].asked for one in asked.judge(table)]
    marks = {(one.section, one.method, one.name): one.mark for one in figures}
    assert marks["1 min", "smooth", "us, mean, over bare loop"] == "ok"
    assert marks["2 min", "smooth", "us, mean, over bare loop"] == "missed"
    assert marks["1 min", "with", "us, mean, over without"] == "missed"


def test_the_bare_loop_takes_every_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, taken = straight_walk(strides=4, standing_s=1.0, rate_hz=100.0).recording, []

    class Counting:
        def __init__(self, params: object) -> None:
            pass

        def integrateMeasurement(self, acc: object, gyr: object, h: float) -> None:
            taken.append(h)

    monkeypatch.setattr(cost.gtsam, "PreintegratedImuMeasurementsG", Counting)
    cost.run_bare_loop(recording)
    assert sum(taken) == pytest.approx(recording.duration_s)


def test_the_cost_of_a_footfall_is_measured() -> None:
    found = online.measure_footfalls(0.4)["online"]
    assert 0.0 < found["p50"] <= found["p99"] <= found["longest"]


def test_a_command_that_fails_is_named() -> None:
    assert min(cost.run_command("--help").values()) > 0.0
    with pytest.raises(SimulationError, match="nowhere"):
        cost.run_command("run", "nowhere.csv")


def test_a_program_that_is_not_there_is_named_beside_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "REPEATS", 1)
    found = experiments.measure_variants(lambda: cost.measure_programs(None, 101))
    assert 0.0 < found["fg-nav iez"]["rmse_2d_m"] < 0.5
    assert "--python" in found["gaitmap"]["failure"]
