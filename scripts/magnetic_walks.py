"""Simulated walks for what a magnetometer on the heel is worth: course, field, rests, sensor, and the true gyro bias.

The sensor has white noise, biases that walk, a scale error if asked for, and a magnetometer without iron. The heel
rocks in stance (`fg_nav.lab.simulation.rocking`), so that no rest is found but in standing.

=================== ================================================================================================
course              140 m and 360 m once round, 720 m twice; the simulator's scenarios of 240 m to 2.5 km
field               `homogeneous`, `smooth`, `indoor`; `cables`: indoor, with a frame of cables upright across the way,
                    100 A, at three places. The potential of the field jumps there by mu_0 I = 126 uT m
rests               standing at both ends for 5 s or more, or none at all
=================== ================================================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import compute_heading
from fg_nav.lab.simulation import Choices, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.fields import Sum
from fg_nav.lab.simulation.fields.sources import Circuit, make_upright_loop
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Section, Stand
from fg_nav.lab.simulation.plan import Walk as Walking
from fg_nav.lab.simulation.scenarios import Route
from fg_nav.lab.simulation.sensors import SensorPrior, preset
from fg_nav.lab.simulation.sensors.triad import Drift
from fg_nav.pipeline import prepare_walk
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk

CABLES = "cables"
FIELDS = ("homogeneous", "smooth", "indoor", CABLES)

RATE_HZ = 100.0

CABLE_A, CABLES_AT = 100.0, (0.2, 0.5, 0.8)  # Current of each frame, and where they stand, as shares of the strides.
FRAME_M = 1.2, 0.3, 2.7  # To either side of the way, below the floor, and the height of the frame.

SMALL = ((0, 0), (0, 25), (45, 25), (45, 0), (0, 0))
WINDING = ((0, 0), (0, 45), (30, 45), (30, 70), (75, 70), (75, 20), (40, 20), (40, 0), (0, 0))
"""Corners of the short courses, m east and north; scaled to the length."""


def make_round(corners: tuple[tuple[int, int], ...], length_m: float, laps: int = 1) -> Route:
    """Return the route that goes round these corners, standing before and after."""
    way = polyline(corners + corners[1:] * (laps - 1), 1.2).scale_to(length_m)

    def route(_: np.random.Generator) -> list[Section]:
        return [Stand(5.0), Walking(way), Stand(5.0)]

    return route


COURSES: Mapping[str, Route] = {
    "140 m": make_round(SMALL, 140.0),
    "360 m": make_round(WINDING, 360.0),
    "720 m": make_round(WINDING, 720.0, laps=2),
    **{name: scenario(name).route for name in ("magnet-corridor", "teaching-building", "office", "mall")},
}
"""By name, from short to long."""


@dataclass(frozen=True)
class Case:
    """What the walks of a row have in common: names of `COURSES` and `FIELDS`."""

    course: str
    field: str
    rests: bool

    @property
    def name(self) -> str:
        """In words."""
        return f"{self.course}, {self.field}, {'rests' if self.rests else 'no rests'}"


def make_sensor(bias_walk_deg_s: float = 6e-4, scale: float = 0.0) -> SensorPrior:
    """Sensor of 0.007 deg/s/sqrt(Hz), 0.15 deg/s of bias per axis, and 0.5 uT a sample, one standard deviation each."""
    demo = preset("demo")
    assert demo.mag is not None
    drift = Drift(walk=float(np.deg2rad(bias_walk_deg_s)))
    gyr = replace(demo.gyr, bias_sd=float(np.deg2rad(0.15)), drift=drift, scale_sd=scale)
    return replace(demo, rate_hz=RATE_HZ, gyr=gyr, mag=replace(demo.mag, rate_hz=RATE_HZ, noise_sd_uT=0.5))


def make_walk(case: Case, seed: int, sensor: SensorPrior) -> SimulatedWalk:
    """Simulate a walk of a case."""
    field = "indoor" if case.field == CABLES else case.field
    magnets = scenario(case.course).magnets if case.course == "magnet-corridor" else ()
    base = replace(
        scenario("demo"), name=case.course, route=COURSES[case.course], worn="heel", sensor=sensor, magnets=magnets
    )
    walk = simulate(base, seed, Choices(field=field, rests="still" if case.rests else "none"))
    return add_cables(walk) if case.field == CABLES else walk


def add_cables(walk: SimulatedWalk) -> SimulatedWalk:
    """Add the frames to what the magnetometer reads: its reading is linear in the field."""
    footprint = walk.strides.footprint
    frames = Sum(
        [make_frame(footprint[k], footprint[k + 1]) for k in (np.array(CABLES_AT) * len(footprint)).astype(int)]
    )
    truth = read_truth(walk)
    assert walk.recording.mag is not None
    added = np.einsum("nji,nj->ni", truth.nav_R_body, frames.at(truth.position + walk.origin))
    recording = replace(walk.recording, mag=walk.recording.mag + added)
    return replace(walk, recording=recording, field=Sum([walk.field, frames]))


def make_frame(before: Floats, after: Floats) -> Circuit:
    """Upright frame of cables across the way from one footprint to the next."""
    ahead = (after - before) / np.linalg.norm(after - before)
    across = FRAME_M[0] * np.array([ahead[1], -ahead[0], 0.0])
    foot = (before + after) / 2 - [0.0, 0.0, FRAME_M[1]]
    return make_upright_loop(foot - across, foot + across, FRAME_M[2], CABLE_A)


def read_truth(walk: SimulatedWalk) -> TrajectoryTruth:
    """Return the true trajectory."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    return truth


def prepare(walk: SimulatedWalk, heading_given: bool = False, until_s: float = np.inf) -> Walk:
    """Find the stances and the field of a walk, or of its beginning."""
    degrees = float(np.rad2deg(compute_heading(read_truth(walk).nav_R_body[0]))) if heading_given else None
    stop = int(np.searchsorted(walk.recording.t, until_s))
    recording = walk.recording if stop == len(walk.recording) else walk.recording.slice(0, stop)
    return prepare_walk(Walk.of(recording, Options(heading_deg=degrees)))


def measure_bias(walk: SimulatedWalk, solution: Solution) -> tuple[float, float]:
    """Error of the gyro bias about up at the last stance and its sigma, deg/s."""
    end = solution.stances
    up = end.nav_R_body[-1].T @ [0.0, 0.0, 1.0]
    true = np.array([np.interp(end.t[-1], walk.biases.t, axis) for axis in walk.biases.gyr.T])
    sigma = np.sqrt(np.sum((up * end.gyro_bias_sigma[-1]) ** 2))
    return float(np.rad2deg(up @ (end.gyro_bias[-1] - true))), float(np.rad2deg(sigma))


def measure_early_bias(
    walk: SimulatedWalk, solve: Callable[[Walk], Solution], until_s: float, heading_given: bool = False
) -> tuple[float, float]:
    """Return the same from what was recorded until then, as it is known at that moment."""
    return measure_bias(walk, solve(prepare(walk, heading_given, until_s)))
