"""Which detectors trust the field beside a magnet on the floor: Figure 6 of AIEZ (Zhang), on `magnet-corridor` (Z-E1).

A foot that stands beside a magnet stands in a field that is wrong and does not change: the classical detector, which
asks for the rate of the strength within a stance (`qsf-stance`), trusts it; AIEZ compares compass and inertial heading.

Footfalls are sorted by how far the magnet turns the field over the ground, where the sensor is: `NEAR` by more than
10 deg, `FAR` by less than 2. Zhang does not describe the magnet. The scenario's turns the field at hardly any footfall
by 10 deg, for these come down a stride apart; so it is laid there ten times over as well (`STRONGER`).

`told_apart` is the probability that the statistic is greater at a footfall near than at one far (the area under the
ROC): what a detector could do at best, whatever its threshold; 0.5 is a coin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.evaluation.roc import make_roc, measure_compass_deviation
from fg_nav.frames import compute_heading
from fg_nav.lab.simulation import SCENARIOS, SimulatedWalk, simulate
from fg_nav.lab.simulation.fields import Sum
from fg_nav.lab.simulation.scenarios import Choices
from fg_nav.lab.store.entries import Arrays, Measurement
from fg_nav.magnetic import DETECTORS, FootfallField, average_footfall_field, judge_field
from fg_nav.recording import TrajectoryTruth

SCENARIO = SCENARIOS["magnet-corridor"]
STRONGER = 10
FAR, NEAR = (0.0, 2.0), (10.0, math.inf)


@dataclass(frozen=True)
class Judged:
    """Footfalls of one walk: how far the magnet turns the field (F,) deg, and each detector's statistic (F,)."""

    turned_deg: Floats
    statistic: Mapping[str, Floats]

    def between(self, name: str, low_deg: float, high_deg: float) -> Floats:
        """Statistic over its threshold of each footfall judged, where the magnet turns the field that far."""
        statistic = self.statistic[name][(self.turned_deg >= low_deg) & (self.turned_deg < high_deg)]
        return np.asarray(statistic[np.isfinite(statistic)])


def judged(strength: int, calibrated: bool, seed: int) -> Judged:
    """One walk with so many magnets in one place."""
    walk, field = walked_past(strength, calibrated, seed)
    return judged_field(walk, field)


def walked_past(strength: int, calibrated: bool, seed: int) -> tuple[SimulatedWalk, FootfallField]:
    """Simulate the walk; the field at its footfalls, the gyroscope's heading beginning at the true one."""
    walk = simulate(replace(SCENARIO, magnets=SCENARIO.magnets * strength), seed, Choices(calibrated=calibrated))
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    start = float(compute_heading(truth.nav_R_body[0]))
    return walk, average_footfall_field(walk.recording, detect_stances(walk.recording), start)


def judged_field(walk: SimulatedWalk, field: FootfallField) -> Judged:
    """How far the magnet turns the field, and what each detector makes of it."""
    statistic = {name: judge_field(field, name).statistic for name in DETECTORS}
    return Judged(np.degrees(np.abs(turned_by_magnet(walk, field))), statistic)


def magnet_part(strength: int, seed: int) -> Measurement:
    """What `walks_of` and Figures 5 and 6 read of one walk with a calibrated magnetometer."""
    return Measurement(f"aiez2017_magnet_{strength}x_{seed}", partial(_magnet_arrays, strength, seed))


def _magnet_arrays(strength: int, seed: int) -> Arrays:
    """Beside the verdicts the headings (F,) rad, the times (F,) s and the true places (F, 2) m of the footfalls."""
    walk, field = walked_past(strength, True, seed)
    found = judged_field(walk, field)
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    arrays = {f"statistic {name}": values for name, values in found.statistic.items()}
    places = {"place": truth.position[field.sample, :2], "magnet": np.array(SCENARIO.magnets[0]) - walk.origin}
    headings = {"t": field.t, "compass": field.force_heading, "gyroscope": field.gyro_heading}
    return arrays | places | headings | {"turned_deg": found.turned_deg}


def walks_of(folder: Path, strength: int, seeds: Sequence[int]) -> list[Judged]:
    """Walks that are kept or made now."""
    return [judged_of(magnet_part(strength, seed).load(folder)) for seed in seeds]


def judged_of(arrays: Arrays) -> Judged:
    """Of the arrays of a part."""
    return Judged(arrays["turned_deg"], {name: arrays[f"statistic {name}"] for name in DETECTORS})


def turned_by_magnet(walk: SimulatedWalk, field: FootfallField) -> Floats:
    """(F,) rad by which the magnet turns the true field over the ground, where the sensor is at each footfall."""
    assert isinstance(walk.field, Sum)
    place = walk.recording.truth.position[field.sample] + walk.origin  # type: ignore[union-attr]
    return -measure_compass_deviation(walk.field.at(place), walk.field.parts[0].at(place))


def pooled(walks: Sequence[Judged], name: str, zone: tuple[float, float]) -> Floats:
    """Statistics of all walks in this zone."""
    return np.concatenate([walk.between(name, *zone) for walk in walks])


def told_apart(walks: Sequence[Judged], name: str) -> float:
    """Probability that the statistic of a footfall near is above that of one far: 0.5 is a coin, whatever threshold."""
    near, far = pooled(walks, name, NEAR), pooled(walks, name, FAR)
    if not (len(near) and len(far)):
        return math.inf
    return make_roc(np.concatenate([far, near]), np.arange(len(far) + len(near)) < len(far)).area
