"""The scripts that measure the smoother with its magnetic field: what they count, and that they run."""

import importlib
import json
import math
import sys
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fg_nav.errors import OutputError
from fg_nav.evaluation.walked import AS_STARTED, WalkErrors
from fg_nav.lab.campaign import kept
from fg_nav.recording import Recording, TrajectoryTruth
from tests.real_data import DATA, needs_data

SCRIPTS = Path(__file__).parents[1] / "scripts"
sys.path.insert(0, str(SCRIPTS))  # a script finds its neighbours by the folder it was started in
compare = importlib.import_module("compare_ekf")
ablation = importlib.import_module("magnetic_ablation")
bias = importlib.import_module("bias_convergence")
consistency = importlib.import_module("smoother_consistency")
corridor = importlib.import_module("magnet_corridor")
cost = importlib.import_module("magnetic_cost")
real = importlib.import_module("real_walks")


class Here:
    """A pool of processes that works at once, in this one."""

    def __init__(self, _):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def map(self, work, *some):
        return map(work, *some)

    def submit(self, work, *given):
        done = Future()
        done.set_result(work(*given))
        return done


def result(method="smoother", walk="1", rmse_m=1.0, runtime_s=1.0, whitened=None, used="uu--", failed=""):
    """Stand in for a walk of one method."""
    key = kept.Key("office", "smooth", walk, "loop", method)
    if failed:
        return kept.Result(key, {}, "code", failed)
    errors = WalkErrors(AS_STARTED, 100.0, rmse_m, mean_m=rmse_m, max_m=rmse_m, rmse_m=rmse_m, heading_rmse_deg=1.0)
    return kept.Result(
        key, {}, "code", errors={AS_STARTED: errors}, whitened=whitened or {}, used=used, runtime_s=runtime_s
    )


# --- ablation --------------------------------------------------------------------------------------------------------


def test_each_switch_is_turned_once_from_the_default_and_once_from_nothing():
    for name in ablation.switches():
        on = getattr(ablation.DEFAULT.magnetic, name)
        turned = ablation.VARIANTS[f"{'without' if on else 'with'} {name}"].parameters.magnetic
        assert turned == replace(ablation.DEFAULT.magnetic, **{name: not on})
        alone = ablation.VARIANTS[f"only {name}"].parameters.magnetic
        assert [other for other in ablation.switches() if getattr(alone, other)] == [name]
    assert len(ablation.switches()) >= 2
    assert not ablation.VARIANTS["inertial"].field


def test_no_two_variants_are_the_same_but_for_their_name():
    told = [ablation.differing(variant) for variant in ablation.VARIANTS.values()]
    assert told[0] == "as it comes"
    twins = {words for words in told if told.count(words) > 1}
    assert all(words.count(" ") <= 3 for words in twins)  # with two switches, without the one is only the other
    files = {kept.Key("office", "smooth", "1", "loop", name).file for name in ablation.VARIANTS}
    assert len(files) == len(ablation.VARIANTS)


def test_an_ablation_counts_walk_by_walk():
    case = {
        "default": [result(walk="1", rmse_m=1.0, runtime_s=3.0), result(walk="2", rmse_m=4.0, runtime_s=8.0)],
        "inertial": [result(walk="1", rmse_m=2.0, runtime_s=2.0), result(walk="2", rmse_m=2.0, runtime_s=4.0)],
        "broken": [result(walk="1", rmse_m=1.0), result(walk="2", failed="no such walk.")],
    }
    assert ablation.over_default(case, "inertial") == pytest.approx(1.0)  # twice, and half
    assert ablation.over_default(case, "broken") == math.inf
    assert ablation.cost_ratio(case, "default") == pytest.approx(1.75)
    assert ablation.used_share(case["default"]) == 0.5
    heads, rows = ablation.table(case)
    assert heads[1] == "rmse (m)"  # there are no landmarks
    assert "failed" in rows[2][1]
    assert [row[0] for row in ablation.summary({"case": case})][-1] == "broken"


def test_the_nees_of_an_ablation_is_over_its_expectation_at_the_last_footfall():
    apart = {"position": [[9.0, 9.0, 9.0], [1.0, 1.0, 1.0]], "heading": [[9.0], [1.0]]}
    assert ablation.nees_ratio([result(whitened=apart)]) == pytest.approx(1.0)
    joint = {**apart, "pose": [[9.0] * 4, [2.0] * 4]}
    assert ablation.nees_ratio([result(whitened=joint), result(whitened=joint)]) == pytest.approx(4.0)
    assert math.isnan(ablation.nees_ratio([result()]))


def test_an_ablation_runs_keeps_and_takes_up_again(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(ablation, "ProcessPoolExecutor", Here)
    given = [
        "--out",
        str(tmp_path),
        "--scenarios",
        "demo",
        "--fields",
        "smooth",
        "--seeds",
        "1",
        "--variants",
        "default",
    ]
    ablation.main(given)
    printed = capsys.readouterr().out
    assert "demo, smooth, magnetometer loop" in printed
    default, bare = (json.loads((tmp_path / f"demo_smooth_loop_{n}_1.json").read_text()) for n in ablation.VARIED)
    assert default["used"].count("u") > 20
    assert "u" not in bare["used"]
    assert default["errors"]["origin"]["rmse_m"] != bare["errors"]["origin"]["rmse_m"]
    assert len(default["whitened"]["position"]) == 4
    monkeypatch.setattr(ablation, "made", None)  # nothing is left to be made
    ablation.main(given)
    with pytest.raises(OutputError, match="make it"):
        ablation.main(["--out", str(tmp_path / "nowhere")])
    ablation.main(["--list"])
    assert "inertial: the field is not given" in capsys.readouterr().out


# --- consistency -----------------------------------------------------------------------------------------------------


def drawn(count, factor=1.0, joint=True):
    """Walks whose errors are so many claimed sigmas, the four footfalls independent."""
    rng = np.random.default_rng(7)
    parts = {part: n for part, n in consistency.PARTS.items() if joint or part not in ("pose", "ground")}
    return [
        result(
            walk=str(k), whitened={part: (factor * rng.standard_normal((4, n))).tolist() for part, n in parts.items()}
        )
        for k in range(count)
    ]


def test_honest_walks_are_within_the_band_and_sure_ones_are_not():
    honest, sure = (consistency.judged("case", drawn(200, factor)) for factor in (1.0, 2.5))
    assert [figure.mark for figure in honest] == ["ok", "ok"]
    assert honest[0].measured == pytest.approx(0.95, abs=0.04)
    assert [figure.mark for figure in sure] == ["short", "short"]
    heads, [row] = consistency.ratio_table({"case": drawn(200, 2.5)})
    assert float(row[heads.index("heading")]) == pytest.approx(2.5, rel=0.1)


def test_without_cross_terms_the_lesser_share_of_the_parts_counts():
    walks = drawn(200, joint=False)
    walks = [
        replace(w, whitened={**w.whitened, "heading": (3 * np.array(w.whitened["heading"])).tolist()}) for w in walks
    ]
    end, _ = consistency.judged("case", walks)
    assert end.name.startswith("position and heading")
    assert end.mark == "short"
    assert consistency.share_table({"case": walks})[1][0][1] == "-"


def test_a_failed_walk_is_outside_the_band():
    failed = [result(walk=str(k), failed="no such walk.") for k in range(50, 100)]
    end, _ = consistency.judged("case", [*drawn(50), *failed])
    assert end.measured == pytest.approx(0.475, abs=0.05)


def test_consistency_runs_on_results_that_compare_ekf_keeps(tmp_path, capsys):
    given = ["--out", str(tmp_path), "--scenarios", "demo", "--fields", "homogeneous", "--seeds", "1", "--jobs", "1"]
    consistency.main([*given, "--magnetometer", "perfect"])
    assert "demo, homogeneous, smoother" in capsys.readouterr().out
    found = json.loads((tmp_path / "demo_homogeneous_perfect_smoother_101.json").read_text())["whitened"]
    assert np.array(found["heading"]).shape == (4, 1)


# --- gyro bias -------------------------------------------------------------------------------------------------------


def test_a_bias_has_settled_when_it_stays():
    steps = len(bias.WALKED_S)
    error = np.full(steps, 0.01)
    assert bias.Found(error, error).settled_s == 0.0
    error[4] = -0.03
    assert bias.Found(error, error).settled_s == bias.WALKED_S[5]
    error[-1] = np.nan
    assert bias.Found(error, error).settled_s == math.inf


def test_the_error_of_a_bias_is_that_about_up():
    t = np.arange(20) / 10.0
    on_its_side = np.tile(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), (20, 1, 1))  # the body's y axis is up
    truth = TrajectoryTruth(t, np.zeros((20, 3)), on_its_side)
    part = Recording(
        t=t, acc=np.tile([0.0, 9.8, 0.0], (20, 1)), gyr=np.zeros((20, 3)), mag=np.ones((20, 3)), truth=truth
    )
    walk = SimpleNamespace(biases=SimpleNamespace(t=t, gyr=np.tile([0.0, 0.01, 0.0], (20, 1))))

    def estimate(*_):
        table = SimpleNamespace(
            t=t[-1:], sample=[19], gyro_bias=np.array([[5.0, 0.03, 5.0]]), gyro_bias_sigma=np.array([[1.0, 0.1, 1.0]])
        )
        return SimpleNamespace(stances=table)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(bias, "detect_stances", lambda _: None)
        patched.setattr(bias, "footfall_field", lambda *_: None)
        error, sigma = bias.error_at_end(walk, part, estimate)
    assert (error, sigma) == (pytest.approx(math.degrees(0.02)), pytest.approx(math.degrees(0.1)))


def test_what_a_gait_adds_is_the_mean_turn_about_up_by_scale_and_axes():
    """A body with y up that turns about up, then not: 1 % of the rate, for half of the time since the first stride."""
    t = np.arange(41) / 10.0
    on_its_side = np.tile(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), (41, 1, 1))
    truth = TrajectoryTruth(t, np.zeros((41, 3)), on_its_side)
    gyr = np.outer((t >= 1.95) & (t < 2.95), [0.3, 0.5, 0.0])
    part = Recording(t=t, acc=np.tile([0.0, 9.8, 0.0], (41, 1)), gyr=gyr, truth=truth)
    walk = SimpleNamespace(drawn={"sensor": {"gyr_matrix": [[1.5, 0, 0], [0.02, 1.01, 0], [0, 0, 1.5]]}})
    expected = math.degrees(0.5 * (0.02 * 0.3 + 0.01 * 0.5))
    assert bias.added_by_gait(walk, part, 1.95) == pytest.approx(expected, rel=0.03)
    assert bias.added_by_gait(walk, part, 4.5) == 0.0


def test_nobody_is_told_of_rests_and_the_sensor_is_off_by_what_is_said():
    prior = bias.wrong_scenario().prior
    assert (prior.gyr.bias[2], prior.mag.noise_sd_uT) == (pytest.approx(math.radians(0.3)), 0.5)
    walk = bias.simulate(bias.wrong_scenario(), 5)
    part = bias.up_to(walk.recording, float(walk.strides.start[0]) + 10.0)
    assert not bias.NO_RESTS.shortest_s < part.t[-1]
    stances = bias.detect_stances(part)
    solution = bias.smooth(part, stances, bias.SMOOTHER)
    assert "there is no rest in it" in " ".join(solution.notes)


def test_bias_convergence_runs(capsys, monkeypatch):
    monkeypatch.setattr(bias, "ProcessPoolExecutor", Here)
    monkeypatch.setattr(bias, "WALKED_S", (10.0, bias.ASKED_S))
    bias.main(["--seeds", "1", "--first", "1"])
    printed = capsys.readouterr().out
    assert [name for name in bias.METHODS if f"\n{name} " in printed] == list(bias.METHODS)


# --- magnet, cost, real walks ----------------------------------------------------------------------------------------


def test_a_step_is_the_largest_change_between_footfalls_the_short_way_round():
    error = np.radians([170.0, 179.0, -178.0, -170.0])
    assert corridor.largest_step_deg(error) == pytest.approx(9.0)


def test_steps_are_judged_on_every_walk():
    walks = [corridor.Stepped(0.5, 0.1, 1.0, 1.0), corridor.Stepped(1.5, 0.2, 1.0, 0.7)]
    assert [f.mark for f in corridor.step_figures("magnet", walks)] == ["short", "ok", "short"]


def test_steps_beside_a_magnet_on_one_walk(capsys, monkeypatch):
    monkeypatch.setattr(corridor, "ProcessPoolExecutor", Here)
    monkeypatch.setattr(corridor, "METHODS", ("iez", "inertial", "smoother"))
    corridor.main(["--seeds", "1", "--steps"])
    printed = capsys.readouterr().out
    assert printed.count("far used, least of any walk") >= 2
    [weak, strong] = [line.split() for line in printed.splitlines() if line.startswith("iez")]
    assert weak == strong  # who does not look at the field does not see the magnet


def test_the_cost_is_a_ratio_within_a_repeat(capsys):
    time = cost.Time
    repeats = [
        [cost.Cost(time(s, s), time(1.2 * s, 1.3 * s), time(0.1, 0.1)) for s in (k, 2 * k, 4 * k)] for k in (1, 5)
    ]
    minute = np.rec.fromarrays([[0.0, 60.0]], names="t")
    figures = cost.print_costs("walk", [minute] * 3, repeats)
    assert [f.measured for f in figures if "with/without" in f.name] == pytest.approx([1.3] * 3)
    assert [f.measured for f in figures if "doubling" in f.name] == pytest.approx([2.0] * 4)
    capsys.readouterr()


def test_the_cost_of_a_short_walk(capsys):
    cost.main(["--repeats", "1", "--fields", "smooth", "--scenario", "demo"])
    assert "demo, smooth: medians over 1 repeats" in capsys.readouterr().out


def test_no_walk_may_be_worse_with_the_magnetometer():
    pairs = [
        real.Pair("gdin 1", 0.4, {"raw": 0.2, "walk": 0.42}, True),
        real.Pair("gdin 2", 0.4, {"raw": 0.6, "walk": 0.44}, True),
    ]
    marks = {iron: [f.mark for f in real.pair_figures("gdin", pairs, iron)] for iron in ("raw", "walk")}
    assert marks == {"raw": ["ok", "short"], "walk": ["ok", "ok"]}
    failed = [real.Pair("gdin 1", 0.4, {"raw": math.inf, "walk": 0.4}, False)]
    assert [f.mark for f in real.pair_figures("gdin", failed, "raw")] == ["short", "short"]


@needs_data
def test_a_real_walk_with_and_without_the_magnetometer(capsys):
    figures = real.measure_magnetic(DATA, {"gdin": ("31",), "openshoe": ("7",)})
    printed = capsys.readouterr().out
    assert "gdin 31" in printed
    assert "openshoe 7" in printed
    assert all(math.isfinite(figure.measured) for figure in figures)
