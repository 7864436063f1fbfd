"""Measure a recording, however broken."""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import detect_stances, find_rests
from fg_nav.detection.mount import measure_turning
from fg_nav.errors import DetectionError, RecordingError
from fg_nav.inspection.facts import Facts, Inspection, MagneticField, Range, Rest, Stamps, StanceShare
from fg_nav.inspection.words import verdict
from fg_nav.recording import MIN_SAMPLES, FootprintTruth, RawRecording, Recording, Truth, usable_samples
from fg_nav.samples import plausibility
from fg_nav.samples.saturation import saturated
from fg_nav.samples.timing import fit_clock


def inspect(raw: RawRecording) -> Inspection:
    """Look at a recording, and say what is good about it and what is not. Never fails on content."""
    facts = _facts(raw)
    return Inspection(**vars(facts), verdict=verdict(facts))


def _facts(raw: RawRecording) -> Facts:
    recording, refusal = _judged(raw)
    usable = usable_samples(raw)
    t, acc, gyr = raw.t[usable], raw.acc[usable], raw.gyr[usable]
    duration = float(np.ptp(t)) if len(t) else 0.0
    rising = _rising(raw, usable)
    stamps = _stamps(raw, usable, rising)
    return Facts(
        name=raw.provenance.path.name if raw.provenance.path else "recording",
        format=raw.provenance.format,
        samples=len(raw.t),
        duration_s=duration,
        stamps=stamps,
        acc_range=_range(acc),
        gyr_range=_range(gyr),
        rest=_rest(raw, rising),
        gravity=plausibility.gravity_transport(acc, gyr, 1.0 / stamps.rate_hz),
        field=None if raw.mag is None else _field(raw.mag, duration),
        stance=_stance_share(recording),
        wearing=None if recording is None else measure_turning(recording).wearing,
        truth=_described(raw.truth),
        refusal=refusal,
        unit_problems=plausibility.unit_problems(raw.t, raw.acc, raw.gyr, raw.mag),
        notes=(recording or raw).provenance.notes,
    )


def _judged(raw: RawRecording) -> tuple[Recording | None, str | None]:
    try:
        return Recording.from_raw(raw), None
    except RecordingError as error:
        return None, str(error)


def _rising(raw: RawRecording, usable: Bools) -> Ints:
    """Find the usable samples that are later than all before them."""
    kept = np.flatnonzero(usable)
    latest = np.maximum.accumulate(raw.t[kept])
    return kept[np.diff(latest, prepend=-np.inf) > 0]


def _stamps(raw: RawRecording, usable: Bools, rising: Ints) -> Stamps:
    step = np.diff(raw.t[usable])
    counts = {
        "repeated": int(np.count_nonzero(step == 0)),
        "backward": int(np.count_nonzero(step < 0)),
        "missing": int(np.count_nonzero(~usable)),
    }
    if len(rising) < 2:
        return Stamps(np.nan, np.nan, 0, np.nan, None, **counts)
    t = raw.t[rising]
    clock = fit_clock(t)
    skipped = np.flatnonzero(np.diff(clock.tick) > 1)
    worst = skipped[np.argmax(np.diff(t)[skipped])] if skipped.size else None
    return Stamps(
        rate_hz=1.0 / clock.period,
        jitter_s=float(np.std(t - clock.even)),
        gaps=len(skipped),
        longest_gap_s=np.nan if worst is None else float(t[worst + 1] - t[worst]),
        longest_gap_row=None if worst is None else int(raw.row[rising[worst + 1]]),
        **counts,
    )


def _range(samples: Floats) -> Range:
    flags = saturated(samples)
    level = np.full(3, np.nan)
    for axis in np.flatnonzero(flags.any(axis=0)):
        level[axis] = np.abs(samples[flags[:, axis], axis]).min()
    return Range(share=flags.sum(axis=0) / max(1, len(flags)), level=level)


def _rest(raw: RawRecording, rising: Ints) -> Rest:
    """Measure the rests among samples in order of time, even if the recording is refused."""
    t, acc, gyr = raw.t[rising], raw.acc[rising], raw.gyr[rising]
    period = plausibility.median_period_s(t)
    orderly = len(t) >= MIN_SAMPLES and plausibility.stamp_problem(period) is None
    rests = find_rests(Recording(t, acc, gyr)) if orderly else ()
    if not rests:
        return Rest(0.0, plausibility.rest_acc(acc, period), np.full(3, np.nan))
    weight = np.array([t[rest.stop - 1] - t[rest.start] for rest in rests])
    acc_at_rest = [float(np.linalg.norm(rest.force)) for rest in rests]
    rate_at_rest = np.average([rest.rate for rest in rests], axis=0, weights=weight)
    return Rest(float(weight.sum()), float(np.average(acc_at_rest, weights=weight)), np.rad2deg(rate_at_rest))


def _field(mag: Floats, duration: float) -> MagneticField:
    strength = plausibility.field_strength(mag)
    strength = strength[np.isfinite(strength)]
    if not strength.size:
        return MagneticField(np.nan, np.nan, 0.0)
    rate = len(strength) / duration if duration > 0 else np.nan
    return MagneticField(float(np.median(strength)), float(np.std(strength)), rate)


def _stance_share(recording: Recording | None) -> StanceShare:
    if recording is None:
        return StanceShare(0, np.nan, "not looked for, since the recording cannot be navigated with")
    try:
        stances = detect_stances(recording)
    except DetectionError as error:
        return StanceShare(0, np.nan, str(error))
    return StanceShare(len(stances), float(np.mean(stances.mask)))


def _described(truth: Truth | None) -> str:
    if truth is None:
        return "none"
    if isinstance(truth, FootprintTruth):
        return f"{len(truth.stride)} footprints"
    attitude = " with attitude" if truth.nav_R_body is not None else ""
    return f"path of {len(truth.t)} positions{attitude}"
