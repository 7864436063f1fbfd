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
    Calibration from an ordinary walk against the iron of the simulated sensor and its chips' own errors.
    Courses: four times round a circle to one side (25 deg a stride), two rounds of a rectangle of 20 m by 14, one loop
    through the office, and a straight; fields of the simulator at Munich, a building a seed. Sensors: `mpu-9250x8` in
    the heel, for the rectangle `lord-gx5-900` on the instep, at 200 Hz.
    found           share of the walks on which it does not refuse
    error, sigma    of h in x, y and z of the sensor, uT, rms over all walks
    over sigma      error by its own sigma, rms over all walks: h in x, y and z, all three, and the six of C
    median          of |error| over sigma of h, by that of a Gaussian (0.67): 1 is honest
    compass         minus true heading, circular sd over the footfalls, median over the walks: as it is, calibrated, and
                    free of iron

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
from numpy.linalg import inv
from scipy.linalg import polar

from fg_nav.arrays import Floats
from fg_nav.calibration import UPPER, circular_sd_deg
from fg_nav.calibration.ellipsoid import fit_ellipsoid
from fg_nav.calibration.walk import WalkCalibrationParameters, calibrate_on_walk
from fg_nav.calibration.walk_model import StrideReadings, read_strides
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap_angle
from fg_nav.lab.allan import NoiseFit, SensorNoise, measure_recording_noise
from fg_nav.lab.simulation import SCENARIOS, Choices, Scenario, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.path import Path, arc, polyline, straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Section, Stand, Walk
from fg_nav.lab.simulation.sensors import preset
from fg_nav.lab.simulation.sensors.triad import TriadPrior
from fg_nav.magnetic import average_footfall_field
from fg_nav.magnetic.detectors import SIGNALS
from fg_nav.truth import TrajectoryTruth


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
    C = polar(np.linalg.inv(soft))[1]
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

LOOP = polyline([(0, 0), (0, 7), (20, 7), (20, -7), (0, -7), (0, 0)], 1.2)
IN_HEEL, ON_INSTEP = scenario("calibration-loop"), scenario("demo")


def _rest_about(path: Path) -> list[Section]:
    return [Stand(5.0), Walk(path), Stand(5.0)]


def _circle(_: np.random.Generator) -> list[Section]:
    return _rest_about(arc(Person().walk.stride_m / np.deg2rad(25.0), 2 * np.pi).repeat(4))


def _office(rng: np.random.Generator) -> list[Section]:
    """One of the three loops of the office."""
    walk = SCENARIOS["office"].route(rng)[1]
    assert isinstance(walk, Walk)
    return _rest_about(walk.path.part(0.0, walk.path.length_m / 3))


COURSES: Mapping[str, Scenario] = {
    "circle": replace(IN_HEEL, name="circle", route=_circle),
    "loop": replace(ON_INSTEP, name="loop", route=lambda _: _rest_about(LOOP.repeat(2))),
    "office": replace(IN_HEEL, name="office", route=_office),
    "straight": replace(IN_HEEL, name="straight", route=lambda _: _rest_about(straight(80.0))),
}
WALK_FIELDS = ("homogeneous", "smooth", "indoor")
RATE_HZ = 200.0


@dataclass(frozen=True)
class Outcome:
    """Of a walk: errors and sigmas (9,) of h (uT) and C; spreads of the compass, deg, before, after, without iron."""

    refused: str
    error: Floats
    sigma: Floats
    spread_deg: tuple[float, float, float]


def print_walks(chosen: argparse.Namespace) -> None:
    """Print one row a course and field, and one for each field without the straight."""
    courses = [name for name in COURSES if chosen.course in (None, name)]
    seeds = harness.seeds_of(chosen)
    cases = [(course, level) for level in WALK_FIELDS for course in courses]
    found = {case: [calibrate_walk(*case, seed) for seed in seeds] for case in cases}
    harness.print_heading(f"Calibration from a walk, {len(seeds)} walks a row")
    header = ("course", "field", "found", "error", "sigma", "over sigma: h", "all", "C", "median", "compass")
    rows = [[*case, *_walk_row(outcomes)] for case, outcomes in found.items()]
    for level in WALK_FIELDS:
        together = [o for case in cases if case[1] == level and case[0] != "straight" for o in found[case]]
        rows += [["all", level, *_walk_row(together)]] if together else []
    harness.print_table(header, rows)
    harness.print_heading("Refused because")
    for case, outcomes in found.items():
        refused = [o.refused for o in outcomes if o.refused]
        if refused:
            print(f"{' '.join(case)}: {len(refused)} of {len(outcomes)}, such as: {refused[0]}")


def calibrate_walk(course: str, level: str, seed: int) -> Outcome:
    """Simulate a walk, calibrate on it, refused or not, and compare with the truth."""
    walk = simulate(COURSES[course], seed, Choices(field=level, rate_hz=RATE_HZ))
    drawn = walk.drawn["sensor"]
    hard, soft = np.array(drawn["hard_iron_uT"]), np.array(drawn["soft_iron"])
    stances = detect_stances(walk.recording)
    strides = read_strides(walk.recording, stances)
    willing = WalkCalibrationParameters(largest_sigma_uT=np.inf, must_gain=False)
    found = calibrate_on_walk(strides, willing)
    return Outcome(
        _find_refusal(strides),
        found.parameters - np.concatenate([hard, polar(np.linalg.inv(soft))[1][UPPER]]),
        found.sigma,
        _spread_compass(walk, stances, (lambda read: read, found.correct, lambda read: (read - hard) @ inv(soft).T)),
    )


def _find_refusal(strides: StrideReadings) -> str:
    try:
        calibrate_on_walk(strides)
    except CalibrationError as error:
        return str(error)
    return ""


def _spread_compass(
    walk: SimulatedWalk, stances: Stances, corrections: Sequence[Callable[[Floats], Floats]]
) -> tuple[float, float, float]:
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    field = average_footfall_field(walk.recording, stances, nav_R_body=truth.nav_R_body)
    after = [replace(field, body_field=correct(field.body_field)) for correct in corrections]
    raw, calibrated, free = (circular_sd_deg(one.heading_difference) for one in after)
    return raw, calibrated, free


def _walk_row(found: Sequence[Outcome]) -> list[str]:
    error, sigma = np.array([o.error for o in found]), np.array([o.sigma for o in found])
    over = error / sigma
    axes = [" ".join(f"{_rms(axis):.2f}" for axis in values[:, :3].T) for values in (error, sigma, over)]
    spreads = np.median([o.spread_deg for o in found], axis=0)
    return [
        f"{sum(not o.refused for o in found)}/{len(found)}",
        *axes,
        f"{_rms(over[:, :3]):.2f}",
        f"{_rms(over[:, 3:]):.2f}",
        f"{np.median(np.abs(over[:, :3])) / MEDIAN_OF_GAUSSIAN:.2f}",
        " / ".join(f"{one:.1f}" for one in spreads),
    ]


MEDIAN_OF_GAUSSIAN = 0.6745  # Of its absolute value, in sigmas.


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
