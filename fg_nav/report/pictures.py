"""Which pictures a result folder gets.

==================== ========================================================
run                  trajectory, heading, gyro_bias, stance_statistic
comparison           trajectories, errors (with a truth), stance_statistic;
                     per method trajectory, heading, gyro_bias
look at the field    field, field_map
==================== ========================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from fg_nav.report.courses import plot_errors, plot_gyro_bias, plot_heading
from fg_nav.report.detection import plot_stance_statistic
from fg_nav.report.field import plot_field
from fg_nav.report.field_map import plot_field_map
from fg_nav.report.field_survey import FieldSurvey
from fg_nav.report.maps import plot_trajectories, plot_trajectory
from fg_nav.report.style import save
from fg_nav.report.view import View

if TYPE_CHECKING:
    from fg_nav.session import Outcome, Session


def draw_result(folder: Path, session: Session, outcome: Outcome) -> None:
    """Draw one method."""
    view = _view(session, outcome)
    save(plot_trajectory(view), folder / "trajectory.png")
    save(plot_heading(view), folder / "heading.png")
    save(plot_gyro_bias(view), folder / "gyro_bias.png")


def draw_stances(folder: Path, session: Session) -> None:
    """Draw the detection that all methods share, where the detector left a statistic."""
    if session.stances.statistic is not None:
        save(plot_stance_statistic(session.recording.t, session.stances), folder / "stance_statistic.png")


def draw_comparison(folder: Path, session: Session, outcomes: Mapping[str, Outcome]) -> None:
    """Draw the methods over each other, and each into its own folder."""
    views = {name: _view(session, outcome) for name, outcome in outcomes.items()}
    save(plot_trajectories(views), folder / "trajectories.png")
    if all(view.comparison is not None for view in views.values()):
        save(plot_errors(views), folder / "errors.png")
    for name, outcome in outcomes.items():
        draw_result(folder / name, session, outcome)


def draw_survey(folder: Path, session: Session, survey: FieldSurvey, outcome: Outcome) -> None:
    """Draw the field along the walk and what the detectors make of it."""
    save(plot_field(survey), folder / "field.png")
    save(plot_field_map(survey, _view(session, outcome)), folder / "field_map.png")


def _view(session: Session, outcome: Outcome) -> View:
    usable = outcome.comparison is not None
    return View(outcome.solution, session.truth if usable else None, outcome.comparison)
