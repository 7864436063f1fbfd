"""The experiments of Munoz Diaz et al. (2017): what gravity and the field show of gyro biases in a pocket.

`walks` has two walks a seed, which stand for the paper's two recorded ones. On them are tried

========== =========================================================================================================
as printed the paper's filter, its equations as they stand, misprints and all (`as_printed`)
filter     with these corrected; gravity by a mean over two strides
batch      `fg_nav.pocket.smooth_pocket`, an iterated Kalman smoother of the whole walk
online     `fg_nav.lab.follow_pocket`, the same with a fixed lag: each estimate is made of what was there until then
========== =========================================================================================================

The graph is given what the filter assumes: that the emulated sensor of the first walk has no errors of scale and axes,
and a magnetometer that is off by its white error only. The MTw of the second walk may have them. The position is that
of the thigh's steps (`fg_nav.pocket.dead_reckoning`), the constant of their length calibrated by the whole walk.

Figures are read off these runs. Biases are in deg/s, axis z along the thigh. MD (21) as printed is a case of its own.
Pictures are Figures 5, 8 to 11, 13 and 14 in the paper's layout: axes of the sensor are blue, red and green as there,
thin lines are one sigma to either side, dashes what is true.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EstimationError
from fg_nav.frames import compute_heading
from fg_nav.lab import palette
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.reproduce.drawing import new_panels
from fg_nav.lab.reproduce.munoz_diaz2017 import as_printed
from fg_nav.lab.reproduce.munoz_diaz2017 import walks as simulated
from fg_nav.lab.reproduce.munoz_diaz2017.walks import (
    BATCH,
    FIELDS_UT,
    FILTER,
    FIRST,
    ONLINE,
    PRINTED,
    SECOND_NOISES_UT,
    Case,
    Setting,
)
from fg_nav.lab.reproduce.results import Line, Planned, Spread, spread_of
from fg_nav.lab.reproduce.runner import Found, Made, Paper, Parts
from fg_nav.lab.simulation import simulate
from fg_nav.lab.store.results import Arrays, Measurement
from fg_nav.pocket import PocketParameters, PocketSmootherParameters, PocketTrack, estimate_pocket, level_start
from fg_nav.pocket.dead_reckoning import calibrate_step_length, reckon_path
from fg_nav.pocket.iterated_smoother import smooth_pocket
from fg_nav.pocket.steps import estimate_swing, find_steps
from fg_nav.recording import Recording
from fg_nav.report.plots import style
from fg_nav.text import to_json

FOG_HOURS, ALLAN_HOURS = 1.0, 14.0  # As in the paper.
OURS, EXPECTED = "ours", "by the field"  # Columns of what no estimator has a hand in.
OWN = ("rest", "sensor", "across")  # Such figures.
AXES = "xyz"
NEAR_MIN = 0.3  # While one passes a car.
BLUNT_MIN = 0.5  # Means over half a minute, in which strides do not count.

GRAPHS = {True: PocketSmootherParameters(gyr_scale_sigma=1e-5, mag_left_uT=1e-3), False: PocketSmootherParameters()}
"""Parameters of the graph, by whether the sensor is emulated; a thousandth of what a real one has stands for none."""

FILTERS: Mapping[str, tuple[PocketParameters, Callable[..., PocketTrack]]] = {
    PRINTED: (as_printed.PRINTED, as_printed.estimate_as_printed),
    FILTER: (PocketParameters(), estimate_pocket),
}


def list_parts(seeds: Sequence[int], quick: bool) -> Parts:
    """One measurement a seed; quick without the other noises of the second walk's magnetometer."""
    name = f"munoz-diaz2017_{{}}{'_quick' if quick else ''}"
    return {"seed": [Measurement(name.format(seed), partial(measure_seed, seed, quick)) for seed in seeds]}


def read_run(made: Made) -> Found:
    """Figures of each seed, and the pictures of the first."""
    lines = [line for planned in made.table.experiments for line in planned.lines(made.levels)]
    values: dict[object, dict[str, list[float]]] = {(line.measure, line.of, line.over): {} for line in lines}
    drawn: dict[str, dict[str, Figure]] = {}
    for part in made.parts["seed"]:
        seed = seed_of(part.load(made.folder))
        drawn = drawn or draw_all(seed, made.table.experiments)
        for line in lines:
            for column, value in read_line(seed, line).items():
                if not math.isnan(value):
                    values[line.measure, line.of, line.over].setdefault(column, []).append(value)

    def measure(line: Line) -> dict[str, Spread]:
        return {column: spread_of(some) for column, some in values[line.measure, line.of, line.over].items()}

    # effective parameters; the noise of the magnetometer and the detector are those of the case
    parameters: dict[str, object] = {name: of for name, (of, _) in FILTERS.items()}
    parameters |= {f"{BATCH} and {ONLINE}, {walk} walk": GRAPHS[walk == "first"] for walk in ("first", "second")}
    return Found({str(line.measure[0]): measure for line in lines}, drawn, dict(to_json(parameters)))


PAPER = Paper(list_parts, read_run)


# --- one seed --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """What an estimator made of a walk, once a second (M rows)."""

    minute: Floats  # (M,) min.
    bias: Floats  # (M, 3) deg/s,
    sigma: Floats  # and its sigma.
    yaw_error: Floats  # (M,) deg, unwrapped, zero at the start.
    strength: Floats | None  # (M,) uT as measured; None without a magnetometer.
    used: Bools  # (M,) whether the differential field update was used.
    path: Floats  # (K, 2) m, places after each stride by dead reckoning; NaN where no step is found.


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
    headings = {
        name: np.unwrap(compute_heading(walk.attitude)) for name, walk in (("first", first), ("second", second))
    }
    arrays: dict[str, Any] = {}
    for walk, setting in settings.items():
        arrays |= {f"setting/{walk}/{name}": value for name, value in vars(setting).items()}
    # what each estimator makes of each case
    noise_uT = SECOND_NOISES_UT[0]
    for case in simulated.list_cases(quick):
        if case in FIRST:
            recording = simulated.record_first(first, case.name, seed)
        else:
            if case.mag_sigma_uT != noise_uT:
                noise_uT = case.mag_sigma_uT
                second = simulated.simulate_second(seed, noise_uT)
            recording = simulated.record_second(second, case.name, seed)
        heading = headings[walk_of(case)]
        for name in case.by:
            columns: dict[str, Any] = {"ended": True}
            try:
                start = level_start(recording, float(heading[0]))
                if name in FILTERS:
                    parameters, estimate = FILTERS[name]
                    chosen = replace(parameters, field_gated=case.gated, mag_sigma_uT=case.mag_sigma_uT)
                    track = estimate(recording, chosen, start)
                else:
                    graph = replace(GRAPHS[case in FIRST], mag_sigma_uT=case.mag_sigma_uT)
                    track = (smooth_pocket if name == BATCH else follow_pocket)(recording, graph, start)
                columns = vars(make_run(track, recording, heading, settings[walk_of(case)]))
            except EstimationError:
                pass
            arrays |= {f"run/{case.name}/{name}/{what}": one for what, one in columns.items() if one is not None}
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


def make_run(track: PocketTrack, recording: Recording, heading: Floats, setting: Setting) -> Run:
    """Once a second, and the way by dead reckoning with the length of the whole walk; `heading` (N,) rad is true."""
    try:
        swing = estimate_swing(recording, track, with_force=False)
        steps = find_steps(recording.t, swing.flexion, swing.up_now)
        path = reckon_path(track, swing, steps, calibrate_step_length(steps, setting.length_m))
        places = np.stack([np.interp(setting.ends, track.t[path.sample], axis) for axis in path.position.T[:2]], axis=1)
    except EstimationError:
        places = np.full((len(setting.ends), 2), np.nan)
    yaw, rows = np.degrees(np.unwrap(compute_heading(track.nav_R_body)) - heading), slice(None, None, 100)
    return Run(
        minute=track.t[rows] / 60.0,
        bias=np.degrees(track.gyro_bias[rows]),
        sigma=np.degrees(track.sigma[rows, 3:]),
        yaw_error=yaw[rows] - yaw[0],
        strength=None if recording.mag is None else np.linalg.norm(recording.mag[rows], axis=1),
        used=track.field_used[rows],
        path=places,
    )


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


# --- its figures -----------------------------------------------------------------------------------------------------


def read_line(seed: Seed, line: Line) -> dict[str, float]:
    """A row of one seed, by column: NaN where the walk has nothing to read it off, infinite where a method ended."""
    what, *arguments = line.measure
    if what in OWN:
        return {EXPECTED if what == "across" else OURS: read_own(seed, str(what), *map(str, arguments))}
    given = [AXES.index(one) if isinstance(one, str) else one for one in arguments]

    def read_case(case: str) -> dict[str, float]:
        runs, setting = seed.runs[case].items(), seed.settings[case]
        return {by: math.inf if run is None else read_run_figure(str(what), run, setting, *given) for by, run in runs}

    if line.of not in seed.runs:
        return {}
    ours = read_case(line.of)
    if line.over:
        other = read_case(line.over)
        ours = {name: ratio(value, other[name]) for name, value in ours.items() if name in other}
    if line.over and line.of in FIELDS_UT:  # the mean square of the field across the thigh sets the time it takes
        ours[EXPECTED] = (read_own(seed, "across", line.over) / read_own(seed, "across", line.of)) ** 2
    return ours


def read_own(seed: Seed, what: str, of: str, axis: str = "x") -> float:
    """What no estimator has a hand in.

    `across` is the rms field across the thigh at a site, uT, and `sensor` an error of Tables 2 and 3, deg/s. `rest` is
    the largest angle of an hour at rest, deg, by how; or what Figure 5 is read for, as decimal logarithms of a ratio:
    of the MTw's over the FOG's, white noise at 1 s and lowest point, and, of the FOG over the MTw, where that lies.
    """
    if what == "across":
        return float(seed.own["sensor/across"][list(FIELDS_UT).index(of)])
    if what == "sensor":
        return float(seed.own[f"sensor/{of}"][AXES.index(axis)])
    if f"rest/{of}" in seed.own:
        return float(seed.own[f"rest/{of}"])
    tau_s, curves = seed.own["allan/tau_s"], {}
    for name in ("fog", "mems"):
        points = [(np.interp(1.0, tau_s, one), one.min(), tau_s[np.argmin(one)]) for one in seed.own[f"allan/{name}"]]
        curves[name] = np.median(points, axis=0)
    white, lowest, at = np.log10(curves["mems"] / curves["fog"])
    return float({"white": white, "lowest": lowest, "at": -at}[of])


def read_run_figure(what: str, run: Run, setting: Setting, *given: float) -> float:
    """A figure of a run by the name that the table has for it; biases of an axis, yaw errors in deg."""
    minute, bias, yaw = run.minute, run.bias, run.yaw_error
    first, *rest = given or (0,)
    of_axis = bias[:, int(first)] if what in BIASES else bias[:, 2]
    match what:
        case "reached":  # minute at which it first is as far from zero as a level, to the same side; infinite for never
            there = np.flatnonzero(of_axis * np.sign(rest[0]) >= abs(rest[0]))
            return float(minute[there[0]]) if len(there) else math.inf
        case "for_good":  # minute from which on it stays so; infinite where it does not at the end
            short = np.flatnonzero(of_axis * np.sign(rest[0]) < abs(rest[0]))
            since = short[-1] + 1 if len(short) else 0
            return float(minute[since]) if since < len(minute) else math.inf
        case "at_end" | "from_zero":  # mean of the last minute, and how far that is from zero
            mean = float(of_axis[minute > minute[-1] - 1.0].mean())
            return mean if what == "at_end" else abs(mean)
        case "at_minute":
            return float(np.interp(rest[0], minute, of_axis))
        case "largest":  # how far it is from the true one at most, from a minute on; which way depends on the iron
            off = np.abs(bias - setting.bias)[minute >= (rest[0] if rest else 0.0), int(first)]
            return float(off.max(initial=0.0))
        case "share_used":  # of the seconds in which the field was used
            return float(run.used.mean())
        case "jump":  # how far the z bias goes to and fro while one passes
            near = np.abs(minute - setting.passed_min[int(first)]) < NEAR_MIN
            return float(np.ptp(of_axis[near])) if near.any() else math.nan
        case "yaw_at_end":
            return float(abs(yaw[-1]))
        case "yaw_after":  # so many ways along the street
            return float(abs(np.interp(setting.ends[setting.legs < first][-1] / 60.0, minute, yaw)))
        case "away_after":  # m from the first place to that after so many ways along the street; truly none
            return float(np.linalg.norm(run.path[np.flatnonzero(setting.legs < first)[-1]]))
        case "yaw_range" | "yaw_wander":  # between two minutes: how far to and fro, and, of half minutes, up and down
            part = (minute >= first) & (minute <= rest[0])  # over how far it gets, 1 where it goes one way
            if what == "yaw_range":
                return float(np.ptp(yaw[part])) if part.any() else math.nan
            at, count = np.unique((minute[part] / BLUNT_MIN).astype(int), return_inverse=True, return_counts=True)[1:]
            means = np.bincount(at, yaw[part]) / count
            return ratio(float(np.abs(np.diff(means)).sum()), float(np.ptp(means))) if len(means) > 1 else math.nan
        case "yaw_grown":  # how much farther it is off from one share of the time to another
            begin, end = np.abs(np.interp(np.array([first, rest[0]]) * minute[-1], minute, yaw))
            return float(end - begin)
        case "yaw_range_over" | "yaw_grown_over":  # of the first two minutes or shares over that of the next two
            one, other = (read_run_figure(what[:-5], run, setting, *span) for span in (given[:2], given[2:]))
            return ratio(one, other)
    raise ValueError(f"a run has no figure '{what}'")


BIASES = ("reached", "for_good", "at_end", "from_zero", "at_minute", "largest")  # Figures of an axis.


def ratio(one: float, other: float) -> float:
    """NaN where neither came, or there is nothing to divide by."""
    if other == 0.0 or (math.isinf(one) and math.isinf(other)):
        return math.nan
    return one / other


# --- pictures --------------------------------------------------------------------------------------------------------

COLOURS = (palette.BLUE, "#CC3311", palette.GREEN)  # Of x, y and z.
BOTH, ALONE = "#CC33AA", palette.GREEN  # Trajectories by both updates and by gravity only, as in Figure 14.
DRAWN = (FILTER, ONLINE)  # Estimators whose runs are drawn.

Runs = Mapping[str, Run | None]  # Of one estimator, by case; one that ended early is left blank.


def draw_all(seed: Seed, experiments: Sequence[Planned]) -> dict[str, dict[str, Figure]]:
    """Draw the figure of each experiment that has one, by each estimator that is drawn."""
    draw: dict[str, Callable[[Mapping[str, str], Runs], Figure]] = {
        **dict.fromkeys(("D-E1", "D-E2", "D-E5"), partial(_draw_biases, seed)),
        "D-E3": partial(_draw_perturbed, seed),
        "D-E4": _draw_yaws,
        "D-E6": partial(_draw_ways, seed.settings["MTw, gravity"]),
    }
    labels = {planned.name: planned.labels for planned in experiments}
    runs = {by: {case: found[by] for case, found in seed.runs.items() if by in found} for by in DRAWN}
    found = {name: {by: make(labels[name], runs[by]) for by in DRAWN} for name, make in draw.items()}
    return {"D-E0": {"": _draw_allan(seed)}, **found}


def _draw_allan(seed: Seed) -> Figure:
    figure, [axes] = new_panels(1, 1, 3.6, 6.0)
    for sensor, line, name in (("fog", "-", "FOG"), ("mems", "--", "MTw")):
        for deviation, colour, axis in zip(seed.own[f"allan/{sensor}"], COLOURS, AXES, strict=True):
            axes.loglog(seed.own["allan/tau_s"], deviation, line, color=colour, label=f"{name} {axis}")
    axes.set(xlabel="averaging time (s)", ylabel="Allan deviation (deg/s)")
    style.head(axes, "Figure 5: gyroscopes at rest", 6)
    return figure


def _draw_biases(seed: Seed, titles: Mapping[str, str], runs: Runs) -> Figure:
    figure, panels = new_panels(1, len(titles), 3.0, 4.2 * len(titles) if len(titles) > 1 else 6.0)
    for axes, (case, title) in zip(panels, titles.items(), strict=True):
        _draw_bias(axes, seed.settings[case], runs[case], title)
    return figure


def _draw_bias(axes: Axes, setting: Setting, run: Run | None, title: str) -> None:
    axes.set(xlabel="time (min)", ylabel="bias (deg/s)")
    if run is not None:
        for axis, colour in enumerate(COLOURS):
            value, sigma = run.bias[:, axis], run.sigma[:, axis]
            axes.plot(run.minute, value, color=colour, label=AXES[axis])
            for side in (-1, 1):
                axes.plot(run.minute, value + side * sigma, color=colour, linewidth=0.4)
            axes.plot(run.minute, setting.bias[:, axis], "--", color=colour, linewidth=0.7)
        # what is drawn is what the estimates do; their uncertainty may be cut off
        shown = np.concatenate([run.bias, setting.bias])
        axes.set_ylim(float(shown.min()) - 0.05, float(shown.max()) + 0.05)
    style.head(axes, title, 3)


def _draw_perturbed(seed: Seed, titles: Mapping[str, str], runs: Runs) -> Figure:
    """Panel (b) only of who has such a run: the graph has no way without its own weighing of the field."""
    always, run, setting = "cars" in runs, runs["cars, detector"], seed.settings["cars"]
    figure, panels = new_panels(1, 3 if always else 2, 3.0, 12.6 if always else 8.4)
    if run is not None and run.strength is not None:
        panels[0].plot(run.minute, run.strength, color=palette.BLUE, linewidth=0.7, label="strength")
        if always:
            used = np.where(run.used, run.strength, np.nan)
            panels[0].plot(run.minute, used, color=COLOURS[1], linewidth=1.0, label="update active")
    for minute in setting.passed_min:
        panels[0].axvline(minute, color=style.SOFT_INK, linewidth=0.5, linestyle=":")
    panels[0].set(xlabel="time (min)", ylabel="field (uT)")
    style.head(panels[0], titles["field"], 2)
    if always:
        _draw_bias(panels[1], setting, runs["cars"], titles["cars"])
    _draw_bias(panels[-1], setting, run, titles["cars, detector"])
    return figure


def _draw_yaws(titles: Mapping[str, str], runs: Runs) -> Figure:
    figure, panels = new_panels(2, 2, 5.0)
    for axes, (case, title) in zip(panels, titles.items(), strict=True):
        run = runs[case]
        if run is not None:
            axes.plot(run.minute, run.yaw_error, color=palette.BLUE)
        axes.set(xlabel="time (min)", ylabel="yaw error (deg)")
        style.head(axes, title)
    return figure


def _draw_ways(setting: Setting, titles: Mapping[str, str], runs: Runs) -> Figure:
    figure, panels = new_panels(1, 2, 4.0)
    for axes, legs, title in zip(panels, (2, None), titles.values(), strict=True):
        part = slice(None) if legs is None else setting.legs < legs
        axes.plot(*setting.path[part].T, color=palette.ORANGE, linewidth=3, label="true")
        for case, colour, name in (("MTw, calibrated", BOTH, "both updates"), ("MTw, gravity", ALONE, "gravity only")):
            run = runs[case]
            if run is not None:
                axes.plot(*run.path[part].T, color=colour, label=name)
        axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
        axes.set_adjustable("datalim")
        style.head(axes, title, 2)
    return figure
