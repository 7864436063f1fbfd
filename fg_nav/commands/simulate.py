"""`fg-nav simulate`: a simulated walk with its truth, into a folder.

==================== ================================================================================================
recording.csv        canonical; magnetometer columns empty where it has no new sample
truth.tum            t x y z qx qy qz qw of the sensor at every sample; the origin is where it first is
truth.json           biases once a second, when the foot stands flat, footprints, field model, all that was drawn
landmarks.csv        landmark,time_s,x_m,y_m,z_m: where the sensor is as it passes; only where there are landmarks
map.png              the walk from above over the strength of the field
==================== ================================================================================================

With both feet there are, in place of the first three, `left.csv`, `left.truth.tum`, `left.truth.json` and the same of
the right foot, both truths in one frame; `person.tum` is the middle of the feet. Landmarks and map are the right one's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fg_nav.commands import Answer, Simulated, Target, simulate_both_feet, simulate_walk
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.simulation import SCENARIOS, Choices, Passing, SimulatedFeet, SimulatedWalk
from fg_nav.lab.simulation.fields import SITES
from fg_nav.lab.simulation.scenarios import FIELDS
from fg_nav.lab.simulation.sensors import PRESETS
from fg_nav.report.files import write_json
from fg_nav.report.folder import FEET_FILES, SIMULATION_FILES
from fg_nav.report.terminal import console, listing
from fg_nav.text import find_version, format_count, to_json
from fg_nav.truth import TrajectoryTruth, Truth

LANDMARK_COLUMNS = ("landmark", "time_s", "x_m", "y_m", "z_m")


def simulate(scenario: str, seed: int, choices: Choices, out: Path | None, force: bool) -> Answer:
    """Simulate a scenario into a folder."""
    with _open_target(scenario, out, force) as target:
        walk = simulate_walk(scenario, seed, choices)
        return _write_into(target, walk, write_simulation, describe_simulation(walk), list_rows(walk))


def simulate_feet(scenario: str, seed: int, choices: Choices, out: Path | None, force: bool) -> Answer:
    """Simulate both feet of a person into a folder."""
    with _open_target(scenario, out, force) as target:
        feet = simulate_both_feet(scenario, seed, choices)
        return _write_into(target, feet, write_feet, describe_feet(feet), list_rows_of_feet(feet))


def _open_target(scenario: str, out: Path | None, force: bool) -> Target:
    return Target(out, force, Path(scenario).stem, SIMULATION_FILES | FEET_FILES)


def _write_into(
    target: Target,
    simulated: Simulated,
    write: Callable[[Path, Simulated], None],
    content: dict[str, Any],
    rows: dict[str, str],
) -> Answer:
    """Write what was simulated into the target, and return what it is and where."""
    target.name = content["scenario"]
    with target.open() as folder:
        write(folder, simulated)
    place = str(target.place)
    return Answer(content | {"folder": place}, partial(print_simulation, rows | {"files": place}))


def _name_walk(walk: SimulatedWalk) -> dict[str, Any]:
    """What makes the walk anew."""
    return {
        "scenario": walk.scenario.name,
        "seed": walk.seed,
        "sensor": walk.scenario.prior.name,
        "worn": walk.scenario.worn,
        "site": walk.scenario.site,
        "field": walk.scenario.field,
        "rests": walk.scenario.rests,
        "feet": walk.scenario.feet,
        "choices": walk.choices,
    }


def describe_simulation(walk: SimulatedWalk) -> dict[str, Any]:
    """Which walk it is: `truth.json` has all that was drawn."""
    return {
        **_name_walk(walk),
        "samples": len(walk.recording),
        "duration_s": walk.recording.duration_s,
        "strides": len(walk.strides),
        "distance_m": measure_walked(walk),
        "landmarks": len(walk.landmarks),
    }


def describe_feet(feet: SimulatedFeet) -> dict[str, Any]:
    """Which walk it is: what `describe_simulation` says of the right foot, and how far apart the feet tread."""
    return describe_simulation(feet.right) | {"step_width_m": feet.step_width_m}


def measure_walked(walk: SimulatedWalk) -> float:
    """Sum of the moves of the foot, m."""
    return float(np.linalg.norm(np.diff(walk.strides.footprint, axis=0), axis=1).sum())


def write_simulation(folder: Path, walk: SimulatedWalk) -> None:
    """Write recording, truth and map into an existing folder."""
    write_canonical(walk.recording, folder / "recording.csv")
    _write_trajectory(folder / "truth.tum", walk.recording.truth)
    write_json(folder / "truth.json", describe_truth(walk))
    _write_surroundings(folder, walk)


def write_feet(folder: Path, feet: SimulatedFeet) -> None:
    """Write recordings, truths and map into an existing folder."""
    for side, walk in feet.sides.items():
        write_canonical(walk.recording, folder / f"{side}.csv")
        _write_trajectory(folder / f"{side}.truth.tum", walk.recording.truth)
        write_json(folder / f"{side}.truth.json", describe_truth(walk) | {"step_width_m": feet.step_width_m})
    _write_trajectory(folder / "person.tum", feet.person)
    _write_surroundings(folder, feet.right)


def _write_trajectory(file: Path, truth: Truth | None) -> None:
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    write_tum(file, truth.t, truth.position, truth.nav_R_body)


def _write_surroundings(folder: Path, walk: SimulatedWalk) -> None:
    """Write the landmarks, if there are any, and the map."""
    from fg_nav.report.plots.style import save
    from fg_nav.report.plots.walk import plot_simulated_walk

    if walk.landmarks:
        _write_landmarks(folder / "landmarks.csv", walk.landmarks)
    save(plot_simulated_walk(walk), folder / "map.png")


def _write_landmarks(file: Path, landmarks: Sequence[Passing]) -> None:
    rows = [(mark.landmark, mark.time_s, *mark.position) for mark in landmarks]
    pd.DataFrame(rows, columns=LANDMARK_COLUMNS).to_csv(file, index=False, float_format="%.9f")


def describe_truth(walk: SimulatedWalk) -> dict[str, Any]:
    """All truth but the path, for JSON: SI units, rad, uT; vectors in nav from the origin unless the name says body."""
    strides = walk.strides
    return {
        "version": find_version(),
        **_name_walk(walk),
        "biases": {
            "time_s": walk.biases.t,
            "gyr_rad_s": walk.biases.gyr,
            "acc_m_s2": walk.biases.acc,
        },
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
    return Answer({"scenarios": scenarios, **parts}, partial(print_scenarios, scenarios, parts))


def print_scenarios(scenarios: dict[str, str], parts: dict[str, list[str]]) -> None:
    """Print scenarios with what they are, and the names of the parts that they can be given."""
    out = console()
    out.print(listing(list(scenarios.items())), soft_wrap=True)
    out.print(listing([(part, ", ".join(names)) for part, names in parts.items()]), soft_wrap=True)


def list_rows(walk: SimulatedWalk) -> dict[str, str]:
    """What was simulated, for people."""
    return {
        "scenario": f"{walk.scenario.name}: {walk.scenario.summary}",
        "seed": str(walk.seed),
        "worn": f"{walk.scenario.worn}, {walk.scenario.prior.name}",
        "field": f"{walk.scenario.field}, {walk.scenario.site}",
        "samples": f"{len(walk.recording)} in {walk.recording.duration_s:.1f} s",
        "strides": f"{len(walk.strides)} over {measure_walked(walk):.1f} m of the foot",
        "landmarks": format_count(len(walk.landmarks), "crossing") if walk.landmarks else "none",
    }


def list_rows_of_feet(feet: SimulatedFeet) -> dict[str, str]:
    """What was simulated of both feet, for people."""
    both = {side: list_rows(walk) for side, walk in feet.sides.items()}
    rows = {name: f"left {both['left'][name]}, right {both['right'][name]}" for name in ("samples", "strides")}
    return both["right"] | rows | {"step width": f"{feet.step_width_m:.3f} m"}


def print_simulation(rows: dict[str, str]) -> None:
    """Print what was simulated, and where the files are."""
    console().print(listing(list(rows.items())), soft_wrap=True)


def _describe_field(part: object) -> dict[str, Any]:
    """A source of field by its kind, with its parameters in the frame of the course (`origin_m`)."""
    parts = getattr(part, "parts", None)
    if parts is not None:
        return {"kind": type(part).__name__, "parts": [_describe_field(inner) for inner in parts]}
    return {"kind": type(part).__name__, **to_json(part)}
