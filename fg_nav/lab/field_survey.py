"""Verdicts of the detectors on the field along a walk, at its footfalls or at every sample, and their quality.

Quality without a truth: the change of compass minus gyroscope from one footfall to the next. Over a stride the
gyroscope is right to a tenth of a degree, so the rest is the field's.

Every sample is judged by the scatter of the field's strength, for a sensor that never stands, as in a pocket. MD (16)
is gated by a detector of the paper's reference 26, which was not available. This one is ours, on the one signal that an
unknown attitude leaves: the strength |B|. Over a window that ends at the sample, of n samples of |B| with standard
deviation sigma,

    T = sum (|B| - mean)^2 / sigma^2      is chi squared with n - 1 degrees of freedom in a static field.

The rate d|B|/dt alone vanishes where the strength is greatest, in the midst of a disturbance; the scatter does not.
If the strength changes evenly by the least change that matters across the window, T is noncentral with

    lambda = (matters / sigma)^2 sum_j (j/(n - 1) - 1/2)^2 = (matters / sigma)^2 n (n + 1) / (12 (n - 1)),

and the threshold is its quantile at the false-alarm rate: the share of such changes that pass. A field that turns and
keeps its strength is not detected, and an uncalibrated magnetometer is disturbed by its own turning. Only measured
samples count, not the NaN rows of a slow magnetometer. At the beginning, and after a gap, the window is shorter, and is
judged as if all of a change had to happen in it.

Quality with a truth. A detector looks at the N steps between the N + 1 stances up to the one it judges. The field of
such a window is truly quasi-static if it is the same at all of its stances, up to a limit: with b_i the true field
there, in nav,

    change_k = max |b_i - b_j|    over all pairs    k - N <= i < j <= k.

All pairs, and not the steps alone: a compass that was used over the window is off by the whole change. With horizontal
strength H its heading changes by asin(limit / H) at most. Static is not right: a field can differ from the Earth's and
stay so (`measure_compass_deviation`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chndtrix

from fg_nav.arrays import Floats, find_runs
from fg_nav.errors import MagneticError
from fg_nav.frames import average_angles, wrap_angle
from fg_nav.magnetic import FieldVerdicts, FootfallField
from fg_nav.magnetic.detectors import (
    DEFAULT,
    DETECTORS,
    FALSE_ALARM_RATE,
    OverThreshold,
    find_own_detectors,
    judge_field,
)
from fg_nav.magnetic.footfall_field import compute_true_heading
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.text import format_count

if TYPE_CHECKING:
    from fg_nav.earth import EarthField
    from fg_nav.walk import Walk

SAMPLEWISE = "munoz-diaz"  # Judges every sample by the second before it; at a foot the footfalls' samples count.
SURVEYED = (*DETECTORS, SAMPLEWISE)  # All detectors, in the order of tables and pictures.
USUAL = tuple(name for name in SURVEYED if not name.endswith("-printed"))  # By default: none as printed in the papers.
ALL = "all"  # Every one of `SURVEYED`.
MIN_FOOTFALLS = 4  # A window of three strides.


@dataclass(frozen=True)
class FieldSurvey:
    """The field of a walk and the verdicts of each detector."""

    field: FootfallField  # At the footfalls.
    verdicts: Mapping[str, FieldVerdicts]  # By detector.
    chosen: str  # Detector of the colours in pictures with one verdict a footfall.
    solution: Solution  # Of a quick estimator, to draw the map on.
    earth: EarthField | None = None  # Undisturbed field at the place and date; None where they were not given.

    @property
    def declination(self) -> float:
        """Of magnetic north, rad clockwise from true north; 0 where the place is not known."""
        return 0.0 if self.earth is None else self.earth.declination

    @property
    def compass_heading(self) -> Floats:
        """(F,) rad clockwise from true north, or from magnetic north where the place is not known."""
        return compute_true_heading(self.field.magnetic_heading, self.declination)

    @property
    def difference(self) -> Floats:
        """(F,) rad, compass minus gyroscope, wrapped."""
        return wrap_angle(self.compass_heading - self.field.gyro_heading)

    @property
    def offset(self) -> float:
        """Circular mean of the difference, rad: the heading at the start, where it was not given."""
        return average_angles(self.difference)

    @cached_property
    def position(self) -> Floats:
        """(F, 3) m of the footfalls."""
        return self.solution.position[self.field.sample]

    @property
    def coverage(self) -> tuple[Coverage, ...]:
        """Coverage of each detector."""
        return tuple(measure_coverage(self.field, name, verdicts) for name, verdicts in self.verdicts.items())


def parse_detectors(words: str | None) -> list[str]:
    """Return the detectors of a comma-separated list, of "all", or without words the usual ones.

    The first is `FieldSurvey.chosen`. Raises `MagneticError` for an unknown name.
    """
    if words is None or words.strip() == ALL:
        return list(dict.fromkeys([DEFAULT, *(USUAL if words is None else SURVEYED)]))
    wanted = [name.strip() for name in words.split(",")]
    for name in wanted:
        if name not in SURVEYED and name not in find_own_detectors():
            known = ", ".join((*SURVEYED, *find_own_detectors()))
            raise MagneticError(f"there is no gate '{name}' to look at: choose {ALL}, or some of {known}.")
    return list(dict.fromkeys(wanted))


def require_field(walk: Walk) -> FootfallField:
    """Return the field at the footfalls; raises `MagneticError` with the reason where it is not known."""
    if walk.field is None:
        raise MagneticError(walk.unjudged or "the field of this walk was not looked at: use `measure_field`.")
    return walk.field


def survey_field(
    recording: Recording,
    field: FootfallField,
    detectors: Sequence[str],
    solution: Solution,
    earth: EarthField | None = None,
) -> FieldSurvey:
    """Judge a walk by each detector, in the order of `SURVEYED`, then others; the first of `detectors` is chosen.

    Raises `MagneticError` if there are too few footfalls for a window, or one cannot judge this walk.
    """
    if len(field) < MIN_FOOTFALLS:
        raise MagneticError(
            f"the recording has {format_count(len(field), 'footfall')}, too few to compare: walk {MIN_FOOTFALLS} or "
            f"more, or look at the samples with --gate {SAMPLEWISE}."
        )
    ordered = sorted(detectors, key=lambda name: SURVEYED.index(name) if name in SURVEYED else len(SURVEYED))
    verdicts = {name: judge_field(field, name) for name in ordered if name != SAMPLEWISE}
    if SAMPLEWISE in detectors:
        # the statistic of the samples, read at the footfalls; threshold of a full window
        statistic = judge_samples(recording).statistic[field.sample]
        reason = f"scatter of the strength over {WINDOW_S:g} s"
        threshold = find_sample_threshold(max(round(WINDOW_S / recording.period_s), MIN_SAMPLES))
        verdicts[SAMPLEWISE] = FieldVerdicts(SAMPLEWISE, statistic, threshold, (reason,) * len(field))
    return FieldSurvey(field, verdicts, detectors[0], solution, earth)


@dataclass(frozen=True)
class Coverage:
    """Share of a walk that a detector accepts, and the quality of its verdicts."""

    detector: str
    footfalls: int
    judged: int
    accepted: int
    longest_run: int  # Accepted footfalls in a row.
    change_deg: float  # Median |change| of compass minus gyroscope between accepted neighbours; NaN without any,
    change_all_deg: float  # and between all neighbours.

    @property
    def share(self) -> float:
        """Accepted, of all footfalls."""
        return self.accepted / self.footfalls if self.footfalls else 0.0


def measure_coverage(field: FootfallField, name: str, verdicts: FieldVerdicts) -> Coverage:
    """Count the footfalls that a detector accepts."""
    accepted = verdicts.quasi_static
    first, after = find_runs(accepted)
    change = np.abs(np.degrees(wrap_angle(np.diff(field.heading_difference))))
    known, both = np.isfinite(change), accepted[1:] & accepted[:-1]
    medians = (float(np.median(change[use])) if use.any() else float("nan") for use in (known & both, known))
    longest = int(np.max(after - first, initial=0))
    return Coverage(name, len(field), int(verdicts.judged.sum()), int(accepted.sum()), longest, *medians)


# --- at every sample --------------------------------------------------------------------------------------------------

WINDOW_S = 1.0  # Of samples: a walker passes a lamp or a car in one to three seconds.
MIN_SAMPLES = 3  # Of the field in a window that is judged.
SIGMA_UT = 0.15  # Of one sample of |B|: noise, 0.11 on the simulated MTw, and the residual of a calibration in a turn.
MATTERS_UT = 0.5  # Least change over the window to be rejected: across a field of 48 uT a turn of half a degree.
SETTINGS: Mapping[str, float] = MappingProxyType(
    {
        "window_s": WINDOW_S, "sigma_uT": SIGMA_UT, "matters_uT": MATTERS_UT, "false_alarm_rate": FALSE_ALARM_RATE,
    }
)  # fmt: skip  # For a file of results.


@dataclass(frozen=True)
class SampleSurvey(OverThreshold):
    """The field at every sample, and the detector's verdicts."""

    t: Floats  # (N,) s.
    strength: Floats  # (N,) uT; NaN where it was not measured.
    statistic: Floats  # (N,), over its threshold.

    @property
    def share(self) -> float:
        """Samples that pass, of those that were judged."""
        judged = int(self.judged.sum())
        return float(self.quasi_static.sum()) / judged if judged else 0.0

    @property
    def longest_s(self) -> float:
        """Time of the longest stretch that passes."""
        first, after = find_runs(self.quasi_static)
        return float(np.max(self.t[after - 1] - self.t[first], initial=0.0))


def find_sample_threshold(count: int) -> float:
    """Threshold of the statistic of a sample with `count` samples in its window."""
    noncentrality = (MATTERS_UT / SIGMA_UT) ** 2 * count * (count + 1) / (12 * (count - 1))
    return float(chndtrix(FALSE_ALARM_RATE, count - 1, noncentrality))


def judge_samples(recording: Recording) -> SampleSurvey:
    """Judge the field at each sample by the window that ends there; NaN where that has too few of the field.

    Raises `MagneticError` without a magnetometer, or if no window has enough samples of the field.
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    t, strength = recording.t, np.linalg.norm(recording.mag, axis=1)
    fresh = np.isfinite(strength)
    value = np.where(fresh, strength - (np.median(strength[fresh]) if fresh.any() else 0.0), 0.0)
    # sums over the window that ends at each sample
    begin = np.searchsorted(t, t - WINDOW_S, side="right")
    totals = (np.concatenate([[0.0], np.cumsum(x)]) for x in (fresh.astype(np.float64), value, value**2))
    samples, total, squares = (x[1:] - x[begin] for x in totals)
    scatter = np.maximum(squares - total**2 / np.maximum(samples, 1.0), 0.0)
    count = np.rint(samples).astype(np.int64)
    if not (count >= MIN_SAMPLES).any():
        raise MagneticError(
            f"no {WINDOW_S:g} s of the recording have {MIN_SAMPLES} samples of the field: record it faster."
        )
    threshold = np.full(count.max() + 1, np.nan)
    for n in np.unique(count[count >= MIN_SAMPLES]):
        threshold[n] = find_sample_threshold(int(n))
    return SampleSurvey(t, strength, scatter / SIGMA_UT**2 / threshold[count])


# --- what is true ----------------------------------------------------------------------------------------------------


def measure_field_change(nav_field: Floats, window: int) -> Floats:
    """Largest change (F,) uT of the true field's vector over the window of each stance; NaN before a whole window.

    `nav_field` (F, 3) uT is true, in nav, at the footfalls; `window` is N, the steps in it.
    """
    return _find_largest(nav_field, window, lambda a, b: np.linalg.norm(a - b, axis=1))


def measure_compass_deviation(nav_field: Floats, earth_field: Floats) -> Floats:
    """Error (F,) rad of the heading that a perfect compass shows in `nav_field` (F, 3) uT, clockwise.

    `earth_field` (3,) or (F, 3) is the field without what deviates it.
    """
    return wrap_angle(_bearing(earth_field) - _bearing(nav_field))


def measure_course_change(position: Floats, window: int) -> Floats:
    """Largest difference (F,) rad between the directions of any two of a window's N steps; NaN before the first.

    `position` (F, 3) m, true, at the footfalls.
    """
    course = _bearing(np.diff(position, axis=0))
    change = _find_largest(course, window - 1, lambda a, b: np.abs(wrap_angle(a - b)))
    return np.concatenate([[np.nan], change])


def _bearing(vector: Floats) -> Floats:
    """Direction (...,) rad over the ground of (..., 3), clockwise from north."""
    return np.asarray(np.arctan2(vector[..., 0], vector[..., 1]))


def _find_largest(values: Floats, window: int, distance: Callable[[Floats, Floats], Floats]) -> Floats:
    """Largest distance (F,) between any two of the `window` + 1 values up to each; NaN before."""
    count = len(values) - window
    parts = [values[lag : lag + count] for lag in range(window + 1)]
    largest = np.max([distance(a, b) for a, b in combinations(parts, 2)], axis=0)
    return np.concatenate([np.full(window, np.nan), largest])
