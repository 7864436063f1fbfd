"""What a recording is like, in numbers and in words: the answer of `fg-nav inspect`.

Broken files are its purpose: what cannot be measured is NaN. Whether a recording can be navigated with is asked of
`Recording.from_raw`. In words: first the word of `fg_nav.verdict`, as far as samples show it without a path, and why;
then the problems, then what is good.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import detect_stances, find_rests
from fg_nav.detection.mount import (
    DECISIVE,
    NO_EVIDENCE,
    SUSPECT,
    AxesEvidence,
    Wearing,
    measure_axes,
    measure_swing_axes,
    measure_turning,
    refuse_foot,
    refuse_pocket,
)
from fg_nav.detection.sensor_processing import MIN_DELAY_STRIDES, MIN_SMOOTHING_HZ, SPECTRUM_S
from fg_nav.errors import DetectionError, EstimationError, RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic.axes import AlignedMagnetometer, align_magnetometer, field_points_up
from fg_nav.recording import MIN_SAMPLES, RawRecording, Recording
from fg_nav.samples import plausibility
from fg_nav.samples.plausibility import MIN_TURNING_WINDOWS, GravityTransport, find_usable_samples
from fg_nav.samples.readings import find_saturated
from fg_nav.samples.stamps import fit_clock
from fg_nav.text import CUT, format_count
from fg_nav.truth import FootprintTruth
from fg_nav.verdict import UNUSABLE, Verdict, combine
from fg_nav.verdict.limits import Reason, judge_bad_samples, judge_filters

MIN_S = 1.0  # A shorter recording holds no stride.
JITTER_SHARE = 0.02  # Jitter above this share of the period is worth a word.
GRAVITY_TOLERANCE_M_S2 = 0.15  # Gravity varies by 0.03 over the Earth; a calibrated accelerometer errs by less.
LONG_REST_S = 3.0  # Rest of this length shows the bias to better than 0.01 deg/s.
SPREAD_SHARE = 0.15  # A field whose strength has a larger standard deviation is disturbed.
STANCE_SHARES = 0.15, 0.8  # A running foot stands for a fifth of the time; one that stands for longer hardly walks.


@dataclass(frozen=True)
class Stamps:
    """Rate of the sensor's clock, and the standard deviation of the stamps about it; counts of what is wrong."""

    rate_hz: float
    jitter_s: float
    gaps: int  # places where samples were dropped
    longest_gap_s: float  # NaN without one
    longest_gap_row: int | None  # behind it
    repeated: int
    backward: int
    missing: int  # samples


@dataclass(frozen=True)
class Range:
    """Saturation by axis: `share` (3,) of the samples and `level` (3,), NaN where there is none."""

    share: Floats
    level: Floats


@dataclass(frozen=True)
class Rest:
    """Duration of all rests, the size of the mean acc, and the mean gyr (3,), its bias.

    Without rest `acc_m_s2` is that of the stillest moments, and the bias NaN.
    """

    duration_s: float
    acc_m_s2: float
    gyro_bias_deg_s: Floats


@dataclass(frozen=True)
class MagneticField:
    """Median and standard deviation of the strength, and the samples a second."""

    strength_uT: float
    spread_uT: float
    rate_hz: float
    aligned: AlignedMagnetometer | None = None  # its delay and its axes, where the recording is not refused
    points_up: bool = False  # as south of the equator


NO_FIELD = MagneticField(np.nan, np.nan, 0.0)


@dataclass(frozen=True)
class StanceShare:
    """Stances found: their `count` and their `share` of the time; NaN and the `reason` if there are none."""

    count: int
    share: float
    reason: str = ""


@dataclass(frozen=True)
class Air:
    """What the barometer reads: its rate, and the range of the pressure."""

    rate_hz: float
    least_hpa: float
    largest_hpa: float


@dataclass(frozen=True)
class Inspection:
    """A recording in numbers, and its `verdict` in words."""

    name: str
    format: str
    samples: int
    duration_s: float
    stamps: Stamps
    acc_range: Range
    gyr_range: Range
    rest: Rest
    gravity: GravityTransport
    axes: AxesEvidence
    field: MagneticField | None  # None without a magnetometer
    stance: StanceShare
    samples_verdict: Verdict  # on what filters and faults left of the samples
    wearing: Wearing | None  # where the turning is clearly that of one (`fg_nav.detection.mount`)
    mount: Wearing  # for which it is judged: as given, else as it turns, else a foot
    truth: str
    refusal: str | None  # why it cannot be navigated with
    unit_problems: tuple[str, ...]  # wrong units and axes
    notes: tuple[str, ...]  # remarks of reader and admission
    air: Air | None = None  # None without a barometer

    @property
    def obstacle(self) -> str | None:
        """Why no path can be had of it: refused, or without a stance or a length; None if one can."""
        if self.refusal is not None or (self.mount == "pocket" and self.duration_s >= MIN_S):
            return self.refusal
        if self.duration_s < MIN_S:
            return f"it lasts {self.duration_s:.2g} s, and a stride takes one: are its stamps in s?"
        return f"no stance was found: {self.stance.reason}" if np.isnan(self.stance.share) else None

    @property
    def is_usable(self) -> bool:
        """Whether a path can be had of the recording."""
        return self.obstacle is None

    @property
    def verdict(self) -> tuple[str, ...]:
        """One sentence a finding, the most important first."""
        word, reasons, why = self.samples_verdict.word, self.samples_verdict.reasons, self.obstacle
        how = ", as that of a trouser pocket (--mount pocket)" if self.mount == "pocket" else ""
        first = f"{word}: {'; '.join(reasons)}." if reasons else f"usable{how}: `fg-nav run` judges the path."
        first = first if why is None else f"{UNUSABLE}: it cannot be navigated with: {why}"
        further = [f"{_capitalize(p)}." for p in self.unit_problems if p not in (self.refusal or "")]
        return (first, *further, *_list_problems(self), *_list_unjudged(self), *_list_merits(self))


def inspect(raw: RawRecording, mount: Wearing | None = None) -> Inspection:
    """Measure a recording, of a sensor worn there; None for where it turns like it, else on a foot.

    Never fails on content: what cannot be measured is NaN.
    """
    recording, refusal = None, None
    try:
        recording = Recording.from_raw(raw)
    except RecordingError as error:
        refusal = str(error)
    notes = (recording or raw).provenance.notes
    # where it is worn, and its axes
    wearing = None if recording is None else measure_turning(recording).wearing
    worn: Wearing = mount or wearing or "foot"
    if recording is not None and mount is not None:
        try:
            refuse_foot(recording) if mount == "pocket" else refuse_pocket(recording)
        except EstimationError as error:
            recording, refusal = None, str(error)
    measure = measure_swing_axes if worn == "pocket" else measure_axes
    axes = NO_EVIDENCE if recording is None else measure(recording.t, recording.acc, recording.gyr)
    if axes.against > DECISIVE:
        recording, refusal = None, f"{axes.problem}."
    # finite samples, and those later than all before them
    usable = find_usable_samples(raw.t, raw.acc, raw.gyr)
    t, acc, gyr = raw.t[usable], raw.acc[usable], raw.gyr[usable]
    duration = float(np.ptp(t)) if len(t) else 0.0
    rising = np.flatnonzero(usable)[np.diff(np.maximum.accumulate(t), prepend=-np.inf) > 0]
    stamps = _measure_stamps(raw, usable, rising)
    # stances, and what speaks against the samples
    stance = StanceShare(0, np.nan, "not looked for, since the recording cannot be navigated with")
    signs = list[Reason]()
    if recording is not None:
        signs, stance = [judge_bad_samples(recording)], StanceShare(0, np.nan, "not looked for: a thigh never stands")
    if recording is not None and worn == "foot":
        try:
            stances = detect_stances(recording)
            stance = StanceShare(len(stances), float(np.mean(stances.mask)))
            signs.insert(0, judge_filters(recording, stances))
        except DetectionError as error:
            stance = StanceShare(0, np.nan, str(error))
    # the barometer
    air, pressure = None, None if raw.pressure is None else plausibility.keep_air(raw.pressure)
    if pressure is not None:
        rate_hz = int(np.isfinite(pressure).sum()) / duration if duration > 0.0 else np.nan
        air = Air(rate_hz, float(1e-2 * np.nanmin(pressure)), float(1e-2 * np.nanmax(pressure)))
    # the truth it carries
    truth = "none"
    if isinstance(raw.truth, FootprintTruth):
        truth = f"{len(raw.truth.stride)} footprints"
    elif raw.truth is not None:
        truth = f"path of {len(raw.truth.t)} positions{' with attitude' if raw.truth.nav_R_body is not None else ''}"
    return Inspection(
        name=raw.provenance.path.name if raw.provenance.path else "recording",
        format=raw.provenance.format,
        samples=len(raw.t),
        duration_s=duration,
        stamps=stamps,
        acc_range=_measure_range(acc),
        gyr_range=_measure_range(gyr),
        rest=_measure_rest(raw, rising),
        gravity=plausibility.measure_gravity_transport(acc, gyr, 1.0 / stamps.rate_hz),
        axes=axes,
        field=None if raw.mag is None else _measure_field(raw.mag, duration, recording),
        stance=stance,
        samples_verdict=combine(signs),
        wearing=wearing,
        mount=worn,
        truth=truth,
        refusal=refusal,
        unit_problems=plausibility.find_unit_problems(raw.t, raw.acc, raw.gyr, raw.mag),
        notes=notes,
        air=air,
    )


def _measure_stamps(raw: RawRecording, usable: Bools, rising: Ints) -> Stamps:
    t, step = raw.t[rising], np.diff(raw.t[usable])
    counts = [int(np.count_nonzero(wrong)) for wrong in (step == 0, step < 0, ~usable)]
    if len(rising) < 2:
        return Stamps(np.nan, np.nan, 0, np.nan, None, *counts)
    clock = fit_clock(t)
    skipped = np.flatnonzero(np.diff(clock.tick) > 1)
    worst = skipped[np.argmax(np.diff(t)[skipped])] if skipped.size else None
    longest_s = np.nan if worst is None else float(t[worst + 1] - t[worst])
    row = None if worst is None else int(raw.row[rising[worst + 1]])
    return Stamps(1.0 / clock.period, float(np.std(t - clock.even)), len(skipped), longest_s, row, *counts)


def _measure_range(samples: Floats) -> Range:
    flags = find_saturated(samples)
    level = np.full(3, np.nan)
    for axis in np.flatnonzero(flags.any(axis=0)):
        level[axis] = np.abs(samples[flags[:, axis], axis]).min()
    return Range(share=flags.sum(axis=0) / max(1, len(flags)), level=level)


def _measure_rest(raw: RawRecording, rising: Ints) -> Rest:
    """Return duration (s), |force| (m/s^2) and rate (deg/s) at rest; `rising` (K,) are the samples in order of time."""
    t, acc, gyr = raw.t[rising], raw.acc[rising], raw.gyr[rising]
    period = plausibility.median_period_s(t)
    orderly = len(t) >= MIN_SAMPLES and plausibility.find_stamp_problem(period) is None
    rests = find_rests(Recording(t, acc, gyr)) if orderly else ()
    if not rests:
        return Rest(0.0, plausibility.measure_rest_acc(acc, period), np.full(3, np.nan))
    weight = np.array([t[rest.stop - 1] - t[rest.start] for rest in rests])
    acc_at_rest = [float(np.linalg.norm(rest.force)) for rest in rests]
    rate_at_rest = np.average([rest.rate for rest in rests], axis=0, weights=weight)
    return Rest(float(weight.sum()), float(np.average(acc_at_rest, weights=weight)), np.rad2deg(rate_at_rest))


def _measure_field(mag: Floats, duration: float, recording: Recording | None) -> MagneticField:
    strength = plausibility.measure_field_strength(mag)
    strength = strength[np.isfinite(strength)]
    if not strength.size:
        return NO_FIELD
    rate = len(strength) / duration if duration > 0 else np.nan
    found = MagneticField(float(np.median(strength)), float(np.std(strength)), rate)
    if recording is None or recording.mag is None:
        return found
    return replace(found, aligned=align_magnetometer(recording), points_up=field_points_up(recording))


def _list_problems(facts: Inspection) -> list[str]:
    """Return problems with axes, stamps, saturation, rests, magnetometer and stances, one sentence each."""
    stamps, rest, axes, jitter = facts.stamps, facts.rest, facts.axes, facts.stamps.jitter_s * facts.stamps.rate_hz
    field, has_units, is_walk = facts.field or NO_FIELD, not facts.unit_problems, facts.refusal is None
    share, (low, high), is_foot = facts.stance.share, STANCE_SHARES, facts.mount != "pocket"
    gap = f"{1e3 * stamps.longest_gap_s:.0f} ms before row {stamps.longest_gap_row}"
    saturated = [
        f"{name} saturates on {axis}: {100 * share:.2g} % of the samples are beyond {level:.4g} {unit}."
        for name, unit, limits in (("gyr", "rad/s", facts.gyr_range), ("acc", "m/s^2", facts.acc_range))
        for axis, share, level in zip("xyz", limits.share.tolist(), limits.level.tolist(), strict=True)
        if share > 0
    ]
    strength, spread, aligned = field.strength_uT, field.spread_uT, field.aligned
    wrong = None if aligned is None else aligned.wrong_axes
    noted = [] if aligned is None or wrong is not None else [f"{_capitalize(note)} in a run." for note in aligned.notes]
    found: list[tuple[object, str]] = [
        (SUSPECT <= axes.against <= DECISIVE,
         f"{_capitalize(axes.problem)}, perhaps: a few strides more would show it."),
        (stamps.missing, f"Missing, or out of any range: {format_count(stamps.missing, 'sample')}."),
        (stamps.repeated, f"Repeated: {format_count(stamps.repeated, 'stamp')}."),
        (stamps.backward, f"Running backward: {format_count(stamps.backward, 'stamp')}."),
        (stamps.gaps, f"Samples were dropped in {format_count(stamps.gaps, 'place')}; the longest gap is {gap}."),
        (jitter > JITTER_SHARE, f"The stamps jitter by {1e3 * stamps.jitter_s:.2f} ms about the sensor's even clock."),
        *((note.startswith(CUT), f"{_capitalize(note)}.") for note in facts.notes),
        *((True, words) for words in saturated),
        (has_units and abs(rest.acc_m_s2 - GRAVITY_M_S2) > GRAVITY_TOLERANCE_M_S2,
         f"|acc| at rest is {rest.acc_m_s2:.2f} m/s^2, gravity {GRAVITY_M_S2:.2f}: "
         f"the accelerometer has a bias or a scale error, which is taken off in a run."),
        (has_units and rest.duration_s == 0,
         "There is no rest to see the gyroscope's bias in: stand still at the start."),
        (has_units and 0 < rest.duration_s < LONG_REST_S,
         f"There is only {rest.duration_s:.1f} s of rest: stand still for longer at the start."),
        (facts.field is None, "There is no magnetometer: the heading is that of the gyroscope alone."),
        (facts.field is not None and np.isnan(strength), "The magnetometer has no sample."),
        (wrong is not None, f"{_capitalize(wrong.warning if wrong else '')}."),
        *((True, words) for words in noted),
        (field.points_up and wrong is None,
         "The field points up, as on the southern hemisphere: elsewhere all axes are the other way round."),
        (spread > SPREAD_SHARE * strength,
         f"The field is disturbed: {strength:.0f} uT with a standard deviation of {spread:.0f} uT."),
        (is_walk and facts.wearing == "pocket",
         "It turns like a thigh that walks, not like a foot: run it with --mount pocket."),
        (is_walk and is_foot and share < low,
         f"The foot stands for only {100 * share:.0f} % of the time: is this sensor on a foot?"),
        (is_walk and is_foot and share > high,
         f"The foot stands for {100 * share:.0f} % of the time: there is little walk in it."),
    ]  # fmt: skip
    return [words for is_so, words in found if is_so]


def _list_merits(facts: Inspection) -> list[str]:
    """Return what is good about the recording, one sentence each."""
    stamps, rest, field, has_units = facts.stamps, facts.rest, facts.field or NO_FIELD, not facts.unit_problems
    is_even = stamps.jitter_s * stamps.rate_hz <= JITTER_SHARE and not (stamps.gaps or stamps.backward)
    strength, spread = field.strength_uT, field.spread_uT
    bias, (low, high) = ", ".join(f"{value:.2f}" for value in rest.gyro_bias_deg_s), STANCE_SHARES
    found = [
        (is_even, f"The stamps are even, at {stamps.rate_hz:.1f} Hz."),
        (has_units and abs(rest.acc_m_s2 - GRAVITY_M_S2) <= GRAVITY_TOLERANCE_M_S2,
         f"|acc| at rest is {rest.acc_m_s2:.2f} m/s^2: gravity."),
        (facts.gravity.is_telling and 0.3 < facts.gravity.gain < 3.0,
         "Gravity turns as the gyroscope says: units and axes agree."),
        (facts.axes.strides >= 5 and facts.axes.log_odds.any() and facts.axes.against < 1.0,  # fewer do not say so
         f"The axes of gyroscope and accelerometer agree in {facts.axes.strides} strides."),
        (has_units and rest.duration_s >= LONG_REST_S,
         f"{rest.duration_s:.0f} s of rest show the bias: {bias} deg/s."),
        (has_units and spread <= SPREAD_SHARE * strength,
         f"The field is steady: {strength:.0f} uT, {spread:.0f} uT about it."),
        (low <= facts.stance.share <= high,
         f"{facts.stance.count} stances make {100 * facts.stance.share:.0f} % of the time."),
    ]  # fmt: skip
    return [words for is_so, words in found if is_so]


def _capitalize(words: str) -> str:
    return words[:1].upper() + words[1:]


def _list_unjudged(facts: Inspection) -> list[str]:
    """Return one sentence with the checks for which the recording is too short, too slow or turns too little."""
    if facts.refusal is not None or facts.mount == "pocket":
        return []
    rate_hz, strides, checks = facts.stamps.rate_hz, facts.axes.strides, list[str]()
    if facts.gravity.n_windows < MIN_TURNING_WINDOWS and strides < MIN_DELAY_STRIDES:  # strides show them too
        checks.append("units against each other (it hardly turns in quiet)")
    if strides < MIN_DELAY_STRIDES:
        checks.append(f"axes and clocks of gyroscope and accelerometer ({format_count(strides, 'stride')})")
    if rate_hz < MIN_SMOOTHING_HZ or facts.duration_s < SPECTRUM_S:
        checks.append(f"whether the samples are smoothed ({facts.duration_s:.0f} s at {rate_hz:.0f} Hz)")
    return [f"Not judged, for want of data: {', '.join(checks)}."] if checks else []
