"""Output for people: result folders, files, tables, the page and pictures.

Imported by the command line, the papers' experiments and scripts only. Importing this package does not import
matplotlib; `fg_nav.report.plots` does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, cast

Plots: TypeAlias = Literal["none", "png", "html", "all"]
"""Drawings of a result: the page `report.html`, the pictures, both or neither."""

WITH_PAGE: tuple[Plots, ...] = ("html", "all")
WITH_PICTURES: tuple[Plots, ...] = ("png", "all")

REPORT = "report.html"  # The page in the folder of a result.

FIGURES = (
    ("distance_m", "distance (m)", "{:.2f}"),
    ("distance_sigma_m", "its sigma (m)", "{:.2f}"),
    ("strides", "strides", "{:d}"),
    ("strides_true", "strides in truth", "{:d}"),
    ("closure_m", "start to end (m)", "{:.3f}"),
    ("closure_percent", "start to end (%)", "{:.2f}"),
    ("rmse_2d_m", "rmse 2-D (m)", "{:.3f}"),
    ("rmse_3d_m", "rmse 3-D (m)", "{:.3f}"),
    ("end_error_m", "end error (m)", "{:.3f}"),
    ("max_error_m", "max error (m)", "{:.3f}"),
    ("moment_rmse_2d_m", "rmse 2-D at the moment (m)", "{:.3f}"),
    ("moment_end_error_m", "end error at the moment (m)", "{:.3f}"),
    ("polished_rmse_2d_m", "rmse 2-D in batch (m)", "{:.3f}"),
    ("polished_closure_m", "start to end in batch (m)", "{:.3f}"),
    ("polish_gap_rms_m", "apart from batch, rms (m)", "{:.3f}"),
    ("polish_gap_max_m", "apart from batch, most (m)", "{:.3f}"),
    ("polish_gap_heading_deg", "apart from batch (deg)", "{:.2f}"),
    ("heading_rmse_deg", "heading rmse (deg)", "{:.2f}"),
    ("scale", "best-fit scale", "{:.4f}"),
    ("alignment", "alignment", "{}"),
    ("magnetometer", "magnetometer", "{}"),
    ("runtime_s", "runtime (s)", "{:.2f}"),
    ("realtime_factor", "times real time", "{:.0f}"),
)
"""Key of the summary, words, and format of every row of a result table."""


@dataclass(frozen=True)
class Cell:
    """A figure of merit as text, with its key and its value in the summary."""

    key: str
    text: str
    value: object


def tabulate_figures(summaries: Sequence[Mapping[str, object]]) -> list[tuple[str, list[Cell]]]:
    """Rows of the figures that at least one of the columns has."""
    rows = []
    for key, words, pattern in FIGURES:
        values = [summary.get(key) for summary in summaries]
        if any(value is not None for value in values):
            cells = [Cell(key, "-" if value is None else pattern.format(value), value) for value in values]
            rows.append((words, cells))
    return rows


def collect_notes(summaries: Sequence[Mapping[str, object]]) -> list[tuple[str, str]]:
    """Return the notes of several methods, each with its method, or with "" where all of them have it."""
    by_method = {str(summary["method"]): cast("list[str]", summary["notes"]) for summary in summaries}
    shared = [note for note in next(iter(by_method.values())) if all(note in notes for notes in by_method.values())]
    own = [(name, note) for name, notes in by_method.items() for note in notes if note not in shared]
    for summary in summaries:
        if counts := cast("dict[str, int] | None", summary.get("graph")):
            words = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in counts.items())
            own.append((str(summary["method"]), f"graph: {words}"))
    return [("", note) for note in shared] + own
