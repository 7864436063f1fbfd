"""Pictures of a walk: its charts as PNG, from above and over time.

==================== ========================================================
run                  trajectory, heading, gyro_bias, stance_statistic
two feet             trajectory
comparison           trajectories, errors (with a truth), stance_statistic;
                     per method trajectory, heading, gyro_bias
==================== ========================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from fg_nav.report.charts import Chart
from fg_nav.report.course import align_feet, align_solution, describe_ellipses, describe_frame, draw_course, draw_feet
from fg_nav.report.plots import style
from fg_nav.report.series import draw_errors, draw_gyro_bias, draw_headings, draw_samples

if TYPE_CHECKING:
    from fg_nav.feet_result import FeetResult
    from fg_nav.walk import Outcome, Walk


def draw_walk(folder: Path, walk: Walk, outcomes: Mapping[str, Outcome]) -> None:
    """Draw one method, or several over each other and each into its own folder; and the detection that they share."""
    (first, *others) = outcomes.values()
    if not others:
        draw_result(folder, walk, first)
    else:
        draw_paths(folder / "trajectories.png", walk, outcomes)
        views = {name: align_solution(walk, outcome) for name, outcome in outcomes.items()}
        if all(view.comparison is not None for view in views.values()):
            words = next(iter(views.values())).alignment_words
            _write(folder / "errors.png", f"Position error{words}", draw_errors(views))
        for name, outcome in outcomes.items():
            draw_result(folder / name, walk, outcome)
    # the detection, where the detector left a statistic
    found = walk.stances
    if found.statistic is not None:
        title = f"Stance detection ({found.detector}): {found.n_footfalls} footfalls"
        _write(folder / "stance_statistic.png", title, *draw_samples(walk.recording, found))


def draw_result(folder: Path, walk: Walk, outcome: Outcome) -> None:
    """Draw one method."""
    name, view = outcome.solution.method, align_solution(walk, outcome)
    draw_paths(folder / "trajectory.png", walk, {name: outcome})
    _write(folder / "heading.png", f"Heading{view.alignment_words}", draw_headings({name: view}))
    _write(folder / "gyro_bias.png", "Gyroscope bias", draw_gyro_bias({name: view}))


def _write(file: Path, title: str, *charts: Chart, caption: str | None = None) -> None:
    style.save(style.render_matplotlib(*charts, title=title, caption=caption), file)


def draw_paths(file: Path, walk: Walk, outcomes: Mapping[str, Outcome]) -> None:
    """Draw the paths of one or more methods from above."""
    views = {name: align_solution(walk, outcome) for name, outcome in outcomes.items()}
    (name, first), *_ = views.items()
    frame = describe_frame(first, outcomes[name], walk.options)
    caption = f"{frame.words} {describe_ellipses(first)}"
    _write(file, f"Path{first.alignment_words}", draw_course(views, outcomes, frame), caption=caption)


def draw_both_feet(file: Path, result: FeetResult) -> None:
    """Draw the paths of both feet and of the person."""
    person, feet, frame = align_feet(result)
    caption = f"{frame.words} {describe_ellipses(person)}"
    _write(file, f"Path{person.alignment_words}", draw_feet(person, feet, frame), caption=caption)


def draw_on_screen(chart: Chart, title: str, axes: Axes | None = None) -> Axes:
    """Draw a map into these axes, or into a new figure of pyplot, which windows and notebooks show."""
    from matplotlib import pyplot

    with style.styled():
        if axes is None:
            axes = pyplot.figure(figsize=(style.WIDTH_IN, style.find_height(chart)), layout="constrained").subplots()
        style.draw_panel(axes, chart)
        style.head(axes, title)
    return axes
