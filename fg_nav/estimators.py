"""The estimators by the names under which people ask for them.

Each takes the same `Walk` and returns a `Solution`, so that a comparison compares estimators and nothing else. They are
imported when first called: the graph library alone takes a second to load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, TypeAlias

from fg_nav.changes import Changes, change_parameters, explain_no_parameter, list_names, select_changes
from fg_nav.detection import StanceParameters
from fg_nav.errors import EstimationError, FgNavError
from fg_nav.solution import Solution
from fg_nav.walk import DETECTOR, WITH_FIXES, Mount, Options, Walk

if TYPE_CHECKING:
    from fg_nav.calibration.of_recording import Calibration
    from fg_nav.online.pocket import Navigator
    from fg_nav.recording import Recording
    from fg_nav.smoother import SmootherParameters

Progress: TypeAlias = Callable[[float], None]  # Called from time to time with the fraction of the work that is done.

Estimator: TypeAlias = Callable[[Walk, Progress | None], Solution]

ONLINE = "online"
SMOOTHER = "smoother"
CARD: Literal["card"] = "card"  # The smoother with `Options.magnetic` "card".
CARD_CHANGES: Changes = (("magnetic.potential", False), ("walk.places", False))  # What makes it of the smoother.
WITH_EXTRA = ("smoother", CARD, "inertial")  # Take the user's own factors: a walk in progress lacks variables.
SMOOTHERS = (SMOOTHER, CARD, "inertial", ONLINE)  # With the field, with compass and differential, without, online.
FILTERS = ("iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched")  # Each also as `-rts`, smoothed.
WITH_OWN_DETECTOR = tuple(name + end for name in FILTERS if name != "iez" for end in ("", "-rts"))
"""Filters with a compass: a detector of their preset judges the field."""

POCKET_METHODS = ("pocket", "munoz-diaz2017")  # Trouser pocket: factor graph, the paper's filter; and `ONLINE`.
DEFAULT_METHOD: dict[Mount, str] = {"foot": "smoother", "pocket": "pocket"}


def choose_parameters(options: Options, calibration: Calibration | None = None) -> SmootherParameters:
    """Return the parameters of the smoother for these options and the calibration of the sensor.

    Later ones prevail: calibrated gyroscope bias, gate, changes of the options, "card".
    """
    from fg_nav.smoother import SmootherParameters

    card = CARD_CHANGES if options.magnetic == CARD else ()
    changes = select_changes(options.changes, SMOOTHER)
    known = None if calibration is None else calibration.gyroscope
    parameters = SmootherParameters() if known is None else SmootherParameters(**known.prior)
    return change_parameters(parameters, (("magnetic.gate", options.gate), *changes, *card))


def _smoother(walk: Walk, progress: Progress | None) -> Solution:
    from fg_nav.smoother import smooth

    extra, start = walk.extra, None
    if walk.gnss is not None:  # which is not combined with factors of the user's own (`walk.check_known`)
        from fg_nav.gnss import describe_fixes
        from fg_nav.smoother.constraints import make_gnss_factors

        extra, start = make_gnss_factors(walk.gnss)
    parameters, heading = choose_parameters(walk.options, walk.calibration), walk.options.heading_rad
    given = (walk.field, walk.fixes, extra, walk.known)
    solution = smooth(walk.recording, walk.stances, parameters, heading, progress, *given)
    if start is None:
        return solution
    notes = (describe_fixes(start), *solution.notes)
    return replace(solution, notes=notes, parameters={**solution.parameters, "gnss_start": start})


def _card(walk: Walk, progress: Progress | None) -> Solution:
    return replace(_smoother(replace(walk, options=replace(walk.options, magnetic=CARD)), progress), method=CARD)


def _inertial(walk: Walk, progress: Progress | None) -> Solution:
    return replace(_smoother(replace(walk, field=None), progress), method="inertial")


BLOCK = 64  # Samples that the online estimator is given at once; its estimates do not depend on it.


def _online(walk: Walk, progress: Progress | None) -> Solution:
    """Feed a recording sample by sample to the online navigator, which finds the stances itself; return its path."""
    from fg_nav.online import OnlineNavigator
    from fg_nav.online.buffer import OnlineOptions
    from fg_nav.online.navigator import finish_walk

    options, calibration = walk.options, None if walk.calibration is None else walk.calibration.magnetometer
    given = OnlineOptions(
        heading_rad=options.heading_rad,
        use_field=walk.field is not None,
        parameters=choose_parameters(options, walk.calibration),
        axes_given=options.mag_axes is not None,
        fixes=walk.fixes,
        calibration=calibration,
    )
    navigator = OnlineNavigator(given)
    _push_recording(navigator, walk.recording if walk.sensed is None else walk.sensed, progress)
    return finish_walk(navigator, options.polish, progress, walk.stances)


def _push_recording(navigator: Navigator, recording: Recording, progress: Progress | None) -> None:
    from fg_nav.online.buffer import taken_rows

    rows = taken_rows(recording)
    for start in range(0, len(recording), BLOCK):
        navigator.add_rows(rows[start : start + BLOCK])  # they were judged as a recording
        if progress is not None:
            progress(start / len(recording))


def _filter(method: str) -> Estimator:
    def run(walk: Walk, progress: Progress | None) -> Solution:
        from fg_nav.ekf.presets import run_filter

        options = walk.options
        density = None
        if method.startswith("matched"):  # noise of the rate in a swing as the smoother finds it
            from fg_nav.smoother import SmootherParameters
            from fg_nav.smoother.problem import estimate_swing_noise

            density = estimate_swing_noise(walk.recording, walk.stances, SmootherParameters())
        given = (walk.recording, walk.stances, walk.field, options.heading_rad)
        return run_filter(method, options.preset, *given, density, select_changes(options.changes, find_owner(method)))

    return run


def _pocket(method: str) -> Estimator:
    def run(walk: Walk, progress: Progress | None) -> Solution:
        from fg_nav.pocket.navigate import navigate_pocket

        options = walk.options
        lengths = (options.step_constant_m, options.known_distance_m)
        return navigate_pocket(walk.recording, method, options.heading_rad, *lengths, progress, walk.gnss)

    return run


def _pocket_online(walk: Walk, progress: Progress | None) -> Solution:
    """Feed a pocket recording sample by sample to the online pocket navigator; return its path."""
    from fg_nav.online.navigator import finish_walk
    from fg_nav.online.pocket import PocketNavigator, PocketOptions

    options = walk.options
    if options.known_distance_m is not None:
        raise EstimationError(
            f"{ONLINE} does not know how far a walk will go: give --step-constant in place of --known-distance."
        )
    given = options.heading_rad, walk.recording.mag is not None, options.step_constant_m, options.mag_axes is not None
    navigator = PocketNavigator(PocketOptions(*given))
    _push_recording(navigator, walk.recording, progress)
    return finish_walk(navigator, options.polish, progress)


ESTIMATORS: dict[str, Estimator] = {
    "smoother": _smoother,
    CARD: _card,
    "inertial": _inertial,
    ONLINE: _online,
    **{method: _filter(method) for method in FILTERS},
    **{method + "-rts": _filter(method + "-rts") for method in FILTERS},
}

POCKET_ESTIMATORS: dict[str, Estimator] = {
    **{method: _pocket(method) for method in POCKET_METHODS},
    ONLINE: _pocket_online,
}


def estimate(walk: Walk, method: str, progress: Progress | None = None) -> Solution:
    """Solve a walk by the method of this name.

    Raises
    ------
    EstimationError
        If there is no such method, if it makes no use of the fixes that were given, or cannot solve this walk.
    """
    run = find_estimator(method, walk.options.mount or "foot")
    given = walk.options.fixes_path is not None or len(walk.fixes) > 0
    if given and method not in WITH_FIXES:
        raise EstimationError(f"{method} makes no use of fixes: leave them out, or choose {' or '.join(WITH_FIXES)}.")
    if walk.gnss is not None and method not in (*WITH_EXTRA, *POCKET_METHODS):
        methods = ", ".join((*WITH_EXTRA, *POCKET_METHODS))
        raise EstimationError(f"{method} makes no use of GNSS: leave it out, or choose one of {methods}.")
    if walk.extra is not None and method not in WITH_EXTRA:
        raise EstimationError(f"{method} has no graph to add to: leave extra out, or choose {' or '.join(WITH_EXTRA)}.")
    with blaming_changes(method, walk.options):
        solution = run(walk, progress)
    return solution if walk.options.mount == "pocket" else solution.widen(walk.recording.provenance.rate_sigma)


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


def find_owner(method: str) -> str:
    """Return the first part of the names of a method's parameters (`Options.changes`)."""
    return SMOOTHER if method in SMOOTHERS else method.removesuffix("-rts")


def check_changes(options: Options) -> None:
    """Raise `EstimationError` for a change of what is no parameter of the smoother, a filter or the stances."""
    for name, _ in options.changes:
        owner = name.partition(".")[0]
        owner = owner if owner in (*FILTERS, DETECTOR) else SMOOTHER
        parameters = StanceParameters() if owner == DETECTOR else find_parameters(owner, options.preset)
        known = [f"{owner}.{own}" for own in list_names(parameters)]
        if name not in known:
            raise EstimationError(explain_no_parameter(name, known))


def find_given_parameters(method: str, options: Options, calibration: Calibration | None = None) -> object:
    """Return the parameters that a method on a foot begins with; what it estimates of them in a walk is not in them."""
    if method in SMOOTHERS:
        return choose_parameters(replace(options, magnetic=CARD) if method == CARD else options, calibration)
    return change_parameters(
        find_parameters(method, options.preset), select_changes(options.changes, find_owner(method))
    )


def find_estimator(name: str, mount: Mount = "foot") -> Estimator:
    """Return the estimator of this name for a sensor worn there; raises `EstimationError` if there is none."""
    there, elsewhere = (ESTIMATORS, POCKET_ESTIMATORS) if mount == "foot" else (POCKET_ESTIMATORS, ESTIMATORS)
    if name in there:
        return there[name]
    if name in elsewhere:
        other = "pocket" if mount == "foot" else "foot"
        raise EstimationError(f"{name} is for --mount {other}: choose one of {', '.join(there)}.")
    raise EstimationError(f"there is no method '{name}': choose one of {', '.join(there)}.")


def find_parameters(method: str, preset: str = "tuned") -> object:
    """Return the default parameters of a foot method, a frozen dataclass, in a preset.

    Raises
    ------
    EstimationError
        If there is no such method, or no such preset of it.
    """
    find_estimator(method)
    if method in SMOOTHERS:
        from fg_nav.smoother import SmootherParameters

        return change_parameters(SmootherParameters(), CARD_CHANGES if method == CARD else ())
    from fg_nav.ekf.presets import find_parameters as of_filter

    return of_filter(method, preset)
