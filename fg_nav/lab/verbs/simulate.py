"""`fg-nav simulate` and `demo`: a simulated walk with its truth (docs/simulation.md), and the methods on one."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import typer

from fg_nav.commands.run import answer_comparison
from fg_nav.commands.shared import Answer, Target, run_methods
from fg_nav.commands.stream import remark
from fg_nav.errors import SimulationError, StreamError
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.simulation import SCENARIOS, Choices, SimulatedFeet, SimulatedWalk
from fg_nav.lab.simulation import scenario as find_scenario
from fg_nav.lab.simulation import simulate as simulate_one
from fg_nav.lab.simulation import simulate_feet as simulate_both
from fg_nav.lab.simulation.fields import SITES
from fg_nav.lab.simulation.scenario_file import SUFFIX, read_scenario
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.simulation.sensors import PRESETS
from fg_nav.lab.verbs import DemoRequest, SimulateRequest
from fg_nav.online.estimates import SMOOTHED, format_table
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.sources import Replay
from fg_nav.pipeline import prepare_walk
from fg_nav.report.files import write_comparison, write_json
from fg_nav.report.folder import RESULT_FILES
from fg_nav.report.terminal import console, listing, progress
from fg_nav.system.processes import catch_signals
from fg_nav.text import find_version, format_count, to_json
from fg_nav.verdict import judge_footfalls
from fg_nav.view.outlets import open_outlets
from fg_nav.view.plan import Plan
from fg_nav.walk import Walk

Simulated = TypeVar("Simulated")

SIMULATION_FILES = frozenset({"recording.csv", "truth.tum", "truth.json", "landmarks.csv", "map.png"})
FEET_FILES = frozenset(
    {
        "left.csv", "left.truth.tum", "left.truth.json", "right.csv", "right.truth.tum", "right.truth.json",
        "person.tum", "landmarks.csv", "map.png",
    }
)  # fmt: skip
DEMO_FILES = RESULT_FILES | SIMULATION_FILES
LANDMARK_COLUMNS = ("landmark", "time_s", "x_m", "y_m", "z_m")


def simulate(request: SimulateRequest) -> Answer:
    """Simulate a scenario, or both feet of a person, into a folder; or list what there is to choose from."""
    if request.list_all:
        return list_scenarios()
    scenario, seed = request.scenario, request.seed
    if scenario is None:
        raise typer.BadParameter("name one, or a file; --list says what there is.", param_hint="SCENARIO")
    choices = Choices(
        request.sensor, request.site, request.field, request.worn, request.rate, request.turn, request.calibrated,
        rests=request.rests, feet=request.feet,
    )  # fmt: skip
    with Target(request.out, request.force, Path(scenario).stem, SIMULATION_FILES | FEET_FILES) as target:
        feet = simulate_named(simulate_both, scenario, seed, choices) if request.both_feet else None
        walk = simulate_named(simulate_one, scenario, seed, choices) if feet is None else feet.right
        target.name = walk.scenario.name
        with target.open() as folder:
            if feet is None:
                write_simulation(folder, walk)
            else:
                write_feet(folder, feet)
    # Which walk this is; all drawn values are in `truth.json`.
    content = {
        **_name_walk(walk),
        "samples": len(walk.recording),
        "duration_s": walk.recording.duration_s,
        "strides": len(walk.strides),
        "distance_m": _measure_walked(walk),
        "landmarks": len(walk.landmarks),
        "folder": str(target.place),
    }
    # The same for the terminal, of both feet what differs.
    rows = {
        "scenario": f"{walk.scenario.name}: {walk.scenario.summary}",
        "seed": str(walk.seed),
        "worn": f"{walk.scenario.worn}, {walk.scenario.prior.name}",
        "field": f"{walk.scenario.field}, {walk.scenario.site}",
    }
    for side, one in {"": walk}.items() if feet is None else feet.sides.items():
        own = {
            "samples": f"{len(one.recording)} in {one.recording.duration_s:.1f} s",
            "strides": f"{len(one.strides)} over {_measure_walked(one):.1f} m of the foot",
        }
        for name, words in own.items():
            rows[name] = ", ".join(filter(None, (rows.get(name), f"{side} {words}".strip())))
    rows["landmarks"] = format_count(len(walk.landmarks), "crossing") if walk.landmarks else "none"
    if feet is not None:
        content["step_width_m"] = feet.step_width_m
        rows["step width"] = f"{feet.step_width_m:.3f} m"
    rows["files"] = str(target.place)
    return Answer(content, lambda: console().print(listing(list(rows.items())), soft_wrap=True))


def _name_walk(walk: SimulatedWalk) -> dict[str, Any]:
    """Return the arguments that reproduce the walk."""
    names = ("worn", "site", "field", "rests", "feet")
    return {
        "scenario": walk.scenario.name,
        "seed": walk.seed,
        "sensor": walk.scenario.prior.name,
        **{name: getattr(walk.scenario, name) for name in names},
        "choices": walk.choices,
    }


def _measure_walked(walk: SimulatedWalk) -> float:
    """Sum of the moves of the foot, m."""
    return float(np.linalg.norm(np.diff(walk.strides.footprint, axis=0), axis=1).sum())


def write_simulation(folder: Path, walk: SimulatedWalk) -> None:
    """Write recording, truth and map into an existing folder."""
    _write_walk(folder, walk, "recording.csv", "")
    _write_surroundings(folder, walk)


def write_feet(folder: Path, feet: SimulatedFeet) -> None:
    """Write recordings, truths and map into an existing folder."""
    for side, walk in feet.sides.items():
        _write_walk(folder, walk, f"{side}.csv", f"{side}.", step_width_m=feet.step_width_m)
    person = feet.person
    assert person.nav_R_body is not None
    write_tum(folder / "person.tum", person.t, person.position, person.nav_R_body)
    _write_surroundings(folder, feet.right)


def _write_walk(folder: Path, walk: SimulatedWalk, recording: str, begin: str, **more: float) -> None:
    write_canonical(walk.recording, folder / recording)
    write_tum(folder / f"{begin}truth.tum", walk.truth.t, walk.truth.position, walk.attitude)
    write_json(folder / f"{begin}truth.json", describe_truth(walk) | more)


def _write_surroundings(folder: Path, walk: SimulatedWalk) -> None:
    """Write the landmarks, if there are any, and the map."""
    from fg_nav.lab.drawing import plot_simulated_walk
    from fg_nav.report.plots.style import save

    if walk.landmarks:
        rows = [(mark.landmark, mark.time_s, *mark.position) for mark in walk.landmarks]
        table = pd.DataFrame(rows, columns=LANDMARK_COLUMNS)
        table.to_csv(folder / "landmarks.csv", index=False, float_format="%.9f")
    save(plot_simulated_walk(walk), folder / "map.png")


def describe_truth(walk: SimulatedWalk) -> dict[str, Any]:
    """Return all truth but the path for JSON: SI, rad, uT; vectors in nav, from the origin, unless named body."""
    strides = walk.strides
    return {
        "version": find_version(),
        **_name_walk(walk),
        "biases": {"time_s": walk.biases.t, "gyr_rad_s": walk.biases.gyr, "acc_m_s2": walk.biases.acc},
        "flat_s": walk.flat,
        "strides": {
            "start_s": strides.start,
            "duration_s": strides.duration,
            "footprint_m": strides.footprint - walk.origin,
            "heading_rad": strides.heading,
            "style": strides.style,
        },
        "field_model": {"origin_m": walk.origin, "earth_uT": walk.earth.vector, **_describe_field(walk.field)},
        "drawn": walk.drawn,
        "person": walk.person,
    }


def list_scenarios() -> Answer:
    """Return what can be simulated: scenarios, sensors, fields, sites."""
    scenarios = {name: one.summary for name, one in SCENARIOS.items()}
    parts = {"sensors": list(PRESETS), "fields": list(FIELDS), "sites": list(SITES)}

    def show() -> None:
        out = console()
        out.print(listing(list(scenarios.items())), soft_wrap=True)
        out.print(listing([(part, ", ".join(names)) for part, names in parts.items()]), soft_wrap=True)

    return Answer({"scenarios": scenarios, **parts}, show)


def _describe_field(part: object) -> dict[str, Any]:
    """A source of field by its kind, with its parameters in the frame of the course (`origin_m`)."""
    parts = getattr(part, "parts", None)
    if parts is not None:
        return {"kind": type(part).__name__, "parts": [_describe_field(inner) for inner in parts]}
    return {"kind": type(part).__name__, **to_json(part)}


def simulate_named(simulate: Callable[..., Simulated], name: str, seed: int, choices: Choices = Choices()) -> Simulated:
    """Simulate one foot or both of a scenario by its name, or that of a file, with a bar on the terminal."""
    own = name.endswith(SUFFIX)
    chosen = read_scenario(Path(name)) if own else find_scenario(name)
    try:
        with progress(chosen.name) as report:
            return simulate(chosen, seed, choices, progress=report)
    except SimulationError as error:
        raise SimulationError(f"{Path(name).name}: {error}" if own else str(error)) from None


DEMO_SCENARIO = "building-loop"
DEMO_METHODS = ("smoother", "card", "inertial", "ma2018", "iez")


def demo(request: DemoRequest) -> Answer:
    """Simulate four minutes of walking round a floor, and compare the methods on it, or show it while it is walked."""
    plan = Plan.read(request.plan, request.plan_points, request.view)
    if request.view:
        _view_demo(request, plan)
        raise typer.Exit
    with Target(request.out, request.force, "demo", DEMO_FILES) as target, target.open() as folder:
        simulated = simulate_named(simulate_one, DEMO_SCENARIO, request.seed)
        # the recording as it will be read from the folder
        provenance = replace(simulated.recording.provenance, path=target.place / "recording.csv", format="canonical")
        walk = prepare_walk(Walk.of(replace(simulated.recording, provenance=provenance)))
        outcomes = run_methods(walk, DEMO_METHODS)
        write_simulation(folder, simulated)
        summaries = write_comparison(folder, walk, outcomes, request.plots)
    return answer_comparison(target.place / "recording.csv", summaries, target.place)


def _view_demo(request: DemoRequest, plan: Plan | None) -> None:
    """Show the simulated walk while it is walked, and then until Ctrl-C.

    Its samples come as a sensor's would, each when its time has come, through `follow`.
    """
    speed = request.speed
    if not 0.0 < speed < float("inf"):
        raise StreamError(f"--speed {speed:g} is no factor: give one above zero.")
    with (
        open_outlets(None, (request.host, request.port), lambda line: None, remark, plan) as outlets,
        catch_signals(signal.SIGINT, signal.SIGTERM) as stop,
    ):
        simulated = simulate_named(simulate_one, DEMO_SCENARIO, request.seed).recording
        remark(f"a walk of {simulated.t[-1] - simulated.t[0]:.0f} s; Ctrl-C ends it.")
        source = Replay(simulated, speed, "the simulated walk")
        navigator = follow({None: Sensor(source, StreamOptions(background=True))}, outlets, stop).navigators[None]
        if not stop.is_set() and outlets.emit_end is not None:
            table, sensor_time = navigator.finish().stances, navigator.intake.sensor_time
            for line in format_table(table, sensor_time, SMOOTHED, None, judge_footfalls(table)):
                outlets.emit_end(line)
            remark("the walk is over, and stays on the page until Ctrl-C.")
            stop.wait()
