"""Output for people: result folders, files, tables, the page and pictures.

Imported by the command line, the papers' experiments and scripts only. Importing this package does not import
matplotlib; `fg_nav.report.plots` does.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

Plots: TypeAlias = Literal["none", "png", "html", "all"]
"""Drawings of a result: the page `report.html`, the pictures, both or neither."""

REPORT = "report.html"  # The page in the folder of a result.
