"""A second walk on the saved places of a first: where it begins, and that it begins nowhere in another building.

    python scripts/saved_places.py [--seeds N] [--first SEED] [--fields LEVEL ...] [--length M] [--jobs N] [--json FILE]

Each seed draws a building: a loop of 340 m through the corridors of an office (Ma 2018) and its field. The first walk
goes round it twice, starts with its true heading, is solved by the smoother and its places are saved. The second one is
another person's with another sensor. It begins anywhere on the loop, in either direction, 0.25 m (rms) aside in each
axis, walks `--length` and has no heading given. Its magnetometer reads the first building's field. Magnetometers are
free of iron. What was chosen was chosen on seeds 1 to 20; seeds from 101 on are reported.

The start that is found is compared with the true one of the sensor in the first walk's frame: so errors of the first
walk count too. The heading is that of the sensor's x axis. Both over their sigmas show what the covariance is worth.
Last, each second walk is looked for in all other buildings, where it must not be found.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import harness
import numpy as np
from harness import Figure, option, spread

from fg_nav.arrays import Floats
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.simulation import Choices, Scenario, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.path import Path as Course
from fg_nav.lab.simulation.plan import Section, Stand, Walk
from fg_nav.pipeline import Result, prepare_walk, run_method, take_places
from fg_nav.places import SavedPlaces, Signature, locate, trace_signature
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options
from fg_nav.walk import Walk as Prepared

LAPS = 2
ASIDE_M = 0.25
ANOTHER = 5000  # Added to the seed of a building for the person, the sensor and the noise of the second walk.
MAX_M, MAX_DEG = 1.0, 5.0  # Of a start that is found.


@dataclass(frozen=True)
class Second:
    """What came of a second walk: the errors (m, deg) of its start and their sigmas; none where it was not found."""

    known: SavedPlaces
    path: Signature
    error_m: float = np.inf
    error_deg: float = np.inf
    over_sigma: float = np.nan
    over_sigma_heading: float = np.nan
    sigma_m: float = np.nan

    @property
    def is_found(self) -> bool:
        """Whether the start is as near as was asked."""
        return self.error_m <= MAX_M and self.error_deg <= MAX_DEG


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        seeds=20,
        first=harness.FIRST_SEED,
        fields=["indoor", "smooth"],
        length=option(40.0, "of the second walk, m"),
        jobs=1,
        json=None,
    )
    figures = [figure for level in chosen.fields for figure in measure_level(chosen, level)]
    harness.print_verdict(figures, chosen.json)


def measure_level(chosen: argparse.Namespace, level: str) -> list[Figure]:
    """Print and return the figures of one level of the field."""
    walk = partial(walk_twice, level=level, length_m=chosen.length)
    found = harness.map_walks(walk, harness.seeds_of(chosen), chosen.jobs, level)
    harness.print_heading(f"A second walk of {chosen.length:g} m, field {level}, {len(found)} buildings")
    located = [one for one in found if np.isfinite(one.error_m)]
    rows = [
        ["start (m)", spread([one.error_m for one in located])],
        ["sigma of it (m)", spread([one.sigma_m for one in located])],
        ["heading (deg)", spread([one.error_deg for one in located])],
        ["start over sigma, rms of an axis", f"{rms([one.over_sigma for one in located]):.2f}"],
        ["heading over sigma, rms", f"{rms([one.over_sigma_heading for one in located]):.2f}"],
    ]
    harness.print_table(["where it was recognized", f"{len(located)} walks"], rows)
    share = float(np.mean([one.is_found for one in found]))
    elsewhere = count_elsewhere(found)
    name = f"{level}, {len(found) * (len(found) - 1)} pairs"
    return [
        Figure("found", level, "smoother", share, low=0.9, pattern="{:.2f}"),
        Figure("recognized in another building", name, "locate", float(elsewhere), high=0.0, pattern="{:.0f}"),
    ]


def rms(values: Sequence[float]) -> float:
    """Root mean square; NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if values else np.nan


def count_elsewhere(found: Sequence[Second]) -> int:
    """Count walks that are recognized in buildings of others."""
    pairs = [(one, other) for one in found for other in found if one is not other]
    return sum(locate(one.path, other.known) is not None for one, other in pairs)


def walk_twice(seed: int, level: str, length_m: float) -> Second:
    """Simulate and solve both walks of a building."""
    lap = draw_lap(seed)
    first, known = solve_first(seed, level, lap)
    second = simulate_second(seed, first, draw_part(seed, lap, length_m))
    prepared = prepare_walk(Prepared.of(second.recording, Options()))
    result = Result.of(prepared, run_method(replace(prepared, places=known), "smoother"))
    assert prepared.recording.mag is not None
    path = trace_signature(result.t, result.position, result.nav_R_body, prepared.recording.mag)
    if result.located is None:
        return Second(known, path)
    place, heading = true_start(first, second, int(result.stances.sample[0]))
    error = result.located.position - place
    turned = np.rad2deg(abs(float(wrap_angle(np.array(result.located.heading - heading)))))
    sigma = result.located.sigma
    over = np.sqrt(np.mean((error[:2] / sigma[:2]) ** 2))
    return Second(
        known,
        path,
        float(np.hypot(*error[:2])),
        float(turned),
        float(over),
        float(turned / np.rad2deg(sigma[3])),
        float(np.hypot(*sigma[:2])),
    )


def draw_lap(seed: int) -> Course:
    """One lap of the office."""
    walk = scenario("office").route(np.random.default_rng([seed, 3]))[1]
    assert isinstance(walk, Walk)
    return walk.path.part(0.0, walk.path.length_m / 3)


def draw_part(seed: int, lap: Course, length_m: float) -> Course:
    """A part of the lap from anywhere on, in either direction, a little aside."""
    rng = np.random.default_rng([seed, 4])
    begin = rng.uniform(0.0, lap.length_m)
    part = lap.repeat(2).part(begin, begin + length_m)
    part = part.reverse() if rng.random() < 0.5 else part
    return part.translate(ASIDE_M * rng.standard_normal(2))


def walk_along(path: Course) -> Scenario:
    """The office with this course."""
    sections: list[Section] = [Stand(5.0), Walk(path), Stand(5.0)]
    return replace(scenario("office"), route=lambda _: sections)


def solve_first(seed: int, level: str, lap: Course) -> tuple[SimulatedWalk, SavedPlaces]:
    """Walk round the building, and save its places."""
    walk = simulate(walk_along(lap.repeat(LAPS)), seed, Choices(field=level, calibrated=True))
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    options = Options(heading_deg=float(np.rad2deg(compute_heading(truth.nav_R_body[0]))))
    prepared = prepare_walk(Prepared.of(walk.recording, options))
    return walk, take_places(prepared, run_method(prepared, "smoother").solution)


def simulate_second(seed: int, first: SimulatedWalk, path: Course) -> SimulatedWalk:
    """Walk along a path, by another person with another sensor, in the field of the first walk."""
    walk = simulate(walk_along(path), seed + ANOTHER, Choices(field="homogeneous", calibrated=True))
    recording = walk.recording
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    assert recording.mag is not None
    place = truth.position + walk.origin
    building = first.field.at(place) - walk.field.at(place)
    mag = recording.mag + np.einsum("nji,nj->ni", truth.nav_R_body, building)
    return replace(walk, recording=replace(recording, mag=mag))


def true_start(first: SimulatedWalk, second: SimulatedWalk, sample: int) -> tuple[Floats, float]:
    """Place (3,) m and heading (rad) of the sensor at a sample of the second walk, in the frame of the first."""
    truth = second.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    place = truth.position[sample] + second.origin - first.origin
    return place, float(compute_heading(truth.nav_R_body[sample]))


if __name__ == "__main__":
    harness.run(main)
