"""`fg-nav inspect`: what a file holds as rows of names and values, and the verdict below."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from fg_nav.commands.requests import InspectRequest
from fg_nav.commands.shared import Answer, answer_each, choose_reading, refuse_misfits, show_number
from fg_nav.detection.mount import NO_EVIDENCE, SUSPECT, AxesEvidence, Wearing
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.inspection import Inspection, Range
from fg_nav.inspection import inspect as inspect_recording
from fg_nav.io import Reading
from fg_nav.report.terminal import console, listing
from fg_nav.text import format_count, to_json

INSPECT_COLUMNS = {
    "format": lambda content: str(content["format"]),
    "samples": show_number("samples", "{:d}"),
    "duration (s)": show_number("duration_s", "{:.1f}"),
    "rate (Hz)": lambda content: _number(content["stamps"]["rate_hz"] or math.nan, "{:.1f}", "-"),
    "verdict": lambda content: str(content["verdict"][0]),
}
"""Of the table of several files."""


def inspect(request: InspectRequest) -> Answer:
    """Inspect each file."""
    files, reading = list(dict.fromkeys(request.files)), choose_reading(request)
    refuse_misfits(request, recordings=len(files))
    if len(files) == 1:
        return inspect_one(files[0], reading, request.mount)
    return answer_each(files, lambda file: inspect_one(file, reading, request.mount), INSPECT_COLUMNS)


def inspect_one(file: Path, reading: Reading, mount: Wearing | None = None) -> Answer:
    """Inspect a file; a recording that cannot be navigated with is a failure."""
    found = inspect_recording(reading.read_raw(file), mount)
    # for scripts: units in the names (SI, deg/s, uT)
    field, axes = found.field, {name: getattr(found.axes, name) for name in ("strides", "against")}
    about_field = field and {
        "strength_uT": field.strength_uT,
        "spread_uT": field.spread_uT,
        "rate_hz": field.rate_hz,
        "points_up": field.points_up,
        "notes": [] if field.aligned is None else field.aligned.notes,
    }
    known = {"recording": str(file), "usable": found.is_usable, "verdict": found.verdict}
    rest = to_json(replace(found, field=None, axes=NO_EVIDENCE))
    content = {**known, **rest, "field": about_field, "axes": {**axes, "words": _axes_words(found.axes)}}

    def show() -> None:
        """Print figures, then the verdict, one sentence a line."""
        verdict = listing([("verdict" if i == 0 else "", words) for i, words in enumerate(found.verdict)])
        for part in (listing(list_figures(found)), "", verdict):
            console().print(part)

    return Answer(content, show, None if found.obstacle is None else RecordingError(found.obstacle))


def list_figures(found: Inspection) -> list[tuple[str, str]]:
    """Return (name, value) rows for the terminal; NaN and None read "unknown"."""
    stamps, rest, field, air, stance = found.stamps, found.rest, found.field, found.air, found.stance
    # Stamps.
    gaps = str(stamps.gaps)
    if stamps.gaps:
        gaps += f", the longest of {1e3 * stamps.longest_gap_s:.0f} ms before row {stamps.longest_gap_row}"
    # Rest.
    bias = ", ".join(f"{value:.3f}" for value in rest.gyro_bias_deg_s)
    where = "at rest" if rest.duration_s > 0 else "when stillest"
    # Field and air.
    strength, pressure = "no magnetometer", []
    if field is not None:
        strength = _number(field.strength_uT, "{:.1f} uT") + _number(field.spread_uT, ", spread {:.1f} uT", "")
        strength += _number(field.rate_hz, ", {:.1f} samples a second", "")
    if air is not None:
        rate = _number(air.rate_hz, ", {:.1f} samples a second", "")
        pressure = [("barometer", f"{air.least_hpa:.2f} to {air.largest_hpa:.2f} hPa{rate}")]
    # Stances.
    stances = f"{stance.count}, {100 * stance.share:.0f} % of the time" if not math.isnan(stance.share) else ""
    return [
        ("file", found.name),
        ("format", found.format),
        ("samples", f"{found.samples} in {found.duration_s:.2f} s"),
        ("rate", _number(stamps.rate_hz, "{:.2f} Hz")),
        ("jitter", _number(1e3 * stamps.jitter_s, "{:.3f} ms")),
        ("gaps", gaps),
        ("stamps", f"{stamps.repeated} repeated, {stamps.backward} backward"),
        ("missing samples", str(stamps.missing)),
        ("acc saturated", _range_words(found.acc_range, "m/s^2")),
        ("gyr saturated", _range_words(found.gyr_range, "rad/s")),
        ("rest", f"{rest.duration_s:.1f} s"),
        (f"|acc| {where}", _number(rest.acc_m_s2, "{:.3f} m/s^2") + f" (gravity {GRAVITY_M_S2:.3f})"),
        ("gyro bias at rest", f"{bias} deg/s" if np.isfinite(rest.gyro_bias_deg_s).all() else "unknown"),
        ("turns like", {"foot": "a foot", "pocket": "a thigh that walks"}.get(found.wearing or "", "not clear")),
        ("axes", _axes_words(found.axes)),
        ("magnetic field", strength),
        *pressure,
        ("stances", stances or stance.reason or "unknown"),
        ("truth", found.truth),
        *(("note", note) for note in found.notes),
    ]


def _range_words(limits: Range, unit: str) -> str:
    share, level = limits.share, limits.level
    axes = [f"{'xyz'[i]} {100 * share[i]:.2g} % at {level[i]:.4g} {unit}" for i in np.flatnonzero(share > 0)]
    return ", ".join(axes) or "no"


def _axes_words(axes: AxesEvidence) -> str:
    if not axes.strides:
        return "not known: no strides"
    if axes.against >= SUSPECT:
        return axes.problem
    return f"those of gyroscope and accelerometer agree in {format_count(axes.strides, 'stride')}"


def _number(value: float, pattern: str, otherwise: str = "unknown") -> str:
    return pattern.format(value) if math.isfinite(value) else otherwise
