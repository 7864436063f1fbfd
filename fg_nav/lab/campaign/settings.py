"""What a result is made with: a kept result with other settings does not hold, and is made anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from fg_nav.calibration.walk import WalkCalibrationParameters
from fg_nav.detection import StanceParameters
from fg_nav.errors import EstimationError
from fg_nav.lab.campaign.kept import Key
from fg_nav.lab.campaign.made import solved
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.own import Own
from fg_nav.lab.campaign.reading import AS_IT_IS, Reading
from fg_nav.lab.campaign.sources import LOOP, MIXTURES, WALK
from fg_nav.lab.simulation import Choices, scenario, simulate
from fg_nav.plain import plain
from fg_nav.session import Options, Session, prepare

PROBE = ("demo", 1)
"""A short walk on which a method tells its effective parameters before it is asked for long ones."""


def settings_of(
    key: Key,
    recorded: bool = False,
    files: Mapping[str, str] | None = None,
    reading: Reading = AS_IT_IS,
    own: Own | None = None,
) -> dict[str, Any]:
    """What a result is made with, as JSON has it.

    The walk is one of a scenario, perhaps the user's `own`, or `recorded` in files with sums and a way of `reading`.
    """
    loop = reading.calibration if recorded else None
    made_with: dict[str, Any] = {
        "method": parameters_of(key.method),
        "stances": StanceParameters(),
        "magnetometer": {LOOP: loop, WALK: WalkCalibrationParameters()}.get(key.magnetometer),
        "walk": files if recorded else _scenario_in_words(key.group, key.field, own),
    }
    if reading.format is not None:
        made_with["format"] = reading.format
    return dict(plain(made_with))


@cache
def parameters_of(method: str) -> Any:
    """Effective parameters of a method, or why it has none, as it tells them after a short walk.

    Changes stand beside those of the same method without: a grid of them needs no walk each.
    """
    one = method_of(method)
    if one.changes:
        return {"changed": plain(parameters_of(one.base)), "changes": plain(dict(one.changes))}
    try:
        return plain(solved(_probe(), method).solution.parameters)
    except EstimationError as error:
        return str(error)


@cache
def _probe() -> Session:
    return replace(prepare(simulate(*PROBE).recording, Options(heading_deg=0.0)), truth=None)


@cache
def _scenario_in_words(name: str, level: str, own: Own | None) -> dict[str, Any]:
    one = Choices(field=level).applied_to(scenario(name) if own is None else own.scenario)
    told = {
        "worn": one.worn,
        "site": one.site,
        "field": (level, MIXTURES.get(level)),
        "magnets": one.magnets,
        "sensor": one.prior,
    }
    if own is not None:
        told |= {"course": own.course, "aligned": one.aligned}
    return dict(plain(told))
