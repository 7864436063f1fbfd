"""The script that prints the ROC of the field detectors, and its picture: on cases that are made up, and one walk."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import EvaluationError, OutputError
from fg_nav.evaluation import FieldChange, roc_of
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.magnetic import DETECTORS
from fg_nav.report.roc import RocPanel, plot_rocs

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
script = importlib.import_module("field_roc")

STANCES = 400


def made_up(seed, passing_deg=90.0):
    """A walk in which every detector's statistic is the true change over 10 uT, with noise; none passes on curves."""
    rng = np.random.default_rng(seed)
    vector, course = rng.uniform(0.0, 20.0, STANCES), rng.uniform(0.0, np.deg2rad(30.0), STANCES)
    vector[:3] = np.nan
    statistic = vector / 10 * np.exp(0.1 * rng.standard_normal(STANCES))
    statistics = {name: np.where(course < np.deg2rad(passing_deg), statistic, 9.0) for name in DETECTORS}
    change = FieldChange(vector, vector / 100, vector / 100, vector)
    return script.Judged(change, course, np.zeros(STANCES), statistics, statistics)


def case(field="between", scenario="mall", **more):
    return script.Case(scenario, field, [made_up(seed, **more) for seed in range(3)])


@pytest.fixture(scope="module")
def demo():
    return script.judged(("demo", 3))


def test_both_levels_of_a_seed_are_the_same_walk_with_the_same_noise():
    """Else a mixture of the two would be no walk: beside the fields, turned into the body, nothing differs."""
    smooth, indoor = (simulate("demo", 3, Choices(field=field, calibrated=True)) for field in ("smooth", "indoor"))
    one, other = smooth.recording, indoor.recording
    np.testing.assert_array_equal(one.gyr, other.gyr)
    np.testing.assert_array_equal(one.truth.position, other.truth.position)
    sample = np.flatnonzero(np.isfinite(one.mag).all(axis=1) & (np.linalg.norm(one.gyr, axis=1) < 0.1))
    nav_R_body = one.truth.nav_R_body[sample]
    measured = np.einsum("nij,nj->ni", nav_R_body, (other.mag - one.mag)[sample])
    true = indoor.nav_field(sample) - smooth.nav_field(sample)
    assert np.median(np.linalg.norm(true, axis=1)) > 5.0
    assert np.median(np.abs(measured - true)) < 0.1


def test_more_steel_changes_more(demo):
    changes = [np.nanmedian(demo[field].change.vector_uT) for field in script.by_steel()]
    assert (np.diff(changes) > 0).all()
    assert set(demo["smooth"].calibrated) == set(DETECTORS)
    assert len({len(walk.course) for walk in demo.values()}) == 1


def test_a_walk_is_judged_as_its_truth_is(demo):
    """In the smooth field the statistic of our detector and the true change rise together; with iron less so."""
    change = demo["smooth"].change.vector_uT

    def order(statistic):
        both = np.isfinite(statistic) & np.isfinite(change)
        ranks = [np.argsort(np.argsort(values[both])) for values in (statistic, change)]
        return np.corrcoef(ranks)[0, 1]

    clean, iron = order(demo["smooth"].calibrated["ma2018"]), order(demo["smooth"].with_iron["ma2018"])
    assert clean > 0.8
    assert iron < clean


def test_roc_of_a_case_is_that_of_all_its_walks():
    some = case()
    roc = some.roc("ma2018-printed")
    assert roc.n_walks == 3
    assert roc.prevalence == pytest.approx(0.5, abs=0.05)
    assert roc.area > 0.97
    assert some.roc("ma2018", some.within("vector", 1e-3)) is None


def test_limit_at_which_a_share_passes():
    change, statistic = np.arange(100.0), np.where(np.arange(100) < 40, 0.5, 2.0)
    assert script.limit_for(change, statistic, 0.8) == 49.0
    assert script.limit_for(change, np.full(100, 0.5), 0.8) == np.inf
    assert np.isnan(script.limit_for(change, np.full(100, 2.0), 0.8))
    assert script.limit_for(change[::-1], statistic[::-1], 0.8) == 49.0


def test_figures_13_and_14_are_asked_of_the_mall_only():
    kept = {f.name: f.measured for f in script.asked_of([case("smooth")])}
    assert len(kept) == 4
    assert all(0.8 < value < 1.2 for value in kept.values())
    lost = {f.name: f.mark for f in script.asked_of([case("smooth", passing_deg=15.0)])}
    assert lost["iqsf: curved over straight"] == "ok"
    assert lost["ma2018: curved over straight"] == "short"
    assert not script.asked_of([case("smooth", "office")])


def test_every_table_is_printed_and_the_curves_drawn(tmp_path, capsys, monkeypatch):
    cases = [case(field) for field in script.by_steel()]
    monkeypatch.setattr(script, "all_cases", lambda *_: cases)
    script.main(["--seeds", "3", "--out", str(tmp_path), "--json", str(tmp_path / "f.json")])
    printed = capsys.readouterr().out
    for words in (
        "Truth: the field at the footfalls",
        "mall, between: truth is",
        "threshold 170",
        "Worth of what passes",
    ):
        assert words in printed
    row = next(line for line in printed.splitlines() if line.startswith("mall, between ") and " 10 uT " in line)
    p_d = case("between").roc("ma2018-printed").at(1.0)[0]
    assert f"{p_d:.2f} (" in row
    assert (tmp_path / "field_roc.png").stat().st_size > 10_000
    assert (tmp_path / "f.json").exists()


def test_what_cannot_be_is_said_before_anything_is_simulated(tmp_path):
    with pytest.raises(EvaluationError, match="two seeds or more"):
        script.main(["--seeds", "1"])
    with pytest.raises(OutputError, match="make it, or name another"):
        script.main(["--out", str(tmp_path / "nowhere")])


def test_the_picture_has_each_detector_s_own_threshold_on_its_curve():
    rng = np.random.default_rng(1)
    walk, signal = np.repeat(np.arange(4), 100), rng.random(400) < 0.5
    rocs = {name: roc_of(rng.exponential(1.0 + ~signal), signal, walk) for name in ("qsf", "qsf-printed")}
    figure = plot_rocs([RocPanel("one", rocs, {"qsf-printed": "170"}), RocPanel("two", rocs)], columns=2)
    one, two = figure.axes
    assert [text.get_text() for text in one.texts] == ["170"]
    assert not two.texts
    lines = {line.get_label(): line for line in one.lines}
    assert lines["qsf"].get_color() == lines["qsf-printed"].get_color()
    dots = [line for line in one.lines if line.get_marker() == "o"]
    for dot, roc in zip(dots, rocs.values(), strict=True):
        assert (float(dot.get_ydata()[0]), float(dot.get_xdata()[0])) == roc.at(1.0)
