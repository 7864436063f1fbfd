"""What the estimators make of the walks of Munoz Diaz et al. (2017): orientation, bias, and the way by dead reckoning.

========== =========================================================================================================
as printed the paper's filter, its equations as they stand, misprints and all (`as_printed`)
filter     with these corrected; gravity by a mean over two strides
batch      `fg_nav.pocket.smooth_pocket`, an iterated Kalman smoother of the whole walk
online     `fg_nav.lab.follow_pocket`, the same with a fixed lag: each estimate is made of what was there until then
========== =========================================================================================================

The graph is given what the filter assumes: that the emulated sensor of the first walk has no errors of scale
and axes, and a magnetometer that is off by its white error only. The MTw of the second walk may have them.

The position is that of the thigh's steps (`fg_nav.pocket.dead_reckoning`), the constant of their length calibrated by
the whole walk.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EstimationError
from fg_nav.frames import compute_heading
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.reproduce.munoz_diaz2017 import as_printed
from fg_nav.lab.reproduce.munoz_diaz2017 import walks as simulated
from fg_nav.lab.reproduce.munoz_diaz2017.walks import BATCH, FILTER, FIRST, PRINTED, SECOND_NOISES_UT, Case, Setting
from fg_nav.lab.simulation import simulate
from fg_nav.lab.store.results import Arrays
from fg_nav.pocket import PocketParameters, PocketSmootherParameters, PocketTrack, estimate_pocket, level_start
from fg_nav.pocket.dead_reckoning import calibrate_step_length, reckon_path
from fg_nav.pocket.iterated_smoother import smooth_pocket
from fg_nav.pocket.steps import estimate_swing, find_steps
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth


@dataclass(frozen=True)
class Run:
    """What an estimator made of a walk, once a second (M rows).

    Attributes
    ----------
    minute : (M,) min.
    bias, sigma : (M, 3) deg/s.
    yaw_error : (M,) deg, unwrapped, zero at the start.
    strength : (M,) uT as measured; None without a magnetometer.
    used : (M,) whether the differential field update was used.
    path : (K, 2) m, places after each stride by dead reckoning.
    """

    minute: Floats
    bias: Floats
    sigma: Floats
    yaw_error: Floats
    strength: Floats | None
    used: Bools
    path: Floats


GRAPHS = {True: PocketSmootherParameters(gyr_scale_sigma=1e-5, mag_left_uT=1e-3), False: PocketSmootherParameters()}
"""Parameters of the graph, by whether the sensor is emulated; a thousandth of what a real one has stands for none."""

FILTERS: Mapping[str, tuple[PocketParameters, Callable[..., PocketTrack]]] = {
    PRINTED: (as_printed.PRINTED, as_printed.estimate_as_printed),
    FILTER: (PocketParameters(), estimate_pocket),
}


def estimate(name: str, recording: Recording, case: Case, heading: float) -> PocketTrack:
    """By one estimator, from the heading at the start."""
    start = level_start(recording, heading)
    if name in FILTERS:
        parameters, run = FILTERS[name]
        return run(recording, replace(parameters, field_gated=case.gated, mag_sigma_uT=case.mag_sigma_uT), start)
    graph = smooth_pocket if name == BATCH else follow_pocket
    return graph(recording, replace(GRAPHS[case in FIRST], mag_sigma_uT=case.mag_sigma_uT), start)


def run_estimators(recording: Recording, case: Case, setting: Setting) -> dict[str, Run | None]:
    """What each estimator of a case makes of a recording; None where it ended."""
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    heading = float(compute_heading(truth.nav_R_body[0]))
    found: dict[str, Run | None] = {}
    for name in case.by:
        try:
            track = estimate(name, recording, case, heading)
        except EstimationError:
            found[name] = None
        else:
            found[name] = make_run(track, recording, truth.nav_R_body, setting)
    return found


def make_run(track: PocketTrack, recording: Recording, true_R: Floats, setting: Setting) -> Run:
    """Once a second, and the way by dead reckoning."""
    yaw = np.degrees(np.unwrap(compute_heading(track.nav_R_body)) - np.unwrap(compute_heading(true_R)))
    rows = slice(None, None, 100)
    strength = None if recording.mag is None else np.linalg.norm(recording.mag[rows], axis=1)
    return Run(
        minute=track.t[rows] / 60.0,
        bias=np.degrees(track.gyro_bias[rows]),
        sigma=np.degrees(track.sigma[rows, 3:]),
        yaw_error=yaw[rows] - yaw[0],
        strength=strength,
        used=track.field_used[rows],
        path=reckon_places(track, recording, setting),
    )


def reckon_places(track: PocketTrack, recording: Recording, setting: Setting) -> Floats:
    """Places (K, 2) m at the end of each stride: steps of the thigh, their length from that of the whole walk.

    NaN where there is no step to be found.
    """
    try:
        swing = estimate_swing(recording, track, with_force=False)
        steps = find_steps(recording.t, swing.flexion, swing.up_now)
        path = reckon_path(track, swing, steps, calibrate_step_length(steps, setting.length_m))
    except EstimationError:
        return np.full((len(setting.ends), 2), np.nan)
    return np.stack([np.interp(setting.ends, track.t[path.sample], axis) for axis in path.position.T[:2]], axis=1)


# --- one seed --------------------------------------------------------------------------------------------------------

FOG_HOURS, ALLAN_HOURS = 1.0, 14.0  # As in the paper.


@dataclass(frozen=True)
class Seed:
    """Both walks of a seed: what is true of them and what the estimators made of each case, None where one ended.

    `own` has what no estimator has a hand in: `rest/` angles of an hour at rest by how, deg, `sensor/` errors as in
    Tables 2 and 3, and `across` (`measure_sensor_errors`), `allan/` curves (`measure_allan_curves`).
    """

    settings: Mapping[str, Setting]
    runs: Mapping[str, Mapping[str, Run | None]]
    own: Mapping[str, Floats]


def measure_seed(seed: int, quick: bool) -> Arrays:
    """Walk and estimate; arrays for `seed_of`, by names with slashes."""
    first, second = simulate(simulated.FIRST_WALK, seed), simulated.simulate_second(seed, SECOND_NOISES_UT[0])
    settings = {"first": simulated.read_setting(first), "second": simulated.read_setting(second)}
    arrays: dict[str, Any] = {}
    for walk, setting in settings.items():
        arrays |= {f"setting/{walk}/{name}": value for name, value in vars(setting).items()}
    # what each estimator makes of each case
    for case in simulated.list_cases(quick):
        if case in FIRST:
            recording = simulated.record_first(first, case.name, seed)
        else:
            if case.mag_sigma_uT != simulated.noise_of(second):
                second = simulated.simulate_second(seed, case.mag_sigma_uT)
            recording = simulated.record_second(second, case.name, seed)
        for name, run in run_estimators(recording, case, settings[walk_of(case)]).items():
            columns = {} if run is None else {what: one for what, one in vars(run).items() if one is not None}
            arrays |= {f"run/{case.name}/{name}/{what}": one for what, one in (columns or {"ended": True}).items()}
    # what no estimator has a hand in
    own: dict[str, Mapping[str, Any]] = {
        "rest": simulated.measure_fog_errors(seed, FOG_HOURS),
        "allan": simulated.measure_allan_curves(seed, ALLAN_HOURS),
        "sensor": simulated.measure_sensor_errors(first, second),
    }
    arrays |= {f"own/{kind}/{name}": one for kind, some in own.items() for name, one in some.items()}
    # single precision is far finer than any figure, and makes some megabytes of a seed
    found = {name: np.asarray(value) for name, value in arrays.items()}
    return {name: one.astype(np.float32) if one.dtype == np.float64 else one for name, one in found.items()}


def walk_of(case: Case) -> str:
    """Which of the two walks a case is of."""
    return "first" if case in FIRST else "second"


def seed_of(arrays: Arrays) -> Seed:
    """What `measure_seed` made."""

    def under(prefix: str) -> dict[str, Any]:
        return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}

    walks = {walk: Setting(**under(f"setting/{walk}/")) for walk in ("first", "second")}
    settings: dict[str, Setting] = {}
    runs: dict[str, dict[str, Run | None]] = {}
    for case in simulated.list_cases(quick=False):
        for name in case.by:
            if columns := under(f"run/{case.name}/{name}/"):
                run = None if "ended" in columns else Run(**{"strength": None, **columns})
                runs.setdefault(case.name, {})[name] = run
                settings[case.name] = walks[walk_of(case)]
    return Seed(settings, runs, under("own/"))
