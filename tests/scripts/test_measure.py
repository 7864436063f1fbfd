"""Experiments: how figures are summed up, judged, stored and written, and that each measures what it says."""

import json

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError, FormatError, SimulationError
from fg_nav.lab.campaign.walks import Simulated
from fg_nav.lab.simulation import scenario, simulate
from fg_nav.smoother import SmootherParameters
from fg_nav.smoother.strides import place_nodes
from fg_nav.walk import Walk
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

harness = load_script("harness")
walks = load_script("walks")
measure = load_script("measure")
experiments = load_script("experiments")
accuracy = load_script("experiments.accuracy")
coverage = load_script("experiments.coverage")
online = load_script("experiments.online")
places = load_script("experiments.places")
worn = load_script("experiments.worn")


def table(*rows):
    """Rows of (section, walk, variant, error or failure)."""
    names = {True: "failure", False: "error"}
    return experiments.Table(
        [{"section": s, "walk": w, "variant": v, names[isinstance(e, str)]: e} for s, w, v, e in rows]
    )


TABLE = table(
    ("s", "1", "ours", 1.0), ("s", "2", "ours", -3.0), ("s", "1", "iez", 2.0), ("s", "2", "iez", 2.0),
    ("other", "1", "ours", "no such walk."), ("other", "2", "ours", 4.0),
)  # fmt: skip


def test_a_figure_is_summed_up_by_its_size_and_a_failure_is_infinitely_bad():
    assert TABLE.values("s", "ours", "error").tolist() == [1.0, 3.0]
    assert TABLE.values("s", "ours", "error", "iez").tolist() == [0.5, 1.5]
    assert TABLE.values("other", "ours", "error").tolist() == [np.inf, 4.0]
    assert not len(TABLE.values("s", "ours", "another"))
    column = experiments.Column("error", "e", "mean / median / worst", "{:.1f}")
    assert column.write(TABLE, "s", "ours") == "2.0 / 2.0 / 3.0"
    assert column.write(TABLE, "other", "ours") == "failed / failed / failed"


def test_what_is_asked_is_judged_in_each_section_that_has_it():
    found = list(experiments.Asked("error", "mean", high=1.9, variant="ours").judge(TABLE))
    assert [(one.section, one.mark) for one in found] == [("s", "missed"), ("other", "missed")]
    [one] = experiments.Asked("error", "rms", high=1.2, section="s", variant="ours", over="iez").judge(TABLE)
    assert (one.measured, one.mark) == (pytest.approx(np.sqrt(1.25)), "ok")


def test_a_section_measured_anew_takes_the_place_of_what_the_store_has(tmp_path):
    experiment = experiments.Experiment("about", lambda chosen: [], [experiments.Column("error", "e", "mean")])
    path = measure.save(tmp_path, "name", experiment, TABLE, measure.make_stamp("words", "101 to 102"))
    measure.save(tmp_path, "name", experiment, table(("s", "1", "ours", 7.0)), measure.make_stamp("words", ""))
    content = json.loads(path.read_text())
    assert [row["error"] for row in content["rows"] if row["section"] == "s"] == [7.0]
    assert len(content["rows"]) == 3
    assert content["made"]["other"]["seeds"] == "101 to 102"
    assert set(content["made"]["s"]) == {"date", "commit", "code", "python", "command"}
    assert experiments.sum_up(TABLE.select("s"), experiment.columns) == {
        ("section", "variant", "walks", "e"): [["s", "ours", "2", "2.000"], ["s", "iez", "2", "2.000"]]
    }


def test_the_command_of_a_table_measures_the_same_again():
    def write(name, *given):
        experiment = measure.EXPERIMENTS[name]
        return measure.write_command(name, experiment, measure.parse(experiment, given))

    run = ("--save", "--jobs", "2", "--data", "somewhere", "--only", "s", "--per-walk")
    assert write("real-walks", *run) == "python scripts/measure.py real-walks"
    again = "python scripts/measure.py coverage --seeds 3 --first 401 --length 90.0"
    assert write("coverage", "--seeds", "3", "--length", "90", *run) == again
    assert write("peers", "--python", "some/python").endswith("peers --seeds 6 --first 101 --python PYTHON")
    assert write("cost", "--ratio", "--minutes", "1", "2").endswith("cost --ratio --minutes 1.0 2.0")


def test_sections_are_chosen_by_how_they_begin_and_what_cannot_be_read_has_failed():
    def refuse():
        raise EstimationError("no such walk.")

    tasks = [experiments.Task("ab", "x", refuse)]
    tasks += [experiments.Task("b", "101", lambda: {"ours": {"error": 1.0}, "iez": refuse})]
    experiment = experiments.Experiment("about", lambda chosen: tasks, [])
    chosen = measure.select_tasks(experiment, measure.parse(experiment, ["--only", "a"]))
    assert chosen == tasks[:1]
    with pytest.raises(SimulationError, match="no such section"):
        measure.select_tasks(experiment, measure.parse(experiment, ["--only", "c"]))
    failed, measured, refused = measure.run_tasks(tasks, 1).rows
    assert failed == {"section": "ab", "walk": "x", "variant": "all", "failure": "no such walk."}
    assert measured == {"section": "b", "walk": "101", "variant": "ours", "error": 1.0}
    assert refused == {"section": "b", "walk": "101", "variant": "iez", "failure": "no such walk."}


def test_an_experiment_that_is_not_there_is_named_and_all_are_listed(capsys):
    with pytest.raises(SimulationError, match="no experiment 'mistake'"):
        measure.main(["mistake"])
    measure.main([])
    out = capsys.readouterr().out
    assert all(name in out for name in measure.EXPERIMENTS)


def test_every_column_that_is_asked_is_one_that_is_measured():
    for name, one in measure.EXPERIMENTS.items():
        figures = {column.figure for column in one.columns}
        assert {asked.figure for asked in one.asked} <= figures, name


# --- the experiments -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def demo():
    recording = simulate("demo", 3).recording
    return Walk(recording, detect_stances(recording), recording.truth)


def test_a_solution_is_measured(demo):
    for estimate in (accuracy.smooth, accuracy.run_iez, accuracy.run_invariant):
        row = accuracy.measure_solution(demo, estimate(demo.recording, demo.stances))
        assert 0 < row["rmse_2d_m"] < 0.3
        assert row["strides_detected"] == demo.stances.n_footfalls - 1
        assert 0 < row["nees"] < np.inf
        assert 0 < row["inside"] <= 1


def test_each_part_left_out_is_a_smoother_of_its_own(demo):
    assert len({repr(parameters) for parameters in accuracy.PARTS.values()}) >= len(accuracy.PARTS) - 1
    assert len(place_nodes(demo.recording, demo.stances, accuracy.PARTS["one node a stance"])) == len(demo.stances)
    assert len(place_nodes(demo.recording, demo.stances, SmootherParameters())) > len(demo.stances)
    scale = {}
    for name in ("default", "plain zero velocity"):
        solution = accuracy.smooth(demo.recording, demo.stances, parameters=accuracy.PARTS[name])
        scale[name] = accuracy.measure_solution(demo, solution)["scale"]
    # 9 cm above the ground, on a foot that rolls by some 20 deg/s, the sensor goes 3 cm/s in stance. Taken for zero
    # velocity, that is missing all the stride long: 2 % of it
    assert 0.01 < scale["plain zero velocity"] - scale["default"] < 0.04


def test_the_table_of_all_sets_names_the_best_filter_of_the_papers():
    rows = [{"section": "gdin", "walk": "15", "variant": name, "rmse_2d_m": error}
            for name, error in (("inertial", 0.3), ("qsf", 0.5), ("aiez", 0.25), ("gtsam iekf", 0.4))]  # fmt: skip
    [line] = accuracy.write_sets(["gdin", "xio"], experiments.Table(rows))[2:]
    cells = [cell.strip() for cell in line.split("|")[2:-1]]
    assert cells == ["1", "0.300 / 0.300", "0.300 / 0.300", "-", "0.250 / 0.250 aiez", "-", "-", "0.400 / 0.400"]


def test_a_simulated_way_is_covered_by_its_sigmas():
    found = experiments.measure_variants(lambda: coverage.cover_way(120.0, None, True, 401))["smoother"]
    assert "failure" not in found
    assert found["horizontal"] > 0.5
    assert 0.01 < found["horizontal ratio"] < 3.0


def test_spoiled_recordings_are_not_trusted():
    raw = accuracy.simulate_demo(301)
    spoiled = {kind: accuracy.spoil(kind, 1, lambda: raw) for kind in ("clipped", "20 Hz", "wrong axes", "loose")}
    judged = {
        name: accuracy.judge_walk("simulated", lambda some=some: some, ["smoother"])["smoother"]
        for name, some in (("good", raw), ("axes", spoiled["wrong axes"]))
    }
    assert judged["good"]["trusted"] == 1
    assert judged["axes"]["trusted"] == 0
    assert len(spoiled["20 Hz"].t) < len(raw.t) / 5
    assert np.abs(spoiled["clipped"].gyr).max() == pytest.approx(np.abs(raw.gyr).max() / 2)
    assert np.isfinite(spoiled["loose"].gyr).all()


def test_laps_wander_aside_by_what_they_say():
    lap = places.draw_lap(101).repeat(2)
    arc = np.linspace(10.0, lap.length_m - 10.0, 400)
    moved = places.move_path(lap, 5)
    nearest = [np.linalg.norm(moved.at(arc)[0][:, :2] - place[:2], axis=1).min() for place in lap.at(arc)[0]]
    assert 0.1 < float(np.sqrt(np.mean(np.square(nearest)))) < 0.5


@needs_data
def test_loops_are_measured_printed_and_stored(tmp_path, capsys):
    given = ["real-walks", "--data", str(DATA), "--only", "xio", "--per-walk", "--save", "--store", str(tmp_path)]
    measure.main(given)
    content = json.loads((tmp_path / "real-walks.json").read_text())
    assert [row["walk"] for row in content["rows"][::3]] == ["xio short", "xio long"]
    assert all(row["ground_m"] < 2.0 for row in content["rows"])
    out = capsys.readouterr().out
    assert "xio long" in out
    assert "stored: " in out


@needs_data
def test_recordings_are_prepared_as_a_run_does():
    walk = next(one for one in walks.list_set(DATA, "mti round") if one.name == "hallway_walk_trial2").prepare()
    assert len(walk.recording) == 3565  # a header, and a row that is no sample
    assert any("accelerometer bias" in note for note in walk.recording.provenance.notes)
    aided = next(one for one in walks.list_set(DATA, "mtig", True) if one.name.startswith("2022_1_13_straight_run"))
    recording = aided.prepare().recording
    assert len(recording.pressure) == len(recording)
    surveyed = next(one for one in walks.list_set(DATA, "gdin") if one.name == "gdin 36").prepare()
    assert surveyed.recording.mag is None
    assert surveyed.truth is not None


def test_missing_recordings_are_one_sentence(tmp_path, capsys):
    for name in ("vicon", "gdin", "openshoe", "mems"):
        with pytest.raises(FormatError, match="no recording of the set"):
            walks.list_set(tmp_path, name)
    with pytest.raises(SystemExit) as left:
        harness.run(lambda: measure.main(["real-walks", "--data", str(tmp_path / "nowhere")]))
    assert left.value.code == 1
    [line] = capsys.readouterr().err.splitlines()
    assert "nowhere" in line
    assert "--data" in line


def test_two_feet_are_measured_alone_and_together():
    found = worn.measure_pair("demo", False, 3)
    assert set(found) == {"alone", "together"}
    assert all(0 < error < 1.0 for one in found.values() for error in one.values())


def test_lines_of_a_walk_in_progress_are_held_against_its_end():
    walk = Simulated("demo", "smooth", 3).prepare("perfect")
    found = online.measure_pushed(walk, walk.options.heading_rad)
    assert 0 < found["worst"] < 10.0
    assert found["gap (m)"] < 0.3
    assert 0 < found["moment (m)"] < 1.0


def test_a_walk_is_smoothed_with_places_and_without(monkeypatch):
    monkeypatch.setattr(places, "COURSES", {"demo": scenario("demo")})
    monkeypatch.setattr(places, "calibrate", lambda seed: None)
    found = experiments.measure_variants(lambda: places.measure_course("demo", "smooth", 3))
    assert all("failure" not in found[name] for name in ("with", "without"))
    assert 0 < found["without"]["all (m)"] < 1.0


@needs_data
def test_all_methods_run_on_a_walk_with_a_magnetometer():
    real = next(one for one in walks.list_set(DATA, "openshoe") if one.name == "openshoe 13")
    found = experiments.measure_variants(lambda: accuracy.measure_real(None, "openshoe", real))
    assert set(found) == {"inertial", "iez", "smoother", *accuracy.FILTERS, "gtsam iekf"}
    assert all(0 < one["ground_m"] < 2 for one in found.values())


@needs_data
def test_a_phone_in_a_pocket_is_laid_beside_its_fixes():
    path = sorted((DATA / "pocket_gnss").glob("*.zip"))[0]
    found = experiments.measure_variants(lambda: worn.measure_pocket(path))
    assert 0.0 < found["with fixes"]["gnss_m"] < found["sensor"]["gnss_m"]
