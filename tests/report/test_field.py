"""The look at the field: figures that can be counted by hand, and pictures of long and of short walks."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.earth import EarthField
from fg_nav.lab.field_drawing import ACCEPTED, REJECTED, UNJUDGED, plot_field, plot_field_map
from fg_nav.lab.field_survey import FieldSurvey, measure_coverage, survey_field
from fg_nav.lab.verbs.detect import collect_survey_notes, describe_survey, tabulate_footfalls, write_survey
from fg_nav.magnetic import FieldVerdicts, FootfallField
from fg_nav.report.charts import AlignedSolution
from fg_nav.report.plots import style
from fg_nav.solution import Solution
from fg_nav.walk import Walk
from tests.magnetic.fields import footfalls, turned
from tests.report import walks

DISTURBED = np.deg2rad([0.0, 1.0, 0.0, 30.0, 31.0, -20.0])  # What the compass is off at six footfalls, clockwise.


def field_of(heading: Floats, compass_off: Floats) -> FootfallField:
    """A level foot with these headings at Munich, and a compass that is off by so much: rad, clockwise."""
    field: FootfallField = footfalls(turned(-compass_off), heading)  # type: ignore[no-untyped-call]
    return field


def verdicts_of(statistic: list[float], name: str = "ma2018") -> FieldVerdicts:
    return FieldVerdicts(name, np.array(statistic), 5.0, ("because",) * len(statistic))


def solution_of(n: int) -> Solution:
    walk = walks.walk()
    solution = walks.outcome(walk).solution
    rows = np.linspace(0, len(solution.t) - 1, 110 * n).astype(int)
    return replace(solution, t=np.arange(110.0 * n) / 200.0, position=solution.position[rows])


def survey_of(n: int, earth: EarthField | None = None) -> FieldSurvey:
    rng = np.random.default_rng(3)
    field = field_of(0.05 * np.arange(n, dtype=np.float64), rng.normal(size=n) * 0.3)
    unjudged = np.where(np.arange(n) < 3, np.nan, 1.0)
    names = ("qsf", "ma2018", "aiez")
    found = {name: verdicts_of(list(unjudged * rng.exponential(size=n)), name) for name in names}
    return FieldSurvey(field, found, "ma2018", solution_of(n), earth)


def test_coverage_counts_what_passes() -> None:
    field = field_of(np.deg2rad([350.0, 355.0, 0.0, 90.0, 180.0, 185.0]), DISTURBED)
    found = measure_coverage(field, "ma2018", verdicts_of([np.nan, 0.5, 0.9, 0.1, 7.0, 0.2]))
    assert (found.footfalls, found.judged, found.accepted, found.longest_run) == (6, 5, 4, 3)
    assert found.share == pytest.approx(4 / 6)
    assert found.change_deg == pytest.approx(np.median([1.0, 30.0]))
    assert found.change_all_deg == pytest.approx(np.median([1.0, 1.0, 30.0, 1.0, 51.0]))


def test_a_detector_that_accepts_nothing_has_no_change_to_show() -> None:
    field = field_of(np.zeros(6), DISTURBED)
    found = measure_coverage(field, "qsf", verdicts_of([np.nan, 2.0, 3.0, 0.5, 2.0, 0.5]))
    assert (found.accepted, found.longest_run) == (2, 1)
    assert np.isnan(found.change_deg)


def test_declination_turns_the_compass_and_nothing_else() -> None:
    survey = survey_of(20)
    east = replace(survey, earth=EarthField((np.sin(0.1) * 20, np.cos(0.1) * 20, -40.0)))
    assert east.compass_heading - survey.compass_heading == pytest.approx(np.full(20, 0.1))
    plain, there = tabulate_footfalls(survey), tabulate_footfalls(east)
    change = (there["difference_deg"] - plain["difference_deg"]).to_numpy()
    assert change == pytest.approx(np.full(20, np.rad2deg(0.1)))
    same = [name for name in plain if name not in ("difference_deg", "compass_heading_deg")]
    pd.testing.assert_frame_equal(plain[same], there[same])


def test_files_tell_verdicts_and_parameters(tmp_path: Path) -> None:
    walk, survey = walks.walk(), survey_of(30)
    write_survey(tmp_path, walk, survey)
    table = pd.read_csv(tmp_path / "field.csv", keep_default_na=False)
    assert list(table["index"]) == list(range(30))
    assert list(table["ma2018_verdict"]) == list(survey.verdicts["ma2018"].words)
    assert set(table["qsf_verdict"]) == {"none", "quasi-static", "disturbed"}
    assert table["strength_uT"].to_numpy() == pytest.approx(np.full(30, 48.0))
    assert table["inclination_deg"].to_numpy() == pytest.approx(np.full(30, 64.0))
    said = json.loads((tmp_path / "detect.json").read_text())
    assert said["footfalls"] == 30
    assert list(said["detectors"]) == ["qsf", "ma2018", "aiez"]
    shares = [one["quasi_static"] / 30 for one in said["detectors"].values()]
    assert shares == [one["share"] for one in said["detectors"].values()]
    assert said["detectors"]["ma2018"]["parameters"]["channels"]
    assert json.loads(json.dumps(describe_survey(walk, survey)["drawn_in_colour"])) == "ma2018"


def test_detectors_are_put_in_their_order() -> None:
    field = field_of(np.zeros(12), np.zeros(12))
    survey = survey_field(walks.walk().recording, field, ["aiez", "qsf"], solution_of(12))
    assert list(survey.verdicts) == ["qsf", "aiez"]
    assert survey.chosen == "aiez"


@pytest.mark.parametrize("n", [1, 4, 40, 1920])
def test_pictures_of_walks_of_any_length(tmp_path: Path, n: int) -> None:
    survey = survey_of(n, EarthField((0.0, 20.0, -40.0)))
    style.save(plot_field(survey), tmp_path / "field.png")
    style.save(plot_field_map(survey, AlignedSolution(survey.solution)), tmp_path / "map.png")
    for name in ("field.png", "map.png"):
        pixels = imread(tmp_path / name)
        assert pixels.shape[1] > 1000
        assert np.mean(pixels[..., :3].min(axis=2) < 0.9) > 0.005


def lane(survey: FieldSurvey) -> Floats:
    """Colours (L, columns, 3) of the lanes in the picture."""
    return np.concatenate([np.asarray(image.get_array()) for image in plot_field(survey).axes[-1].images])


def test_a_lane_shows_each_verdict_of_a_short_walk() -> None:
    survey = survey_of(6)
    survey = replace(survey, verdicts={"ma2018": verdicts_of([np.nan, 0.5, 2.0, 0.5, np.nan, 2.0])})
    colours = lane(survey)[0]
    middle = ((np.arange(6) + 0.5) * len(colours) / 6).astype(int)
    wanted = [UNJUDGED, ACCEPTED, REJECTED, ACCEPTED, UNJUDGED, REJECTED]
    assert colours[middle] == pytest.approx(np.array([to_rgb(one) for one in wanted]))


def test_a_lane_is_empty_where_nobody_steps() -> None:
    survey = survey_of(40)
    t = np.arange(40.0) + np.where(np.arange(40) < 20, 0.0, 100.0)
    survey = replace(survey, field=replace(survey.field, t=t), verdicts={"ma2018": verdicts_of([0.5] * 40)})
    empty = (lane(survey)[0] == 1.0).all(axis=1).mean()
    assert empty == pytest.approx((101.0 - 2 * 3.0) / 140.0, abs=0.005)


def test_a_note_tells_where_nobody_steps(walk: Walk) -> None:
    assert not [note for note in collect_survey_notes(walk) if "no footfall" in note]
    first, last = 10, 25
    kept = np.r_[0:first, last : len(walk.stances)]
    stances = Stances.from_mask(np.isin(np.arange(walk.stances.n_samples), standing(walk.stances, kept)))
    t = walk.recording.t
    gap_s = t[walk.stances.start[last]] - t[walk.stances.stop[first - 1] - 1]
    (note,) = [note for note in collect_survey_notes(replace(walk, stances=stances)) if "no footfall" in note]
    assert f"for {gap_s:.0f} s" in note


def standing(stances: Stances, kept: Ints) -> Ints:
    """Samples of some of the stances."""
    return np.concatenate([np.arange(stances.start[k], stances.stop[k]) for k in kept])


def test_a_lane_mixes_the_verdicts_of_a_long_walk() -> None:
    n = 4000
    survey = replace(survey_of(n), verdicts={"ma2018": verdicts_of([0.5, 2.0] * (n // 2))})
    half = (np.array(to_rgb(ACCEPTED)) + np.array(to_rgb(REJECTED))) / 2
    assert np.abs(lane(survey)[0] - half).max() < 0.2


def test_map_counts_what_it_colours(walk: Walk) -> None:
    survey = survey_of(40)
    figure = plot_field_map(survey, AlignedSolution(survey.solution))
    for axes, one in zip(figure.axes, survey.coverage, strict=True):
        assert axes.get_title(loc="left") == f"{one.detector}: {100 * one.share:.0f} %"
        coloured = sum(len(np.asarray(line.get_xdata())) for line in axes.lines if line.get_color() == ACCEPTED)
        assert coloured == one.accepted


@pytest.mark.parametrize(("stretched", "rows"), [(1.0, 2), (0.02, 1)], ids=["wide", "tall"])
def test_maps_of_a_long_corridor_stand_beside_each_other(stretched: float, rows: int) -> None:
    survey = survey_of(40)
    survey = replace(survey, verdicts={f"d{k}": verdicts_of([0.5] * 40) for k in range(6)}, chosen="d0")
    solution = replace(survey.solution, position=survey.solution.position * [stretched, 1.0, 1.0])
    figure = plot_field_map(replace(survey, solution=solution), AlignedSolution(solution))
    assert figure.axes[0].get_gridspec().nrows == rows  # type: ignore[union-attr]


def test_map_claims_no_north_where_the_truth_has_none(walk: Walk) -> None:
    survey = survey_of(40)
    for changed, word in ((walk, "north"), (walks.with_footprints(walk), "y")):
        outcome = walks.outcome(changed)
        view = AlignedSolution(outcome.solution, changed.truth, outcome.comparison)
        label = plot_field_map(survey, view)._supylabel  # type: ignore[attr-defined]
        assert label.get_text() == f"{word} (m)"
