"""Pictures, and which of them a result folder gets.

==================== ========================================================
run                  trajectory, heading, gyro_bias, stance_statistic
two feet             trajectory
comparison           trajectories, errors (with a truth), stance_statistic;
                     per method trajectory, heading, gyro_bias
look at the field    field, field_map
==================== ========================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import fg_nav.report.plots.fonts  # noqa: F401  before matplotlib
from fg_nav.report.aligned import AlignedSolution, align_solution
from fg_nav.report.plots.maps import plot_trajectories, plot_trajectory
from fg_nav.report.plots.style import save
from fg_nav.report.plots.timeseries import plot_errors, plot_gyro_bias, plot_heading, plot_stance_statistic

if TYPE_CHECKING:
    from fg_nav.evaluation.field_survey import FieldSurvey
    from fg_nav.walk import Outcome, Walk


def draw_result(folder: Path, walk: Walk, outcome: Outcome) -> None:
    """Draw one method."""
    view = align_solution(walk, outcome)
    save(plot_trajectory(view), folder / "trajectory.png")
    save(plot_heading(view), folder / "heading.png")
    save(plot_gyro_bias(view), folder / "gyro_bias.png")


def draw_person(folder: Path, view: AlignedSolution) -> None:
    """Draw the path between two feet."""
    save(plot_trajectory(view), folder / "trajectory.png")


def draw_stances(folder: Path, walk: Walk) -> None:
    """Draw the detection that all methods share, where the detector left a statistic."""
    if walk.stances.statistic is not None:
        save(plot_stance_statistic(walk.recording.t, walk.stances), folder / "stance_statistic.png")


def draw_comparison(folder: Path, walk: Walk, outcomes: Mapping[str, Outcome]) -> None:
    """Draw the methods over each other, and each into its own folder."""
    views = {name: align_solution(walk, outcome) for name, outcome in outcomes.items()}
    save(plot_trajectories(views), folder / "trajectories.png")
    if all(view.comparison is not None for view in views.values()):
        save(plot_errors(views), folder / "errors.png")
    for name, outcome in outcomes.items():
        draw_result(folder / name, walk, outcome)


def draw_survey(folder: Path, walk: Walk, survey: FieldSurvey, outcome: Outcome) -> None:
    """Draw the field along the walk and what the detectors make of it."""
    from fg_nav.report.plots.field import plot_field, plot_field_map

    save(plot_field(survey), folder / "field.png")
    save(plot_field_map(survey, align_solution(walk, outcome)), folder / "field_map.png")
