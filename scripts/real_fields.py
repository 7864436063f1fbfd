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
shuffled        how many are accepted, and their rms, where the footfalls of each walk come in random order. Chance
                neighbours that agree are nearer to the middle than one alone (four of them twice as near): a detector
                that only sees chance does as well here
change          of the difference since the stance before, rms, of all and of the accepted
=============== ====================================================================================================

AIEZ tests the difference itself: what it accepts is near to the middle because that is what it asks for:
its rms says nothing about the field.

Calibration (`fg_nav.calibration.walk`), circular sd of the difference: as it is; calibrated on the walk itself; as is
about a line in time (the inertial heading drifts), and so about a line with each eighth of the walk calibrated on the
others ("other parts"). Level iron: what it adds to the field over the ground, uT forward and left,
its standard deviation per axis, and by how many degrees (rms) it alone would spread the compass. A walk on which it
refuses is calibrated all the same here, and said to be refused. "Found" asks for a gain on the other parts: the
median of those found flatters, and that of all walks does not.

Real walks with their magnetometer and without it: the set `magnetometer` of `real_walks.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import harness
import numpy as np
import walks
from harness import Figure
from walks import GDIN, OPENSHOE, REAL_WALKS

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration import (
    UPPER,
    MagnetometerCalibration,
    circular_sd_deg,
    correct_field,
    differentiate_inverse,
    mean_up,
)
from fg_nav.calibration.walk import (
    Spread,
    WalkCalibrationParameters,
    calibrate_on_walk,
    measure_spread,
)
from fg_nav.calibration.walk_model import WITHOUT_IRON, StrideModel, StrideReadings, fit_iron, read_strides, sum_iron
from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.errors import CalibrationError, EstimationError, EvaluationError
from fg_nav.frames import wrap_angle
from fg_nav.io import read
from fg_nav.lab.campaign.walks import RAW, WALK, Recorded
from fg_nav.magnetic import FieldVerdicts, FootfallField, average_footfall_field
from fg_nav.magnetic.detectors import DETECTORS, judge_field
from fg_nav.magnetic.footfall_field import compute_level_R_body
from fg_nav.pipeline import run_method
from fg_nav.walk import Walk as PreparedWalk

MAGNETIC_M, NO_WORSE, MAGNETIC_CLOSURE_PERCENT = 0.45, 1.10, 0.5
"""Mean footprint rmse, m; greatest ratio of any walk's to its own without the field; median closure, %."""

KNOWN_IRON: Mapping[str, str] = {RAW: "as recorded", WALK: "calibrated on the walk"}
MERITS = {GDIN: "footprint rmse (m)", OPENSHOE: "closure (%)"}


@dataclass(frozen=True)
class Pair:
    """A figure of merit of one walk without the field and with it, by what was known of the iron; infinite: failed."""

    group: str
    walk: str
    without: float
    with_field: Mapping[str, float]
    calibrated: bool

    def ratio(self, iron: str) -> float:
        """With the field over without it."""
        return self.with_field[iron] / self.without

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        known = {"without": self.without, **self.with_field}
        rounded = {name: harness.finite(float(f"{value:.5g}")) for name, value in known.items()}
        return {"group": self.group, "name": self.walk, **rounded, "calibrated": self.calibrated}


def measure_pairs(data: Path, names: Mapping[str, Sequence[str]] = REAL_WALKS) -> list[Pair]:
    """Measure each walk without the field and with it."""
    return [measure_pair(group, walk, data) for group in MERITS for walk in names[group]]


def measure_pair(group: str, walk: str, data: Path) -> Pair:
    """Measure one walk without the field and with it."""
    source = Recorded(walks.real_path(group, walk, data))
    prepared = {iron: source.prepare(iron) for iron in KNOWN_IRON}
    with_field = {iron: measure_merit(one, "smoother") for iron, one in prepared.items()}
    known = prepared[WALK].calibration is not None
    return Pair(group, walk, measure_merit(prepared[RAW], "inertial"), with_field, known)


def measure_merit(walk: PreparedWalk, method: str) -> float:
    """Footprint rmse in m where there is a truth, else closure in percent; infinite where the method fails."""
    try:
        metrics = run_method(walk, method).metrics
    except (EstimationError, EvaluationError):
        return float("inf")
    value = metrics.closure_percent if walk.truth is None else metrics.rmse_2d_m
    return float("inf") if value is None else value


def print_pairs(pairs: Sequence[Pair]) -> list[Figure]:
    """Print one row a walk, and return the figures of each group."""
    figures = []
    for group, merit in MERITS.items():
        some = [pair for pair in pairs if pair.group == group]
        if not some:
            continue
        harness.print_heading(f"{group}: {merit}, without the magnetometer and with it (ratio)")
        rows = []
        for one in some:
            cells = [f"{one.with_field[iron]:.3f} ({one.ratio(iron):.2f})" for iron in KNOWN_IRON]
            rows.append((f"{group} {one.walk}", f"{one.without:.3f}", *cells, "yes" if one.calibrated else "no"))
        harness.print_table(("walk", "without", *KNOWN_IRON.values(), "shows its iron"), rows)
        found = [figure for iron in KNOWN_IRON for figure in judge_pairs(group, some, iron)]
        harness.print_figures(found)
        figures += found
    return figures


def judge_pairs(group: str, pairs: Sequence[Pair], iron: str) -> list[Figure]:
    """What is asked with the magnetometer."""
    some = np.array([one.with_field[iron] for one in pairs])
    worst, words = max(one.ratio(iron) for one in pairs), KNOWN_IRON[iron]
    section, name = f"{group}, magnetometer", f"{words}: greatest ratio to without"
    mean, middle = float(some.mean()), float(np.median(some))
    if group == OPENSHOE:
        return [
            Figure(section, f"{words}: closure, median (%)", "smoother", middle, high=MAGNETIC_CLOSURE_PERCENT),
            Figure(section, name, "smoother", worst, pattern="{:.2f}"),
        ]
    return [
        Figure(section, f"{words}: rmse, mean (m)", "smoother", mean, high=MAGNETIC_M),
        Figure(section, name, "smoother", worst, high=NO_WORSE, pattern="{:.2f}"),
    ]


ANYWAY = WalkCalibrationParameters(must_gain=False, largest_sigma_uT=float("inf"))  # Calibrates on any walk.


@dataclass(frozen=True)
class FieldWalk:
    """A walk, its field and strides with the inertial attitude of the IEZ filter, and what each detector says."""

    name: str
    field: FootfallField
    strides: StrideReadings
    verdicts: Mapping[str, FieldVerdicts]

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
    draws = harness.option(50, "random orders to compare with", metavar="N")
    chosen = harness.parse_arguments(__doc__, arguments, data=None, draws=draws, walks=None)
    found = read_fields(walks.data_folder(chosen.data), chosen.walks)
    print_coverage(found)
    print_worth(found, chosen.draws)
    print_calibrations(found)


def read_fields(data: Path, names: Sequence[str] | None = None) -> list[FieldWalk]:
    """Load the walks, all or those named."""
    numbers = [n for n in walks.GDIN_WALKS if names is None or f"gdin {n}" in names]
    some = [name for name in walks.LOOPS if name.startswith(OPENSHOE) and (names is None or name in names)]
    return [_judge(walk) for walk in (*walks.read_gdin(data, numbers), *walks.read_loops(data, some))]


def _judge(walk: walks.Walk) -> FieldWalk:
    path = walk.recording.provenance.path
    assert path is not None
    recording = read(path)
    stances = detect_stances(recording)
    inertial = run_iez(walk.recording, walk.stances).nav_R_body
    field = average_footfall_field(recording, stances, nav_R_body=inertial)
    strides = read_strides(recording, stances, inertial)
    return FieldWalk(walk.name, field, strides, {name: judge_field(field, name) for name in DETECTORS})


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
    header = ("detector", "accepted", "rms: all", "accepted", "shuffled: accepted", "rms", "change: all", "accepted")
    harness.print_table(header, [measure_worth(found, name, draws) for name in DETECTORS])


def measure_worth(found: Sequence[FieldWalk], name: str, draws: int) -> list[str]:
    """Figures of one detector, pooled over the walks."""
    rng = np.random.default_rng(0)
    passed = [walk.verdicts[name].quasi_static for walk in found]
    difference, change = [w.difference for w in found], [w.change for w in found]
    every = [np.isfinite(d) for d in difference]
    count, rms = shuffle_footfalls(found, name, draws, rng)
    return [
        name,
        f"{sum(p.sum() for p in passed)}",
        *(_degrees(_rms_deg(difference, of)) for of in (every, passed)),
        f"{count:.1f}",
        _degrees(rms),
        *(_degrees(_rms_deg(change, of)) for of in (every, passed)),
    ]


def _degrees(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"


def shuffle_footfalls(
    found: Sequence[FieldWalk], name: str, times: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Accepted stances and their rms, deg, where the footfalls of each walk come in random order; means over times."""
    passed, difference = [], []
    for walk in (walk for _ in range(times) for walk in found):
        order = rng.permutation(len(walk.field))
        moved = (f.name for f in fields(walk.field) if f.name not in ("sample", "t"))
        mixed = {part: getattr(walk.field, part)[order] for part in moved}
        passed.append(judge_field(replace(walk.field, **mixed), name).quasi_static)
        difference.append(walk.difference[order])
    return sum(p.sum() for p in passed) / times, _rms_deg(difference, passed)


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


def calibrate(walk: FieldWalk) -> Calibrated:
    """Calibrate on the walk, refused or not."""
    refused = ""
    try:
        calibrate_on_walk(walk.strides)
    except CalibrationError as error:
        refused = str(error)
    found = calibrate_on_walk(walk.strides, ANYWAY)
    itself = circular_sd_deg(correct_field(walk.field, found).heading_difference)
    model = StrideModel.of(walk.strides)
    parts = measure_spread(model, fit_iron(model))
    return Calibrated(found, refused, circular_sd_deg(walk.field.heading_difference), itself, parts)


def print_calibrations(found: Sequence[FieldWalk]) -> None:
    """Spread of compass minus inertial heading, before and after."""
    every = {walk.name: calibrate(walk) for walk in found}
    harness.print_heading(
        "Circular sd of compass minus inertial heading, deg, before and after a calibration from walks"
    )
    rows, figures = [], []
    for walk in found:
        c = every[walk.name]
        figures.append((c.before, c.itself, c.parts.before_deg, c.parts.after_deg))
        rows.append([walk.name, *(f"{x:.1f}" for x in figures[-1]), *_level_iron(walk, c)])
    taken = [not every[walk.name].refused for walk in found]
    rows.append(_middle("median", figures, [True] * len(found)))
    if any(taken):
        rows.append(_middle("median of those found", figures, taken))
    spreads = ("as it is", "on itself", "less a line", "other parts")
    harness.print_table(("walk", *spreads, "level iron", "sigma", "iron alone", "verdict"), rows)
    for name, c in every.items():
        if c.refused:
            print(f"{name}: {c.refused}")


def _middle(name: str, figures: Sequence[tuple[float, ...]], chosen: Sequence[bool]) -> list[str]:
    middle = np.median(np.array(figures)[np.array(chosen)], axis=0)
    return [name, *(f"{x:.1f}" for x in middle), "", "", "", f"{sum(chosen)} walks"]


def _level_iron(walk: FieldWalk, c: Calibrated) -> tuple[str, str, str, str]:
    # horizontal iron of a foot that stands flat: h, and S times the vertical field
    found, up = c.calibration, mean_up(walk.field.nav_R_body)
    vertical_uT = float(np.nanmean(correct_field(walk.field, found).nav_field[:, 2]))
    level = compute_level_R_body(up)[:2] @ sum_iron(up, vertical_uT)
    iron = np.concatenate([found.hard_iron_uT, np.linalg.inv(found.correction)[UPPER]])
    by_parameters = level @ differentiate_inverse(found.correction)
    offset, covariance = level @ (iron - WITHOUT_IRON), by_parameters @ found.covariance @ by_parameters.T
    sigma = np.sqrt(np.trace(covariance) / 2)
    strength = np.linalg.norm(np.nanmean(correct_field(walk.field, c.calibration).nav_field, axis=0)[:2])
    alone = np.degrees(np.linalg.norm(offset) / strength / np.sqrt(2))
    verdict = "refused" if c.refused else "found"
    return f"{offset[0]:+.1f} {offset[1]:+.1f}", f"{sigma:.1f}", f"{alone:.0f}", verdict


if __name__ == "__main__":
    harness.run(main)
