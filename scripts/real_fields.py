"""What a real floor leaves of the magnetic heading: detectors and calibration on the gdin and openshoe walks.

    python scripts/real_fields.py [--data DIR] [--draws N]

Ten gdin walks (one sensor, one person's foot, seven ways of mounting) and three openshoe walks, indoors. Inertial
heading: the IEZ filter without magnetometer; every figure is of the difference compass minus inertial heading at the
footfalls, as the sensor reads, without any calibration. Its circular mean over the walk is taken off: how the two
headings lie to each other is no fact about the field.

Worth of an accepted stance, pooled over the walks:

=============== ====================================================================================================
accepted        stances that a detector passes, all walks together
rms: all        of the difference about the middle of its walk, of all stances with a field
accepted        the same of the accepted
p               share of random choices whose rms is no larger: as many stances of each walk
p shifted       the same of the pattern of verdicts shifted along its walk: runs of neighbours stay together
shuffled        how many are accepted, and their rms, where the footfalls of each walk come in random order. Chance
                neighbours that agree are nearer to the middle than one alone (four of them twice as near): a detector
                that only sees chance does as well here
change          of the difference since the stance before, rms, of all and of the accepted
=============== ====================================================================================================

AIEZ tests the difference itself: what it accepts is near to the middle because that is what it asks for, and neither
its rms nor its p say anything about the field.

Calibration (`fg_nav.calibration.walk`), circular sd of the difference: as it is; calibrated on the walk itself; as is
about a line in time (the inertial heading drifts), and so about a line with each eighth of the walk calibrated on the
others ("other parts"); calibrated on the other walks of the same sensor, their hard irons averaged by their covariances
("other walks": not all are mounted alike). Level iron: what it adds to the field over the ground, uT forward and left,
its standard deviation per axis, and by how many degrees (rms) it alone would spread the compass. A walk on which it
refuses is calibrated all the same here, and said to be refused. "Found" asks for a gain on the other parts: the
median of those found flatters, and that of all walks does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import harness
import numpy as np
import walks

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration import (
    Spread,
    WalkCalibrationParameters,
    calibrate_on_walk,
    circular_sd_deg,
    correct_field,
    find_level_iron,
    measure_spread,
)
from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap_angle
from fg_nav.io import read
from fg_nav.magnetic import FieldVerdicts, FootfallField, average_footfall_field
from fg_nav.magnetic.quasi_static import DETECTORS, judge_field

OPENSHOE = ("openshoe 1", "openshoe 7", "openshoe 13")

ANYWAY = WalkCalibrationParameters(must_gain=False, largest_sigma_uT=float("inf"))
"""Calibrates on any walk."""

SHUFFLE_SHARE = 40
"""Shuffling costs a run of the detector: so many times fewer than random choices."""


@dataclass(frozen=True)
class FieldWalk:
    """A walk, its field with the inertial attitude of the IEZ filter, and what each detector says."""

    name: str
    field: FootfallField
    verdicts: Mapping[str, FieldVerdicts]

    @property
    def sensor(self) -> str:
        """Which sensor it was."""
        return self.name.split()[0]

    @cached_property
    def difference(self) -> Floats:
        """Compass minus inertial heading (F,) rad about its circular mean; NaN without a field."""
        middle = np.angle(np.nanmean(np.exp(1j * self.field.heading_difference)))
        return wrap_angle(self.field.heading_difference - middle)

    @property
    def change(self) -> Floats:
        """Of the difference since the stance before (F,) rad; NaN for the first."""
        return wrap_angle(np.diff(self.difference, prepend=np.nan))


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    draws = harness.option(2000, "random choices to compare with", metavar="N")
    chosen = harness.parse_arguments(__doc__, arguments, data=None, draws=draws, walks=None)
    found = real_fields(walks.data_folder(chosen.data), chosen.walks)
    print_coverage(found)
    print_worth(found, chosen.draws)
    print_calibrations(found)


def real_fields(data: Path, names: Sequence[str] | None = None) -> list[FieldWalk]:
    """Load the walks, all or those named."""
    numbers = [n for n in walks.GDIN_WALKS if names is None or f"gdin {n}" in names]
    some = [name for name in OPENSHOE if names is None or name in names]
    return [_judged(walk) for walk in (*walks.read_gdin(data, numbers), *walks.read_loops(data, some))]


def _judged(walk: walks.Walk) -> FieldWalk:
    path = walk.recording.provenance.path
    assert path is not None
    recording = read(path)
    stances = detect_stances(recording)
    inertial = run_iez(walk.recording, walk.stances).nav_R_body
    field = average_footfall_field(recording, stances, nav_R_body=inertial)
    return FieldWalk(walk.name, field, {name: judge_field(field, name) for name in DETECTORS})


def print_coverage(found: Sequence[FieldWalk]) -> None:
    """Accepted and rejected shares of all footfalls; what is left was not judged."""
    harness.print_heading("Accepted / rejected, % of the footfalls")
    rows = [[walk.name, str(len(walk.field)), *(_shares([v]) for v in walk.verdicts.values())] for walk in found]
    rows.append(["all", str(sum(len(w.field) for w in found))])
    rows[-1] += [_shares([walk.verdicts[name] for walk in found]) for name in DETECTORS]
    harness.print_table(("walk", "footfalls", *DETECTORS), rows)


def _shares(verdicts: Sequence[FieldVerdicts]) -> str:
    passed = np.concatenate([v.quasi_static for v in verdicts])
    judged = np.concatenate([v.judged for v in verdicts])
    return f"{100 * passed.mean():.0f} / {100 * (judged & ~passed).mean():.0f}"


def print_worth(found: Sequence[FieldWalk], draws: int) -> None:
    """What an accepted stance is worth against the inertial heading."""
    harness.print_heading("Worth of an accepted stance, deg")
    some = ("accepted", "rms: all", "accepted", "p", "p shifted")
    header = ("detector", *some, "shuffled: accepted", "rms", "change: all", "accepted")
    harness.print_table(header, [worth(found, name, draws) for name in DETECTORS])


def worth(found: Sequence[FieldWalk], name: str, draws: int) -> list[str]:
    """Figures of one detector, pooled over the walks."""
    rng = np.random.default_rng(0)
    passed = [walk.verdicts[name].quasi_static for walk in found]
    difference, change = [w.difference for w in found], [w.change for w in found]
    every = [np.isfinite(d) for d in difference]
    chance = chances(difference, passed, draws, rng) if np.concatenate(passed).any() else (np.nan, np.nan)
    count, rms = shuffled(found, name, max(1, draws // SHUFFLE_SHARE), rng)
    return [
        name,
        f"{sum(p.sum() for p in passed)}",
        *(_told(_rms_deg(difference, of), 1) for of in (every, passed)),
        *(_told(share, 3) for share in chance),
        f"{count:.1f}",
        _told(rms, 1),
        *(_told(_rms_deg(change, of), 1) for of in (every, passed)),
    ]


def _told(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def shuffled(found: Sequence[FieldWalk], name: str, times: int, rng: np.random.Generator) -> tuple[float, float]:
    """Accepted stances and their rms, deg, where the footfalls of each walk come in random order; means over times."""
    passed, difference = [], []
    for walk in (walk for _ in range(times) for walk in found):
        order = rng.permutation(len(walk.field))
        moved = (f.name for f in fields(walk.field) if f.name not in ("sample", "t"))
        mixed = {part: getattr(walk.field, part)[order] for part in moved}
        passed.append(judge_field(replace(walk.field, **mixed), name).quasi_static)
        difference.append(walk.difference[order])
    return sum(p.sum() for p in passed) / times, _rms_deg(difference, passed)


def chances(
    difference: Sequence[Floats], passed: Sequence[Bools], draws: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Share of random choices, and of shifted ones, whose rms is no larger than that of those passed."""
    known = [np.isfinite(d) for d in difference]
    values = [d[k] for d, k in zip(difference, known, strict=True)]
    marks = [p[k] for p, k in zip(passed, known, strict=True)]
    actual = _rms_deg(values, marks)
    chosen = [[rng.permutation(m) for m in marks] for _ in range(draws)]
    shifted = [[np.roll(m, int(rng.integers(len(m)))) for m in marks] for _ in range(draws)]
    some, along = (np.mean([_rms_deg(values, of) <= actual + 1e-9 for of in way]) for way in (chosen, shifted))
    return float(some), float(along)


def _rms_deg(values: Sequence[Floats], chosen: Sequence[Bools]) -> float:
    """NaN where none is chosen."""
    pooled = np.concatenate([v[c] for v, c in zip(values, chosen, strict=True)])
    pooled = pooled[np.isfinite(pooled)]
    return float(np.degrees(np.sqrt(np.mean(pooled**2)))) if len(pooled) else float("nan")


@dataclass(frozen=True)
class Calibrated:
    """A walk's calibration, whether it would be refused, and spreads in deg."""

    calibration: MagnetometerCalibration
    refused: str
    before: float
    itself: float
    parts: Spread


def calibrated(walk: FieldWalk) -> Calibrated:
    """Calibrate on the walk, refused or not."""
    refused = ""
    try:
        calibrate_on_walk(walk.field)
    except CalibrationError as error:
        refused = str(error)
    found = calibrate_on_walk(walk.field, ANYWAY)
    itself = circular_sd_deg(correct_field(walk.field, found).heading_difference)
    return Calibrated(
        found, refused, circular_sd_deg(walk.field.heading_difference), itself, measure_spread(walk.field)
    )


def print_calibrations(found: Sequence[FieldWalk]) -> None:
    """Spread of compass minus inertial heading, before and after."""
    every = {walk.name: calibrated(walk) for walk in found}
    harness.print_heading(
        "Circular sd of compass minus inertial heading, deg, before and after a calibration from walks"
    )
    rows, figures = [], []
    for walk in found:
        c = every[walk.name]
        others = [every[w.name].calibration for w in found if w.sensor == walk.sensor and w.name != walk.name]
        elsewhere = circular_sd_deg(_by_others(walk.field, others).heading_difference)
        figures.append((c.before, c.itself, c.parts.before_deg, c.parts.after_deg, elsewhere))
        rows.append([walk.name, *(f"{x:.1f}" for x in figures[-1]), *_level_iron(walk, c)])
    taken = [not every[walk.name].refused for walk in found]
    rows.append(_middle("median", figures, [True] * len(found)))
    if any(taken):
        rows.append(_middle("median of those found", figures, taken))
    spreads = ("as it is", "on itself", "less a line", "other parts", "other walks")
    harness.print_table(("walk", *spreads, "level iron", "sigma", "iron alone", "verdict"), rows)
    for name, c in every.items():
        if c.refused:
            print(f"{name}: {c.refused}")


def _middle(name: str, figures: Sequence[tuple[float, ...]], chosen: Sequence[bool]) -> list[str]:
    middle = np.median(np.array(figures)[np.array(chosen)], axis=0)
    return [name, *(f"{x:.1f}" for x in middle), "", "", "", f"{sum(chosen)} walks"]


def _level_iron(walk: FieldWalk, c: Calibrated) -> tuple[str, str, str, str]:
    offset, covariance = find_level_iron(c.calibration, walk.field)
    sigma = np.sqrt(np.trace(covariance) / 2)
    strength = np.linalg.norm(np.nanmean(correct_field(walk.field, c.calibration).nav_field, axis=0)[:2])
    alone = np.degrees(np.linalg.norm(offset) / strength / np.sqrt(2))
    verdict = "refused" if c.refused else "found"
    return f"{offset[0]:+.1f} {offset[1]:+.1f}", f"{sigma:.1f}", f"{alone:.0f}", verdict


def _by_others(field: FootfallField, others: Sequence[MagnetometerCalibration]) -> FootfallField:
    """Correct by the hard irons of other walks, averaged by their covariances; as it is if there are none."""
    if not others:
        return field
    weights = [np.linalg.inv(c.covariance[:3, :3]) for c in others]
    pulled = sum(w @ c.hard_iron_uT for w, c in zip(weights, others, strict=True))
    hard = np.linalg.solve(np.sum(weights, axis=0), pulled)
    return replace(field, body_field=field.body_field - hard)


if __name__ == "__main__":
    harness.run(main)
