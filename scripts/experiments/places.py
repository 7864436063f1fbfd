"""What a walk gains where it comes back to places that its field shows, and what it loses where it does not.

Each walk is smoothed with places (`SmootherParameters.walk.places`) and without, on a magnetometer that was calibrated
on a loop. What was tuned was tuned on seeds 1 to 20. The simulator's feet come back to within 0.07 m of their old line;
people do not. So the path itself wanders to the side, by 0.25 m (rms, correlation length 5 m), independently on each
lap: two passes are 0.35 m apart (rms).
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial

import harness
import numpy as np

from experiments import Asked, Column, Experiment, Figures, Found, Task, find_truth, give_heading, list_seeds
from fg_nav.evaluation.comparison import align
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.campaign.walks import simulate_calibration
from fg_nav.lab.simulation import Choices, Scenario, SimulatedWalk, routes, scenario, simulate
from fg_nav.lab.simulation.path import Path, open_curve, polyline
from fg_nav.lab.simulation.plan import Section, Stand, Walk
from fg_nav.pipeline import Result, prepare_walk, run_method, take_places
from fg_nav.places import SavedPlaces, locate, trace_signature
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import WalkParameters
from fg_nav.walk import Options
from fg_nav.walk import Walk as Prepared

PLACES = {"with": SmootherParameters(), "without": SmootherParameters(walk=WalkParameters(places=False))}
LEVELS, LAPS = ("indoor", "smooth"), 3  # of the field; of the office
KNOT_M = 0.5  # Between the points that a wandering path goes through: less than half the radius of a corner.
ASIDE_M, ASIDE_LENGTH_M = 0.25, 5.0  # By how much a path wanders, rms, and its correlation length.
FALSE_M = 2.0  # So far apart are the footfalls of a false tie.


# --- walks that return, and such as do not ---------------------------------------------------------------------------


calibrate = cache(partial(simulate_calibration, "office"))
"""Calibrate the shoe and sensor of a seed, which are those of all these walks, on a loop."""


def walk_laps(rng: np.random.Generator) -> list[Section]:
    """The laps of the office, each of them a little aside of the others."""
    begin, walk, end = scenario("office").route(rng)
    assert isinstance(walk, Walk)
    return [begin, replace(walk, path=move_path(walk.path, int(rng.integers(2**31)))), end]


def move_path(path: Path, seed: int) -> Path:
    """Let a path wander slowly to its sides."""
    arc = np.linspace(0.0, path.length_m, round(path.length_m / KNOT_M) + 1)
    place, step = path.at(arc)[0], arc[1]
    # white noise, smoothed to the correlation length, to the left of the path
    reach = np.arange(-round(25.0 / step), round(25.0 / step) + 1) * step
    window = np.exp(-((reach / ASIDE_LENGTH_M) ** 2))
    noise = np.random.default_rng([seed, 77]).standard_normal(len(arc) + len(reach) - 1)
    wander = ASIDE_M * np.convolve(noise, window, "valid") / np.linalg.norm(window)
    wander *= np.minimum(1.0, np.minimum(arc, arc[-1] - arc) / 5.0)
    ahead = np.gradient(place[:, :2], axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    return open_curve(place + np.stack([-ahead[:, 1] * wander, ahead[:, 0] * wander, 0.0 * wander], axis=1))


SHORT_M = 220.0
PARALLEL_M = [corner for k in range(6) for corner in [(0.0, 3.0 * k), (32.0, 3.0 * k)][:: -1 if k % 2 else 1]]
"""Six corridors to the east, walked to and fro."""


def walk_along(path: Path, like: str = "office") -> Scenario:
    """A scenario with this course."""
    sections: list[Section] = [Stand(5.0), Walk(path), Stand(5.0)]
    return replace(scenario(like), route=lambda _: sections)


def shorten_open(rng: np.random.Generator) -> list[Section]:
    """The first part of office-open."""
    begin, walk, end = routes.office_open(rng)
    assert isinstance(walk, Walk)
    return [begin, replace(walk, path=walk.path.part(0.0, SHORT_M), strides=None), end]


COURSES: Mapping[str, Scenario] = {
    "office, 3 laps": replace(scenario("office"), name="office-3", route=walk_laps),
    "alone, open": replace(scenario("office-open"), name="open", route=shorten_open),
    "alone, parallel": replace(walk_along(polyline(PARALLEL_M, routes.CORNER_M), "office-open"), name="parallel"),
}


def measure_course(name: str, level: str, seed: int) -> Found:
    """Smooth one walk with places and without, the heading at the start given."""
    walk = simulate(COURSES[name], seed, Choices(field=level))
    prepared = prepare_walk(Prepared.of(walk.recording, give_heading(walk.recording), calibrate(seed)))

    def measure(parameters: SmootherParameters) -> Figures:
        recording, heading = prepared.recording, prepared.options.heading_rad
        table = smooth(recording, prepared.stances, parameters, heading, field=prepared.field).stances
        place = find_truth(walk.recording)[0].position[table.sample]
        # rms of the footfalls of all laps and of the last one, after the best yaw
        walked = np.cumsum(np.linalg.norm(np.diff(place[:, :2], axis=0, prepend=place[:1, :2]), axis=1))
        squared = np.sum((align(table.position, place).apply(table.position) - place)[:, :2] ** 2, axis=1)
        found = {"all (m)": float(np.sqrt(np.mean(squared)))}
        if name.startswith("office"):
            found["last lap (m)"] = float(np.sqrt(np.mean(squared[walked >= walked[-1] * (1.0 - 1.0 / LAPS)])))
        # footfalls that are said to be at an earlier place, and those that are not
        if table.same_place is not None:
            later = np.flatnonzero(table.same_place >= 0)
            apart = np.linalg.norm(place[later] - place[table.same_place[later]], axis=1)
            found |= {"ties": len(later), "false": int(np.sum(apart > FALSE_M))}
        return found

    return {words: partial(measure, parameters) for words, parameters in PLACES.items()}


# --- saved places ----------------------------------------------------------------------------------------------------

PIECE_M = 40.0  # of the second walk
ANOTHER = 5000  # Added to the seed of a building for the person, the sensor and the noise of the second walk.


def list_saved(chosen: Namespace) -> list[Task]:
    """A building a seed; then each second walk is looked for in the next buildings, where it must not be found."""
    seeds = list(harness.seeds_of(chosen))
    return [
        Task(level, f"{seed}", partial(walk_twice, level, seed, seeds[k + 1 : k + 3] or seeds[:1]))
        for level in LEVELS
        for k, seed in enumerate(seeds)
    ]


def walk_twice(level: str, seed: int, others: list[int]) -> Found:
    """Simulate and solve both walks of a building."""
    first, known = solve_first(seed, level)
    # a part of the lap from anywhere on, in either direction, a little aside; another person and sensor
    rng, lap = np.random.default_rng([seed, 4]), draw_lap(seed)
    begin = rng.uniform(0.0, lap.length_m)
    part = lap.repeat(2).part(begin, begin + PIECE_M)
    path = (part.reverse() if rng.random() < 0.5 else part).translate(ASIDE_M * rng.standard_normal(2))
    second = simulate(walk_along(path), seed + ANOTHER, Choices(field="homogeneous", calibrated=True))
    # its magnetometer reads the first building's field, as a reading is linear in it
    truth, nav_R_body = find_truth(second.recording)
    place = truth.position + second.origin
    assert second.recording.mag is not None
    change = np.einsum("nji,nj->ni", nav_R_body, first.field.at(place) - second.field.at(place))
    prepared = prepare_walk(Prepared.of(replace(second.recording, mag=second.recording.mag + change), Options()))

    def measure() -> Figures:
        result = Result.of(prepared, run_method(replace(prepared, places=known), "smoother"))
        assert prepared.recording.mag is not None
        trace = trace_signature(result.t, result.position, result.nav_R_body, prepared.recording.mag)
        elsewhere = [locate(trace, solve_first(other, level)[1]) is not None for other in others if other != seed]
        found: dict[str, float] = {"elsewhere": sum(elsewhere), "found": 0}
        if result.located is None:
            return found
        sample = int(result.stances.sample[0])
        off = result.located.position - (truth.position[sample] + second.origin - first.origin)
        turned = abs(float(wrap_angle(np.array(result.located.heading - compute_heading(nav_R_body[sample])))))
        near = np.hypot(*off[:2]) <= 1.0 and turned <= np.radians(5.0)
        return found | {"start (m)": float(np.hypot(*off[:2])), "found": int(near)}

    return {"smoother": measure}


def draw_lap(seed: int) -> Path:
    """One lap of the office."""
    walk = scenario("office").route(np.random.default_rng([seed, 3]))[1]
    assert isinstance(walk, Walk)
    return walk.path.part(0.0, walk.path.length_m / 3)


@cache
def solve_first(seed: int, level: str) -> tuple[SimulatedWalk, SavedPlaces]:
    """Walk twice round the building, and save its places."""
    walk = simulate(walk_along(draw_lap(seed).repeat(2)), seed, Choices(field=level, calibrated=True))
    prepared = prepare_walk(Prepared.of(walk.recording, give_heading(walk.recording)))
    return walk, take_places(prepared, run_method(prepared, "smoother").solution)


EXPERIMENTS: Mapping[str, Experiment] = {
    "returning-walks": Experiment(
        """Walks that come back, smoothed with places and without, and such as do not come back.

        Laps of the office: horizontal error, rms over the footfalls of all laps and of the last, m, after the best yaw.
        Alone: walks of some 200 m that never return: a part of office-open, corridors 3 m apart. False: footfalls that
        are said to be at the place of one from which they are more than 2 m away.""",
        lambda chosen: list_seeds(
            chosen,
            {f"{name}, {level}": partial(measure_course, name, level) for name in COURSES for level in LEVELS},
        ),
        (
            Column("last lap (m)", "last lap (m)"),
            Column("all (m)", "all (m)"),
            Column("all (m)", "over without", "median / worst", "{:.3f}", "without"),
            Column("false", "false", "sum", "{:.0f}"),
            Column("ties", "of", "sum", "{:.0f}"),
        ),
        [
            Asked("ties", "sum", high=0, section=f"{name}, {level}", variant="with", pattern="{:.0f}")
            for name in list(COURSES)[1:]
            for level in LEVELS
        ],
        seeds=20,
    ),
    "saved-places": Experiment(
        """A second walk on the saved places of a first: where it begins, and that it begins nowhere in another
        building.

        A building a seed: a loop of 340 m through the corridors of an office (Ma 2018), walked twice with the true
        heading. The second walk of 40 m is another person's with another sensor, begins anywhere on the loop in either
        direction, 0.25 m (rms) aside in each axis, and has no heading given. Errors of the first walk count too.""",
        list_saved,
        (
            Column("found", "found within 1 m and 5 deg", "mean", "{:.2f}"),
            Column("start (m)", "start (m)"),
            Column("elsewhere", "in other buildings", "sum", "{:.0f}"),
        ),
        [Asked("found", "mean", 0.9), Asked("elsewhere", "sum", high=0, pattern="{:.0f}")],
        seeds=20,
    ),
}
