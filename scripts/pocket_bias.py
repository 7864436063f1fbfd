"""How fast a gyro bias is found in a trouser pocket, and how far off the heading is after 39 minutes.

    python scripts/pocket_bias.py [--seeds N] [--first SEED] [--noise UT] [--jobs N] [--json FILE]

The 3 km of `pocket-street` with z along the thigh and the errors of Table 2 of Munoz Diaz et al. (2017): 0.1 deg/s of
noise a rate sample, biases of -0.1, 0.1 and -0.1 deg/s, which are not given. The magnetometer has 0.5 uT of white
noise a sample at 100 Hz, and the same walk is made in each of these fields:

========= ==========================================================================================================
equator   homogeneous, Table 1
munich    the same
street    that of the equator with lamps and parked cars, each passed at 1 m and 4 m, in every block of 120 m
past-cars the walk of `pocket-past-cars`: two cars and two lamps, as in the paper's Figures 7b and 10
========= ==========================================================================================================

============== =====================================================================================================
online         `fg_nav.lab.follow_pocket`: each estimate is made of what was there until then
batch          `fg_nav.pocket.smooth_pocket`: of all of the walk
paper          `fg_nav.pocket.estimate_pocket`, given the noise of the magnetometer
quarter        the same with fields a quarter of a second apart
quarter, wide  that with the graph's prior of the bias
============== =====================================================================================================

Found is the time, from the start of the recording (a rest of 10 s, then the walk), after which the error of the z bias
stays within 0.02 deg/s for good. Above the paper's is the most, over all times after a minute, by which the median
error of the online estimate is larger than that of a filter of the paper. The bound is Cramer and Rao's for a
minute of noisy field and gyroscope, with the tilt known, a field that keeps still, and no other knowledge of the bias.

Medians over the seeds, 5 and 95 % behind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import harness
import numpy as np
from harness import FIRST_SEED, Figure, option, spread

from fg_nav.arrays import Floats
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.reproduce.munoz_diaz2017.walks import FIELDS_UT, replace_field
from fg_nav.lab.simulation import Choices, SimulatedWalk, simulate
from fg_nav.lab.simulation.fields import Field, Homogeneous, street
from fg_nav.pocket import (
    PocketParameters,
    PocketSmootherParameters,
    PocketStart,
    PocketTrack,
    estimate_pocket,
    smooth_pocket,
)
from fg_nav.pocket.filter import GYR_DENSITY_DEG
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth

NOISE_UT = 0.5
WITHIN_DEG_S = 0.02
EVERY_S, FROM_S = 1.0, 60.0
SHOWN_S = (30, 60, 120, 300, 600, 1200, 2300)
STREET_M = 500.0
TILT_SIGMA = math.radians(0.5)

FIELDS = ("equator", "munich", "street", "past-cars")
FOUND_S = {"equator": 60.0, "munich": 60.0, "street": 300.0, "past-cars": 300.0}
YAW_DEG = {"equator": 3.0, "munich": 3.0, "street": 6.0, "past-cars": 6.0}
GRAPH = ("online", "batch")

Estimate: TypeAlias = Callable[[Recording, PocketStart], PocketTrack]


@dataclass(frozen=True)
class Found:
    """Of one method on one walk: the error of the z bias, deg/s, at each of `EVERY_S` seconds; and at the end.

    `yaw_deg` is the error of the heading, `nees` (3 expected) that of the bias, mean over the times after a minute.
    """

    error: Floats
    yaw_deg: float
    nees: float

    @property
    def found_s(self) -> float:
        """From when on the error is within what is asked; infinite for never."""
        outside = np.flatnonzero(~(np.abs(self.error) <= WITHIN_DEG_S))
        first = int(outside[-1]) + 1 if len(outside) else 0
        return first * EVERY_S if first < len(self.error) else math.inf


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, estimate, print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        seeds=20,
        first=FIRST_SEED,
        noise=option(NOISE_UT, "magnetometer, uT", metavar="UT"),
        jobs=1,
        json=None,
    )
    of_seeds = harness.map_walks(partial(find_biases, noise_uT=chosen.noise), harness.seeds_of(chosen), chosen.jobs)
    figures = []
    for name in FIELDS:
        in_field = {method: [walk[name][method] for walk in of_seeds] for method in of_seeds[0][name]}
        print_errors(name, in_field)
        print_ends(in_field)
        figures += judge_field(name, in_field)
    figures += bounds(chosen.noise)
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json)


def methods_at(noise_uT: float) -> Mapping[str, Estimate]:
    """Return the methods, each given the noise of the magnetometer."""
    graph, paper = PocketSmootherParameters(mag_sigma_uT=noise_uT), PocketParameters(mag_sigma_uT=noise_uT)
    quarter = replace(paper, shortest_difference_s=0.25)
    wide = replace(quarter, gyro_bias_sigma_deg_s=graph.gyro_bias_sigma_deg_s)
    return {
        "online": lambda recording, start: follow_pocket(recording, graph, start),
        "batch": lambda recording, start: smooth_pocket(recording, graph, start),
        "paper": lambda recording, start: estimate_pocket(recording, paper, start),
        "quarter": lambda recording, start: estimate_pocket(recording, quarter, start),
        "quarter, wide": lambda recording, start: estimate_pocket(recording, wide, start),
    }


def find_biases(seed: int, noise_uT: float) -> dict[str, dict[str, Found]]:
    """What each method finds in each field, on the walks of one seed."""
    walk = simulate("pocket-street", seed, Choices(aligned=True))
    past_cars = simulate("pocket-past-cars", seed)
    found = {}
    for number, name in enumerate(FIELDS):
        of = past_cars if name == "past-cars" else walk
        recording = replace_field(of, _field(name, of), noise_uT, np.random.default_rng((seed, number)))
        start = _true_start(recording)
        found[name] = {m: judge(run(recording, start), of) for m, run in methods_at(noise_uT).items()}
    return found


def _field(name: str, walk: SimulatedWalk) -> Field:
    if name == "past-cars":
        return walk.field
    if name == "street":
        return street(Homogeneous(FIELDS_UT["equator"]), STREET_M)
    return Homogeneous(FIELDS_UT[name])


def _true_attitude(recording: Recording) -> Floats:
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    return truth.nav_R_body


def _true_start(recording: Recording) -> PocketStart:
    return PocketStart(_true_attitude(recording)[0], TILT_SIGMA)


def judge(track: PocketTrack, walk: SimulatedWalk) -> Found:
    """Lay a track beside the truth."""
    true_bias = np.stack([np.interp(track.t, walk.biases.t, axis) for axis in walk.biases.gyr.T], axis=1)
    off = track.gyro_bias - true_bias
    seconds = np.searchsorted(track.t, np.arange(track.t[0], track.t[-1], EVERY_S))
    turn = track.nav_R_body[-1] @ _true_attitude(walk.recording)[-1].T
    yaw = math.degrees(math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]))
    kept = track.t[track.covariance_sample] >= FROM_S
    error, P = off[track.covariance_sample[kept]], track.covariance[kept, 3:, 3:]
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(P, error[:, :, None])[:, :, 0])
    return Found(np.degrees(off[seconds, 2]), yaw, float(nees.mean()))


def print_errors(name: str, methods: Mapping[str, Sequence[Found]]) -> None:
    """Size of the error over time."""
    harness.print_heading(f"{name}: error of the z bias after so many seconds, deg/s: median (95 %)")
    rows = []
    for method, some in methods.items():
        size = np.abs([[one.error[min(s, len(one.error) - 1)] for s in SHOWN_S] for one in some])
        middle, high = np.percentile(size, [50, 95], axis=0)
        rows.append([method, *(f"{a:.4f} ({b:.4f})" for a, b in zip(middle, high, strict=True))])
    harness.print_table(("method", *(f"{s} s" for s in SHOWN_S)), rows)


def print_ends(methods: Mapping[str, Sequence[Found]]) -> None:
    """When the bias is found, the heading at the end, and whether the claims are true."""
    rows = []
    for method, some in methods.items():
        found = spread([one.found_s for one in some], "{:.0f}")
        yaw = spread(np.abs([one.yaw_deg for one in some]), "{:.2f}")
        rows.append([method, found, yaw, f"{np.mean([one.nees for one in some]):.1f}"])
    harness.print_table(("method", "found after s (5 to 95 %)", "yaw at the end, deg", "NEES of 3"), rows)


def judge_field(name: str, methods: Mapping[str, Sequence[Found]]) -> list[Figure]:
    """Every figure that something is asked of, in one field."""
    found = float(np.percentile([one.found_s for one in methods["online"]], 50, method="higher"))
    words = f"{name}: z bias within {WITHIN_DEG_S} deg/s for good, s"
    figures = [Figure(name, words, "online", found, high=FOUND_S[name], pattern="{:.0f}")]
    for method in GRAPH:
        yaw = float(np.median(np.abs([one.yaw_deg for one in methods[method]])))
        figures.append(Figure(name, f"{name}: yaw error at the end, deg", method, yaw, high=YAW_DEG[name]))
    for method in methods:
        if method not in GRAPH:
            above, when = above_paper(methods["online"], methods[method])
            words = f"{name}: most above '{method}', deg/s (after {when:.0f} s)"
            figures.append(Figure(name, words, "online", above, high=0.0, pattern="{:.4f}"))
    return figures


def above_paper(ours: Sequence[Found], theirs: Sequence[Found]) -> tuple[float, float]:
    """Largest excess of our median error over theirs after a minute, deg/s, and when that is, s."""
    length = min(len(one.error) for one in (*ours, *theirs))
    a, b = (np.median(np.abs([one.error[:length] for one in some]), axis=0) for some in (ours, theirs))
    first = round(FROM_S / EVERY_S)
    excess = (a - b)[first:]
    return float(excess.max()), float((np.argmax(excess) + first) * EVERY_S)


def bounds(noise_uT: float) -> list[Figure]:
    """Least standard deviation of the bias about up after a minute."""
    gyr = GYR_DENSITY_DEG
    return [
        Figure("bound", f"{name}: bound after {FROM_S:.0f} s, deg/s", "", bound, pattern="{:.4f}")
        for name in ("equator", "munich")
        for bound in [upright_bound(FROM_S, math.hypot(*FIELDS_UT[name][:2]), noise_uT, gyr)]
    ]


def upright_bound(
    seconds: float, across_uT: float, noise_uT: float, gyr_density_deg: float, rate_hz: int = 100
) -> float:
    """Least standard deviation, deg/s, of a bias about up from a field across it and a gyroscope that are noisy.

    Angle a(t) = a_0 + b t + random walk, seen with white errors: the information of both unknowns, by the inverse of
    the covariance of what is seen, taken once a second.
    """
    t = np.arange(1.0, seconds + 1.0)
    seen = math.degrees(noise_uT / across_uT) ** 2 / rate_hz
    covariance = gyr_density_deg**2 * np.minimum(t[:, None], t) + seen * np.eye(len(t))
    A = np.stack([np.ones(len(t)), t], axis=1)
    return float(np.sqrt(np.linalg.inv(A.T @ np.linalg.solve(covariance, A))[1, 1]))


if __name__ == "__main__":
    harness.run(main)
