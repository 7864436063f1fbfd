"""What is measured on simulated walks besides the filters: detections, noise, headings (Ma 2018; M-E2 to M-E4).

Detections (Figures 8, 13, 14). Truth is the simulator's field at the footfalls: a stance is truly quasi-static where
the largest difference between the field vectors of any two of the four stances of its window (three strides, Ma's N) is
below a limit. P_D and P_FA are Ma's: how often a field passes that is truly quasi-static, and one that is not. What is
quasi-static depends on how much steel there is, so there are three fields, each with its own limit:

======= ================================================================================================
smooth  the level of that name: at the foot the field changes by 3 uT in the median over a window
between 0.65 of smooth and 0.35 of indoor: about 10 uT, the geometric mean of the two
indoor  the level of that name, fitted to real walks over reinforced floors: 27 uT
======= ================================================================================================

The mixture needs no walk of its own: with one seed the two levels have the same steps and the same noise, and the
magnetometer's reading is linear in the field. Hard and soft iron are removed as drawn. Bands are of 90 % over walks
(`fg_nav.lab.roc`). The fraction and the limits were chosen on seeds below 100. AIEZ's statistic depends on
its own threshold, for what passes corrects the heading it is compared with.

Noise, two hours, for the sigmas of Ma's detector (section 5.2): changes from one instant to the next of magnetic minus
gyro heading, of the inclination and of the strength, Ma (13). The paper says neither whether the foot walked, nor from
which instant to which. Three readings:

========== =========================================================================================================
walked     from footfall to footfall, in a field without steel; magnetometer calibrated on the loop, as Ma's
iron on    the same with the magnetometer as it is in the shoe, its iron turning with the foot
at rest    from sample to sample of the magnetometer, the shoe on a table
========== =========================================================================================================

Headings at the footfalls by compass, gyroscope and filter, for the pictures: as in the paper the compass is levelled by
the accelerometer of the standing foot, and the gyroscope's heading begins at the true one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.campaign.methods import solve_by
from fg_nav.lab.campaign.walks import LOOP, RAW, Simulated
from fg_nav.lab.field_survey import require_field
from fg_nav.lab.roc import (
    Roc,
    make_roc,
    measure_compass_deviation,
    measure_course_change,
    measure_field_change,
)
from fg_nav.lab.simulation import SCENARIOS, Choices, SimulatedWalk, simulate
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.store.results import Arrays, Measurement
from fg_nav.magnetic import DETECTORS, FootfallField, average_footfall_field, judge_field
from fg_nav.magnetic.detectors import QUASI_STATIC
from fg_nav.magnetic.footfall_field import (
    compute_field_heading,
    compute_inclination,
    integrate_attitude,
    rotate_to_level,
)
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth

WINDOW = 3  # Strides of a window, as Ma has it; one truth for all detectors, whatever their own windows.
FIELDS = {"smooth": 0.0, "between": 0.35, "indoor": 1.0}  # How much of `indoor` is in each; the rest is `smooth`.
LIMIT_UT = {"smooth": 2.0, "between": 10.0, "indoor": 20.0}  # Of the change of the vector over a window.

MA, MA_THRESHOLD, MA_P_D, OURS = "ma2018-printed", 170.0, 0.8, "ma2018"

STRAIGHT_DEG, CURVED_DEG = 5.0, 15.0  # Of a window's three strides the directions differ by less, or by more.
FEWEST = 20  # Cases of a kind without which no ROC is drawn from them.


@dataclass(frozen=True)
class Judged:
    """One simulated walk in one field: what is true of its F stances, and each detector's statistic over threshold.

    True are the change of the field's vector and of the course over the window, uT and rad, and how far a perfect
    compass is off, rad.
    """

    vector_uT: Floats
    course: Floats
    deviation: Floats
    statistic: Mapping[str, Floats]


@dataclass(frozen=True)
class Case:
    """All walks in one field."""

    field: str
    walks: Sequence[Judged]

    @cached_property
    def walk(self) -> Ints:
        """(M,) which walk a stance is of."""
        return np.repeat(np.arange(len(self.walks)), [len(walk.course) for walk in self.walks])

    @cached_property
    def vector_uT(self) -> Floats:
        """(M,) true change over the window."""
        return np.concatenate([walk.vector_uT for walk in self.walks])

    @cached_property
    def course_deg(self) -> Floats:
        """(M,) by how much the directions of the window's strides differ."""
        return np.asarray(np.rad2deg(np.concatenate([walk.course for walk in self.walks])))

    @cached_property
    def wrong_deg(self) -> Floats:
        """(M,) error of a perfect compass."""
        return np.asarray(np.abs(np.rad2deg(np.concatenate([walk.deviation for walk in self.walks]))))

    def statistic(self, detector: str) -> Floats:
        """(M,) over its threshold; NaN also where the truth is not known."""
        parts = [walk.statistic[detector] for walk in self.walks]
        return np.where(np.isfinite(self.vector_uT), np.concatenate(parts), np.nan)

    def passes(self, detector: str) -> Bools:
        """(M,) True where the field passes; not where it was not judged."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.statistic(detector) < 1.0)

    @property
    def static(self) -> Bools:
        """(M,) truly so, by the field's own limit."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.vector_uT < LIMIT_UT[self.field])

    def roc(self, detector: str) -> Roc | None:
        """ROC against the truth; None with too few of a kind."""
        statistic, signal = self.statistic(detector), self.static
        judged = np.isfinite(statistic)
        if min(signal[judged].sum(), (~signal)[judged].sum()) < FEWEST:
            return None
        return make_roc(statistic, signal, self.walk)


def judge_walk(scenario: str, seed: int) -> dict[str, Judged]:
    """Simulate a scenario with a seed, and judge it in each of `FIELDS`."""
    smooth, indoor = (simulate(scenario, seed, Choices(field=level)) for level in ("smooth", "indoor"))
    stances = detect_stances(smooth.recording)
    attitude = integrate_attitude(smooth.recording, stances)
    return {name: _judge_in(smooth, indoor, share, stances, attitude) for name, share in FIELDS.items()}


def _judge_in(smooth: SimulatedWalk, indoor: SimulatedWalk, share: float, stances: Stances, attitude: Floats) -> Judged:
    """Judge the walk in a mixture of the two fields; both are the same walk."""
    recording = smooth.recording
    sample = stances.stillest(recording.gyr)
    assert isinstance(recording.truth, TrajectoryTruth)
    nav_field = (1 - share) * smooth.nav_field(sample) + share * indoor.nav_field(sample)
    mixed = replace(recording, mag=_mix(recording.mag, indoor.recording.mag, share))
    field = average_footfall_field(_remove_iron(mixed, smooth), stances, nav_R_body=attitude)
    return Judged(
        measure_field_change(nav_field, WINDOW).vector_uT,
        measure_course_change(recording.truth.position[sample], WINDOW),
        measure_compass_deviation(nav_field, smooth.earth.vector),
        {name: judge_field(field, name).statistic for name in DETECTORS},
    )


def _mix(one: Floats | None, other: Floats | None, share: float) -> Floats:
    assert one is not None
    assert other is not None
    return (1 - share) * one + share * other


def _remove_iron(recording: Recording, walk: SimulatedWalk) -> Recording:
    """Remove the hard and soft iron as drawn: as calibrated as can be."""
    assert recording.mag is not None
    sensor = walk.drawn["sensor"]
    mag = np.linalg.solve(np.array(sensor["soft_iron"]), (recording.mag - np.array(sensor["hard_iron_uT"])).T).T
    return replace(recording, mag=mag)


def split_way(case: Case) -> dict[str, Bools]:
    """(M,) True where the path is straight, or is curved."""
    course = case.course_deg
    with np.errstate(invalid="ignore"):
        return {"straight": course < STRAIGHT_DEG, "curved": course >= CURVED_DEG}


def roc_part(scenario: str, seed: int) -> Measurement:
    """What `load_cases` reads of one walk."""
    return Measurement(f"ma2018_roc_{scenario}_{seed}", partial(_measure_detections, scenario, seed))


def _measure_detections(scenario: str, seed: int) -> Arrays:
    """Truth and statistics of one walk in each of `FIELDS`, by names with a slash."""
    arrays: dict[str, Floats] = {}
    for field, walk in judge_walk(scenario, seed).items():
        arrays |= {f"{field}/{name}": getattr(walk, name) for name in _TRUE}
        arrays |= {f"{field}/statistic {name}": values for name, values in walk.statistic.items()}
    return arrays


def load_cases(folder: Path, scenario: str, seeds: Sequence[int]) -> dict[str, Case]:
    """Cases by field, of walks that are kept or made now; the magnetometer calibrated as can be."""
    walks = [roc_part(scenario, seed).load(folder) for seed in seeds]
    return {field: Case(field, [_judged_of(arrays, field) for arrays in walks]) for field in FIELDS}


def _judged_of(arrays: Arrays, field: str) -> Judged:
    statistics = {name: arrays[f"{field}/statistic {name}"] for name in DETECTORS}
    vector_uT, course, deviation = (arrays[f"{field}/{name}"] for name in _TRUE)
    return Judged(vector_uT, course, deviation, statistics)


_TRUE = ("vector_uT", "course", "deviation")


SENSOR = "mpu-9250x8"

WALK = "office"  # 12.2 minutes: ten of them are two hours.

WALKED, IRON_ON, AT_REST = "walked", "iron on", "at rest"

REST_S, QUICK_REST_S = 7200.0, 600.0


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
        found[name] = _sigmas(*_look_at(average_footfall_field(recording, detect_stances(recording))))
    if rest_s:
        found[AT_REST] = _sigmas(*_lie(seed, rest_s))
    return found


def _look_at(field: FootfallField) -> tuple[Floats, Floats, Floats]:
    """What the detector sees of the footfalls that have a field."""
    known = np.isfinite(field.strength)
    return field.heading_difference[known], field.inclination[known], field.strength[known]


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


STRENGTH_HZ = 5.0  # At which the strength of the field is stored.


def headings_part(name: str, scenario: str, field: str, seed: int, method: str) -> Measurement:
    """What `measure_headings` finds; `name` begins that of the file."""
    words = method.replace(":", "-")
    return Measurement(
        f"{name}_{scenario}_{field}_{words}_{seed}", partial(measure_headings, scenario, field, seed, method)
    )


def measure_headings(scenario: str, field: str, seed: int, method: str) -> Arrays:
    """Follow one filter over a walk whose magnetometer is calibrated on the loop.

    Returns
    -------
    dict
        `t` (F,) s, `compass`, `gyroscope`, `estimate` (F,) rad clockwise from north, `used` (F,) where the filter
        used the field, `place` (F, 2) m true, all at the footfalls; `strength_t` (M,) s and `strength` (M,) uT.
    """
    walk = Simulated(scenario, field, seed).prepare(LOOP)
    seen, stances = require_field(walk), solve_by(method, walk).solution.stances
    recording, truth = walk.recording, walk.truth
    assert recording.mag is not None
    assert isinstance(truth, TrajectoryTruth)
    known = np.flatnonzero(np.isfinite(recording.mag).all(axis=1))
    every = known[:: max(round(len(known) / (np.ptp(recording.t) * STRENGTH_HZ)), 1)]
    return {
        "t": seen.t,
        "compass": seen.force_heading,
        "gyroscope": seen.gyro_heading,
        "estimate": compute_heading(stances.nav_R_body),
        "used": np.array([word == QUASI_STATIC for word in stances.field]),
        "place": truth.position[seen.sample, :2],
        "strength_t": recording.t[every],
        "strength": np.linalg.norm(recording.mag[every], axis=1),
    }
