"""The methods by name: one table of what estimates a walk, and of what each makes use of.

Each takes the same `Walk` and returns a `Solution`, so that a comparison compares estimators and nothing else. Their
packages are imported when first called: the graph library alone takes a second to load. Other packages add methods of
their own by entry points (`fg_nav.plugins`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeAlias

from fg_nav.errors import EstimationError, FgNavError
from fg_nav.text import DETECTOR, Changes, change_parameters, explain_no_parameter, list_names, select_changes

if TYPE_CHECKING:
    from fg_nav.calibration.of_recording import Calibration
    from fg_nav.smoother import SmootherParameters
    from fg_nav.solution import Solution
    from fg_nav.walk import Magnetic, Mount, Options, Walk

Progress: TypeAlias = Callable[[float], None]  # Called from time to time with the fraction of the work that is done.

Estimator: TypeAlias = Callable[["Walk", Progress | None], "Solution"]

Use: TypeAlias = Literal["fixes", "gnss", "extra", "places", "feet", "gate", "magnetic", "preset", "polish", "stances"]


@dataclass(frozen=True)
class Method:
    """An estimator, and what it makes use of."""

    name: str  # Under which people ask for it; its solutions have it too.
    run: Estimator  # Solves a walk, and reports the fraction of the work that is done from time to time.
    mount: Mount = "foot"  # Where the sensor is worn.
    uses_field: bool = True  # Whether its path depends on the magnetic field.
    # "fixes", "gnss", "places" of an earlier walk, "extra" factors; both "feet" in one graph; a "gate" on the field
    # (others judge it by their own detector), a choice of "magnetic" factors, a "preset"; can "polish"; the "stances"
    # of the walk (others find them on the way)
    uses: frozenset[Use] = frozenset()
    owner: str = ""  # First part of the names of its parameters (`Options.changes`).
    # Its frozen dataclass of parameters before it estimates some of them in a walk; None for a method that has none.
    parameters: Callable[[Options, Calibration | None], object] | None = None


USE_WORDS: dict[Use, str] = {
    "fixes": "fixes",
    "gnss": "GNSS",
    "extra": "extra factors",
    "places": "saved places",
    "feet": "the other foot",
    "gate": "--gate",
    "magnetic": "--magnetic",
    "preset": "--preset",
    "polish": "--polish",
}

CARD: Literal["card"] = "card"  # The smoother with `Options.magnetic` "card".
CARD_CHANGES: Changes = (("magnetic.potential", False), ("walk.places", False))  # What makes it of the smoother.
SMOOTHER = "smoother"
RTS = "-rts"  # Behind the name of a filter: smoothed backward.
LOG = logging.getLogger(__name__)

BLOCK = 64  # Samples that the online estimator is given at once; its estimates do not depend on it.


def choose_parameters(
    options: Options, calibration: Calibration | None = None, magnetic: Magnetic | None = None
) -> SmootherParameters:
    """Return the parameters of the smoother for these options and the calibration of the sensor.

    Later ones prevail: calibrated gyroscope bias, gate, changes of the options, "card" as they or `magnetic` say.
    """
    from fg_nav.smoother import SmootherParameters

    known = None if calibration is None else calibration.gyroscope
    parameters = SmootherParameters() if known is None else SmootherParameters(**known.prior)
    card = CARD_CHANGES if (magnetic or options.magnetic) == CARD else ()
    changes = (("magnetic.gate", options.gate), *select_changes(options.changes, SMOOTHER), *card)
    return change_parameters(parameters, changes)


def _smoother(
    walk: Walk, progress: Progress | None, magnetic: Magnetic | None = None, use_field: bool = True
) -> Solution:
    from fg_nav.smoother import smooth

    extra, start = walk.extra, None
    if walk.gnss is not None:  # which is not combined with factors of the user's own (`walk.check_known`)
        from fg_nav.smoother.constraints import make_gnss_factors
        from fg_nav.truth import describe_fixes

        extra, start = make_gnss_factors(walk.gnss)
    parameters = choose_parameters(walk.options, walk.calibration, magnetic)
    given = (walk.field if use_field else None, walk.fixes, extra, walk.known)
    solution = smooth(walk.recording, walk.stances, parameters, walk.options.heading_rad, progress, *given)
    if start is None:
        return solution
    notes = (describe_fixes(start), *solution.notes)
    return replace(solution, notes=notes, parameters={**solution.parameters, "gnss_start": start})


def _online(walk: Walk, progress: Progress | None) -> Solution:
    """Feed a recording to the online navigator, which finds stances or strides itself; return its path."""
    from fg_nav.online.buffer import OnlineOptions, taken_rows
    from fg_nav.online.navigator import finish_walk
    from fg_nav.online.pocket import begin_walk

    options, in_pocket = walk.options, walk.options.mount == "pocket"
    if in_pocket and options.known_distance_m is not None:
        raise EstimationError(
            "online does not know how far a walk will go: give --step-constant in place of --known-distance."
        )
    recording = walk.recording if walk.sensed is None else walk.sensed
    given = OnlineOptions(
        mount=options.mount or "foot",
        heading_rad=options.heading_rad,
        use_field=(recording.mag if in_pocket else walk.field) is not None,
        parameters=choose_parameters(options, walk.calibration),
        axes_given=options.mag_axes is not None,
        fixes=walk.fixes,
        calibration=None if walk.calibration is None else walk.calibration.magnetometer,
        step_constant_m=options.step_constant_m,
    )
    navigator, rows = begin_walk(given, lambda words: None), taken_rows(recording)
    for start in range(0, len(rows), BLOCK):
        navigator.add_rows(rows[start : start + BLOCK])  # they were judged as a recording
        if progress is not None:
            progress(start / len(rows))
    return finish_walk(navigator, options.polish, progress, walk.stances)


def _filter(method: str, walk: Walk, progress: Progress | None) -> Solution:
    from fg_nav.ekf.presets import run_filter

    options, density = walk.options, None
    if method.startswith("matched"):  # noise of the rate in a swing as the smoother finds it
        from fg_nav.smoother import SmootherParameters
        from fg_nav.smoother.problem import estimate_swing_noise

        density = estimate_swing_noise(walk.recording, walk.stances, SmootherParameters())
    given = (walk.recording, walk.stances, walk.field, options.heading_rad)
    changes = select_changes(options.changes, method.removesuffix(RTS))
    return run_filter(method, options.preset, *given, density, changes)


def _choose_of_filter(method: str, options: Options, calibration: Calibration | None) -> object:
    """Return the parameters of a filter in its preset, with the changes."""
    from fg_nav.ekf.presets import find_parameters as of_filter

    changes = select_changes(options.changes, method.removesuffix(RTS))
    return change_parameters(of_filter(method, options.preset), changes)


def _pocket(method: str, walk: Walk, progress: Progress | None) -> Solution:
    from fg_nav.pocket.navigate import navigate_pocket

    options = walk.options
    lengths = (options.step_constant_m, options.known_distance_m)
    return navigate_pocket(walk.recording, method, options.heading_rad, *lengths, progress, walk.gnss)


def _list_filters() -> Iterator[Method]:
    """Yield the filters of the papers: those with a compass judge the field by a detector of their preset."""
    for end in ("", RTS):
        for name in ("iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched"):
            uses: frozenset[Use] = frozenset(("preset", "stances", *(("gate",) if name == "iez" else ())))
            run, parameters = partial(_filter, name + end), partial(_choose_of_filter, name + end)
            yield Method(name + end, run, uses_field=name != "iez", uses=uses, owner=name, parameters=parameters)


_OF_GRAPH: frozenset[Use] = frozenset(("fixes", "gnss", "extra", "gate", "stances"))
_OF_BOTH: frozenset[Use] = frozenset(("places", "feet"))
_OF_STREAM: frozenset[Use] = frozenset(("fixes", "gate", "magnetic", "polish"))
_GNSS: frozenset[Use] = frozenset(("gnss",))
_GRAPH = (SMOOTHER, choose_parameters)
_CHOOSE_CARD = partial(choose_parameters, magnetic=CARD)
_TABLE = (
    Method(SMOOTHER, _smoother, "foot", True, _OF_GRAPH | _OF_BOTH | {"magnetic"}, *_GRAPH),
    Method(CARD, partial(_smoother, magnetic=CARD), "foot", True, _OF_GRAPH, SMOOTHER, _CHOOSE_CARD),
    Method("inertial", partial(_smoother, use_field=False), "foot", False, _OF_GRAPH | _OF_BOTH, *_GRAPH),
    Method("online", _online, "foot", True, _OF_STREAM, *_GRAPH),
    *_list_filters(),
    Method("pocket", partial(_pocket, "pocket"), "pocket", uses=_GNSS),
    Method("munoz-diaz2017", partial(_pocket, "munoz-diaz2017"), "pocket", uses=_GNSS),
    Method("online", _online, "pocket", uses=frozenset(("polish",))),
)
_MOUNTS: tuple[Mount, ...] = ("foot", "pocket")
METHODS: dict[Mount, dict[str, Method]] = {
    mount: {one.name: one for one in _TABLE if one.mount == mount} for mount in _MOUNTS
}
"""By where the sensor is worn, and by name; the first is the default."""


def list_methods(mount: Mount = "foot") -> dict[str, Method]:
    """Return the methods for a sensor worn there by name, with those that other packages add."""
    from fg_nav.plugins import find_plugins

    added = {
        one.name: replace(one, uses=one.uses - {"feet"})  # which are solved by our graph alone
        for one in find_plugins("methods", Method).values()
        if one.mount == mount
    }
    return METHODS[mount] | {name: one for name, one in added.items() if name not in METHODS[mount]}


def name_owners() -> dict[str, str]:
    """Return the first method on a foot that has the parameters of each owner, by owner."""
    return {one.owner: one.name for one in reversed(list_methods().values()) if one.owner}


def get_method(name: str, mount: Mount = "foot") -> Method | None:
    """Return the method of this name, also one that another package adds; None if there is none."""
    return METHODS[mount].get(name) or list_methods(mount).get(name)


def find_method(name: str, mount: Mount = "foot") -> Method:
    """Return the method of this name for a sensor worn there; raises `EstimationError` if there is none."""
    found = get_method(name, mount)
    if found is not None:
        return found
    elsewhere: Mount = "pocket" if mount == "foot" else "foot"
    is_elsewhere = get_method(name, elsewhere) is not None
    words = f"{name} is for --mount {elsewhere}" if is_elsewhere else f"there is no method '{name}'"
    raise EstimationError(f"{words}: choose one of {', '.join(list_methods(mount))}.")


def check_use(method: Method, use: Use) -> None:
    """Raise `EstimationError` for what a method makes no use of."""
    if use not in method.uses:
        words = USE_WORDS[use]
        others = [one.name for one in list_methods(method.mount).values() if use in one.uses]
        choose = f", or choose {'one of ' if len(others) > 1 else ''}{', '.join(others)}" if others else ""
        raise EstimationError(f"{method.name} makes no use of {words}: leave {words} out{choose}.")


def estimate(walk: Walk, method: str, progress: Progress | None = None) -> Solution:
    """Solve a walk by the method of this name.

    Raises `EstimationError` if there is none, if it makes no use of what was given, or cannot solve this walk.
    """
    found = find_method(method, walk.options.mount or "foot")
    given: dict[Use, object] = {
        "fixes": walk.fixes or walk.options.fixes_path,  # None without
        "gnss": walk.gnss,
        "extra": walk.extra,
        "places": walk.places,
    }
    for use, one in given.items():
        if one is not None:
            check_use(found, use)
    with blaming_changes(method, walk.options):
        solution = replace(found.run(walk, progress), method=method, uses_field=found.uses_field)
    for words in (f"{method}: solved in {solution.runtime_s:.2f} s", *solution.notes):
        LOG.info(words)
    return solution if found.mount == "pocket" else solution.widen(walk.recording.provenance.rate_sigma)


@contextmanager
def blaming_changes(method: str, options: Options) -> Iterator[None]:
    """Raise `EstimationError` where a method breaks with parameters that the user set."""
    try:
        yield
    except FgNavError:
        raise
    except (ArithmeticError, RuntimeError, ValueError) as error:
        if not options.changes:
            raise
        raise EstimationError(f"{method} fails with the parameters that were set ({error}): set others.") from error


def check_changes(options: Options) -> None:
    """Raise `EstimationError` for a change of what is no parameter of the smoother, a filter or the stances."""
    from fg_nav.detection import StanceParameters

    owners = name_owners() if options.changes else {}
    for name, _ in options.changes:
        owner = name.partition(".")[0]
        owner = owner if owner in (*owners, DETECTOR) else SMOOTHER
        parameters = StanceParameters() if owner == DETECTOR else find_parameters(owners[owner], options.preset)
        known = [f"{owner}.{own}" for own in list_names(parameters)]
        if name not in known:
            raise EstimationError(explain_no_parameter(name, known))


def find_parameters(method: str, preset: str = "tuned") -> object:
    """Return the default parameters of a foot method, a frozen dataclass, in a preset.

    Raises `EstimationError` if there is no such method, it has no parameters, or no such preset.
    """
    from fg_nav.walk import Options

    found = find_method(method)
    if found.parameters is None:
        raise EstimationError(f"{method} has no parameters that could be set: leave them as they are.")
    return found.parameters(Options(preset=preset), None)
