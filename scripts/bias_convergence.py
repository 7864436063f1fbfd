"""How fast is a wrong gyro bias found by walking? The z axis off by 0.3 deg/s at a standing start.

    python scripts/bias_convergence.py [--seeds N] [--first SEED] [--jobs N] [--json FILE]

The course of `teaching-building` with the scenario's sensor on the heel, its z gyro off by 0.3 deg/s beside its own
bias; a homogeneous field, a magnetometer without iron and with 0.5 uT of white noise a sample at 100 Hz. A rest at the
start would show the bias at once, so nobody is told of rests: the prior is about zero, 0.3 deg/s wide. The foot stands
for some seconds before the first stride; time counts from that stride on.

What is known after T seconds of walking is what an estimator makes of the recording up to there, at its last footfall.
Error is that of the bias about up, which is what turns the heading: up . R (b - b_true). Settled is the first T after
which the error stays below 0.02 deg/s to the end of the times looked at. Median over the seeds, 5 and 95 % behind; the
claimed sigma, about up, below.

While a foot walks its gyroscopes' wrong scales and axes turn the heading too. In a steady gait that is the same in
every stride, and nothing but a rest tells it from a bias: up . R E w, mean over the time walked, with the E that was
drawn. It stands below the methods; what an estimator finds is compared with the sum of both as well.

========== =======================================================================================================
smoother   as it comes, but for prior and rests
inertial   the same without the field: what the velocities of a foot tell of a rotation about up
ma2018     the filter with the compass as tuned, with the same prior and rests
matched    that with the smoother's models
========== =======================================================================================================
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import figures as fig
import numpy as np
from figures import Figure

from fg_nav.arrays import Floats
from fg_nav.detection import RestParameters, detect_stances
from fg_nav.ekf.gated_compass import GatedCompassParameters, run_gated_compass
from fg_nav.ekf.matched import MatchedParameters, run_matched
from fg_nav.ekf.presets import find_parameters
from fg_nav.frames import heading_of
from fg_nav.lab.simulation import SCENARIOS, Scenario, SimulatedWalk, simulate
from fg_nav.lab.simulation.sensors import IronPrior
from fg_nav.magnetic import FootfallField, footfall_field
from fg_nav.recording import Recording, TrajectoryTruth
from fg_nav.report.terminal import progress
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.solution import Solution
from fg_nav.stances import Stances

FIRST_SEED, SEEDS = 101, 20
WRONG_DEG_S, NOISE_UT, FIELD_RATE_HZ = 0.3, 0.5, 100.0
WALKED_S = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 120.0)
WITHIN_DEG_S, ASKED_S = 0.02, 60.0

NO_RESTS = RestParameters(shortest_s=math.inf, shortest_at_end_s=math.inf)
"""No stretch is as long as that."""

SMOOTHER = replace(SmootherParameters(), rest=NO_RESTS, gyro_bias_sigma_deg_s=WRONG_DEG_S)

Estimate: TypeAlias = Callable[[Recording, Stances, FootfallField, float], Solution]


def _filtered(method: str, recording: Recording, stances: Stances, field: FootfallField, heading: float) -> Solution:
    parameters = find_parameters(method)
    assert isinstance(parameters, GatedCompassParameters)
    core = replace(parameters.inertial, rest=NO_RESTS, gyro_bias_sigma_deg_s=WRONG_DEG_S)
    parameters = replace(parameters, inertial=core)
    if isinstance(parameters, MatchedParameters):
        return run_matched(recording, stances, field, parameters, heading)
    return run_gated_compass(recording, stances, field, parameters, heading)


def _smoothed(recording: Recording, stances: Stances, field: FootfallField, heading: float) -> Solution:
    return smooth(recording, stances, SMOOTHER, heading, field=field)


def _inertial(recording: Recording, stances: Stances, field: FootfallField, heading: float) -> Solution:
    return smooth(recording, stances, SMOOTHER, heading)


METHODS: Mapping[str, Estimate] = {
    "smoother": _smoothed,
    "inertial": _inertial,
    "ma2018": partial(_filtered, "ma2018"),
    "matched": partial(_filtered, "matched"),
}


@dataclass(frozen=True)
class Found:
    """Bias error about up and its claimed sigma, deg/s, after each of the times walked (T,)."""

    error: Floats
    sigma: Floats
    by_gait: Floats = field(default_factory=lambda: np.zeros(len(WALKED_S)))
    """What scale and axes add to the rate about up, mean since the first stride, deg/s (T,)."""

    @property
    def settled_s(self) -> float:
        """First time after which the error stays within what is asked; infinite for none."""
        outside = np.flatnonzero(~(np.abs(self.error) <= WITHIN_DEG_S))
        first = 0 if not len(outside) else int(outside[-1]) + 1
        return WALKED_S[first] if first < len(WALKED_S) else math.inf


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, estimate, print."""
    chosen = _parse(arguments)
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    found: dict[str, list[Found]] = {name: [] for name in METHODS}
    with progress(f"{len(seeds)} walks") as tell, ProcessPoolExecutor(chosen.jobs) as pool:
        for done, of_seed in enumerate(pool.map(found_on, seeds), start=1):
            for name, one in of_seed.items():
                found[name].append(one)
            tell(done / len(seeds))
    print_errors(found)
    figures = judged(found)
    fig.print_figures(figures)
    fig.print_verdict(figures)
    if chosen.json:
        fig.write_json(chosen.json, {"figures": [f.as_dict() for f in figures]})


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="How fast a wrong gyro bias is found by walking.")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"how many walks ({SEEDS})")
    parser.add_argument("--first", type=int, default=FIRST_SEED, metavar="SEED", help=f"the first ({FIRST_SEED})")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    return parser.parse_args(arguments)


def wrong_scenario() -> Scenario:
    """Return the course with a sensor whose z gyro is off."""
    scenario = SCENARIOS["teaching-building"]
    prior = scenario.prior
    assert prior.mag is not None
    mag = replace(prior.mag, noise_sd_uT=NOISE_UT, rate_hz=FIELD_RATE_HZ)
    gyr = replace(prior.gyr, bias=(0.0, 0.0, float(np.radians(WRONG_DEG_S))))
    sensor = replace(prior, gyr=gyr, mag=mag).with_iron(IronPrior())
    return replace(scenario, sensor=sensor, field="homogeneous")


def found_on(seed: int) -> dict[str, Found]:
    """What each method knows of the bias, on one walk."""
    walk = simulate(wrong_scenario(), seed)
    first_step = float(walk.strides.start[0])
    times = [first_step + walked for walked in WALKED_S]
    parts = [up_to(walk.recording, time) for time in times]
    by_gait = np.array([added_by_gait(walk, part, first_step) for part in parts])
    return {name: replace(known(walk, parts, estimate), by_gait=by_gait) for name, estimate in METHODS.items()}


def added_by_gait(walk: SimulatedWalk, part: Recording, first_step: float) -> float:
    """Mean rate about up since the first stride, deg/s, that the sensor's scale and axes add; 0 before it."""
    truth, h = part.truth, np.diff(part.t)
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    walks = part.t[:-1] >= first_step
    if not walks.any():
        return 0.0
    errors = np.array(walk.drawn["sensor"]["gyr_matrix"]) - np.eye(3)
    body_up = truth.nav_R_body[: len(h), 2]
    added = np.einsum("ni,ij,nj->n", body_up, errors, part.integrable[1][:-1])
    return math.degrees(float(np.average(added[walks], weights=h[walks])))


def up_to(recording: Recording, time_s: float) -> Recording:
    """Return the recording until then."""
    return recording.slice(0, int(np.searchsorted(recording.t, time_s)))


def known(walk: SimulatedWalk, parts: Sequence[Recording], estimate: Estimate) -> Found:
    """What one method knows at the end of each part."""
    errors = np.array([error_at_end(walk, part, estimate) for part in parts])
    return Found(errors[:, 0], errors[:, 1])


def error_at_end(walk: SimulatedWalk, part: Recording, estimate: Estimate) -> tuple[float, float]:
    """Error about up and claimed sigma, deg/s, at the last footfall of a part of the walk."""
    truth = part.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    stances = detect_stances(part)
    heading = float(heading_of(truth.nav_R_body[0]))
    table = estimate(part, stances, footfall_field(part, stances, heading), heading).stances
    true_bias = np.array([np.interp(table.t[-1], walk.biases.t, axis) for axis in walk.biases.gyr.T])
    body_up = truth.nav_R_body[int(table.sample[-1]), 2]
    error = float(body_up @ (table.gyro_bias[-1] - true_bias))
    sigma = float(np.linalg.norm(body_up * table.gyro_bias_sigma[-1]))
    return math.degrees(error), math.degrees(sigma)


def print_errors(found: Mapping[str, Sequence[Found]]) -> None:
    """Size of the error over time, and the claimed sigma below it."""
    fig.print_heading("Error of the z gyro bias after so many seconds of walking, deg/s: median (95 %)")
    rows = []
    for name, some in found.items():
        size = np.abs([one.error for one in some])
        middle, high = np.percentile(size, [50, 95], axis=0)
        rows.append([name, *(f"{a:.3f} ({b:.3f})" for a, b in zip(middle, high, strict=True))])
        sigma = np.median([one.sigma for one in some], axis=0)
        rows.append(["  claimed sigma", *(f"{one:.3f}" for one in sigma)])
    middle, high = np.percentile(np.abs([one.by_gait for one in next(iter(found.values()))]), [50, 95], axis=0)
    rows.append(["scale and axes", *(f"{a:.3f} ({b:.3f})" for a, b in zip(middle, high, strict=True))])
    fig.print_table(("method", *(f"{walked:.0f} s" for walked in WALKED_S)), rows)


def judged(found: Mapping[str, Sequence[Found]]) -> list[Figure]:
    """Time until the bias is known to what is asked, and whether the claim is true."""
    at = WALKED_S.index(ASKED_S)
    figures = []
    for name, some in found.items():
        settled = [one.settled_s for one in some]
        high = ASKED_S if name == "smoother" else math.inf
        low, middle, most = np.percentile(settled, [5, 50, 95], method="higher")
        within = WITHIN_DEG_S if name == "smoother" else math.inf
        words = f"s of walking to within {WITHIN_DEG_S} deg/s"
        figures += [
            Figure("bias", f"{words}, median", name, float(middle), high=high, pattern="{:.0f}"),
            Figure("bias", f"{words}, 5 %", name, float(low), pattern="{:.0f}"),
            Figure("bias", f"{words}, 95 %", name, float(most), pattern="{:.0f}"),
            Figure("bias", f"error at {ASKED_S:.0f} s, median (deg/s)", name, _median(some, at, 0.0), high=within),
            Figure("bias", "the same, of bias and gait together", name, _median(some, at, 1.0)),
            Figure("bias", f"share of walks within it at {ASKED_S:.0f} s", name, _share(some, at), pattern="{:.2f}"),
            Figure("bias", f"error over sigma at {ASKED_S:.0f} s, rms", name, _rms(some, at), pattern="{:.2f}"),
        ]
    return figures


def _median(some: Sequence[Found], at: int, gait: float) -> float:
    return float(np.median([abs(one.error[at] - gait * one.by_gait[at]) for one in some]))


def _share(some: Sequence[Found], at: int) -> float:
    return float(np.mean([abs(one.error[at]) <= WITHIN_DEG_S for one in some]))


def _rms(some: Sequence[Found], at: int) -> float:
    return float(np.sqrt(np.mean([(one.error[at] / one.sigma[at]) ** 2 for one in some])))


if __name__ == "__main__":
    fig.leave_with(main)
