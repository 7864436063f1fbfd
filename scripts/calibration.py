"""Calibrations against the truth of simulated sensors: how wrong they are, and whether their sigmas say so.

    python scripts/calibration.py ellipsoid [--seeds N]
    python scripts/calibration.py walk [--seeds N] [--course NAME]
    python scripts/calibration.py noise [--seeds N] [--minutes M]
    python scripts/calibration.py channels [--seeds N]

ellipsoid
    Errors of the nine parameters over their own sigmas. Each seed draws a sensor (hard iron 15 uT and soft iron 6 % per
    axis, not symmetric), turns it to 400 orientations in a field of 48 uT and adds noise of 0.5 uT per axis. The truth
    is what readings can show: hard iron, and the symmetric part P of the polar decomposition Q P of the inverse soft
    iron; of determinant 1 where the strength is not known. "all ways": orientations are random; "by hand": the field
    points within 60 deg of a plane through the sensor, as with a box that is turned about two of its axes; "half": the
    field points into one half of the sphere; "outliers": all ways, 3 % of the readings wrong by 20 uT per axis.

walk
    Calibration from an ordinary walk. Strides, headings and field are the simulator's: its courses, its levels `indoor`
    and `smooth`, at Munich, a building a seed. The footfalls are made from them without sensing every sample: the foot
    stands flat to 1.5 deg, the sensor sits turned on it by up to 20 deg, the field is read to 0.2 uT, and the inertial
    heading drifts by a constant rate (0.02 deg/s) and a walk (1 deg per root of a minute). Iron: drawn as the preset
    `mpu-9250x8` has it (9.5 uT per axis, soft 0.06), or Ma's Table 1.
    found           share of the walks on which it does not refuse
    error           of h over the ground, uT per axis, rms over the walks on which it is found; with what soft iron
                    makes of the vertical field, which a level floor cannot tell from it
    standardised    that error by its own covariance, rms, over all walks: 1 is honest; and the same of h alone
    compass         minus true heading, circular sd over the footfalls, median over the walks on which it is found: as
                    it is, calibrated, and free of iron

noise
    What an Allan deviation finds of sensors that lie on a table for an hour (`at-rest`). Found over true, median (least
    to most) over axes and seeds: N, K where the preset has a walk and the hour shows it, and the lowest point of the
    curve, over that which noise and drift have by their formulas (`fg_nav.lab.simulation.sensors.triad`).

channels
    What the sigmas of the field detectors' presets rest on: the scatter of each channel's value from footfall to
    footfall in a homogeneous field, over sqrt 2, by the median, which is that of the straights, and by the standard
    deviation, which is that of the turns. On `teaching-building`, median over the seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import harness
import numpy as np
from harness import option, spread
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.calibration import (
    WalkCalibrationParameters,
    calibrate_on_walk,
    circular_sd_deg,
    correct_field,
    find_level_iron,
)
from fg_nav.calibration.allan import NoiseFit
from fg_nav.calibration.at_rest import SensorNoise, measure_recording_noise
from fg_nav.calibration.ellipsoid import fit_ellipsoid, symmetric
from fg_nav.calibration.magnetometer import UPPER
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import GRAVITY_M_S2, wrap_angle, yaw_rotation
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.fields import SITES, draw_environment
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Section, Stand, Walk, plan
from fg_nav.lab.simulation.sensors import Iron, IronPrior, ma_table_1, preset
from fg_nav.lab.simulation.sensors.triad import TriadPrior
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.detectors import SIGNALS
from fg_nav.magnetic.footfall_field import compute_level_R_body


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print one of the four."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        what=option(None, "what to measure", choices=tuple(EXPERIMENTS), positional=True),
        seeds=40,
        first=harness.FIRST_SEED,
        course=option(None, "of the walks, this one only", choices=sorted(COURSES)),
        minutes=option(60.0, "length of a recording at rest", metavar="M"),
    )
    EXPERIMENTS[chosen.what](chosen)


def _rms(values: Sequence[Floats] | Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


# --- ellipsoid -------------------------------------------------------------------------------------------------------

STRENGTH_UT, NOISE_UT, HARD_UT, SOFT = 48.0, 0.5, 15.0, 0.06
READINGS = 400
WAYS: Mapping[str, tuple[float, float]] = {
    "all ways": (-1.0, 1.0),
    "by hand": (-np.sin(np.deg2rad(60.0)), np.sin(np.deg2rad(60.0))),
    "half": (0.0, 1.0),
    "outliers": (-1.0, 1.0),
}
"""How the sensor is turned: the component of the field along an axis of the sensor lies between these."""
NAMES = ("h_x", "h_y", "h_z", "C_xx", "C_xy", "C_xz", "C_yy", "C_yz", "C_zz")


def print_ellipsoid(chosen: argparse.Namespace) -> None:
    """Print errors over sigmas, for each way to turn the sensor."""
    seeds = harness.seeds_of(chosen)
    kinds = [(way, strength) for way in WAYS for strength in (STRENGTH_UT, None)]
    found = {
        f"{way}, strength {'known' if strength else 'unknown'}": [standardize_errors(s, way, strength) for s in seeds]
        for way, strength in kinds
    }
    rows = [[name, *_rms_row(errors)] for name, errors in found.items()]
    harness.print_heading(f"Errors over their own sigmas, rms over {len(seeds)} seeds")
    harness.print_table(("readings", *NAMES, "all", "refused"), rows)
    harness.print_verdict(
        [harness.Figure(n, "rms of all errors", "ellipsoid", rms_of_all(e), 0.8, 1.3) for n, e in found.items()]
    )


def standardize_errors(seed: int, way: str, strength_uT: float | None) -> Floats | None:
    """Errors (9,) over their sigmas for one sensor; None where the readings were refused."""
    rng = np.random.default_rng([seed, list(WAYS).index(way)])
    hard = HARD_UT * rng.standard_normal(3)
    soft = np.eye(3) + SOFT * rng.standard_normal((3, 3))
    readings = draw_readings(hard, soft, way, rng)
    C = symmetric(np.linalg.inv(soft))
    if strength_uT is None:
        C = C / np.cbrt(np.linalg.det(C))
    try:
        found = fit_ellipsoid(readings, strength_uT)
    except CalibrationError:
        return None
    return np.asarray((found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma)


def draw_readings(hard_uT: Floats, soft: Floats, way: str, rng: np.random.Generator) -> Floats:
    """Readings (N, 3) uT of a sensor in the field, evenly over all directions that it is turned to."""
    axis = rng.standard_normal(3)
    low, high = WAYS[way]
    many = rng.standard_normal((10 * READINGS, 3))
    many /= np.linalg.norm(many, axis=1, keepdims=True)
    along = many @ (axis / np.linalg.norm(axis))
    field = STRENGTH_UT * many[(along >= low) & (along <= high)][:READINGS]
    readings = field @ soft.T + hard_uT + NOISE_UT * rng.standard_normal(field.shape)
    if way == "outliers":
        wild = rng.uniform(size=READINGS) < 0.03
        readings[wild] += 20.0 * rng.standard_normal((int(wild.sum()), 3))
    return np.asarray(readings)


def rms_of_all(errors: Sequence[Floats | None]) -> float:
    """Rms of all parameters over seeds; infinite where all were refused."""
    known = [error for error in errors if error is not None]
    return _rms(known) if known else np.inf


def _rms_row(errors: Sequence[Floats | None]) -> list[str]:
    known = np.array([error for error in errors if error is not None]).reshape(-1, 9)
    per = np.sqrt((known**2).mean(axis=0)) if len(known) else np.full(9, np.inf)
    return [*(f"{value:.2f}" for value in per), f"{rms_of_all(errors):.2f}", f"{len(errors) - len(known)}"]


# --- walk ------------------------------------------------------------------------------------------------------------

EARTH = SITES["munich"]
SENSOR_M = np.array([0.0, 0.0, 0.1])
STANDS_FLAT_RAD, SITS_TURNED_RAD = np.radians(1.5), np.radians(20.0)
READ_TO_UT = 0.2
DRIFT_RATE_DEG_S, DRIFT_WALK_DEG_SQRT_MIN = 0.02, 1.0

COURSES: dict[str, Callable[[np.random.Generator], Sequence[Section]]] = {
    "demo": SCENARIOS["demo"].route,
    "office": SCENARIOS["office"].route,
    "mall": SCENARIOS["mall"].route,
    "straight": lambda _: [Walk(straight(80.0))],
}

CASES = (
    ("demo", "indoor", "preset"),
    ("demo", "smooth", "preset"),
    ("office", "indoor", "preset"),
    ("mall", "indoor", "preset"),
    ("straight", "indoor", "preset"),
)
IRON = {"preset": IronPrior(hard_sd_uT=9.5, soft_sd=0.06), "Ma": ma_table_1(), "none": IronPrior()}


@dataclass(frozen=True)
class Walked:
    """Footfalls of a made-up walk, with iron; `free` is the field (F, 3) uT in the body frame without it."""

    field: FootfallField
    free: Floats
    iron: Iron
    drift: Floats

    @property
    def level_iron(self) -> Floats:
        """True (2,) uT over the ground in levelled axes: what `fg_nav.calibration.walk.level_iron` estimates."""
        up = self.field.nav_R_body[:, 2].mean(axis=0)
        added = self.iron.hard_uT + EARTH.vector[2] * (self.iron.soft - np.eye(3)) @ up
        return np.asarray(compute_level_R_body(up)[:2] @ added)

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


def print_walks(chosen: argparse.Namespace) -> None:
    """Print one row a course, field and iron."""
    cases = [case for case in CASES if chosen.course in (None, case[0])]
    seeds = harness.seeds_of(chosen)
    harness.print_heading(f"Calibration from a walk, {len(seeds)} walks a row")
    results = {case: [calibrate_walk(make_walk(*case, seed)) for seed in seeds] for case in cases}
    spreads = ("compass: is", "calibrated", "iron-free")
    header = ("course", "field", "iron", "found", "error", "standardised", "h", *spreads)
    harness.print_table(header, [[*case, *_walk_row(found)] for case, found in results.items()])
    harness.print_heading("Refused because")
    for case, found in results.items():
        refused = [o.refused for o in found if o.refused]
        if refused:
            print(f"{' '.join(case)}: {len(refused)} of {len(found)}, such as: {refused[0]}")


def make_walk(course: str, level: str, iron: str, seed: int) -> Walked:
    """Make a walk: every seed another walker, building, sensor and drift."""
    rng = np.random.default_rng([seed, len(course)])
    strides = plan(COURSES[course](rng), Person().draw(rng), rng)
    environs = draw_environment(level, EARTH, strides.footprint, rng)
    t = np.append(strides.start, strides.start[-1] + strides.duration[-1])
    tilt = Rotation.from_rotvec(STANDS_FLAT_RAD * rng.standard_normal((len(t), 3)) * [1, 1, 0])
    mount = Rotation.from_rotvec(SITS_TURNED_RAD * rng.uniform(-1, 1, 3)).as_matrix()
    truth = np.array([yaw_rotation(np.pi / 2 - angle) for angle in strides.heading]) @ tilt.as_matrix() @ mount
    felt = environs.at(strides.footprint + SENSOR_M)
    free = np.einsum("nji,nj->ni", truth, felt)
    drawn = IRON[iron].draw(rng)
    drift = _draw_drift(t, rng)
    drifted = np.array([yaw_rotation(angle) for angle in -drift]) @ truth
    reading = drawn.bend(free) + READ_TO_UT * rng.standard_normal(free.shape)
    count, none = np.full(len(t), 20), np.zeros(len(t))
    force = GRAVITY_M_S2 * drifted[:, 2]
    field = FootfallField(np.arange(len(t)), t, reading, force, drifted, count, none, none, none)
    return Walked(field, free, drawn, drift)


def _draw_drift(t: Floats, rng: np.random.Generator) -> Floats:
    """Of the inertial heading (F,) rad, clockwise."""
    step = np.diff(t, prepend=t[0])
    walk = DRIFT_WALK_DEG_SQRT_MIN * np.sqrt(step / 60) * rng.standard_normal(len(t))
    return np.asarray(np.radians(np.cumsum(walk) + DRIFT_RATE_DEG_S * rng.standard_normal() * (t - t[0])))


def calibrate_walk(walk: Walked) -> Outcome:
    """Calibrate on a walk, refused or not, and compare with the truth."""
    willing = replace(WalkCalibrationParameters(), largest_sigma_uT=np.inf, must_gain=False)
    refused = ""
    try:
        calibrate_on_walk(walk.field)
    except CalibrationError as error:
        refused = str(error)
    found = calibrate_on_walk(walk.field, willing)
    offset, covariance = find_level_iron(found, walk.field)
    wrong = offset - walk.level_iron
    after = correct_field(walk.field, found).body_field
    return Outcome(
        refused,
        wrong,
        np.asarray(np.linalg.solve(np.linalg.cholesky(covariance), wrong)),
        (found.hard_iron_uT - walk.iron.hard_uT) / found.sigma[:3],
        (walk.spread_deg(walk.field.body_field), walk.spread_deg(after), walk.spread_deg(walk.free)),
    )


def _walk_row(found: Sequence[Outcome]) -> list[str]:
    good = [o for o in found if not o.refused]
    spreads = np.median([o.spread_deg for o in good or found], axis=0)
    return [
        f"{len(good)}/{len(found)}",
        f"{_rms([o.error_uT for o in good or found]):.2f}",
        f"{_rms([o.standardised for o in found]):.2f}",
        f"{_rms([o.hard for o in found]):.2f}",
        *(f"{one:.1f}" for one in spreads),
    ]


# --- noise -----------------------------------------------------------------------------------------------------------

AT_REST = ("xsens-mtw", "lord-gx5", "mpu-9250", "kvh-1750")


def print_noise(chosen: argparse.Namespace) -> None:
    """Print one row a sensor: found over true."""
    rows = []
    for sensor in AT_REST:
        found: dict[str, list[NoiseFit]] = {"gyr": [], "acc": []}
        for seed in harness.seeds_of(chosen):
            for one in measure_noise(sensor, seed, chosen.minutes):
                found.get(one.sensor, []).extend(one.fits)
        for name, fits in found.items():
            rows.append((f"{sensor} {name}", f"{len(fits)}", *_noise_row(fits, getattr(preset(sensor), name))))
    harness.print_heading(f"Found over true, median (least to most), {chosen.minutes:g} minutes at rest")
    harness.print_table(("sensor", "axes", "N", "K", "K seen", "lowest"), rows)


def measure_noise(sensor: str, seed: int, minutes: float) -> tuple[SensorNoise, ...]:
    """Noise of the sensors of a preset that lies still for so long."""
    scenario = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(60.0 * minutes)])
    return measure_recording_noise(simulate(scenario, seed, Choices(sensor=sensor)).recording).sensors


def _noise_row(fits: Sequence[NoiseFit], prior: TriadPrior) -> tuple[str, str, str, str]:
    white = np.array([fit.white.value for fit in fits]) / prior.noise_density
    walks = [fit.walk.value for fit in fits if fit.walk.seen]
    lowest = np.array([fit.lowest for fit in fits]) / true_deviation(np.geomspace(0.1, 900.0, 200), prior).min()
    walk = np.array(walks) / prior.drift.walk if prior.drift.walk else []
    words = [spread(ratios, "{:.2f}", (0, 100)) for ratios in (white, walk, lowest)]
    return words[0], words[1], f"{len(walks)} of {len(fits)}", words[2]


def true_deviation(tau_s: Floats, prior: TriadPrior) -> Floats:
    """Allan deviation of white noise, a Gauss-Markov process and a walk."""
    d, x = prior.drift, tau_s / prior.drift.time_s
    markov = d.sd**2 / x**2 * (2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))
    return np.asarray(np.sqrt(prior.noise_density**2 / tau_s + markov + d.walk**2 * tau_s / 3))


# --- channels --------------------------------------------------------------------------------------------------------

WALKED, BUILDING = ("mpu-9250x8", "xsens-mtw", "lord-gx5-900"), "teaching-building"


def print_channels(chosen: argparse.Namespace) -> None:
    """Print the scatter of each channel, for each sensor, calibrated or not."""
    harness.print_heading(f"Scatter of one stance's value in a homogeneous field, {BUILDING}: straights / all")
    rows = [
        (f"{sensor}, {words}", *measure_scatter(sensor, calibrated, harness.seeds_of(chosen)))
        for sensor in WALKED
        for words, calibrated in (("calibrated", True), ("as is", False))
    ]
    harness.print_table(("sensor", *(f"{name}, {signal.unit}" for name, signal in SIGNALS.items())), rows)


def measure_scatter(sensor: str, calibrated: bool, seeds: Sequence[int]) -> list[str]:
    """Scatter of each signal in words; median over the seeds."""
    found = []
    for seed in seeds:
        walk = simulate(BUILDING, seed, Choices(sensor=sensor, field="homogeneous", calibrated=calibrated))
        field = average_footfall_field(walk.recording, detect_stances(walk.recording))
        found.append([_scatter_of(signal.of(field), signal.angle, signal.scale) for signal in SIGNALS.values()])
    return [f"{straights:.2g} / {everything:.2g}" for straights, everything in np.median(found, axis=0)]


def _scatter_of(value: Floats, angle: bool, scale: float) -> tuple[float, float]:
    change = np.diff(value)
    change = (wrap_angle(change) if angle else change) * scale / np.sqrt(2.0)
    middle = np.nanmedian(np.abs(change - np.nanmedian(change)))
    return float(1.4826 * middle), float(np.nanstd(change))


EXPERIMENTS: Mapping[str, Callable[[argparse.Namespace], None]] = {
    "ellipsoid": print_ellipsoid,
    "walk": print_walks,
    "noise": print_noise,
    "channels": print_channels,
}

if __name__ == "__main__":
    harness.run(main)
