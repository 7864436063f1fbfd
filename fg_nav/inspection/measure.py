"""Measure a recording, however broken.

A rest, as meant here, is a second in which neither gyroscope nor accelerometer shows more than its noise: a
foot between two steps rolls too much for it. The mean gyroscope output in it is the bias, but for the turn
of the Earth (0.004 deg/s).
"""

from __future__ import annotations

import numpy as np

from fg_nav import plausibility
from fg_nav.arrays import Bools, Floats
from fg_nav.errors import DetectionError, RecordingError
from fg_nav.inspection.facts import Facts, Inspection, MagneticField, Range, Rest, Stamps, StanceShare
from fg_nav.inspection.words import verdict
from fg_nav.recording import FootprintTruth, RawRecording, Recording, Truth, usable_samples
from fg_nav.saturation import saturated
from fg_nav.timing import fit_clock

_REST_S = 1.0
_REST_GYR_RAD_S = float(np.deg2rad(0.6))
_REST_ACC_M_S2 = 0.15
"""Standard deviations at rest: above the noise of consumer sensors, below the movement of a walking foot."""


def inspect(raw: RawRecording) -> Inspection:
    """Look at a recording, and say what is good about it and what is not. Never fails on content."""
    facts = _facts(raw)
    return Inspection(**vars(facts), verdict=verdict(facts))


def _facts(raw: RawRecording) -> Facts:
    recording, refusal = _judged(raw)
    usable = usable_samples(raw)
    t, acc, gyr = raw.t[usable], raw.acc[usable], raw.gyr[usable]
    duration = float(np.ptp(t)) if len(t) else 0.0
    stamps = _stamps(raw, usable)
    period = 1.0 / stamps.rate_hz
    return Facts(
        name=raw.provenance.path.name if raw.provenance.path else "recording",
        format=raw.provenance.format,
        samples=len(raw.t),
        duration_s=duration,
        stamps=stamps,
        acc_range=_range(acc),
        gyr_range=_range(gyr),
        rest=_rest(acc, gyr, period),
        gravity=plausibility.gravity_transport(acc, gyr, period),
        field=None if raw.mag is None else _field(raw.mag, duration),
        stance=_stance_share(recording),
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


def _stamps(raw: RawRecording, usable: Bools) -> Stamps:
    kept = np.flatnonzero(usable)
    step = np.diff(raw.t[kept])
    latest = np.maximum.accumulate(raw.t[kept])
    rising = kept[np.diff(latest, prepend=-np.inf) > 0]
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


def _rest(acc: Floats, gyr: Floats, period: float) -> Rest:
    length = round(_REST_S / period) if 1e-4 < period < _REST_S / 3 else 0
    resting = _resting(acc, gyr, length) if 0 < length <= len(acc) else np.zeros(len(acc), dtype=np.bool_)
    if not resting.any():
        return Rest(0.0, plausibility.rest_acc(acc, period), np.full(3, np.nan))
    return Rest(
        duration_s=float(np.count_nonzero(resting) * period),
        acc_m_s2=float(np.median(np.linalg.norm(acc[resting], axis=1))),
        gyro_bias_deg_s=np.rad2deg(gyr[resting].mean(axis=0)),
    )


def _resting(acc: Floats, gyr: Floats, length: int) -> Bools:
    """(N,) True where a sample is part of `length` samples of rest."""
    still = (_moving_std(acc, length) < _REST_ACC_M_S2) & (_moving_std(gyr, length) < _REST_GYR_RAD_S)
    change = np.zeros(len(acc) + 1, dtype=np.int64)
    begin = np.flatnonzero(still.all(axis=1))
    change[begin] += 1
    change[begin + length] -= 1
    return np.asarray(np.cumsum(change[:-1]) > 0)


def _moving_std(vectors: Floats, length: int) -> Floats:
    """Take the standard deviations (N - length + 1, 3) of `length` neighbours."""
    centred = vectors - np.median(vectors, axis=0)  # the sums below cancel less
    first, second = (np.concatenate([np.zeros((1, 3)), np.cumsum(v, axis=0)]) for v in (centred, centred**2))
    mean = (first[length:] - first[:-length]) / length
    variance = (second[length:] - second[:-length]) / length - mean**2
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


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
    from fg_nav.detection import detect_stances

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
