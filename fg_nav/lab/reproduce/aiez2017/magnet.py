"""What detectors make of the field beside a magnet on the floor: walks through `magnet-corridor` (Zhang, Figure 6).

Footfalls are sorted by how far the magnet turns the field over the ground, where the sensor is: `NEAR` by more than
10 deg, `FAR` by less than 2. Zhang does not describe the magnet. The scenario's turns the field at hardly any footfall
by 10 deg, for these come down a stride apart; so it is laid there ten times over as well (`STRONGER`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.frames import compute_heading
from fg_nav.lab.roc import make_roc, measure_compass_deviation
from fg_nav.lab.simulation import SCENARIOS, SimulatedWalk, simulate
from fg_nav.lab.simulation.fields import Sum
from fg_nav.lab.simulation.scenarios import Choices
from fg_nav.lab.store.results import Arrays, Measurement
from fg_nav.magnetic import DETECTORS, FootfallField, average_footfall_field, judge_field
from fg_nav.truth import TrajectoryTruth

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


def magnet_part(strength: int, seed: int) -> Measurement:
    """What `judged_of` and Figure 6 read of one walk with a calibrated magnetometer."""
    return Measurement(f"aiez2017_magnet_{strength}x_{seed}", partial(_walk_past, strength, seed))


def _walk_past(strength: int, seed: int) -> Arrays:
    """Statistics, headings (F,) rad, times (F,) s and true places (F, 2) m at the footfalls past so many magnets.

    The gyroscope's heading begins at the true one.
    """
    walk = simulate(replace(SCENARIO, magnets=SCENARIO.magnets * strength), seed, Choices(calibrated=True))
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    start = float(compute_heading(truth.nav_R_body[0]))
    field = average_footfall_field(walk.recording, detect_stances(walk.recording), start)
    arrays = {f"statistic {name}": judge_field(field, name).statistic for name in DETECTORS}
    places = {"place": truth.position[field.sample, :2], "magnet": np.array(SCENARIO.magnets[0]) - walk.origin}
    headings = {"t": field.t, "compass": field.force_heading, "gyroscope": field.gyro_heading}
    return arrays | places | headings | {"turned_deg": np.degrees(np.abs(_turn_by_magnet(walk, field)))}


def judged_of(arrays: Arrays) -> Judged:
    """Footfalls of one walk as they are stored."""
    return Judged(arrays["turned_deg"], {name: arrays[f"statistic {name}"] for name in DETECTORS})


def _turn_by_magnet(walk: SimulatedWalk, field: FootfallField) -> Floats:
    """(F,) rad by which the magnet turns the true field over the ground, where the sensor is at each footfall."""
    assert isinstance(walk.field, Sum)
    place = walk.recording.truth.position[field.sample] + walk.origin  # type: ignore[union-attr]
    return -measure_compass_deviation(walk.field.at(place), walk.field.parts[0].at(place))


def pool(walks: Sequence[Judged], name: str, zone: tuple[float, float]) -> Floats:
    """Statistics of all walks in this zone."""
    return np.concatenate([walk.between(name, *zone) for walk in walks])


def measure_separation(walks: Sequence[Judged], name: str) -> float:
    """Probability that the statistic of a footfall near is above that of one far: the area under the ROC."""
    near, far = pool(walks, name, NEAR), pool(walks, name, FAR)
    if not (len(near) and len(far)):
        return math.inf
    return make_roc(np.concatenate([far, near]), np.arange(len(far) + len(near)) < len(far)).area
