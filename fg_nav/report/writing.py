"""Everything that a command writes into its folder: the files with figures, and the pictures beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from fg_nav.report.field_results import write_survey
from fg_nav.report.field_survey import FieldSurvey
from fg_nav.report.pictures import draw_comparison, draw_result, draw_stances, draw_survey
from fg_nav.report.results import write_comparison, write_result
from fg_nav.report.simulated import write_simulation
from fg_nav.report.style import save
from fg_nav.report.surroundings import plot_surroundings

if TYPE_CHECKING:
    from fg_nav.lab.simulation import SimulatedWalk
    from fg_nav.session import Outcome, Session


def write_run_folder(folder: Path, session: Session, outcome: Outcome) -> None:
    """Write what one method made of a recording."""
    write_result(folder, session, outcome)
    draw_result(folder, session, outcome)
    draw_stances(folder, session)


def write_comparison_folder(folder: Path, session: Session, outcomes: Mapping[str, Outcome]) -> None:
    """Write what several methods made of it."""
    write_comparison(folder, session, outcomes)
    draw_comparison(folder, session, outcomes)
    draw_stances(folder, session)


def write_survey_folder(folder: Path, session: Session, survey: FieldSurvey, outcome: Outcome) -> None:
    """Write what the detectors make of its field; `outcome` is that of the method that drew the path."""
    write_survey(folder, session, survey)
    draw_survey(folder, session, survey, outcome)


def write_simulation_folder(folder: Path, walk: SimulatedWalk) -> None:
    """Write a simulated recording with its truth and its map."""
    write_simulation(folder, walk)
    save(plot_surroundings(walk), folder / "map.png")
