"""The scripts that measure the smoother with its magnetic field: what they count, and that they run."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.errors import OutputError
from fg_nav.lab.store.results import Key, Result
from fg_nav.lab.walked import AS_STARTED, WalkErrors
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

compare = load_script("compare_ekf")
ablation = load_script("magnetic_ablation")
honest = load_script("consistency")
walks = ablation.magnetic_walks
real = load_script("real_fields")


@pytest.fixture
def short_course(monkeypatch):
    """Make the shortest course shorter."""
    monkeypatch.setitem(walks.COURSES, "140 m", walks.make_round(walks.SMALL, 50.0))


def result(method="smoother", walk="1", rmse_m=1.0, runtime_s=1.0, whitened=None, used="uu--", failed=""):
    """Stand in for a walk of one method."""
    key = Key("office", "smooth", walk, "loop", method)
    if failed:
        return Result(key, {}, "code", failed)
    errors = WalkErrors(AS_STARTED, 100.0, rmse_m, mean_m=rmse_m, max_m=rmse_m, rmse_m=rmse_m, heading_rmse_deg=1.0)
    return Result(key, {}, "code", errors={AS_STARTED: errors}, whitened=whitened or {}, used=used, runtime_s=runtime_s)


# --- ablation --------------------------------------------------------------------------------------------------------


def test_each_factor_is_left_out_once_and_each_gate_is_tried():
    magnetic = ablation.DEFAULT.magnetic
    assert len(ablation.list_factors()) >= 2
    for name in ablation.list_factors():
        assert ablation.VARIANTS[f"without {name}"].parameters.magnetic == replace(magnetic, **{name: False})
    gates = {one.parameters.magnetic.gate for one in ablation.VARIANTS.values()}
    assert gates == set(ablation.GATES)
    assert not ablation.VARIANTS["inertial"].field
    assert len({repr(one) for one in ablation.VARIANTS.values()}) == len(ablation.VARIANTS)


def test_an_ablation_counts_walk_by_walk():
    def walk(rmse, runtime):
        return {"rmse": rmse, "end": rmse, "heading": 1.0, "bias 30": 0.1, "runtime": runtime}

    results = {
        "inertial": [walk(2.0, 2.0), walk(2.0, 4.0)],
        "default": [walk(1.0, 3.0), walk(4.0, 8.0)],
        "broken": [walk(1.0, 3.0), {}],
    }
    assert ablation.compare_walks(results["default"], results["inertial"], "rmse") == (pytest.approx(1.0), 2.0)
    assert ablation.compare_walks(results["broken"], results["inertial"], "rmse") == (math.inf, math.inf)
    heads, rows = ablation.make_table(results)
    assert rows[1][heads.index("cost")] == "1.75"
    assert rows[1][heads.index("over inertial")] == "1.00"
    assert rows[1][heads.index("bias 60 s (deg/s)")] == "-"  # a walk that is too short has none
    assert "failed" in rows[2][1]


def test_an_ablation_runs_keeps_and_takes_up_again(tmp_path, capsys, monkeypatch, short_course):
    given = ["--out", str(tmp_path), "--courses", "140 m", "--fields", "smooth", "--seeds", "1", "--jobs", "1"]
    given += ["--variants", "default", "--no-real"]
    ablation.main(given)
    printed = capsys.readouterr().out
    assert "140 m, smooth, no rests: 1 walks" in printed
    assert len(list(tmp_path.glob("*.json"))) == 4  # two variants, with rests and without
    kept = json.loads((tmp_path / "140_m_smooth_no_rests_101_default.json").read_text())
    assert 0 < kept["figures"]["rmse"] < 5.0
    monkeypatch.setattr(ablation.magnetic_walks, "make_walk", None)  # nothing is left to be made
    ablation.main(given)
    assert capsys.readouterr().out == printed
    with pytest.raises(OutputError, match="make it"):
        ablation.main(["--out", str(tmp_path / "nowhere")])


def test_a_walk_through_cables_and_a_real_one_are_judged():
    bare, cables = (walks.Case("720 m", field, rests=False) for field in ("indoor", "cables"))
    results = {
        case: {
            "inertial": [{"rmse": 1.0, "runtime": 1.0}],
            "default": [{"rmse": rmse, "runtime": 1.4}],
        }
        for case, rmse in ((bare, 0.2), (cables, 0.3))
    }
    assert [f.mark for f in ablation.judge_simulated(results)] == ["ok", "missed", "ok"]
    inertial = [{"merit": 1.0, "spoiled": 1.0}, {"merit": 0.1, "spoiled": 1.0}]
    ours = [{"merit": 0.8, "spoiled": 0.4}, {"merit": 0.12, "spoiled": 0.4}]
    found = {"inertial": {"openshoe": inertial}, "default": {"openshoe": ours}}
    assert [f.mark for f in ablation.judge_real(found)] == ["ok", "ok", "ok"]
    worse = {"inertial": {"openshoe": inertial}, "default": {"openshoe": [ours[0], {"merit": 0.2, "spoiled": 1.0}]}}
    assert [f.mark for f in ablation.judge_real(worse)] == ["missed", "missed", "missed"]


@needs_data
def test_an_ablation_of_a_real_walk_as_it_is_and_spoiled(tmp_path):
    store = ablation.Store(tmp_path, "code")
    ablation.make_real(store, "openshoe", "7", DATA, ("inertial",))
    found = store.read("openshoe 7", "inertial")
    assert found is not None
    assert found["spoiled"] > found["merit"] > 0
    assert ablation.Store(tmp_path, "other code").read("openshoe 7", "inertial") is None


# --- walks for it ----------------------------------------------------------------------------------------------------


def test_the_potential_jumps_by_the_current_of_a_frame():
    """Ampere: the line integral of the field through a frame and back round it is mu_0 I."""
    frame = walks.make_frame(np.array([3.0, 2.0, 0.0]), np.array([3.0, 3.3, 0.0]))
    ways = [[3.0, -60.0, 0.1], [3.0, 60.0, 0.1], [90.0, 60.0, 0.1], [90.0, -60.0, 0.1], [3.0, -60.0, 0.1]]
    total = 0.0
    for start, end in pairwise(ways):
        share = (np.arange(20000)[:, None] + 0.5) / 20000
        step = (np.array(end) - start) / 20000
        total += float((frame.at(np.array(start) + share * (np.array(end) - start)) @ step).sum())
    assert abs(total) == pytest.approx(4 * np.pi * 0.1 * walks.CABLE_A, rel=1e-3)


def test_cables_change_the_magnetometer_alone(short_course):
    bare, cables = (
        walks.make_walk(walks.Case("140 m", field, rests=False), 3, walks.make_sensor())
        for field in ("indoor", "cables")
    )
    np.testing.assert_array_equal(bare.recording.gyr, cables.recording.gyr)
    added = np.linalg.norm(cables.recording.mag - bare.recording.mag, axis=1)
    assert np.median(added) < 2.0
    assert added.max() > 10.0


def test_the_bias_is_that_of_the_beginning(short_course):
    """A rest shows it; what comes after does not count."""
    walk = walks.make_walk(walks.Case("140 m", "homogeneous", rests=True), 3, walks.make_sensor())
    error, sigma = walks.measure_early_bias(walk, ablation.Variant().solve, 30.0)
    assert abs(error) < 0.05
    assert 0.001 < sigma < 0.05
    assert walks.prepare(walk, until_s=30.0).recording.t[-1] < 30.0


# --- honest sigmas ---------------------------------------------------------------------------------------------------


def test_true_sigmas_are_found_true_and_small_ones_are_not(capsys):
    rng = np.random.default_rng(5)
    conditions = [honest.Condition(bool(k % 2), True, 6e-4, 0.0, "indoor") for k in range(400)]
    parts = [{part: rng.standard_normal(n) for part, n in honest.PARTS.items()} for _ in conditions]
    marks = {f.mark for f in honest.judge_nees(conditions, parts)}
    assert marks == {"ok"}
    sure = [{part: 2 * z for part, z in one.items()} for one in parts]
    assert {f.mark for f in honest.judge_nees(conditions, sure)} == {"missed"}
    failed = [one if k % 10 > 2 else {} for k, one in enumerate(parts)]  # of every ten walks three
    assert {f.mark for f in honest.judge_nees(conditions, failed)} == {"missed"}
    assert "heading not given" in capsys.readouterr().out


def test_a_bias_is_judged_by_its_size_and_its_sigma():
    fields = ["homogeneous"] * 200
    rng = np.random.default_rng(5)
    true = [{"error": 0.01 * z, "sigma": 0.01} for z in rng.standard_normal(200)]
    assert [f.mark for f in honest.judge_bias(fields, true)] == ["ok", "ok"]
    large = [{"error": 5 * one["error"], "sigma": 0.05} for one in true]
    assert [f.mark for f in honest.judge_bias(fields, large)] == ["missed", "ok"]
    sure = [{**one, "sigma": 0.005} for one in true]
    assert [f.mark for f in honest.judge_bias(fields, sure)] == ["ok", "missed"]


def test_it_whitens_the_errors_of_a_walk_and_keeps_them(tmp_path, monkeypatch, short_course):
    what = honest.Condition(heading=True, rests=True, bias_walk_deg_s=6e-4, scale=0.0, field="smooth")
    found = honest.measure_kept(tmp_path, "code", "140 m", (what, 101))
    assert {part: len(z) for part, z in found.items()} == honest.PARTS
    assert np.abs(np.concatenate(list(found.values()))).max() < 6.0
    monkeypatch.setattr(honest, "measure_walk", None)
    assert honest.measure_kept(tmp_path, "code", "140 m", (what, 101)) == found


# --- consistency -----------------------------------------------------------------------------------------------------


def drawn(count, factor=1.0, joint=True):
    """Walks whose errors are so many claimed sigmas, the four footfalls independent."""
    rng = np.random.default_rng(7)
    parts = {part: n for part, n in compare.PARTS.items() if joint or part not in ("pose", "ground")}
    return [
        result(
            walk=str(k), whitened={part: (factor * rng.standard_normal((4, n))).tolist() for part, n in parts.items()}
        )
        for k in range(count)
    ]


def test_honest_walks_are_within_the_band_and_sure_ones_are_not():
    end, of_mean, above = compare.shares_inside(drawn(200), "pose")
    assert (end, of_mean, above) == pytest.approx((0.95, 0.95, 0.025), abs=0.04)
    end, of_mean, above = compare.shares_inside(drawn(200, 2.5), "pose")
    assert max(end, of_mean) < 0.6
    assert above > 0.4
    heads, [row] = compare.make_honesty_table({"smoother": drawn(200, 2.5)})
    assert float(row[heads.index("heading / sigma")]) == pytest.approx(2.5, rel=0.1)


def test_without_cross_terms_there_are_the_shares_of_the_parts():
    heads, [row] = compare.make_honesty_table({"smoother": drawn(200, joint=False)})
    assert row[heads.index("pose")] == "-"
    assert row[heads.index("position")].startswith("9")


def test_a_failed_walk_is_outside_the_band():
    failed = [result(walk=str(k), failed="no such walk.") for k in range(50, 100)]
    assert compare.shares_inside([*drawn(50), *failed], "pose")[0] == pytest.approx(0.475, abs=0.05)


# --- real walks ------------------------------------------------------------------------------------------------------


def test_no_walk_may_be_worse_with_the_magnetometer():
    pairs = [
        real.Pair("gdin", "1", 0.4, {"raw": 0.2, "walk": 0.42}, True),
        real.Pair("gdin", "2", 0.4, {"raw": 0.6, "walk": 0.44}, True),
    ]
    marks = {iron: [f.mark for f in real.judge_pairs("gdin", pairs, iron)] for iron in ("raw", "walk")}
    assert marks == {"raw": ["ok", "missed"], "walk": ["ok", "ok"]}
    failed = [real.Pair("gdin", "1", 0.4, {"raw": math.inf, "walk": 0.4}, False)]
    assert [f.mark for f in real.judge_pairs("gdin", failed, "raw")] == ["missed", "missed"]
    loops = [replace(pairs[0], group="openshoe")]
    assert "as recorded: closure, median (%)" in {f.name for f in real.judge_pairs("openshoe", loops, "raw")}


@needs_data
def test_a_real_walk_with_and_without_the_magnetometer(capsys):
    figures = real.print_pairs(real.measure_pairs(DATA, {"gdin": ("31",), "openshoe": ("7",)}))
    printed = capsys.readouterr().out
    assert "gdin 31" in printed
    assert "openshoe 7" in printed
    assert all(math.isfinite(figure.measured) for figure in figures)
