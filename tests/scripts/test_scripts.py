"""The scripts that print the project's figures: what they measure, and how they judge it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError, FormatError
from fg_nav.evaluation import Metrics
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import simulate
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.strides import place_nodes
from tests.real_data import DATA, needs_data
from tests.scripts import SCRIPTS, load_script

harness = load_script("harness")
walks = load_script("walks")
real_walks = load_script("real_walks")
long_walk = walks.simulate_long_walk


@pytest.fixture(scope="module")
def demo():
    recording = simulate("demo", 3).recording
    return walks.Walk("demo", recording, detect_stances(recording))


def results(method="smoother", **columns):
    """One result a walk, from columns of figures of merit."""
    blank = Metrics(distance_m=100.0, closure_m=0.0, strides_detected=80)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return [real_walks.Result("s", str(k), method, replace(blank, **row)) for k, row in enumerate(rows)]


def judge(section, rows):
    """All figures of a section, of these rows."""
    of = real_walks.SECTIONS[section]
    return [*(figure for merit in of.merits for figure in merit.judge(section, rows)), *of.more(section, rows)]


def by_name(found, method="smoother"):
    return {figure.name: figure for figure in found if figure.method == method}


@pytest.mark.parametrize(
    ("measured", "low", "high", "asked", "mark"),
    [
        (0.5, -np.inf, 0.5, "<= 0.500", "ok"),
        (0.501, -np.inf, 0.5, "<= 0.500", "missed"),
        (7, 8, np.inf, ">= 8.000", "missed"),
        (1.2, 0.99, 1.01, "0.990 to 1.010", "missed"),
        (1.0, 0.99, 1.01, "0.990 to 1.010", "ok"),
        (9.9, -np.inf, np.inf, "", ""),
        (np.inf, -np.inf, 0.5, "<= 0.500", "missed"),
        (np.nan, -np.inf, 0.5, "<= 0.500", "missed"),
    ],
)
def test_a_figure_is_marked_by_what_was_asked(measured, low, high, asked, mark):
    figure = harness.Figure("section", "name", "method", measured, low, high)
    assert (figure.asked, figure.mark) == (asked, mark)


def test_what_could_not_be_measured_is_null_in_the_file(tmp_path):
    figure = harness.Figure("section", "name", "method", float("inf"), high=1.0)
    harness.write_json(tmp_path / "f.json", {"figures": [figure.as_dict()]})
    [written] = json.loads((tmp_path / "f.json").read_text())["figures"]
    assert written["measured"] is None
    assert (written["high"], written["mark"]) == (1.0, "missed")


def test_in_a_pipe_tables_are_plain_text(capsys):
    harness.print_figures([harness.Figure("section", "some name", "iez", 0.25, high=0.2)])
    assert capsys.readouterr().out.splitlines()[-1].split() == ["some", "name", "iez", "<=", "0.200", "0.250", "missed"]


def test_means_and_medians_over_walks_and_scale_tolerance():
    flat, space, scale = [0.02, 0.04, 0.12], [0.03, 0.05, 0.25], [0.98, 1.011, 1.5]
    columns = {"rmse_2d_m": flat, "rmse_3d_m": space, "scale": scale}
    rows = results(**columns) + results("iez", **columns)
    every = judge(real_walks.VICON_LABELLED, rows)
    found = by_name(every)
    assert found["rmse 2-D (m), mean"].measured == pytest.approx(0.06)
    assert found["rmse 2-D (m), median"].measured == 0.04
    assert found["rmse 3-D (m), mean"].mark == "missed"
    assert found["rmse 3-D (m), median"].mark == "ok"
    assert found["rmse 3-D (m), p95"].measured == pytest.approx(0.05 + 0.9 * 0.2)
    assert found["best-fit scale, median"].mark == "missed"
    assert by_name(every, "iez")["rmse 3-D (m), mean"].high == real_walks.PYSHOE["mean"][1]


def test_strides_are_counted_right_within_one():
    rows = results(strides_true=[80, 79, 81, 82, 70], rmse_2d_m=[0.1] * 5, scale=[1.0] * 5)
    found = judge(real_walks.FOOTPRINTS, rows + [replace(row, method="iez") for row in rows])
    [count] = [figure for figure in found if "stride count" in figure.name]
    assert (count.measured, count.mark) == (3, "missed")


def test_a_walk_without_a_solution_is_infinitely_bad(demo):
    def fails(recording, stances):
        raise EstimationError("no such walk.")

    failed = real_walks.measure_walk("s", demo, "smoother", fails)
    assert failed.failure == "no such walk."
    rows = [failed, *results(closure_percent=[0.1]), *results("iez", closure_percent=[0.1, 0.2])]
    found = by_name(judge(real_walks.LOOPS, rows))
    assert found["closure (%), worst"].measured == np.inf
    assert found["closure (%), median"].mark == "missed"


def test_both_methods_are_measured_on_the_same_walk(demo):
    rows = real_walks.run_methods("s", [demo])
    assert [row.method for row in rows] == ["smoother", "iez"]
    for row in rows:
        assert row.value("rmse_2d_m") < 0.3
        assert row.value("strides_detected") == demo.stances.n_footfalls - 1
        assert 0 < row.value("median_ratio") < np.inf
        assert row.as_dict()["median_ratio"] == pytest.approx(row.value("median_ratio"), rel=1e-4)


def test_each_part_left_out_is_a_smoother_of_its_own(demo, monkeypatch):
    solved = {}

    def smooth_once(recording, stances, parameters):
        """Stand in for all sets of walks, which are all the same one here."""
        if repr(parameters) not in solved:
            solved[repr(parameters)] = smooth(recording, stances, parameters)
        return solved[repr(parameters)]

    monkeypatch.setattr(real_walks, "smooth", smooth_once)
    variants = dict(real_walks.ABLATION)
    assert len({repr(parameters) for parameters in variants.values()}) >= len(variants) - 1  # one is the default's
    chosen = {section: [demo] for section, _, _ in real_walks.ABLATION_COLUMNS.values()}
    rows = {name: real_walks.measure_variant(p, chosen) for name, p in variants.items()}
    assert all(None not in row.values() for row in rows.values())
    default = rows["default"]
    # 9 cm above the ground, on a foot that rolls by some 20 deg/s, the sensor goes 3 cm/s in stance. Taken for zero
    # velocity, that is missing all the stride long: 2 % of it
    for without in ("plain zero velocity", "no lever"):
        assert 0.01 < rows[without]["scale"] - default["scale"] < 0.04


def test_a_wider_walk_of_the_bias_makes_wider_ends(demo, monkeypatch):
    monkeypatch.setattr(real_walks, "BIAS_WALK_OF", {real_walks.MEMS: lambda data: [demo]})
    monkeypatch.setattr(real_walks, "BIAS_WALKS_DEG_S", (3e-4, 2e-2))
    rows = {row["level"]: row for row in real_walks.measure_bias_walk(DATA)}
    assert list(rows) == ["as chosen", "3e-04", "2e-02"]
    assert rows["2e-02"]["sigma_m"] > 1.2 * rows["3e-04"]["sigma_m"]
    assert all(0 < row["error_m"] < 1 for row in rows.values())


def test_one_node_a_stance_is_what_it_says(demo):
    parameters = real_walks.ABLATION["one node a stance"]
    assert len(place_nodes(demo.recording, demo.stances, parameters)) == len(demo.stances)
    assert len(place_nodes(demo.recording, demo.stances, SmootherParameters())) > len(demo.stances)


def test_missing_recordings_are_one_sentence(tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        harness.run(lambda: real_walks.main(["--data", str(tmp_path / "nowhere")]))
    assert left.value.code == 1
    [line] = capsys.readouterr().err.splitlines()
    assert "nowhere" in line
    assert "--data" in line


@pytest.mark.parametrize(
    "load", [walks.read_vicon_labelled, walks.read_vicon_detected, walks.read_gdin, walks.read_loops]
)
def test_an_empty_folder_is_refused(tmp_path, load):
    with pytest.raises(FormatError):
        load(tmp_path)


def test_data_folder_is_the_option_then_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("FG_NAV_DATA", str(tmp_path))
    assert walks.data_folder(None) == tmp_path
    assert walks.data_folder(SCRIPTS) == SCRIPTS


@needs_data
def test_loops_are_printed_and_written(tmp_path, capsys):
    real_walks.main(["--data", str(DATA), "--only", "loops", "--json", str(tmp_path / "f.json")])
    written = json.loads((tmp_path / "f.json").read_text())
    assert [row["walk"] for row in written["walks"][::2]] == list(walks.LOOPS)
    percent = [row["closure_percent"] for row in written["walks"] if row["method"] == "smoother"]
    median = next(f for f in written["figures"] if f["name"] == "closure (%), median")
    assert median["measured"] == pytest.approx(np.median(percent), rel=5e-5)  # walks are written with five digits
    out = capsys.readouterr().out
    assert "openshoe 13" in out
    assert "figures are as asked" in out


@needs_data
def test_closed_walks_are_prepared_as_a_run_does():
    [walk] = walks.read_recorded(DATA, ["mti1_loops/hallway_walk_trial2"])
    assert len(walk.recording) == 3565  # a header, and a row that is no sample
    assert any("accelerometer bias" in note for note in walk.recording.provenance.notes)
    [row] = real_walks.run_methods(real_walks.ROUND, [walk], {"smoother": real_walks.smooth})
    assert row.value("ground_m") < 0.5
    assert row.as_dict()["z_m"] == pytest.approx(row.value("z_m"), rel=1e-3)
    found = by_name(judge(real_walks.ROUND, [row]))
    assert found["z over sigma, rms"].measured == abs(row.value("z_ratio"))


@needs_data
def test_a_barometer_is_read_beside_its_recording():
    [plain], [aided] = (walks.read_recorded(DATA, ["mtig710/2022_1_13_straight_run*"], air) for air in (False, True))
    assert plain.recording.pressure is None
    assert plain.recording.mag is None
    assert len(aided.recording.pressure) == len(plain.recording)


def test_passes_of_a_corridor_and_a_staircase_are_compared():
    ends = {"1_13_straight_a": (100.0, 0.1), "1_13_straight_b": (101.0, 0.0), "1_14_stair_up": (9.0, 3.0)}
    ends["1_14_stair_down"] = (9.0, -3.2)
    [blank] = results(rmse_2d_m=[None])
    rows = [replace(blank, walk=walk, end={"ground_m": d, "z_m": z}) for walk, (d, z) in ends.items()]
    found = by_name(real_walks.judge_passes(real_walks.MTIG + real_walks.AIR, rows))
    assert found["2 passes of a corridor, apart (%)"].measured == pytest.approx(100 / 100.5)
    assert found["stairs up and down, apart (m)"].measured == pytest.approx(0.2)
    assert found["stairs up and down, apart (m)"].mark == "missed"


def test_what_was_not_measured_anew_stays_in_the_file(tmp_path):
    old = {"made": {"corridor": "a day", "ablation": "a day"}, "figures": [], "ablation": [{"smoother": "default"}]}
    old["walks"] = [{"section": "corridor", "walk": "x"}, {"section": "mems", "walk": "y"}]
    harness.write_json(tmp_path / "f.json", old)
    measured = {"figures": [], "walks": [{"section": "mems", "walk": "z"}], "magnetometer": [], "ablation": []}
    content = real_walks.keep_others(tmp_path / "f.json", measured)
    assert [row["walk"] for row in content["walks"]] == ["x", "z"]
    assert content["ablation"] == old["ablation"]
    assert content["made"]["corridor"] == "a day"
    assert content["made"]["mems"] != "a day"


@needs_data
def test_vicon_trials_are_measured_with_labels_and_with_our_own_stances(capsys, monkeypatch):
    trials = sorted((DATA / "vicon").glob("*.mat"))[:2]
    monkeypatch.setattr(walks, "_vicon_paths", lambda data: trials)
    rows, found = real_walks.measure_sets(DATA, ["vicon"], per_walk=True)
    ours, stored = ([row for row in rows if (row.method == "stored") == kept] for kept in (False, True))
    assert len(ours) == 2 * 2 * 2
    assert len({row.section for row in rows}) == 2
    assert all(row.value("rmse_2d_m") < 0.3 for row in ours)
    assert [row.value("armse_m") for row in stored] == [0.032, 0.027]
    assert all(row.value("armse_m") < 0.2 for row in ours)
    assert trials[1].stem in capsys.readouterr().out
    assert all(np.isfinite(figure.measured) for figure in found)


@needs_data
def test_the_magnetometer_is_taken_off():
    [walk] = walks.read_gdin(DATA, [36])
    assert walk.recording.mag is None
    assert walk.recording.truth is not None


@pytest.fixture(scope="module")
def three_rounds():
    return long_walk(2.5, 5)


def test_rounds_of_a_long_walk_join_at_rest(three_rounds):
    """Where one round ends and the next begins the sensor stands: no jump, and the same bias on either side."""
    assert len(three_rounds) == 30000
    position = three_rounds.truth.position
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert step.max() < 0.05  # a foot at 10 m/s
    home = np.flatnonzero((np.linalg.norm(position[1:], axis=1) < 0.3) & (step < 1e-5))
    later = [part for part in np.split(home, np.flatnonzero(np.diff(home) > 200) + 1) if part[0] > 2000]
    assert [len(part) for part in later] == pytest.approx([2000, 2000], abs=120)  # 10 s, twice
    bias = three_rounds.gyr[:500].mean(axis=0)
    for part in later:
        middle = part[100:-100]
        strength = np.linalg.norm(three_rounds.acc[middle], axis=1)
        assert strength.mean() == pytest.approx(GRAVITY_M_S2, abs=0.1)
        assert np.abs(strength - strength.mean()).max() < 0.2
        assert three_rounds.gyr[middle].mean(axis=0) == pytest.approx(bias, abs=3e-4)


def test_a_long_walk_is_one_walk(three_rounds):
    walk = walks.Walk("long", three_rounds, detect_stances(three_rounds))
    [row] = real_walks.run_methods("s", [walk], {"smoother": real_walks.smooth})
    assert row.value("strides_detected") == pytest.approx(2.2 * 61, abs=3)
    assert row.value("rmse_2d_m") < 0.5
    assert row.value("scale") == pytest.approx(1.0, abs=0.01)


def test_a_long_walk_comes_from_its_seed():
    first, second, other = (long_walk(0.2, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.acc, second.acc)
    assert not np.array_equal(first.acc, other.acc)
