"""`--preset`: the filters of the papers from the command line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.ekf.compass import AiezParameters, GatedCompassParameters
from fg_nav.ekf.presets import AS_PRINTED, GATED, NOT_RUN, PHYSICAL, PRESETS, TUNED, TUNED_PARAMETERS, find_parameters
from fg_nav.errors import EstimationError
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import simulate
from fg_nav.magnetic.detectors import DETECTORS
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.walk import Walk
from tests.command_line import FgNav

FILTERS = ("iez", *GATED, "aiez")


@pytest.fixture(scope="module")
def prepared() -> Walk:
    return prepare_walk(Walk.of(simulate("demo", 5).recording))


@pytest.fixture(scope="module")
def walk(prepared: Walk, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "walk.csv"
    write_canonical(prepared.recording, path)
    return path


def used(folder: Path) -> dict[str, object]:
    content = json.loads((folder / "config.json").read_text())
    parameters = content["parameters"]
    assert isinstance(parameters, dict)
    return parameters


@pytest.mark.parametrize("method", FILTERS)
def test_each_filter_runs_in_each_preset(prepared: Walk, method: str) -> None:
    ends = set()
    for preset in PRESETS:
        outcome = run_method(replace(prepared, options=replace(prepared.options, preset=preset)), method)
        said = preset == AS_PRINTED and method in NOT_RUN
        assert (NOT_RUN.get(method) in outcome.solution.notes) == said
        ends.add(tuple(outcome.solution.position[-1]))
    assert len(ends) >= 2


def test_compare_takes_filters_beside_the_smoother_which_has_no_presets(fg_nav: FgNav, walk: Path) -> None:
    ran = fg_nav("compare", walk, "--methods", "smoother,aiez", "--preset", "as-printed", "--out", "out")
    assert ran.code == 0, ran.err
    assert used(Path("out/aiez"))["hdr_as_printed"] is True


def test_run_takes_a_preset_and_says_what_of_it_is_not_run(fg_nav: FgNav, walk: Path) -> None:
    ran = fg_nav("run", walk, "--method", "ma2018", "--preset", "as-printed", "--out", "out")
    assert ran.code == 0, ran.err
    assert used(Path("out"))["levelled_by_force"] is True
    assert NOT_RUN["ma2018"] in json.loads(Path("out/summary.json").read_text())["notes"]


def test_a_preset_that_there_is_not_is_refused_before_anything_is_read(fg_nav: FgNav) -> None:
    ran = fg_nav("run", "none.csv", "--method", "iez", "--preset", "magic")
    assert ran.refused("no preset 'magic'", *PRESETS)


def test_a_filter_without_a_magnetometer_is_refused(fg_nav: FgNav, walk: Path) -> None:
    assert fg_nav("run", walk, "--method", "aiez", "--no-mag").refused("aiez needs a magnetometer")


def test_tuned_is_the_default_and_physical_where_nothing_is_tuned() -> None:
    for method in FILTERS:
        assert find_parameters(method) == find_parameters(method, TUNED)
        assert (find_parameters(method, TUNED) == find_parameters(method, PHYSICAL)) == (method not in TUNED_PARAMETERS)


def test_unknown_filters_and_presets_are_refused() -> None:
    with pytest.raises(EstimationError, match=r"no preset 'physical' of 'smoother': .*aiez, matched"):
        find_parameters("smoother", PHYSICAL)
    with pytest.raises(EstimationError, match=r"no preset 'as-printed' of 'matched-rts': .*aiez\."):
        find_parameters("matched-rts", AS_PRINTED)
    with pytest.raises(EstimationError, match="no preset 'best'"):
        find_parameters("iez", "best")


def test_as_printed_has_the_figures_of_the_papers() -> None:
    ma, zhang = find_parameters("ma2018", AS_PRINTED), find_parameters("aiez", AS_PRINTED)
    assert isinstance(ma, GatedCompassParameters)
    assert ma.detector.threshold == 170.0
    assert ma.detector.window == 3
    assert ma.compass_sigma_deg == pytest.approx(3.84, abs=0.01)  # 0.067 rad
    assert isinstance(zhang, AiezParameters)
    assert zhang.hdr_as_printed
    assert not zhang.detector.counts_drift


def test_physical_believes_what_its_detector_of_the_same_name_passes() -> None:
    for method in GATED:
        parameters = find_parameters(method, PHYSICAL)
        assert isinstance(parameters, GatedCompassParameters)
        assert parameters.detector == DETECTORS[method]


def test_aiez_tests_the_compass_with_the_sigma_it_takes_it_in_with() -> None:
    parameters = find_parameters("aiez", PHYSICAL)
    assert isinstance(parameters, AiezParameters)
    offset, strength_rate = parameters.detector.channels
    assert np.degrees(offset.sigma) == pytest.approx(parameters.compass_sigma_deg)
    assert np.degrees(offset.sigma * np.sqrt(parameters.detector.threshold)) == pytest.approx(25.0, abs=0.5)
    assert strength_rate in DETECTORS["aiez"].channels
