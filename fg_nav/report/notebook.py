"""A solution in a notebook: its figures as a small table, and its path from above as SVG."""

from __future__ import annotations

from typing import cast

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.pipeline import Result
from fg_nav.report.charts import BLUE, GRAY, VERMILION, Paths, find_extent, spread_rows
from fg_nav.report.files import align_any, is_of_feet, summarize, summarize_feet, summarize_lagged
from fg_nav.report.terminal import describe_result
from fg_nav.solution import Solution
from fg_nav.text import to_html
from fg_nav.truth import FootprintTruth

SIDE_PX, MARGIN_PX = 260.0, 4.0  # Of the longer side of the picture, and about it.
MAX_CORNERS = 400  # Of a line: more are closer than pixels.


def render_solution(solution: Solution) -> str:
    """Return the figures that `fg-nav run` prints, and the path, as HTML."""
    if isinstance(solution, Result):
        summary = summarize(solution.walk, solution.outcome, solution.verdict)
    else:
        summary = summarize_feet(solution) if is_of_feet(solution) else summarize_lagged(solution)
    rows = [("verdict", ": ".join([str(summary["verdict"]), *cast("list[str]", summary["reasons"])]))]
    rows += [(name, words) for name, _, words in (line.partition(": ") for line in describe_result(summary))]
    return to_html(f"{type(solution).__name__} by {solution.method}", rows, draw_svg(align_any(solution)))


def draw_svg(paths: Paths) -> str:
    """Draw paths from above, north or y up, with a dot at the start, over the truth."""
    truth, lines = paths.first.truth, list[tuple[str, Floats]]()
    if truth is not None:
        lines.append((GRAY, truth.xy if isinstance(truth, FootprintTruth) else truth.position[:, :2]))
    for color, view in zip((BLUE, VERMILION), paths.views.values(), strict=False):
        lines.append((color, view.align_position(view.solution.position)[:, :2]))
    # in pixels, thinned
    every = np.concatenate([points[np.isfinite(points).all(axis=1)] for _, points in lines])
    low, scale = every.min(axis=0), SIDE_PX / max(find_extent(every), 1e-3)
    width, height = (np.ptp(every, axis=0) * scale + 2.0 * MARGIN_PX).tolist()
    drawn = list[str]()
    for color, points in lines:
        known = points[np.isfinite(points).all(axis=1)]
        at = (known[spread_rows(len(known), MAX_CORNERS)] - low) * scale + MARGIN_PX
        corners = [f"{x:.1f},{height - y:.1f}" for x, y in at.tolist()]
        drawn.append(f'<polyline points="{" ".join(corners)}" fill="none" stroke="{color}" stroke-width="1.5"/>')
    x, y = corners[0].split(",")
    drawn.append(f'<circle cx="{x}" cy="{y}" r="{MARGIN_PX}" fill="{color}"/>')
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}">{"".join(drawn)}</svg>'
