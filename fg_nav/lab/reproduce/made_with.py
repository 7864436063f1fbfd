"""What the walks of an experiment are drawn from, and what its detectors test, for the parameters that a page tells.

Those of the methods are told by each result (`fg_nav.lab.reproduce.cells.parameters_of`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from fg_nav.lab.campaign.kept import Key
from fg_nav.lab.campaign.settings import settings_of
from fg_nav.lab.simulation.fields.building import SMOOTH_KINDS, Clutter
from fg_nav.magnetic import DETECTORS

FIELDS: dict[str, Any] = {"smooth": SMOOTH_KINDS, "indoor": Clutter()}
"""Objects and floor of a level."""


def made_with(keys: Iterable[Key], detectors: Iterable[str]) -> dict[str, Any]:
    """By name: site, sensor and place of each scenario, the objects of each field, and these detectors."""
    keys = list(keys)
    of_scenario = {key.group: key for key in reversed(keys)}
    levels = sorted({key.field for key in keys} & set(FIELDS))
    return {
        **{f"scenario {name}": _whatever_field(settings_of(of_scenario[name])["walk"]) for name in sorted(of_scenario)},
        **{f"field {level}": FIELDS[level] for level in levels},
        **{f"detector {name}": DETECTORS[name] for name in detectors},
    }


def _whatever_field(walk: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in walk.items() if name != "field"}
