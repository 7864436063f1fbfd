"""An inspection in words: first whether the recording can be used, then the problems, then what is good."""

from __future__ import annotations

import numpy as np

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.inspection.facts import Facts, Range
from fg_nav.wording import counted

_JITTER_SHARE = 0.02
"""Jitter above this share of the period is worth a word."""

_GRAVITY_TOLERANCE_M_S2 = 0.15
"""Above the variation of gravity over the Earth (0.03) and the error of a calibrated accelerometer."""

_BIAS_DEG_S = 1.0
"""A bias above this is that of an uncalibrated sensor."""

_LONG_REST_S = 3.0
"""Rest of this length shows the bias to better than a hundredth of a degree a second."""

_SPREAD_SHARE = 0.15
"""A field strength that varies more, in its standard deviation, is disturbed."""

_STANCE_SHARES = (0.15, 0.8)
"""A running foot stands for a fifth of the time or more; one that stands for longer hardly walks."""


def verdict(facts: Facts) -> tuple[str, ...]:
    """Sentences on a recording, the most important first."""
    refused = facts.refusal is not None
    first = f"It cannot be navigated with: {facts.refusal}" if refused else "It can be navigated with."
    further = [f"{p[0].upper()}{p[1:]}." for p in facts.unit_problems if p not in (facts.refusal or "")]
    problems = [*_stamp_problems(facts), *_saturation(facts), *_rest_problems(facts), *_field_problems(facts)]
    return (first, *further, *problems, *_stance_problems(facts), *_good(facts))


def _stamp_problems(facts: Facts) -> list[str]:
    stamps = facts.stamps
    said = []
    if stamps.missing:
        said.append(f"Missing, or out of any range: {counted(stamps.missing, 'sample')}.")
    if stamps.repeated:
        said.append(f"Repeated: {counted(stamps.repeated, 'stamp')}.")
    if stamps.backward:
        said.append(f"Running backward: {counted(stamps.backward, 'stamp')}.")
    if stamps.gaps:
        longest = f"{1e3 * stamps.longest_gap_s:.0f} ms before row {stamps.longest_gap_row}"
        said.append(f"Samples were dropped in {counted(stamps.gaps, 'place')}; the longest gap is {longest}.")
    if stamps.jitter_s * stamps.rate_hz > _JITTER_SHARE:
        said.append(f"The stamps jitter by {1e3 * stamps.jitter_s:.2f} ms about the sensor's even clock.")
    return said


def _saturation(facts: Facts) -> list[str]:
    return [
        f"{name} saturates on {axis}: {100 * share:.2g} % of the samples are beyond {level:.4g} {unit}."
        for name, unit, limits in (("gyr", "rad/s", facts.gyr_range), ("acc", "m/s^2", facts.acc_range))
        for axis, share, level in _saturated_axes(limits)
    ]


def _saturated_axes(limits: Range) -> list[tuple[str, float, float]]:
    rows = zip("xyz", limits.share.tolist(), limits.level.tolist(), strict=True)
    return [row for row in rows if row[1] > 0]


def _rest_problems(facts: Facts) -> list[str]:
    if facts.unit_problems:
        return []
    rest, said = facts.rest, []
    if abs(rest.acc_m_s2 - GRAVITY_M_S2) > _GRAVITY_TOLERANCE_M_S2:
        said.append(
            f"|acc| at rest is {rest.acc_m_s2:.2f} m/s^2, gravity {GRAVITY_M_S2:.2f}: "
            f"the accelerometer has an offset or a scale error."
        )
    if rest.duration_s == 0:
        said.append("There is no rest to see the gyroscope's bias in: stand still at the start.")
    elif rest.duration_s < _LONG_REST_S:
        said.append(f"There is only {rest.duration_s:.1f} s of rest: stand still for longer at the start.")
    if np.abs(rest.gyro_bias_deg_s).max() > _BIAS_DEG_S:
        said.append(f"The gyroscope's bias is large: {_triple(rest.gyro_bias_deg_s)} deg/s.")
    return said


def _field_problems(facts: Facts) -> list[str]:
    field = facts.field
    if field is None:
        return ["There is no magnetometer: the heading is that of the gyroscope alone."]
    if np.isnan(field.strength_uT):
        return ["The magnetometer has no sample."]
    if field.spread_uT > _SPREAD_SHARE * field.strength_uT:
        spread = f"{field.strength_uT:.0f} uT with a standard deviation of {field.spread_uT:.0f} uT"
        return [f"The field is disturbed: {spread}."]
    return []


def _stance_problems(facts: Facts) -> list[str]:
    stance = facts.stance
    if facts.refusal is not None:
        return []
    if facts.wearing == "pocket":
        return ["It turns like a thigh that walks, not like a foot: run it with --mount pocket."]
    if np.isnan(stance.share):
        return [f"No stance was found: {stance.reason}"]
    low, high = _STANCE_SHARES
    if stance.share < low:
        return [f"The foot stands for only {100 * stance.share:.0f} % of the time: is this sensor on a foot?"]
    if stance.share > high:
        return [f"The foot stands for {100 * stance.share:.0f} % of the time: there is little walk in it."]
    return []


def _good(facts: Facts) -> list[str]:
    stamps, rest, field = facts.stamps, facts.rest, facts.field
    said = []
    if stamps.jitter_s * stamps.rate_hz <= _JITTER_SHARE and not (stamps.gaps or stamps.backward):
        said.append(f"The stamps are even, at {stamps.rate_hz:.1f} Hz.")
    if not facts.unit_problems and abs(rest.acc_m_s2 - GRAVITY_M_S2) <= _GRAVITY_TOLERANCE_M_S2:
        said.append(f"|acc| at rest is {rest.acc_m_s2:.2f} m/s^2: gravity.")
    if facts.gravity.is_telling and 0.3 < facts.gravity.gain < 3.0:
        said.append("Gravity turns as the gyroscope says: units and axes agree.")
    if rest.duration_s >= _LONG_REST_S and not facts.unit_problems:
        said.append(f"{rest.duration_s:.0f} s of rest show the bias: {_triple(rest.gyro_bias_deg_s)} deg/s.")
    if field is not None and field.spread_uT <= _SPREAD_SHARE * field.strength_uT and not facts.unit_problems:
        said.append(f"The field is steady: {field.strength_uT:.0f} uT, {field.spread_uT:.0f} uT about it.")
    low, high = _STANCE_SHARES
    if low <= facts.stance.share <= high and facts.wearing != "pocket":
        said.append(f"{facts.stance.count} stances make {100 * facts.stance.share:.0f} % of the time.")
    return said


def _triple(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
