"""The comparison of methods: what is kept and joined, what is printed beside the papers, and that it runs."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EstimationError, OutputError, SimulationError
from fg_nav.lab.campaign import execute
from fg_nav.lab.campaign.methods import method_of, solve_by
from fg_nav.lab.campaign.walks import Simulated
from fg_nav.lab.store import code
from fg_nav.lab.store.results import Key, Result, read_result, write_result
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, WalkErrors
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

script = load_script("compare_ekf")

KEY = Key("mall", "indoor", "101", "loop", "ma2018")
SETTINGS = {"method": {"sigma": 0.1, "names": ["a", "b"]}, "walk": None}


def result(key=KEY, end_m=3.0, at_landmarks=(1.0, 2.0), failed="", heading_deg=-5.0):
    """Stand in for a method's walk of 100 m."""
    errors = WalkErrors(AS_STARTED, 100.0, end_m, -0.2, heading_deg, 0.5 * end_m, 2 * end_m)
    errors = replace(errors, rmse_m=0.7 * end_m, heading_laid_deg=-4.0, heading_rmse_deg=2.0, scale_percent=0.2)
    path = [[0.0, 0.0], [0.0, 50.0], [end_m, 100.0]]
    blank = Result(key, SETTINGS, "code", failed)
    if failed:
        return blank
    return replace(
        blank,
        errors={AS_STARTED: errors, BEST_YAW: replace(errors, alignment=BEST_YAW)},
        landmark=("A", "B"),
        landmark_m={AS_STARTED: list(at_landmarks), BEST_YAW: [0.5, 0.5]},
        estimate={AS_STARTED: path, BEST_YAW: path},
        truth=[[0.0, 0.0], [0.0, 50.0], [0.0, 100.0]],
        used="u-u",
        samples=1000,
        runtime_s=0.004,
    )


def rows_of(printed, begins):
    return [line for line in printed.splitlines() if line.startswith(begins)]


def test_a_result_is_read_back_as_it_was_kept(tmp_path):
    write_result(tmp_path, result())
    found = read_result(tmp_path, KEY, SETTINGS)
    assert found.errors == result().errors
    assert (found.key, found.landmark_m, found.us_per_sample) == (KEY, result().landmark_m, 4.0)
    track = script.track_of(found, BEST_YAW)
    np.testing.assert_array_equal(track.used, [True, False, True])
    np.testing.assert_allclose(track.error_m, [0.0, 0.0, 3.0])
    assert [path.name for path in tmp_path.iterdir()] == [KEY.file]


@needs_data
def test_no_two_results_share_a_file(tmp_path):
    given = ["--seeds", "3", "--real", "gdin", "openshoe", "--magnetometer", *script.MAGNETOMETERS]
    keys = script.list_keys(script.parse(["--out", str(tmp_path), *given]))
    assert len({key.file for key in keys}) == len(keys) == len(set(keys))
    real = {key.magnetometer for key in keys if key.group == "gdin"}
    assert real == {"walk", "raw", "none"}


def test_medians_stand_over_the_paper_and_the_reduction_is_walk_by_walk(capsys):
    theirs = [result(replace(KEY, method="iqsf", walk=w), at_landmarks=e) for w, e in (("1", (9, 11)), ("2", (30, 50)))]
    ours = [result(replace(KEY, walk=w), at_landmarks=e) for w, e in (("1", (1, 2)), ("2", (10, 10)))]
    script.print_case("mall", {"iqsf": theirs, "ma2018": ours})
    printed = capsys.readouterr().out
    assert "against iqsf, each preset against its own" in printed
    landmarks = printed[printed.index("At the landmarks") :].partition("Error over")[0]
    [row] = rows_of(landmarks, "ma2018")
    # means 1.5 and 10 against 10 and 40: 85 and 75 percent
    assert row.split()[:2] == ["ma2018", "5.75"]
    assert row.split()[-4:] == ["80.0", "(75.5", "to", "84.5)"]
    [paper] = rows_of(landmarks, "  Ma 2018, proposed")
    assert paper.split()[-2:] == ["1.5", "85"]
    assert rows_of(landmarks, "  Ma 2018, iQSF")[0].split()[-1] == "11.3"


def test_a_preset_is_compared_with_the_same_of_the_reference():
    def one(method, error):
        return [result(replace(KEY, method=method), at_landmarks=(error, error))]

    case = {"iqsf": one("iqsf", 8.0), "iqsf:physical": one("iqsf:physical", 4.0)}
    case |= {name: one(name, 2.0) for name in ("ma2018", "ma2018:physical", "ma2018:as-printed")}
    heads, rows = script.make_table(script.TABLES["At the landmarks"], case, "mall", "iqsf")
    found = {row[0]: row[heads.index(script.REDUCED)] for row in rows}
    assert (found["ma2018"], found["ma2018:physical"], found["ma2018:as-printed"]) == ("75.0", "50.0", "75.0")


def test_errors_with_a_sign_count_by_their_size(capsys):
    two = [result(replace(KEY, walk=w), heading_deg=d) for w, d in (("1", -10.0), ("2", 10.0))]
    script.print_case("case", {"ma2018": two})
    [row] = rows_of(capsys.readouterr().out.split("Along")[0], "ma2018")
    assert "10.0 (10.0 to 10.0)" in row


def test_a_failed_walk_is_infinitely_wrong_and_told(capsys):
    some = [result(replace(KEY, walk=str(k)), end_m=1.0) for k in range(3)]
    some += [result(replace(KEY, walk=str(k)), failed="no such walk.") for k in range(3, 5)]
    script.print_case("case", {"ma2018": some})
    script.print_remarks(some)
    printed = capsys.readouterr().out
    assert "1.00 (1.00 to failed)" in printed
    assert "failed: mall, 3, ma2018: no such walk." in printed
    assert "3 of 5" not in printed
    assert "5 of 5 results were made by other code (ma2018)" in printed


def test_a_failed_walk_reduces_nothing(capsys):
    """Of three walks two are halved, and one fails: the median is one half, the least a failure."""
    theirs = [result(replace(KEY, method="iqsf", walk=w), at_landmarks=(10.0, 10.0)) for w in "123"]
    ours = [result(replace(KEY, walk=w), at_landmarks=(5.0, 5.0)) for w in "12"]
    ours.append(result(replace(KEY, walk="3"), failed="no such walk."))
    script.print_case("mall", {"iqsf": theirs, "ma2018": ours})
    landmarks = capsys.readouterr().out.partition("At the landmarks")[2]
    assert rows_of(landmarks, "ma2018")[0].endswith("50.0 (failed to 50.0)")


def test_the_sum_over_the_code_sees_what_runs_and_nothing_else():
    one = code.strip_source('"""Page."""\nA = 1\n"""Of it."""\ndef f(x):\n    """Say."""\n    return x + A  # why\n')
    assert one == code.strip_source("A=1\ndef f(x): return (x + A)\n")
    assert one != code.strip_source("A=1\ndef f(x): return (x - A)\n")


def test_what_cannot_be_is_said_before_anything_is_simulated(tmp_path):
    with pytest.raises(EstimationError, match="no method 'magic'"):
        script.main(["--out", str(tmp_path), "--methods", "magic"])
    with pytest.raises(SimulationError, match="no field 'rough'"):
        script.main(["--out", str(tmp_path), "--fields", "rough"])
    with pytest.raises(OutputError, match="make it, and name it"):
        script.main(["--out", str(tmp_path / "nowhere")])


def test_it_runs_joins_and_skips(tmp_path, capsys, monkeypatch):
    demo = ["--out", str(tmp_path), "--scenarios", "demo", "--fields", "smooth", "--seeds", "1", "--jobs", "1"]
    with monkeypatch.context() as without_pictures:
        without_pictures.setattr(script, "draw_case", lambda *_: None)
        script.main([*demo, "--methods", "iez"])
    first = tmp_path / "demo_smooth_loop_iez_101.json"
    stamp = first.stat().st_mtime_ns
    asked = []
    monkeypatch.setattr(script, "run_here", noted(asked))
    script.main([*demo, "--methods", "iez", "qsf", "--magnetometer", "loop", "perfect"])
    [task] = asked
    made = sorted((key.magnetometer, key.method) for key in task.settings)
    assert made == [("loop", "qsf"), ("perfect", "iez"), ("perfect", "qsf")]
    assert first.stat().st_mtime_ns == stamp
    printed = capsys.readouterr().out
    assert "demo, smooth, magnetometer perfect: 1 walk," in printed
    assert len(list(tmp_path.glob("*.png"))) == 6
    # All iron off changes nothing for who has no compass; and the walk is what it says it is.
    loop, perfect = (json.loads((tmp_path / f"demo_smooth_{m}_iez_101.json").read_text()) for m in ("loop", "perfect"))
    assert loop["errors"] == perfect["errors"]
    assert 60.0 < loop["errors"]["origin"]["distance_m"] < 90.0
    assert loop["errors"]["origin"]["max_m"] < 1.0  # in the sixties of metres: given the true heading at the start
    monkeypatch.setattr(script, "draw_case", lambda *_: None)
    # Other code is joined, unless that is not wanted.
    for one in (script, execute):
        monkeypatch.setattr(one, "code_sum", lambda: "other code")
    script.main([*demo, "--methods", "iez"])
    assert "1 of 1 results were made by other code (iez)" in capsys.readouterr().out
    assert first.stat().st_mtime_ns == stamp
    for _ in range(2):
        script.main([*demo, "--methods", "iez", "--renew"])
    assert "other code" not in capsys.readouterr().out
    assert len(asked) == 2  # what the new code made holds
    # Other parameters make it again.
    monkeypatch.setattr(execute, "parameters_of", lambda method: {"other": method})
    script.main([*demo, "--methods", "iez"])
    assert len(asked) == 3


def noted(asked):
    """Make walks as ever, and note what was asked for."""
    run = script.run_here

    def run_here(tasks, workers):
        asked.extend(tasks)
        return run(tasks, workers)

    return run_here


@needs_data
def test_real_walks_have_the_best_yaw_or_their_closure(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(script, "REAL_WALKS", {"gdin": ("31",), "openshoe": ("7",)})
    given = ["--scenarios", "--real", "gdin", "openshoe", "--data", str(DATA), "--out", str(tmp_path), "--jobs", "1"]
    script.main([*given, "--methods", "iez", "--magnetometer", "raw"])
    printed = capsys.readouterr().out
    assert "gdin, real, magnetometer raw" in printed
    gdin = json.loads((tmp_path / "gdin_real_raw_iez_31.json").read_text())
    assert set(gdin["errors"]) == {"yaw"}
    assert gdin["errors"]["yaw"]["mean_m"] < 1.0
    openshoe = json.loads((tmp_path / "openshoe_real_raw_iez_7.json").read_text())
    assert set(openshoe["errors"]) == {"closure"}


def test_a_preset_goes_with_the_method():
    walk = replace(Simulated("demo", "smooth", 101).prepare("raw"), truth=None)
    tuned, printed = (solve_by(name, walk).solution for name in ("iez", "iez:as-printed"))
    assert tuned.parameters != printed.parameters
    assert execute.parameters_of("iez") != execute.parameters_of("iez:as-printed")
    with pytest.raises(EstimationError, match="no preset 'magic'"):
        method_of("iez:magic")


def smoothers(group, level, **errors):
    """Three walks of the smoother, and of the filters that it is held against."""
    sizes = {"smoother": 1.0, "ma2018": 4.0, "matched": 2.0, "matched-rts": 1.6, **errors}
    return {
        method: [
            result(
                replace(KEY, group=group, field=level, method=method, walk=str(k)),
                end_m=k * size,
                at_landmarks=(0.5 * k * size, 1.5 * k * size),
            )
            for k in (1, 2, 3)
        ]
        for method, size in sizes.items()
    }


def test_errors_over_those_of_others_are_printed_walk_by_walk(capsys):
    script.print_case("office, smooth", smoothers("office", "smooth"))
    ratios = capsys.readouterr().out.partition("Error over that of others")[2]
    assert rows_of(ratios, "smoother")[0].split()[1] == "0.25"
    assert "over ma2018" in ratios
    assert "over inertial" not in ratios


def straight(method, sideways_m, used):
    truth = np.column_stack([np.zeros(11), np.arange(11.0)])
    return script.Track(method, truth + np.linspace(0, 1, 11)[:, None] * [sideways_m, 0.0], np.asarray(used), truth)


def test_errors_are_drawn_over_the_distance_truly_walked():
    tracks = {"a": [straight("a", e, np.ones(11, dtype=bool)) for e in (1.0, 2.0, 3.0)]}
    [axes] = script.plot_error_over_distance(tracks, "title").axes
    [line] = axes.lines
    np.testing.assert_allclose(line.get_xdata()[[0, -1]], [0.0, 10.0])
    np.testing.assert_allclose(line.get_ydata(), 0.2 * np.asarray(line.get_xdata()))


def test_methods_with_the_same_colour_have_other_dashes():
    walks = {name: [straight(name, 1.0, np.ones(11, dtype=bool))] for name in "abcdefghi"}
    [axes] = script.plot_error_over_distance(walks, "title").axes
    looks = {(line.get_color(), line.get_linestyle()) for line in axes.lines}
    assert len(looks) == len(walks)


def test_the_detection_map_shows_which_footfalls_were_used_where_they_truly_were():
    used = np.arange(11) % 2 == 0
    figure = script.plot_detection_maps([straight("a", 5.0, used), straight("b", 5.0, ~used)], "title")
    first, second = figure.axes
    assert (first.get_title("left"), second.get_title("left")) == ("a: 55 % used", "b: 45 % used")
    yes = next(line for line in first.lines if line.get_label() == "used")
    np.testing.assert_allclose(yes.get_xydata(), np.column_stack([np.zeros(6), np.arange(0.0, 11.0, 2.0)]))


def test_paths_have_a_panel_a_method():
    tracks = [straight(name, 1.0, np.ones(11, dtype=bool)) for name in "abcd"]
    figure = script.plot_paths(tracks, "title")
    assert [axes.get_title("left") for axes in figure.axes] == ["a", "b", "c", "d", "", ""]
