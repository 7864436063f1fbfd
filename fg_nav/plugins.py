"""What other packages add to this one, by entry points of their `pyproject.toml`.

================ ==========================================================================
group            an entry point names
================ ==========================================================================
fg_nav.methods   an estimator: `fg_nav.estimators.Method`
fg_nav.readers   a format of recordings: `fg_nav.io.formats.Format`
fg_nav.detectors a detector of the quasi-static magnetic field: `fg_nav.magnetic.detectors.Detector`
fg_nav.exports   a format of exports: `fg_nav.report.export.Export`
================ ==========================================================================
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from typing import TypeVar

from fg_nav.errors import PluginError

T = TypeVar("T")


@cache
def find_plugins(group: str, kind: type[T]) -> dict[str, T]:
    """Return what installed packages add to a group, by name; raises `PluginError` if one does not load or fit."""
    found = {}
    for entry in entry_points(group=f"fg_nav.{group}"):
        package = entry.dist.name if entry.dist else entry.module
        try:
            added = entry.load()
        except Exception as error:  # A package of somebody else may fail in any way.
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            words = f"does not load ({reason})"
            raise PluginError(f"{entry.name} of the package {package} {words}: uninstall it.") from error
        if not isinstance(added, kind):
            words = f"is no {kind.__name__}, which fg_nav.{group} are"
            raise PluginError(f"{entry.name} of the package {package} {words}: uninstall it.")
        found[entry.name] = added
    return found
