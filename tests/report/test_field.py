"""The look at the field: figures that can be counted by hand, and pictures of long and of short walks."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb

from fg_nav.arrays import Floats
from fg_nav.earth import EarthField
from fg_nav.lab.drawing import ACCEPTED, REJECTED, UNJUDGED, plot_field
from fg_nav.lab.field_survey import FieldSurvey, measure_coverage
from fg_nav.lab.verbs.detect import tabulate_footfalls
from fg_nav.magnetic import FieldVerdicts, FootfallField
from tests.magnetic.fields import footfalls, turned
from tests.report import walks

DISTURBED = np.deg2rad([0.0, 1.0, 0.0, 30.0, 31.0, -20.0])  # What the compass is off at six footfalls, clockwise.


def field_of(heading: Floats, compass_off: Floats) -> FootfallField:
    """A level foot with these headings at Munich, and a compass that is off by so much: rad, clockwise."""
    field: FootfallField = footfalls(turned(-compass_off), heading)  # type: ignore[no-untyped-call]
    return field


def verdicts_of(statistic: list[float], name: str = "ma2018") -> FieldVerdicts:
    return FieldVerdicts(name, np.array(statistic), 5.0, ("because",) * len(statistic))


def survey_of(n: int, earth: EarthField | None = None) -> FieldSurvey:
    rng = np.random.default_rng(3)
    field = field_of(0.05 * np.arange(n, dtype=np.float64), rng.normal(size=n) * 0.3)
    unjudged = np.where(np.arange(n) < 3, np.nan, 1.0)
    names = ("qsf", "ma2018", "aiez")
    found = {name: verdicts_of(list(unjudged * rng.exponential(size=n)), name) for name in names}
    solution = walks.outcome(walks.walk()).solution
    rows = np.linspace(0, len(solution.t) - 1, 110 * n).astype(int)
    solution = replace(solution, t=np.arange(110.0 * n) / 200.0, position=solution.position[rows])
    return FieldSurvey(field, found, "ma2018", solution, earth)


def test_coverage_counts_what_passes() -> None:
    field = field_of(np.deg2rad([350.0, 355.0, 0.0, 90.0, 180.0, 185.0]), DISTURBED)
    found = measure_coverage(field, "ma2018", verdicts_of([np.nan, 0.5, 0.9, 0.1, 7.0, 0.2]))
    assert (found.footfalls, found.judged, found.accepted, found.longest_run) == (6, 5, 4, 3)
    assert found.share == pytest.approx(4 / 6)
    assert found.change_deg == pytest.approx(np.median([1.0, 30.0]))
    assert found.change_all_deg == pytest.approx(np.median([1.0, 1.0, 30.0, 1.0, 51.0]))
    never = measure_coverage(field, "qsf", verdicts_of([np.nan, 2.0, 3.0, 0.5, 2.0, 0.5]))
    assert (never.accepted, never.longest_run, bool(np.isnan(never.change_deg))) == (2, 1, True)


def test_declination_turns_the_compass_and_nothing_else() -> None:
    survey = survey_of(20)
    east = replace(survey, earth=EarthField((np.sin(0.1) * 20, np.cos(0.1) * 20, -40.0)))
    assert east.compass_heading - survey.compass_heading == pytest.approx(np.full(20, 0.1))
    plain, there = tabulate_footfalls(survey), tabulate_footfalls(east)
    change = (there["difference_deg"] - plain["difference_deg"]).to_numpy()
    assert change == pytest.approx(np.full(20, np.rad2deg(0.1)))
    same = [name for name in plain if name not in ("difference_deg", "compass_heading_deg")]
    pd.testing.assert_frame_equal(plain[same], there[same])


def test_a_lane_shows_each_verdict_of_a_short_walk() -> None:
    survey = survey_of(6)
    survey = replace(survey, verdicts={"ma2018": verdicts_of([np.nan, 0.5, 2.0, 0.5, np.nan, 2.0])})
    colours = np.concatenate([np.asarray(image.get_array()) for image in plot_field(survey).axes[-1].images])[0]
    middle = ((np.arange(6) + 0.5) * len(colours) / 6).astype(int)
    wanted = [UNJUDGED, ACCEPTED, REJECTED, ACCEPTED, UNJUDGED, REJECTED]
    assert colours[middle] == pytest.approx(np.array([to_rgb(one) for one in wanted]))
