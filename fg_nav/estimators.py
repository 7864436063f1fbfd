"""The estimators by the names under which people ask for them.

Each takes the same recording, the same stances and the same field at their footfalls, and returns a `Solution`, so that
a comparison compares estimators and nothing else. They are imported when first called: the graph library alone takes a
second to load.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from fg_nav.changes import Changes, changed
from fg_nav.errors import EstimationError
from fg_nav.fixes import Fix
from fg_nav.magnetic import FootfallField
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances

Progress: TypeAlias = Callable[[float], None]
"""Told from time to time what fraction of the work is done."""

Mount: TypeAlias = Literal["foot", "pocket"]
"""Where the sensor is worn."""


@dataclass(frozen=True)
class Given:
    """What every estimator is given of a walk.

    Attributes
    ----------
    recording, stances : of one walk.
    field : at its footfalls; None where it is unknown.
    heading : rad clockwise from north, of the body's x axis at the start; None where it is unknown: then zero, or what
        the compass says.
    preset : of a filter's parameters (`fg_nav.ekf.presets`).
    fixes : positions known from elsewhere; of use to the smoother only.
    step_constant_m, known_distance_m : of one who walks with the sensor in a pocket (`fg_nav.pocket.dead_reckoning`).
    changes : of the method's parameters; of use to those on a foot only.
    """

    recording: Recording
    stances: Stances
    field: FootfallField | None = None
    heading: float | None = None
    preset: str = "tuned"
    fixes: tuple[Fix, ...] = ()
    step_constant_m: float | None = None
    known_distance_m: float | None = None
    changes: Changes = ()


Estimator: TypeAlias = Callable[[Given, Progress | None], Solution]


WITH_FIXES = ("smoother", "inertial")
"""Those that make use of fixes."""

SMOOTHERS = ("smoother", "inertial", "online")
"""The factor graph with the magnetic field, without, and while the walk goes on."""

FILTERS = ("iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched")
"""Each also as `-rts`: with the way back over its pass."""

POCKET_METHODS = ("pocket", "munoz-diaz2017")
"""For a sensor in a trouser pocket: orientation by the factor graph, and by the paper's filter."""

DEFAULT_METHOD: dict[Mount, str] = {"foot": "smoother", "pocket": "pocket"}


def _smoother(given: Given, progress: Progress | None) -> Solution:
    from fg_nav.smoother import SmootherParameters, smooth

    parameters = changed(SmootherParameters(), given.changes)
    return smooth(given.recording, given.stances, parameters, given.heading, progress, given.field, given.fixes)


def _inertial(given: Given, progress: Progress | None) -> Solution:
    return replace(_smoother(replace(given, field=None), progress), method="inertial")


BLOCK = 64
"""Samples that the online estimator is given at once; its estimates do not depend on it."""


def _online(given: Given, progress: Progress | None) -> Solution:
    """Push a recording through as if it were being walked; then solve it as a whole, with the stances it was given."""
    from fg_nav.online import OnlineNavigator
    from fg_nav.online.buffer import rows_of
    from fg_nav.online.smoother import OnlineOptions
    from fg_nav.smoother import SmootherParameters

    recording, field = given.recording, given.field
    parameters = changed(SmootherParameters(), given.changes)
    navigator = OnlineNavigator(OnlineOptions(given.heading, field is not None, parameters=parameters))
    rows = rows_of(recording)
    for start in range(0, len(recording), BLOCK):
        navigator.add_rows(rows[start : start + BLOCK])  # they were judged as a recording
        if progress is not None:
            progress(start / len(recording))
    return navigator.finish(progress, given.stances, field)


def _filter(method: str) -> Estimator:
    def run(given: Given, progress: Progress | None) -> Solution:
        from fg_nav.ekf.presets import run_filter

        density = _swing_density(given) if method.startswith("matched") else None
        walk = (given.recording, given.stances, given.field, given.heading)
        return run_filter(method, given.preset, *walk, density, given.changes)

    return run


def _swing_density(given: Given) -> float:
    """Noise of the rate in a swing as the smoother finds it, for the filter that is to use the same."""
    from fg_nav.smoother import SmootherParameters
    from fg_nav.smoother.problem import estimate_swing_noise

    return estimate_swing_noise(given.recording, given.stances, SmootherParameters())


def _pocket(method: str) -> Estimator:
    def run(given: Given, progress: Progress | None) -> Solution:
        from fg_nav.pocket.navigate import navigate_pocket

        lengths = (given.step_constant_m, given.known_distance_m)
        return navigate_pocket(given.recording, method, given.heading, *lengths, progress)

    return run


ESTIMATORS: dict[str, Estimator] = {
    "smoother": _smoother,
    "inertial": _inertial,
    "online": _online,
    **{method: _filter(method) for method in FILTERS},
    **{method + "-rts": _filter(method + "-rts") for method in FILTERS},
}


POCKET_ESTIMATORS: dict[str, Estimator] = {method: _pocket(method) for method in POCKET_METHODS}


def estimator(name: str, mount: Mount = "foot") -> Estimator:
    """Return the estimator of this name for a sensor worn there; raises `EstimationError` if there is none."""
    there, elsewhere = (ESTIMATORS, POCKET_ESTIMATORS) if mount == "foot" else (POCKET_ESTIMATORS, ESTIMATORS)
    if name in there:
        return there[name]
    if name in elsewhere:
        other = "pocket" if mount == "foot" else "foot"
        raise EstimationError(f"{name} is for --mount {other}: choose one of {', '.join(there)}.")
    raise EstimationError(f"there is no method '{name}': choose one of {', '.join(there)}.")


def parameters_of(method: str, preset: str = "tuned") -> object:
    """Return the parameters of a method on a foot, a frozen dataclass, as it begins with them.

    Raises
    ------
    EstimationError
        If there is no such method, or no such preset of it.
    """
    estimator(method)
    if method in SMOOTHERS:
        from fg_nav.smoother import SmootherParameters

        return SmootherParameters()
    from fg_nav.ekf.presets import find_parameters as of_filter

    return of_filter(method, preset)
