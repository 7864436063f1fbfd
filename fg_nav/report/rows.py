"""The rows of a table of results, and the notes that go with it: the same on the terminal and on the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

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


def collect_notes(summaries: Sequence[Mapping[str, object]]) -> list[tuple[str, str]]:
    """Return notes with the method whose they are, which is empty where they are everybody's."""
    said = {str(summary["method"]): cast("list[str]", summary["notes"]) for summary in summaries}
    shared = [note for note in next(iter(said.values())) if all(note in notes for notes in said.values())]
    own = [(name, note) for name, notes in said.items() for note in notes if note not in shared]
    own += [(str(one["method"]), _describe_graph(one["graph"])) for one in summaries if one.get("graph")]
    return [("", note) for note in shared] + own


def _describe_graph(counts: object) -> str:
    words = ", ".join(f"{count} {kind.replace('_', ' ')}" for kind, count in cast("dict[str, int]", counts).items())
    return f"graph: {words}"
