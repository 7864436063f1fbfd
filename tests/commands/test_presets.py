"""`--preset`: the filters of the papers from the command line."""

from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.ekf.presets import AS_PRINTED, GATED, NOT_RUN, PHYSICAL, PRESETS, TUNED, TUNED_PARAMETERS, find_parameters
from fg_nav.errors import EstimationError
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.walk import Walk
from tests.command_line import FgNav
from tests.commands.folders import config, summary

FILTERS = ("iez", *GATED, "aiez")


@pytest.fixture(scope="module")
def prepared() -> Walk:
    return prepare_walk(Walk.of(simulate("demo", 5).recording.slice(0, 6000)))


@pytest.mark.parametrize("method", FILTERS)
def test_each_filter_runs_in_each_preset_by_default_as_tuned(prepared: Walk, method: str) -> None:
    assert find_parameters(method) == find_parameters(method, TUNED)
    assert (find_parameters(method, TUNED) == find_parameters(method, PHYSICAL)) == (method not in TUNED_PARAMETERS)
    ends = set()
    for preset in PRESETS:
        outcome = run_method(replace(prepared, options=replace(prepared.options, preset=preset)), method)
        said = preset == AS_PRINTED and method in NOT_RUN
        assert (NOT_RUN.get(method) in outcome.solution.notes) == said
        ends.add(tuple(outcome.solution.position[-1]))
    assert len(ends) >= 2


def test_compare_takes_filters_beside_the_smoother_and_says_what_of_a_preset_is_not_run(
    fg_nav: FgNav, prepared: Walk
) -> None:
    write_canonical(prepared.recording, Path("walk.csv"))
    words = ("--methods", "smoother,ma2018,aiez", "--preset", "as-printed", "--plots", "none", "--out", "out")
    ran = fg_nav("compare", "walk.csv", *words)
    assert ran.code == 0, ran.err
    ma, aiez = (config(f"out/{name}")["parameters"] for name in ("ma2018", "aiez"))
    assert ma["levelled_by_force"] is aiez["hdr_as_printed"] is True
    assert NOT_RUN["ma2018"] in summary("out/ma2018")["notes"]


def test_unknown_filters_and_presets_are_refused() -> None:
    with pytest.raises(EstimationError, match=r"no preset 'physical' of 'smoother': .*aiez, matched"):
        find_parameters("smoother", PHYSICAL)
    with pytest.raises(EstimationError, match=r"no preset 'as-printed' of 'matched-rts': .*aiez\."):
        find_parameters("matched-rts", AS_PRINTED)
    with pytest.raises(EstimationError, match="no preset 'best'"):
        find_parameters("iez", "best")


def test_as_printed_has_the_figures_of_the_papers() -> None:
    ma, zhang = find_parameters("ma2018", AS_PRINTED), find_parameters("aiez", AS_PRINTED)
    assert (ma.detector.threshold, ma.detector.window) == (170.0, 3)
    assert ma.compass_sigma_deg == pytest.approx(3.84, abs=0.01)  # 0.067 rad
    assert zhang.hdr_as_printed
    assert not zhang.detector.counts_drift
