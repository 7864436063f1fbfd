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

from fg_nav.report.charts import Chart, Paths, align_feet, align_paths, describe_ellipses, draw_course
from fg_nav.report.plots import style
from fg_nav.report.series import draw_errors, draw_gyro_bias, draw_headings, draw_samples

if TYPE_CHECKING:
    from fg_nav.both_feet import FeetResult
    from fg_nav.walk import Outcome, Walk


def draw_walk(folder: Path, walk: Walk, outcomes: Mapping[str, Outcome], both: FeetResult | None = None) -> None:
    """Draw one method, or several over each other and each into its own folder, or the paths of both feet."""
    if both is not None:
        draw_paths(folder / "trajectory.png", align_feet(both))
        return
    if len(outcomes) > 1:
        paths = align_paths(outcomes, walk)
        draw_paths(folder / "trajectories.png", paths)
        if all(view.comparison is not None for view in paths.views.values()):
            _write(folder / "errors.png", f"Position error{paths.first.alignment_words}", draw_errors(paths.views))
    for name, outcome in outcomes.items():
        paths, place = align_paths({name: outcome}, walk), folder if len(outcomes) == 1 else folder / name
        draw_paths(place / "trajectory.png", paths)
        _write(place / "heading.png", f"Heading{paths.first.alignment_words}", draw_headings(paths.views))
        _write(place / "gyro_bias.png", "Gyroscope bias", draw_gyro_bias(paths.views))
    # the detection, where the detector left a statistic
    found = walk.stances
    if found.statistic is not None:
        title = f"Stance detection ({found.detector}): {found.n_footfalls} footfalls"
        _write(folder / "stance_statistic.png", title, *draw_samples(walk.recording, found))


def _write(file: Path, title: str, *charts: Chart, caption: str | None = None) -> None:
    style.save(style.render_matplotlib(*charts, title=title, caption=caption), file)


def draw_paths(file: Path, paths: Paths) -> None:
    """Draw paths from above."""
    caption = f"{paths.frame.words} {describe_ellipses(paths.first)}"
    _write(file, f"Path{paths.first.alignment_words}", draw_course(paths), caption=caption)


def draw_on_screen(paths: Paths, axes: Axes | None = None) -> Axes:
    """Draw paths from above into these axes, or into a new figure of pyplot, which windows and notebooks show."""
    from matplotlib import pyplot

    chart = draw_course(paths)
    with style.styled():
        if axes is None:
            axes = pyplot.figure(figsize=(style.WIDTH_IN, style.find_height(chart)), layout="constrained").subplots()
        style.draw_panel(axes, chart)
        style.head(axes, f"Path{paths.first.alignment_words}")
    return axes
