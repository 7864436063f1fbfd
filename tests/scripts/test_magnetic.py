"""The scripts that measure the smoother with its magnetic field: what they count, and that they run."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import OutputError
from fg_nav.evaluation.walked import AS_STARTED, WalkErrors
from fg_nav.lab.store.results import Key, Result
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

compare = load_script("compare_ekf")
ablation = load_script("magnetic_ablation")
real = load_script("real_fields")


def result(method="smoother", walk="1", rmse_m=1.0, runtime_s=1.0, whitened=None, used="uu--", failed=""):
    """Stand in for a walk of one method."""
    key = Key("office", "smooth", walk, "loop", method)
    if failed:
        return Result(key, {}, "code", failed)
    errors = WalkErrors(AS_STARTED, 100.0, rmse_m, mean_m=rmse_m, max_m=rmse_m, rmse_m=rmse_m, heading_rmse_deg=1.0)
    return Result(key, {}, "code", errors={AS_STARTED: errors}, whitened=whitened or {}, used=used, runtime_s=runtime_s)


# --- ablation --------------------------------------------------------------------------------------------------------


def test_each_switch_is_turned_once_from_the_default_and_once_from_nothing():
    for name in ablation.list_switches(ablation.DEFAULT.magnetic):
        on = getattr(ablation.DEFAULT.magnetic, name)
        turned = ablation.VARIANTS[f"{'without' if on else 'with'} {name}"].parameters.magnetic
        assert turned == replace(ablation.DEFAULT.magnetic, **{name: not on})
        alone = ablation.VARIANTS[f"only {name}"].parameters.magnetic
        assert [other for other in ablation.list_switches(ablation.DEFAULT.magnetic) if getattr(alone, other)] == [name]
    assert len(ablation.list_switches(ablation.DEFAULT.magnetic)) >= 2
    assert not ablation.VARIANTS["inertial"].field


def test_no_two_variants_are_the_same_but_for_their_name():
    described = [ablation.describe(variant) for variant in ablation.VARIANTS.values()]
    assert described[0] == "as it comes"
    twins = {words for words in described if described.count(words) > 1}
    assert all(words.count(" ") <= 3 for words in twins)  # with two switches, without the one is only the other
    files = {Key("office", "smooth", "1", "loop", name).file for name in ablation.VARIANTS}
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
    heads, rows = ablation.make_table(case)
    assert heads[1] == "rmse (m)"  # there are no landmarks
    assert "failed" in rows[2][1]
    assert [row[0] for row in ablation.summarize({"case": case})][-1] == "broken"


def test_the_nees_of_an_ablation_is_over_its_expectation_at_the_last_footfall():
    apart = {"position": [[9.0, 9.0, 9.0], [1.0, 1.0, 1.0]], "heading": [[9.0], [1.0]]}
    assert ablation.nees_ratio([result(whitened=apart)]) == pytest.approx(1.0)
    joint = {**apart, "pose": [[9.0] * 4, [2.0] * 4]}
    assert ablation.nees_ratio([result(whitened=joint), result(whitened=joint)]) == pytest.approx(4.0)
    assert math.isnan(ablation.nees_ratio([result()]))


def test_an_ablation_runs_keeps_and_takes_up_again(tmp_path, capsys, monkeypatch):
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
        "--jobs",
        "1",
    ]
    ablation.main(given)
    printed = capsys.readouterr().out
    assert "demo, smooth, magnetometer loop" in printed
    default, bare = (json.loads((tmp_path / f"demo_smooth_loop_{n}_1.json").read_text()) for n in ablation.VARIED)
    assert default["used"].count("u") > 10  # what the gate passes of a smooth field
    assert "u" not in bare["used"]
    assert default["errors"]["origin"]["rmse_m"] != bare["errors"]["origin"]["rmse_m"]
    assert len(default["whitened"]["position"]) == 4
    monkeypatch.setattr(ablation, "make_walk", None)  # nothing is left to be made
    ablation.main(given)
    with pytest.raises(OutputError, match="make it"):
        ablation.main(["--out", str(tmp_path / "nowhere")])
    ablation.main(["--list"])
    assert "inertial: the field is not given" in capsys.readouterr().out


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


@needs_data
def test_a_real_walk_with_and_without_the_magnetometer(capsys):
    figures = real.print_pairs(real.measure_pairs(DATA, {"gdin": ("31",), "openshoe": ("7",)}))
    printed = capsys.readouterr().out
    assert "gdin 31" in printed
    assert "openshoe 7" in printed
    assert all(math.isfinite(figure.measured) for figure in figures)
