"""Calibration of a magnetometer from an ordinary walk, on simulated ones: how wrong, and does it know how wrong.

    python scripts/walk_calibration.py [--seeds N] [--first SEED]

Strides, headings and field are the simulator's: its courses, its levels `indoor` and `smooth`, at Munich, a building a
seed. The footfalls are made from them without sensing every sample: the foot stands flat to 1.5 deg, the sensor sits
turned on it by up to 20 deg, the field is read to 0.2 uT, and the inertial heading drifts by a constant rate (0.02
deg/s) and a walk (1 deg per root of a minute).

Iron: drawn as the preset `mpu-9250x8` has it (9.5 uT per axis, soft 0.06), or Ma's Table 1.

=============== ====================================================================================================
found           share of the walks on which it does not refuse
error           of h over the ground, uT per axis, rms over the walks on which it is found; with what soft iron makes of
                the vertical field, which a level floor cannot tell from it and which harms the heading just the same
standardised    that error by its own covariance, rms: 1 is honest; over all walks, refused or not
h               the same of h alone, all three axes
compass         minus true heading, circular sd over the footfalls, median over the walks on which it is found: as it
                is, calibrated, and free of iron
=============== ====================================================================================================
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import figures as fig
import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.calibration import (
    WalkCalibrationParameters,
    calibrate_on_walk,
    circular_sd_deg,
    corrected_field,
    level_iron,
)
from fg_nav.errors import CalibrationError
from fg_nav.frames import GRAVITY_M_S2, yaw_rotation
from fg_nav.lab.simulation import SCENARIOS
from fg_nav.lab.simulation.fields import SITES, environment
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Section, Walk, plan
from fg_nav.lab.simulation.sensors import Iron, IronPrior, ma_table_1
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.compass import level_R_body

EARTH = SITES["munich"]
SENSOR_M = np.array([0.0, 0.0, 0.1])
STANDS_FLAT_RAD, SITS_TURNED_RAD = np.radians(1.5), np.radians(20.0)
READ_TO_UT = 0.2
DRIFT_RATE_DEG_S, DRIFT_WALK_DEG_SQRT_MIN = 0.02, 1.0

PRESET = IronPrior(hard_sd_uT=9.5, soft_sd=0.06)

COURSES: dict[str, Callable[[np.random.Generator], Sequence[Section]]] = {
    "demo": SCENARIOS["demo"].course,
    "office": SCENARIOS["office"].course,
    "mall": SCENARIOS["mall"].course,
    "straight": lambda _: [Walk(straight(80.0))],
}

CASES = (
    ("demo", "indoor", "preset"),
    ("demo", "smooth", "preset"),
    ("demo", "indoor", "none"),
    ("office", "indoor", "preset"),
    ("office", "smooth", "preset"),
    ("office", "indoor", "Ma"),
    ("mall", "indoor", "preset"),
    ("straight", "indoor", "preset"),
)
IRON = {"preset": PRESET, "Ma": ma_table_1(), "none": IronPrior()}


@dataclass(frozen=True)
class Walked:
    """Footfalls of a made-up walk, with iron; `free` is the field (F, 3) uT in the body frame without it."""

    field: FootfallField
    free: Floats
    iron: Iron
    drift: Floats

    @property
    def level_iron(self) -> Floats:
        """True (2,) uT over the ground in levelled axes: of what `fg_nav.calibration.walk.level_iron` tells."""
        up = self.field.nav_R_body[:, 2].mean(axis=0)
        added = self.iron.hard_uT + EARTH.vector[2] * (self.iron.soft - np.eye(3)) @ up
        return np.asarray(level_R_body(up)[:2] @ added)

    def spread_deg(self, body_field: Floats) -> float:
        """Circular sd of compass minus true heading."""
        return circular_sd_deg(replace(self.field, body_field=body_field).heading_difference + self.drift)


@dataclass(frozen=True)
class Outcome:
    """Of one walk; `standardised` (2,) over the ground, `hard` (3,) of h alone; spreads before, after, without iron."""

    refused: str
    error_uT: Floats
    standardised: Floats
    hard: Floats
    spread_deg: tuple[float, float, float]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Calibration from an ordinary walk, on simulated ones.")
    parser.add_argument("--seeds", type=int, default=60, metavar="N", help="walks of a case")
    parser.add_argument("--first", type=int, default=101, metavar="SEED", help="the first of them")
    parser.add_argument("--course", choices=sorted(COURSES), help="this one only")
    chosen = parser.parse_args(arguments)
    cases = [case for case in CASES if chosen.course in (None, case[0])]
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    fig.print_heading(f"Calibration from a walk, {chosen.seeds} walks a row")
    header = (
        "course",
        "field",
        "iron",
        "found",
        "error",
        "standardised",
        "h",
        "compass: is",
        "calibrated",
        "iron-free",
    )
    results = {case: [outcome(walked(*case, seed)) for seed in seeds] for case in cases}
    fig.print_table(header, [[*case, *row(found)] for case, found in results.items()])
    fig.print_heading("Refused because")
    for case, found in results.items():
        refused = [o.refused for o in found if o.refused]
        if refused:
            print(f"{' '.join(case)}: {len(refused)} of {len(found)}, such as: {refused[0]}")


def walked(course: str, level: str, iron: str, seed: int) -> Walked:
    """Make a walk: every seed another walker, building, sensor and drift."""
    rng = np.random.default_rng([seed, len(course)])
    strides = plan(COURSES[course](rng), Person().drawn(rng), rng)
    environs = environment(level, EARTH, strides.footprint, rng)
    t = np.append(strides.start, strides.start[-1] + strides.duration[-1])
    tilt = Rotation.from_rotvec(STANDS_FLAT_RAD * rng.standard_normal((len(t), 3)) * [1, 1, 0])
    mount = Rotation.from_rotvec(SITS_TURNED_RAD * rng.uniform(-1, 1, 3)).as_matrix()
    truth = np.array([yaw_rotation(np.pi / 2 - angle) for angle in strides.heading]) @ tilt.as_matrix() @ mount
    felt = environs.at(strides.footprint + SENSOR_M)
    free = np.einsum("nji,nj->ni", truth, felt)
    drawn = IRON[iron].draw(rng)
    drift = _drift(t, rng)
    drifted = np.array([yaw_rotation(angle) for angle in -drift]) @ truth
    reading = drawn.bent(free) + READ_TO_UT * rng.standard_normal(free.shape)
    return Walked(_field(t, reading, drifted), free, drawn, drift)


def _drift(t: Floats, rng: np.random.Generator) -> Floats:
    """Of the inertial heading (F,) rad, clockwise."""
    step = np.diff(t, prepend=t[0])
    walk = DRIFT_WALK_DEG_SQRT_MIN * np.sqrt(step / 60) * rng.standard_normal(len(t))
    return np.asarray(np.radians(np.cumsum(walk) + DRIFT_RATE_DEG_S * rng.standard_normal() * (t - t[0])))


def _field(t: Floats, reading: Floats, nav_R_body: Floats) -> FootfallField:
    count, none = np.full(len(t), 20), np.zeros(len(t))
    force = GRAVITY_M_S2 * nav_R_body[:, 2]
    return FootfallField(np.arange(len(t)), t, reading, force, nav_R_body, count, none, none, none)


def outcome(walk: Walked) -> Outcome:
    """Calibrate on it, whatever it says, and hold what it said against the truth."""
    willing = replace(WalkCalibrationParameters(), largest_sigma_uT=np.inf, must_gain=False)
    refused = ""
    try:
        calibrate_on_walk(walk.field)
    except CalibrationError as error:
        refused = str(error)
    found = calibrate_on_walk(walk.field, willing)
    offset, covariance = level_iron(found, walk.field)
    wrong = offset - walk.level_iron
    root = np.linalg.cholesky(covariance)
    after = corrected_field(walk.field, found).body_field
    return Outcome(
        refused,
        wrong,
        np.asarray(np.linalg.solve(root, wrong)),
        (found.hard_iron_uT - walk.iron.hard_uT) / found.sigma[:3],
        (walk.spread_deg(walk.field.body_field), walk.spread_deg(after), walk.spread_deg(walk.free)),
    )


def row(found: Sequence[Outcome]) -> list[str]:
    """Figures of a case, in words."""
    good = [o for o in found if not o.refused]
    shown = good or list(found)
    before, after, free = np.median([o.spread_deg for o in shown], axis=0)
    return [
        f"{len(good)}/{len(found)}",
        f"{_rms([o.error_uT for o in shown]):.2f}",
        f"{_rms([o.standardised for o in found]):.2f}",
        f"{_rms([o.hard for o in found]):.2f}",
        *(f"{spread:.1f}" for spread in (before, after, free)),
    ]


def _rms(values: Sequence[Floats]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    fig.leave_with(main)
