"""Steps of a sensor on the thigh against what is known of them: how many, how far, and where to.

    python scripts/pocket_steps.py [--data DIR] [--seeds N] [--scenarios A,B] [--method NAME] [--real-method NAME]

Real: both thighs of `qmt_fullbody`, 40 to 140 s, against the foot of the same leg. The foot's way is that of our
smoother, stride by stride, and so the truth is good to some 2 %. The walk is cut where the foot has gone half of it:
the step constant is calibrated on one half by the foot's way there, and tried on the other; and the default is tried
on the whole walk. In turns one foot goes farther than the other, the hip as far as both in the mean: `both feet` is
against that. Direction: that of each stride against the foot's, less the mean; neither knows north.

Simulated: seeds from 101 on. `default` has the default step constant; `calibrated` that of another, short walk of the
same person (the scenario `demo`) by its true length. A distance is that of the foot below, strides of 0.4 m and more.
Errors of the position are after turning the whole to fit (yaw), at the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import harness
import numpy as np
import walks
from harness import option, spread
from scipy.io import loadmat

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.errors import FgNavError
from fg_nav.evaluation import evaluate
from fg_nav.lab.simulation import Choices, SimulatedWalk, simulate
from fg_nav.pocket.navigate import METHODS, navigate_pocket
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.solution import Solution

USED_S = (40.0, 140.0)
STRIDE_M = 0.4
"""A stride of the true foot counts from this length on: less is a shuffle or a turn."""

SCENARIOS = ("pocket-street", "pocket-long")


@dataclass(frozen=True)
class Progressed:
    """A way along somebody's path: `t` (K,) s at the ends of strides, and the metres gone by then (K,)."""

    t: Floats
    gone: Floats

    @classmethod
    def of(cls, solution: Solution) -> Progressed:
        """Along the rows of a solution's table."""
        moves = np.linalg.norm(np.diff(solution.stances.position[:, :2], axis=0), axis=1)
        return cls(solution.stances.t, np.concatenate([[0.0], np.cumsum(moves)]))

    def between(self, begin: float, end: float) -> float:
        """Metres gone between two times."""
        return float(np.diff(np.interp([begin, end], self.t, self.gone))[0])


def measure_leg(body: dict[str, Any], side: str, method: str) -> dict[str, float]:
    """Figures of one leg of the real subject: counts, and errors of distance in percent."""
    thigh = navigate_pocket(real_recording(body, f"upper_leg_{side}"), method)
    feet = {name: real_foot(body, name) for name in ("left", "right")}
    steps, ways = Progressed.of(thigh), {name: Progressed.of(foot) for name, foot in feet.items()}
    own = ways[side]
    begin, end = thigh.stances.t[[0, -1]]
    middle = float(np.interp(own.gone[-1] / 2, own.gone, own.t))

    def ratio(first: float, last: float, truths: Sequence[Progressed] = (own,)) -> float:
        return steps.between(first, last) / float(np.mean([truth.between(first, last) for truth in truths]))

    both = list(ways.values())
    inside = (own.t[:-1] > begin - 1.0) & (own.t[1:] < end + 1.0)
    return {
        "strides": float(len(thigh.stances) - 1),
        "foot strides": float(np.sum((np.diff(own.gone) > STRIDE_M) & inside)),
        "foot m": own.between(begin, end),
        "default %": 100 * (ratio(begin, end) - 1),
        "direction, rms deg": direction_rms(thigh, feet[side]),
        "second by first %": 100 * (ratio(middle, end) / ratio(begin, middle) - 1),
        "first by second %": 100 * (ratio(begin, middle) / ratio(middle, end) - 1),
        "default, both feet %": 100 * (ratio(begin, end, both) - 1),
        "second by first, both feet %": 100 * (ratio(middle, end, both) / ratio(begin, middle, both) - 1),
        "first by second, both feet %": 100 * (ratio(begin, middle, both) / ratio(middle, end, both) - 1),
    }


def real_foot(body: dict[str, Any], side: str) -> Solution:
    """The way of one foot of the subject."""
    recording = real_recording(body, f"foot_{side}")
    return smooth(recording, detect_stances(recording))


def direction_rms(thigh: Solution, foot: Solution) -> float:
    """Scatter, deg rms, of the directions of the thigh's strides about those of the foot over the same time."""
    t = thigh.stances.t
    moves = [np.diff(_at(t, solution), axis=0) @ [1, 1j] for solution in (thigh, foot)]
    far = np.abs(moves[1]) > STRIDE_M
    off = np.angle(moves[0][far] * np.conj(moves[1][far]))
    off = np.angle(np.exp(1j * off) / np.exp(1j * off).mean())
    return float(np.degrees(np.sqrt((off**2).mean())))


def _at(t: Floats, solution: Solution) -> Floats:
    """Places (K, 2) m on the ground at these times."""
    return np.stack([np.interp(t, solution.t, axis) for axis in solution.position[:, :2].T], axis=1)


def real_recording(body: dict[str, Any], segment: str) -> Recording:
    """What one segment of the subject recorded."""
    inside = (body["t"] > USED_S[0]) & (body["t"] < USED_S[1])
    return Recording(body["t"][inside], body[segment].acc[inside], body[segment].gyr[inside])


def true_strides(walk: SimulatedWalk) -> Floats:
    """Lengths (K,) m of the strides of the foot below that go somewhere."""
    lengths = np.linalg.norm(np.diff(walk.strides.footprint[:, :2], axis=0), axis=1)
    return np.asarray(lengths[lengths > STRIDE_M])


def measure_walk(scenario: str, seed: int, method: str) -> dict[str, float]:
    """Figures of one simulated walk: counts, and errors in percent and m."""
    worn = Choices(worn="pocket")
    walk, short = simulate(scenario, seed, worn), simulate("demo", seed, worn)
    constant = person_constant(short, method)
    true = true_strides(walk)
    default = navigate_pocket(walk.recording, method)
    calibrated = navigate_pocket(walk.recording, method, step_constant_m=constant)
    distance = float(true.sum())
    metrics = evaluate(calibrated, walk.recording.truth)
    return {
        "true strides": float(len(true)),
        "missed %": 100 * (1 - (len(default.stances) - 1) / len(true)),
        "default %": 100 * (Progressed.of(default).gone[-1] / distance - 1),
        "calibrated %": 100 * (Progressed.of(calibrated).gone[-1] / distance - 1),
        "rmse m": metrics.rmse_2d_m or 0.0,
    }


def person_constant(walk: SimulatedWalk, method: str) -> float:
    """Step constant of a person by a walk of known length."""
    known = float(true_strides(walk).sum())
    law = navigate_pocket(walk.recording, method, known_distance_m=known).parameters["step_length"]
    assert isinstance(law, dict)
    return float(law["constant_m"])


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        seeds=10,
        scenarios=SCENARIOS,
        method=option(METHODS[0], "of the simulated walks", choices=METHODS),
        real_method=option(METHODS[0], "of the real walks", choices=METHODS),
        jobs=1,
    )
    print_real(chosen.data, chosen.real_method)
    for scenario in chosen.scenarios if chosen.seeds else ():
        measure = partial(measure_walk, scenario, method=chosen.method)
        rows = harness.map_walks(measure, harness.seeds_of(chosen), chosen.jobs, scenario)
        harness.print_heading(f"{scenario}, {chosen.method}: median (5 to 95 % of {chosen.seeds} seeds)")
        harness.print_table(("", ""), [(name, spread([row[name] for row in rows], "{:.3g}")) for name in rows[0]])


def print_real(data: Path | None, method: str) -> None:
    """The real thighs, where their recordings are."""
    try:
        path = walks.data_folder(data) / "qmt_fullbody" / "full_body_example_data.mat"
    except FgNavError as error:
        print(f"the real thighs are left out: {error}")
        return
    body = loadmat(path, squeeze_me=True, struct_as_record=False)
    legs = {side: measure_leg(body, side, method) for side in ("left", "right")}
    harness.print_heading(f"Real thighs against the foot of the same leg, {method}")
    names = list(legs["left"])
    harness.print_table(("", *legs), [(name, *(f"{leg[name]:.3g}" for leg in legs.values())) for name in names])


if __name__ == "__main__":
    harness.run(main)
