"""What is measured on simulated walks besides the filters: detections and noise (Ma 2018; M-E2).

Detections. A stance is truly quasi-static where the largest difference between the true field vectors of any two of the
four stances of its window (three strides, Ma's N) is below a limit. P_D and P_FA are Ma's: how often a field passes
that is truly quasi-static, and one that is not. What is quasi-static depends on how much steel there is, so there are
three fields, each with its own limit; fraction and limits were chosen on seeds below 100:

======= ================================================================================================
smooth  the level of that name: at the foot the field changes by 3 uT in the median over a window
between 0.65 of smooth and 0.35 of indoor: about 10 uT, the geometric mean of the two
indoor  the level of that name, fitted to real walks over reinforced floors: 27 uT
======= ================================================================================================

The mixture needs no walk of its own: with one seed the two levels have the same steps and the same noise, and the
magnetometer's reading is linear in the field. Hard and soft iron are removed as drawn. AIEZ's statistic depends on its
own threshold, for what passes corrects the heading it is compared with.

Noise, for the sigmas of the detector (section 5.2): changes from one instant to the next, Ma (13). The paper says
neither whether the foot walked, nor from which instant to which, so there are three readings: `walked` from footfall to
footfall without steel, the magnetometer calibrated on the loop; `iron on`, as it is in the shoe, its iron turning with
the foot; `at rest`, from sample to sample, the shoe on a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap_angle
from fg_nav.lab.campaign.walks import LOOP, RAW, Simulated
from fg_nav.lab.roc import (
    Roc,
    make_roc,
    measure_compass_deviation,
    measure_course_change,
    measure_field_change,
)
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.store.results import Arrays, Measurement
from fg_nav.magnetic import DETECTORS, average_footfall_field, judge_field
from fg_nav.magnetic.footfall_field import (
    compute_field_heading,
    compute_inclination,
    integrate_attitude,
    rotate_to_level,
)
from fg_nav.truth import TrajectoryTruth

WINDOW = 3  # Strides of a window, as Ma has it; one truth for all detectors, whatever their own windows.
FIELDS = {"smooth": 0.0, "between": 0.35, "indoor": 1.0}  # How much of `indoor` is in each; the rest is `smooth`.
LIMIT_UT = {"smooth": 2.0, "between": 10.0, "indoor": 20.0}  # Of the change of the vector over a window.

MA, MA_THRESHOLD, OURS = "ma2018-printed", 170.0, "ma2018"

STRAIGHT_DEG, CURVED_DEG = 5.0, 15.0  # Of a window's three strides the directions differ by less, or by more.
FEWEST = 20  # Cases of a kind without which no ROC is drawn from them.


@dataclass(frozen=True)
class Case:
    """All walks in one field, as `measure_detections` leaves them: what is true of their M stances, and statistics."""

    field: str
    walks: Sequence[Arrays]

    def column(self, name: str) -> Floats:
        """(M,) of all walks."""
        return np.concatenate([walk[f"{self.field}/{name}"] for walk in self.walks])

    @cached_property
    def walk(self) -> Ints:
        """(M,) which walk a stance is of."""
        return np.repeat(np.arange(len(self.walks)), [len(walk[f"{self.field}/course_deg"]) for walk in self.walks])

    def statistic(self, detector: str) -> Floats:
        """(M,) over its threshold; NaN also where the truth is not known."""
        return np.where(np.isfinite(self.column("vector_uT")), self.column(f"statistic {detector}"), np.nan)

    def passes(self, detector: str) -> Bools:
        """(M,) True where the field passes; not where it was not judged."""
        return np.asarray(self.statistic(detector) < 1.0)

    def roc(self, detector: str) -> Roc | None:
        """ROC against the truth, by the field's own limit; None with too few of a kind."""
        statistic, static = self.statistic(detector), self.column("vector_uT") < LIMIT_UT[self.field]
        judged = np.isfinite(statistic)
        if min(static[judged].sum(), (~static)[judged].sum()) < FEWEST:
            return None
        return make_roc(statistic, static, self.walk)


def roc_part(scenario: str, seed: int) -> Measurement:
    """What a `Case` has of one walk."""
    return Measurement(f"ma2018_roc_{scenario}_{seed}", partial(measure_detections, scenario, seed))


def measure_detections(scenario: str, seed: int) -> Arrays:
    """Simulate a walk and judge its F stances in each of `FIELDS`; arrays by field and name, with a slash.

    Returns
    -------
    dict
        `vector_uT`, `course_deg` (F,) true changes of the field's vector and of the course over the window, `wrong_deg`
        (F,) by how much a perfect compass is off, and `statistic DETECTOR` (F,) over its threshold.
    """
    smooth, indoor = (simulate(scenario, seed, Choices(field=level)) for level in ("smooth", "indoor"))
    recording, sensor = smooth.recording, smooth.drawn["sensor"]
    assert recording.mag is not None
    assert indoor.recording.mag is not None
    assert isinstance(recording.truth, TrajectoryTruth)
    stances = detect_stances(recording)
    attitude = integrate_attitude(recording, stances)
    sample = stances.stillest(recording.gyr)
    arrays: dict[str, Floats] = {}
    for name, share in FIELDS.items():
        # the walk in a mixture of the two fields, its iron removed as drawn
        nav_field = (1 - share) * smooth.nav_field(sample) + share * indoor.nav_field(sample)
        mixed = (1 - share) * recording.mag + share * indoor.recording.mag
        mag = np.linalg.solve(np.array(sensor["soft_iron"]), (mixed - np.array(sensor["hard_iron_uT"])).T).T
        field = average_footfall_field(replace(recording, mag=mag), stances, nav_R_body=attitude)
        # what is true of the stances, and what the detectors make of them
        arrays |= {
            f"{name}/vector_uT": measure_field_change(nav_field, WINDOW),
            f"{name}/course_deg": np.rad2deg(measure_course_change(recording.truth.position[sample], WINDOW)),
            f"{name}/wrong_deg": np.abs(np.rad2deg(measure_compass_deviation(nav_field, smooth.earth.vector))),
        }
        arrays |= {f"{name}/statistic {detector}": judge_field(field, detector).statistic for detector in DETECTORS}
    return arrays


SENSOR = "mpu-9250x8"

WALK = "office"  # 12.2 minutes: ten of them are two hours.

WALKED, IRON_ON, AT_REST = "walked", "iron on", "at rest"


def noise_part(seed: int, rest_s: float) -> Measurement:
    """Sigmas of one seed: (heading rad, inclination rad, strength uT), by the names above."""
    return Measurement(f"ma2018_noise_{seed}_{rest_s:.0f}s", partial(measure_noise, seed, rest_s))


def measure_noise(seed: int, rest_s: float) -> Arrays:
    """Measure one seed; no rest where `rest_s` is zero."""
    found = {}
    walk = Simulated(WALK, "homogeneous", seed)
    for name, magnetometer in ((WALKED, LOOP), (IRON_ON, RAW)):
        try:
            prepared = walk.prepare(magnetometer)
        except CalibrationError:
            found[name] = np.full(3, np.inf)
            continue
        recording = prepared.sensed  # as it came, corrected by the loop at most
        assert recording is not None
        field = average_footfall_field(recording, detect_stances(recording))
        known = np.isfinite(field.strength)
        found[name] = _sigmas(field.heading_difference[known], field.inclination[known], field.strength[known])
    if rest_s:
        found[AT_REST] = _sigmas(*_lie(seed, rest_s))
    return found


def _lie(seed: int, rest_s: float) -> tuple[Floats, Floats, Floats]:
    """The same sample by sample; the rate of a shoe at rest is no more than its bias, which the walk would take off."""
    still = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(rest_s)])
    recording = simulate(still, seed, Choices(sensor=SENSOR, rate_hz=100.0)).recording
    assert recording.mag is not None
    mag = recording.mag[np.isfinite(recording.mag).all(axis=1)]
    up = np.nanmean(recording.acc, axis=0)
    level = rotate_to_level(mag, np.broadcast_to(up, mag.shape))
    return compute_field_heading(level), compute_inclination(level), np.linalg.norm(mag, axis=1)


def _sigmas(heading: Floats, inclination: Floats, strength: Floats) -> Floats:
    """Standard deviations of the changes."""
    return np.array([np.std(wrap_angle(np.diff(heading))), np.std(np.diff(inclination)), np.std(np.diff(strength))])
