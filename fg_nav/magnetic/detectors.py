r"""Verdicts on the magnetic field at each footfall, and their detectors: channels, a window, a form, a threshold.

Channels are signals, one value a footfall. A *value* is whatever it is, and its changes from footfall to footfall are
tested; a *zero* should be zero at every footfall and is tested as it stands.

====================== ===== ===== ==========================================================================
signal                 kind  unit  definition
====================== ===== ===== ==========================================================================
strength               value uT    |B|                                              (Ma (13) s^B, QSF)
inclination            value rad   of the field below the horizon                   (Ma (13) s^I)
magnetic heading       value rad   of the body, by the compass                      (iQSF)
gyro heading           value rad   of the body, by the gyroscope                    (iQSF)
heading difference     value rad   compass minus gyroscope                          (Ma (13) s^theta)
heading offset         zero  rad   compass minus inertial heading, that one aligned with the compass (AIEZ (9))
strength rate          zero  uT/s  slope of |B| within the stance                   (AIEZ (9), QSF)
====================== ===== ===== ==========================================================================

At footfall k the window holds the last N changes of each channel c (the N + 1 last footfalls; of a *zero*, the N last);
it ends at the footfall tested, so that a verdict is causal. With x the values, y the changes, all over sigma:

=============== ====================================================================== ==========================
form            statistic T                                                            source
=============== ====================================================================== ==========================
chi squared     sum_c sum_k (x_k - mean x)^2                 (a zero: sum_k x_k^2)      ours
sum of squares  (1/N) sum_c sum_k y_k^2                                                AIEZ (17); Afzal's QSF
squared sums    (1/N) sum_c (sum_k |y_k|)^2                                            Ma (26), absolutes as printed
=============== ====================================================================== ==========================

The field passes where T < threshold: the likelihood ratio test of Ma (15)-(26) and AIEZ (8), (10)-(18), with their
misprints (docs/equations.md) put right.

Changes of values that scatter independently are correlated by -1/2 from one to the next (MA(1)), so their squares do
not add up to a chi squared, against Ma (14). The scatter of the values themselves does: T is chi squared with N degrees
of freedom a channel, exactly, in a static field.

Threshold. Ma's P_FA is the probability that a field passes which is *not* quasi-static. It needs a meaning of "not": a
channel's `matters`, the change spread evenly over the window that has to be rejected (of a zero: its lasting value).
T is then noncentral chi squared with

    lambda = min over channels of (matters / sigma)^2 s,   s = sum_j (j/N - 1/2)^2 = (N + 1)(N + 2) / (12 N);
                                                           of a zero, s = N;

and the threshold its quantile at the false-alarm rate; P_D, the share of static fields that pass, follows.

Alignment of the heading, for a heading offset. A scalar Kalman filter estimates the difference of inertial heading and
compass: its first value is the mean of the first `ALIGNMENT_FOOTFALLS`, which are not tested; it is updated at each
footfall that passes, and only predicted where the field is rejected. A walk that begins in a disturbed field is tested
against that field; a lasting deviation is accepted in the end, as the test widens with the drift.

The detectors by name are those of the papers, physical and as printed. What matters is our choice: over three strides
3 uT, along the field or across it. In Munich's field that is 3 uT of strength, 4 deg of inclination or 8 deg of
heading. For AIEZ, a compass that is 10 deg off, or a strength that changes by 2.5 uT/s, 0.75 uT in a short stance.

Sigmas of the physical presets are an eighth of that: 1 deg of heading difference, 0.5 deg, 0.375 uT for one stance's
mean. A heading itself scatters by 2 deg from stride to stride: iQSF is allowed 3 deg, and needs 20 deg as the least
turn that matters. The compass of AIEZ is allowed 2.5 deg, beside the drift.

As printed: Ma's sigmas, N = 3 and threshold 170 (28.9 deg a step in the heading difference alone). Zhang gives no value
and Afzal's and iQSF's are not in these papers: Ma's sigmas where they apply, 10 deg and 0.5 uT/s for AIEZ, and the 99 %
quantile of independent changes, the authors' assumption.

Verdicts. A window spans twice its length of strides at most; the first footfalls, with too few before them, are not
judged. An estimator with better attitudes replaces `nav_R_body` in the footfall field and has it judged again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

import numpy as np
from scipy.special import chdtri, chndtrix

from fg_nav.arrays import Bools, Brief, Floats, Ints
from fg_nav.errors import MagneticError
from fg_nav.frames import average_angles, wrap_angle
from fg_nav.magnetic.footfall_field import FootfallField
from fg_nav.plugins import find_plugins
from fg_nav.text import format_count, format_ratio

FALSE_ALARM_RATE = 0.05  # Share of the fields that change by what matters and pass, where no threshold is fixed.
ALIGNMENT_FOOTFALLS = 3  # Footfalls whose mean aligns the inertial heading with the compass; they are not tested.
HEADING_DRIFT = float(np.deg2rad(0.2))  # Random walk of the inertial heading, rad/sqrt(s): 1.5 deg after a minute.

Form: TypeAlias = Literal["chi squared", "sum of squares", "squared sums"]
FORMS: tuple[Form, ...] = get_args(Form)

OFFSET = "heading offset"  # The only signal that depends on earlier verdicts.


@dataclass(frozen=True)
class Signal:
    """Quantity `of` a footfall field (F,), its `unit` for people and how many of these a unit is."""

    of: Callable[[FootfallField], Floats]
    unit: str
    scale: float
    angle: bool
    value: bool


_ANGLE = "deg", float(np.degrees(1.0)), True
SIGNALS: Mapping[str, Signal] = {
    "strength": Signal(lambda field: field.strength, "uT", 1.0, False, True),
    "inclination": Signal(lambda field: field.inclination, *_ANGLE, True),
    "magnetic heading": Signal(lambda field: field.magnetic_heading, *_ANGLE, True),
    "gyro heading": Signal(lambda field: field.gyro_heading, *_ANGLE, True),
    "heading difference": Signal(lambda field: field.heading_difference, *_ANGLE, True),
    OFFSET: Signal(lambda field: field.heading_difference, *_ANGLE, False),
    "strength rate": Signal(lambda field: field.strength_rate, "uT/s", 1.0, False, False),
}


@dataclass(frozen=True)
class Channel:
    """A signal and what is expected of it, in rad, uT or uT/s.

    `sigma` is of one footfall's value, or, in a form as printed, of what that form squares. To a strength rate the
    standard error of each slope is added, as variances add. `matters` is the least change over the window (of a zero:
    the least lasting value) that a detector is to reject; only needed for a threshold from a false-alarm rate.
    """

    name: str  # Of the signal, one of `SIGNALS`.
    sigma: float
    matters: float = float("nan")

    def __post_init__(self) -> None:
        if self.name not in SIGNALS:
            raise MagneticError(f"there is no channel '{self.name}': choose one of {', '.join(SIGNALS)}.")
        if not self.sigma > 0.0 or not np.isfinite(self.sigma):
            raise MagneticError(f"the sigma of channel '{self.name}' must be positive, not {self.sigma}.")

    @property
    def signal(self) -> Signal:
        """Entry of `SIGNALS`."""
        return SIGNALS[self.name]

    def values(self, field: FootfallField) -> Floats:
        """(F,) rad, uT or uT/s; NaN where there was no field. Angles are not unwrapped."""
        value = self.signal.of(field)
        return np.asarray(np.where(np.isfinite(field.strength), value, np.nan))

    def sigmas(self, field: FootfallField) -> Floats:
        """(F,) standard deviation of each value; NaN where it is unknown."""
        if self.name != "strength rate":
            return np.full(len(field), self.sigma)
        return np.asarray(np.hypot(self.sigma, field.strength_rate_sigma))


@dataclass(frozen=True)
class Detector:
    """A detector of the quasi-static field.

    `counts_drift`: of a heading offset: test against S = P + sigma^2 (a Kalman filter's innovation); False for sigma^2
    alone, AIEZ (17) as printed, which rejects for ever once the drift exceeds sqrt(threshold) sigma.
    """

    name: str  # For people and for `DETECTORS`.
    channels: tuple[Channel, ...]  # At least one.
    form: Form = "chi squared"  # How they become one statistic.
    window: int = 3  # N, changes from footfall to footfall that are tested; for zeros alone, footfalls.
    fixed_threshold: float | None = None  # Of the statistic, or None for that of the false-alarm rate.
    counts_drift: bool = True

    def __post_init__(self) -> None:
        if not self.channels:
            raise MagneticError(f"detector '{self.name}' has no channel: give it at least one.")
        if self.form not in FORMS:
            raise MagneticError(f"there is no form '{self.form}' of a detector: choose one of {', '.join(FORMS)}.")
        if self.window < 1:
            raise MagneticError(f"the window of detector '{self.name}' must be at least 1, not {self.window}.")
        if self.fixed_threshold is not None and not self.fixed_threshold > 0.0:
            raise MagneticError(f"the threshold of a detector must be positive, not {self.fixed_threshold}.")

    @property
    def changing(self) -> Bools:
        """(C,) True for channels that are values, False for zeros."""
        return np.array([channel.signal.value for channel in self.channels])

    @property
    def rows(self) -> int:
        """Footfalls that a verdict uses."""
        return self.window + bool(self.changing.any())

    @property
    def max_strides(self) -> int:
        """Strides that a window may span, those without a field included."""
        return 2 * (self.rows - 1)

    @property
    def offset_column(self) -> int | None:
        """Index of the heading offset among the channels."""
        return next((c for c, channel in enumerate(self.channels) if channel.name == OFFSET), None)

    @property
    def degrees_of_freedom(self) -> int:
        """Of the statistic under a static field; chi squared only."""
        return self.window * len(self.channels)

    @property
    def noncentrality(self) -> float:
        """Of the statistic under the least change that matters, in the channel in which it is seen worst."""
        spread = (self.window + 1) * (self.window + 2) / (12 * self.window)
        return min((c.matters / c.sigma) ** 2 * (spread if c.signal.value else self.window) for c in self.channels)

    @property
    def threshold(self) -> float:
        """Of the statistic; raises as `find_threshold` where none is fixed."""
        return self.find_threshold(FALSE_ALARM_RATE) if self.fixed_threshold is None else self.fixed_threshold

    def find_threshold(self, false_alarm_rate: float) -> float:
        """Threshold at which this share of the fields that change by what matters passes.

        Raises `MagneticError` for a form that is not chi squared, or a channel without `matters`.
        """
        if not 0.0 < false_alarm_rate < 1.0:
            raise MagneticError(f"a false-alarm rate must be between 0 and 1, not {false_alarm_rate}.")
        if self.form != "chi squared":
            raise MagneticError(
                f"the form '{self.form}' of detector '{self.name}' has no distribution to take a rate from: "
                "fix its threshold, or choose 'chi squared'."
            )
        if not np.isfinite(self.noncentrality):
            raise MagneticError(f"detector '{self.name}' does not say which changes matter: fix its threshold.")
        return float(chndtrix(false_alarm_rate, self.degrees_of_freedom, self.noncentrality))

    def compute_statistic(self, window: Floats) -> Floats:
        """T (...,) of windows (..., C, rows) of the channels' values over their sigmas, angles unwrapped."""
        return np.asarray(self.compute_parts(window).sum(axis=-1))

    def compute_parts(self, values: Floats) -> Floats:
        """Share (..., C) of each channel in the statistic T, which is their sum.

        `values` (..., C, rows) over their sigmas: N + 1 rows of a value, of which a zero uses the last N.
        """
        latest = values[..., -self.window :]
        if self.form == "chi squared":
            about_mean = values - values.mean(axis=-1, keepdims=True)
            return np.asarray(np.where(self.changing, (about_mean**2).sum(axis=-1), (latest**2).sum(axis=-1)))
        # the N changes of a value from row to row; a zero as it stands
        change = np.where(self.changing[:, None], np.diff(latest, axis=-1, prepend=values[..., :1]), latest)
        sums = (change**2).sum(axis=-1) if self.form == "sum of squares" else np.abs(change).sum(axis=-1) ** 2
        return np.asarray(sums / self.window)


def _make_channel(name: str, sigma: float, matters: float) -> Channel:
    return Channel(name, float(np.deg2rad(sigma)), float(np.deg2rad(matters)))


_STRENGTH = Channel("strength", sigma=0.375, matters=3.0)
_INCLINATION = _make_channel("inclination", sigma=0.5, matters=4.0)
_DIFFERENCE = _make_channel("heading difference", sigma=1.0, matters=8.0)
_STRENGTH_RATE = Channel("strength rate", sigma=0.5, matters=2.5)

MA_SIGMA_HEADING, MA_SIGMA_INCLINATION, MA_SIGMA_STRENGTH = 0.067, 0.054, 0.535  # rad, rad, uT: Ma 2018, standing.
_MA_STRENGTH = Channel("strength", MA_SIGMA_STRENGTH)
_MA_INCLINATION = Channel("inclination", MA_SIGMA_INCLINATION)


def _make_printed(
    name: str, form: Form, window: int, channels: tuple[Channel, ...], counts_drift: bool = True
) -> Detector:
    """As printed, with a threshold at the 99 % quantile of N C independent squares."""
    quantile = float(chdtri(window * len(channels), 0.01)) / window
    return Detector(name, channels, form, window, fixed_threshold=quantile, counts_drift=counts_drift)


_ALL = (
    Detector("qsf", (_STRENGTH,)),
    Detector(
        "iqsf",
        (
            _STRENGTH,
            _INCLINATION,
            _make_channel("magnetic heading", 3.0, 20.0),
            _make_channel("gyro heading", 3.0, 20.0),
        ),
    ),
    Detector("ma2018", (_DIFFERENCE, _INCLINATION, _STRENGTH)),
    Detector("aiez", (_make_channel(OFFSET, 2.5, 10.0), _STRENGTH_RATE), window=1),
    Detector("qsf-stance", (_STRENGTH_RATE,), window=1),
    _make_printed("qsf-printed", "sum of squares", 3, (_MA_STRENGTH,)),
    _make_printed(
        "iqsf-printed",
        "sum of squares",
        3,
        (
            _MA_STRENGTH,
            _MA_INCLINATION,
            Channel("magnetic heading", MA_SIGMA_HEADING),
            Channel("gyro heading", MA_SIGMA_HEADING),
        ),
    ),
    Detector(
        "ma2018-printed",
        (Channel("heading difference", MA_SIGMA_HEADING), _MA_INCLINATION, _MA_STRENGTH),
        "squared sums",
        window=3,
        fixed_threshold=170.0,
    ),
    _make_printed(
        "aiez-printed",
        "sum of squares",
        1,
        (Channel(OFFSET, float(np.deg2rad(10.0))), Channel("strength rate", 0.5)),
        counts_drift=False,
    ),
)

DETECTORS: Mapping[str, Detector] = MappingProxyType({detector.name: detector for detector in _ALL})
DEFAULT = "ma2018"  # It keeps to curved walks, where iQSF cannot, and needs no heading to begin with, as AIEZ does.


def find_own_detectors() -> Mapping[str, Detector]:
    """Detectors of other packages by name (`fg_nav.plugins`); raises `PluginError` as `find_plugins`."""
    return find_plugins("detectors", Detector)


def scale_detector(detector: Detector, allowance: float, window: int | None = None) -> Detector:
    """Return the detector that lets pass changes `allowance` times as large, over a `window` of its own."""
    channels = tuple(
        replace(channel, sigma=allowance * channel.sigma, matters=allowance * channel.matters)
        for channel in detector.channels
    )
    return replace(detector, channels=channels, window=detector.window if window is None else window)


# `aiez` as the filter's own test, with the sigma of the compass's update: 25 deg pass. With 2.5 deg a filter whose
# heading is off by more than 6 deg rejects every correct compass.
AGREEING = replace(DETECTORS["aiez"], channels=(_make_channel(OFFSET, 10.0, 40.0), *DETECTORS["aiez"].channels[1:]))
# The detectors of the filters' preset `tuned` and of the smoother's gates (`fg_nav.ekf.presets`).
TUNED: Mapping[str, Detector] = MappingProxyType(
    {
        **DETECTORS,
        "qsf": scale_detector(DETECTORS["qsf"], 8.0, window=1),
        "iqsf": scale_detector(DETECTORS["iqsf"], 16.0, window=5),
        "ma2018": scale_detector(DETECTORS["ma2018"], 16.0, window=2),
        "aiez": scale_detector(AGREEING, 1.4),
    }
)


# verdicts

NO_GATE = "none"  # The gate that weighs all footfalls alike.
HARD = ":hard"  # Suffix of a gate, the papers' switch: the compass is used at its full weight or not at all.
GATES = (*DETECTORS, NO_GATE, *(name + HARD for name in DETECTORS))  # Weights of the compass at a footfall, by name.
PRIOR_COUNT = 2.0  # Weight of the walk's own spread against one footfall's statistic, in changes of the field.

NO_FIELD, TOO_LITTLE = "no field was measured at this footfall", "too little of the field was measured at this footfall"
QUASI_STATIC, DISTURBED, UNKNOWN = "quasi-static", "disturbed", "none"  # Verdicts; `none` where there is none.


class OverThreshold:
    """Verdicts by a statistic (F,) over its threshold: below 1 the field passes; NaN where there is none."""

    statistic: Floats

    @property
    def judged(self) -> Bools:
        """(F,) True where there was enough of the field to judge it."""
        return np.isfinite(self.statistic)

    @property
    def quasi_static(self) -> Bools:
        """(F,) True where the field passes; never where it was not judged."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.statistic < 1.0)


@dataclass(frozen=True)
class FieldVerdicts(Brief, OverThreshold):
    """Verdicts on the field, one a footfall."""

    detector: str  # Its name.
    statistic: Floats  # (F,) of the detector, over its threshold.
    threshold: float  # Of the statistic, in the detector's own units.
    reason: tuple[str, ...]  # (F,) of the verdict, in words.

    def __len__(self) -> int:
        return len(self.statistic)

    @property
    def coverage(self) -> float:
        """Share of all footfalls whose field passes."""
        return float(self.quasi_static.mean()) if len(self) else 0.0

    @property
    def words(self) -> tuple[str, ...]:
        """(F,) the verdicts as they stand in `strides.csv`."""
        passed = np.where(self.quasi_static, QUASI_STATIC, DISTURBED)
        return tuple(str(word) for word in np.where(self.judged, passed, UNKNOWN))


def find_detector(name: str) -> Detector:
    """Return the detector of this name, known or of another package; raises `MagneticError` for any other name."""
    found = DETECTORS.get(name) or find_own_detectors().get(name)
    if found is None:
        known = ", ".join((*DETECTORS, *find_own_detectors()))
        raise MagneticError(f"there is no detector '{name}': choose one of {known}.")
    return found


def find_gate(gate: str) -> Detector:
    """Return the detector of a gate, hard or not, which is the one of the filter of that name."""
    name = gate.removesuffix(HARD)
    return TUNED.get(name) or find_detector(name)


def choose_gate(name: str | None) -> str:
    """Return the gate that was asked for, or the default; raises `MagneticError` if there is none of this name."""
    if name is not None and name not in GATES and name.removesuffix(HARD) not in find_own_detectors():
        known = ", ".join((*GATES, *find_own_detectors()))
        raise MagneticError(f"there is no gate '{name}': choose one of {known}.")
    return DEFAULT if name is None else name


def apply_gate(field: FootfallField, gate: str) -> FieldVerdicts:
    """Judge the field by the gate of this name, one of `GATES`; raises `MagneticError` as `find_detector`."""
    if gate != NO_GATE:
        return judge_field(field, find_gate(gate))
    seen = np.isfinite(field.strength)
    reasons = tuple("there is no gate" if one else NO_FIELD for one in seen)
    return FieldVerdicts(NO_GATE, np.where(seen, 0.0, np.nan), np.inf, reasons)


def weigh_statistic(verdicts: FieldVerdicts, gate: str) -> Floats:
    """Variance (F,) of the compass at each footfall over that of the whole walk, by the statistic of the gate.

    The statistic T sums n squared changes of the field, and is v chi squared for a field of variance v. So T over its
    median estimates v relative to the walk; with a prior worth `PRIOR_COUNT` changes the posterior mean is

        (PRIOR_COUNT + n T / median T) / (PRIOR_COUNT + n).

    A hard gate has 1 where it passes the field and infinity elsewhere; without a gate all are 1.
    """
    if gate.endswith(HARD):
        return np.where(verdicts.quasi_static, 1.0, np.inf)
    judged = verdicts.judged
    if gate == NO_GATE or not judged.any() or not (middle := float(np.median(verdicts.statistic[judged]))) > 0.0:
        return np.ones(len(verdicts))
    detector = find_gate(gate)
    count = detector.window * len(detector.channels)
    ratio = np.where(judged, verdicts.statistic / middle, 1.0)
    return np.asarray((PRIOR_COUNT + count * ratio) / (PRIOR_COUNT + count))


def count_needed(gate: str) -> int | None:
    """Latest footfalls that a verdict of this gate depends on; None for all so far, which align a heading offset."""
    if gate == NO_GATE:
        return 1
    detector = find_gate(gate)
    return detector.max_strides + 1 if detector.offset_column is None else None


def judge_field(field: FootfallField, detector: Detector | str = DEFAULT) -> FieldVerdicts:
    """Judge the field at F footfalls, in order of time, each by it and those before it.

    One footfall after the other, the latest (`count_needed`) are enough; with a heading offset, whose alignment depends
    on earlier verdicts, all of them are needed. Raises `MagneticError` for a
    name that is none, or a detector without a threshold.
    """
    chosen = find_detector(detector) if isinstance(detector, str) else detector
    threshold = chosen.threshold
    values = np.stack([channel.values(field) for channel in chosen.channels], axis=1)
    sigmas = np.stack([channel.sigmas(field) for channel in chosen.channels], axis=1)
    # the footfalls that have a field, without whole turns between neighbours
    measured = np.flatnonzero(np.isfinite(values + sigmas).all(axis=1))
    values, sigmas = values[measured], sigmas[measured]
    angles = [c for c, channel in enumerate(chosen.channels) if channel.signal.angle and channel.signal.value]
    values[:, angles] = np.unwrap(values[:, angles], axis=0)
    # those whose window has all its footfalls, near enough to each other
    strides = chosen.rows - 1
    complete = np.zeros(len(measured), dtype=np.bool_)
    complete[strides:] = measured[strides:] - measured[: max(len(measured) - strides, 0)] <= chosen.max_strides
    if chosen.offset_column is not None:
        complete[:ALIGNMENT_FOOTFALLS] = False
        _align_heading(values, sigmas, field.t[measured], complete, chosen, threshold)
    # one statistic a window, over the threshold
    ends = np.flatnonzero(complete)
    rows = ends[:, None] + np.arange(-strides, 1)
    windows = np.swapaxes(values[rows], 1, 2)
    parts = chosen.compute_parts(windows / np.swapaxes(sigmas[rows], 1, 2)) / threshold
    statistic = np.full(len(field), np.nan)
    statistic[measured[ends]] = parts.sum(axis=1)
    # reasons, first why a footfall is not judged
    reasons = [TOO_LITTLE if known else NO_FIELD for known in np.isfinite(field.strength)]
    for n, footfall in enumerate(measured):
        reasons[footfall] = f"over {format_count(strides, 'stride')} there are too many footfalls without a field"
        if n < strides:
            reasons[footfall] = f"fewer than {format_count(chosen.rows, 'footfall')} with a field so far"
        if chosen.offset_column is not None and n < ALIGNMENT_FOOTFALLS:
            reasons[footfall] = "here the inertial heading is aligned with the compass"
    for end, reason in zip(ends, _explain_verdicts(windows, parts, measured, ends, chosen), strict=True):
        reasons[measured[end]] = reason
    return FieldVerdicts(chosen.name, statistic, threshold, tuple(reasons))


def _align_heading(
    values: Floats, sigmas: Floats, t: Floats, complete: Bools, detector: Detector, threshold: float
) -> None:
    """Subtract the alignment (scalar Kalman filter) from the heading offset, and add its variance; both in place."""
    column, first = detector.offset_column, min(ALIGNMENT_FOOTFALLS, len(values))
    if column is None or not first:
        return
    difference, noise = values[:, column].copy(), detector.channels[column].sigma ** 2
    alignment, variance = average_angles(difference[:first]), noise / first
    for k in range(len(values)):
        # predict: the inertial heading drifts
        if k >= first:
            variance += HEADING_DRIFT**2 * (t[k] - t[k - 1])
        values[k, column] = wrap_angle(difference[k] - alignment)
        if detector.counts_drift:
            sigmas[k, column] = np.sqrt(noise + variance)
        # update where the field passes
        window = slice(k + 1 - detector.rows, k + 1)
        if complete[k] and detector.compute_statistic((values[window] / sigmas[window]).T) < threshold:
            gain = variance / (variance + noise)
            alignment, variance = alignment + gain * values[k, column], (1.0 - gain) * variance


def _explain_verdicts(windows: Floats, parts: Floats, measured: Ints, ends: Ints, detector: Detector) -> list[str]:
    """Reasons (E,) of the verdicts at footfalls `ends`: channel of the largest part of T, the others in brackets."""
    described = []
    for values, channel in zip(np.swapaxes(windows, 0, 1), detector.channels, strict=True):
        signal = channel.signal
        number = (np.ptp(values, axis=1) if signal.value else values[:, -1]) * signal.scale
        words = f"{channel.name} changes by" if signal.value else channel.name
        described.append([f"{words} {each:.2g} {signal.unit}" for each in number])
    strides = measured[ends] - measured[ends + 1 - detector.rows]
    reasons = []
    for each, part, count in zip(zip(*described, strict=True), parts, strides, strict=True):
        first, *others = (each[c] for c in np.argsort(-part, kind="stable"))
        rest = f" ({', '.join(others)})" if others else ""
        over = f"over {format_count(int(count), 'stride')}" if count else "this stance"
        reasons.append(f"{over}: {first}{rest}; {format_ratio(part.sum())} times the threshold")
    return reasons
