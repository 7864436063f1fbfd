"""Ma's calibration on the shoe against his Table 1 and his Figure 7, on one simulated loop (M-E1).

Scenario `calibration-loop`: circles to the right and left in a homogeneous field, eight MPU-9250 on the heel, 400 Hz.
What shoe and floor do to the readings of the standing foot is the levelled line of Table 1: offsets 137.95 and 75.26
mG, long axis at 0.973 rad, ratio of the axes 0.896 (`ma_table_1`, in the mean true attitude of this walk's stances).

Recovery: offset, eta and tau from the footfalls of a walk, against what was put in: the fitted ellipse, the extremes as
printed, and the extremes with eta in its right quadrant (`fg_nav.calibration.ellipse_fit`).

Heading: magnetic heading of the corrected footfalls minus that of the gyroscope, less its circular mean.

========================= ===========================================================================================
none                      raw readings
ellipse, fitted           ours
ellipse, as printed       Ma (6)-(12) to the letter
ellipse, by extremes      the same with Ma (8) in the right quadrant
CLSEF, bare               the sensor tumbled for a minute without the shoe, where it has the other line of Table 1, the
                          K_c and B_c of the CLSEF method, along the levelled axes; shoe and floor make up the
                          difference of the two lines. C is taken upper triangular, as the paper has it
ellipsoid, bare           the same with C symmetric, as we have it. Readings cannot tell which is right; here K_c is
  ..., no iron in shoe    these two on a walk in a shoe without iron, on a floor without: the control
ellipsoid, bare: chips    the sensor has what the preset draws for its chips, and on the shoe Ma's iron comes on top:
                          all of it is the shoe's. The others are not run on these readings
ellipsoid, on the shoe    the ellipsoid of all the walk's readings, swing and stance: shoe on, floor beneath
========================= ===========================================================================================

Table 1 does not tell the vertical iron on the shoe; there is none here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.calibration import Ellipse, calibrate_on_loop
from fg_nav.calibration.ellipse import find_ellipse_as_printed, find_ellipse_by_extremes
from fg_nav.calibration.ellipsoid import fit_ellipsoid, upper_triangular
from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap_angle
from fg_nav.lab.simulation import Choices, Scenario, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.fields import SITES
from fg_nav.lab.simulation.sensors import IronPrior, SensorPrior, ma_table_1, make_iron, preset
from fg_nav.lab.simulation.sensors.magnetometer import MA_ETA_RAD, MA_OFFSET_UT, MA_TAU
from fg_nav.lab.simulation.walk import Streams
from fg_nav.lab.store.entries import Arrays, Measurement
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.compass import compute_field_heading, compute_level_R_body, rotate_to_level
from fg_nav.recording import TrajectoryTruth

LOOP = "calibration-loop"

SENSOR = "mpu-9250x8"

MA_K = np.array([[1.027, 0.037, 0.046], [0.0, 1.018, -0.002], [0.0, 0.0, 1.062]])
"""K_c of Table 1, CLSEF: what brings readings less B_c to the field."""

MA_B_UT = np.array([14.336, 7.975, -5.641])
"""B_c of Table 1, CLSEF."""

TUMBLED_S = 60.0

MG_PER_UT = 10.0

Taken = TypeVar("Taken")
Found = TypeVar("Found")

CLSEF, CONTROL = "CLSEF, bare", ", no iron in shoe"

Correct = Callable[[Floats], Floats]
"""Field (F, 3) uT in the body, from readings (F, 3) uT."""

ELLIPSES: dict[str, Callable[[FootfallField], Ellipse]] = {
    "ellipse, fitted": lambda field: calibrate_on_loop(field)[0],
    "ellipse, as printed": lambda field: find_ellipse_as_printed(field.level_field[:, :2]),
    "ellipse, by extremes": lambda field: find_ellipse_by_extremes(field.level_field[:, :2]),
}


@dataclass(frozen=True)
class Loop:
    """One walked loop: errors of each ellipse, and heading differences (F,) rad of each calibration.

    `recovery` holds by method (|offset error| uT, |eta error| rad, |tau error|), `ellipse` (offset x, y uT, eta rad,
    tau); `heading` is empty where a method refused. `tumbled` (N, 3) uT are the readings free of the shoe in levelled
    axes, `K` (3, 3) and `B_uT` (3,) what they tell, as in the CLSEF line of Table 1, the scale of K being unknown.
    """

    footfalls: int
    recovery: dict[str, tuple[float, float, float]]
    ellipse: dict[str, Floats]
    heading: dict[str, Floats]
    sigma: Floats
    tumbled: Floats
    K: Floats
    B_uT: Floats


def walked_loop(seed: int, field: str = "homogeneous") -> Loop:
    """One seed: the loop with Ma's iron, and with Ma's iron on top of the chips' own."""
    choices = Choices(field=field)
    R = standing_attitude(simulate(LOOP, seed, choices))
    exact = simulate(on_shoe(preset(SENSOR).with_iron(ma_table_1(R))), seed, choices)
    on_top = simulate(on_shoe(replace(preset(SENSOR), iron=ma_table_1(R))), seed, choices)
    control = simulate(on_shoe(preset(SENSOR).with_iron(bare_of_table_1(R))), seed, choices)
    footfalls, footfalls_on_top = field_of(exact), field_of(on_top)
    found = {name: tried(method, footfalls) for name, method in ELLIPSES.items()}
    by_hand = tumbled(preset(SENSOR).with_iron(bare_of_table_1(R)), seed)
    bare = tried(fit_ellipsoid, by_hand)
    chips = tried(fit_ellipsoid, tumbled(replace(preset(SENSOR), iron=IronPrior()), seed))
    on_control = field_of(control)
    spheres = {
        CLSEF: (footfalls, triangular(bare, R)),
        CLSEF + CONTROL: (on_control, triangular(bare, R)),
        "ellipsoid, bare": (footfalls, symmetric_of(bare)),
        "ellipsoid, bare" + CONTROL: (on_control, symmetric_of(bare)),
        "ellipsoid, bare: chips": (footfalls_on_top, symmetric_of(chips)),
        "ellipsoid, on the shoe": (footfalls, symmetric_of(tried(fit_ellipsoid, readings_of(exact)))),
    }
    heading = {"none": difference(footfalls, footfalls.level_field)}
    heading |= {name: flat_difference(footfalls, ellipse) for name, ellipse in found.items()}
    heading |= {name: lifted_difference(*of) for name, of in spheres.items()}
    fitted = found["ellipse, fitted"]
    return Loop(
        footfalls=int(np.isfinite(footfalls.level_field).all(axis=1).sum()),
        recovery={name: errors_of(ellipse) for name, ellipse in found.items()},
        ellipse={name: shape_of(ellipse) for name, ellipse in found.items()},
        heading=heading,
        sigma=np.full(4, np.inf) if fitted is None else fitted.sigma,
        tumbled=by_hand @ R.T,
        K=np.full((3, 3), np.nan) if bare is None else upper_triangular(R @ bare.correction @ R.T),
        B_uT=np.full(3, np.nan) if bare is None else R @ bare.hard_iron_uT,
    )


def loop_part(seed: int) -> Measurement:
    """What `loops_of` reads of one loop."""
    return Measurement(f"ma2018_loop_{seed}", partial(_loop_arrays, seed))


def _loop_arrays(seed: int) -> Arrays:
    loop = walked_loop(seed)
    arrays = {"footfalls": np.array(loop.footfalls), "sigma": loop.sigma, "tumbled": loop.tumbled[::_EVERY]}
    arrays |= {"K": loop.K, "B_uT": loop.B_uT}
    for group in _BY_NAME:
        arrays |= {f"{group}/{name}": np.array(values) for name, values in getattr(loop, group).items()}
    return arrays


def loops_of(folder: Path, seeds: Sequence[int]) -> list[Loop]:
    """Loops that are kept or made now; of the tumbled readings each tenth."""
    return [_loop_of(loop_part(seed).load(folder)) for seed in seeds]


def _loop_of(arrays: Arrays) -> Loop:
    groups: dict[str, dict[str, Floats]] = {
        group: {key.partition("/")[2]: found for key, found in arrays.items() if key.startswith(f"{group}/")}
        for group in _BY_NAME
    }
    recovery = {name: (float(found[0]), float(found[1]), float(found[2])) for name, found in groups["recovery"].items()}
    return Loop(
        footfalls=int(arrays["footfalls"]),
        recovery=recovery,
        ellipse=groups["ellipse"],
        heading=groups["heading"],
        sigma=arrays["sigma"],
        tumbled=arrays["tumbled"],
        K=arrays["K"],
        B_uT=arrays["B_uT"],
    )


_BY_NAME, _EVERY = ("recovery", "ellipse", "heading"), 10


def on_shoe(prior: SensorPrior) -> Scenario:
    """Scenario of the loop with this sensor on the heel."""
    return replace(scenario(LOOP), sensor=prior)


def standing_attitude(walk: SimulatedWalk) -> Floats:
    """level_R_body (3, 3) of the mean true stance."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    sample = detect_stances(walk.recording).stillest(walk.recording.gyr)
    return compute_level_R_body(truth.nav_R_body[sample, 2].mean(axis=0))


def bare_of_table_1(R: Floats) -> IronPrior:
    """Make the module without the shoe, as the CLSEF line of Table 1 has it, in levelled axes."""
    return make_iron(R.T @ MA_B_UT, R.T @ np.linalg.inv(MA_K) @ R)


def field_of(walk: SimulatedWalk) -> FootfallField:
    """Field at the footfalls, all by our own stances and attitude."""
    return average_footfall_field(walk.recording, detect_stances(walk.recording))


def readings_of(walk: SimulatedWalk) -> Floats:
    """All readings (N, 3) of a walk, in swing and stance."""
    assert walk.recording.mag is not None
    return walk.recording.mag


def tumbled(prior: SensorPrior, seed: int) -> Floats:
    """Readings (N, 3) of the sensor turned about by hand for a minute, all ways, in the field of Munich."""
    rng = np.random.default_rng([seed, 7])
    t = np.asarray(np.arange(int(TUMBLED_S * prior.rate_hz)) * prior.period_s, dtype=np.float64)
    rate = 2.0 * np.sin(t[:, None] * rng.uniform(0.3, 1.0, 3) + rng.uniform(0, 2 * np.pi, 3))
    nav_R_body = Rotation.random(random_state=rng).as_matrix()
    turns = Rotation.from_rotvec(rate * prior.period_s).as_matrix()
    attitude = np.empty((len(t), 3, 3))
    for k, turn in enumerate(turns):
        attitude[k] = nav_R_body
        nav_R_body = nav_R_body @ turn
    nav_field = SITES["munich"].at(np.zeros((1, 3)))[0]
    body_field = np.einsum("nji,j->ni", attitude, nav_field)
    still = np.zeros_like(body_field)
    run = prior.draw(Streams(seed, LOOP).lasting("sensor")).switch_on(rng)  # the same sensor as on the shoe
    mag = run.measure(t, still, still, lambda at: _between(at, t, body_field)).mag
    assert mag is not None
    return mag


def _between(at: Floats, t: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(at, t, values[:, k]) for k in range(3)], axis=1)


def tried(method: Callable[[Taken], Found], readings: Taken) -> Found | None:
    """What a method finds, or None where it refuses."""
    try:
        return method(readings)
    except CalibrationError:
        return None


def errors_of(ellipse: Ellipse | None) -> tuple[float, float, float]:
    """Errors of offset (uT, the longer component), eta (rad) and tau; infinite where there is no ellipse."""
    if ellipse is None:
        return (np.inf, np.inf, np.inf)
    eta = (ellipse.eta_rad - MA_ETA_RAD + np.pi / 2) % np.pi - np.pi / 2
    return float(np.abs(ellipse.offset_uT - MA_OFFSET_UT).max()), abs(eta), abs(ellipse.tau - MA_TAU)


def shape_of(ellipse: Ellipse | None) -> Floats:
    """Offset x, y uT, eta rad in half a turn, and tau; infinite where there is no ellipse."""
    if ellipse is None:
        return np.full(4, np.inf)
    return np.array([*ellipse.offset_uT, ellipse.eta_rad % np.pi, ellipse.tau])


def difference(field: FootfallField, level_field: Floats) -> Floats:
    """Magnetic minus gyro heading (F,) rad of footfalls with a field, less the mean direction."""
    known = np.isfinite(level_field).all(axis=1)
    turned = wrap_angle(compute_field_heading(level_field) - field.gyro_heading)[known]
    return wrap_angle(turned - np.angle(np.exp(1j * turned).mean()))


def flat_difference(field: FootfallField, ellipse: Ellipse | None) -> Floats:
    """Heading difference by an ellipse."""
    return np.empty(0) if ellipse is None else difference(field, ellipse.correct(field.level_field[:, :2]))


def lifted_difference(field: FootfallField, correct: Correct | None) -> Floats:
    """Heading difference by a calibration of the body's readings."""
    if correct is None:
        return np.empty(0)
    return difference(field, rotate_to_level(correct(field.body_field), field.nav_R_body[:, 2]))


def symmetric_of(calibration: MagnetometerCalibration | None) -> Correct | None:
    """Correct by C as we have it."""
    return None if calibration is None else calibration.correct


def triangular(calibration: MagnetometerCalibration | None, R: Floats) -> Correct | None:
    """Correct by the upper triangular form of C in the axes level_R_body R (3, 3): Ma's K_c."""
    if calibration is None:
        return None
    K = R.T @ upper_triangular(R @ calibration.correction @ R.T) @ R
    return lambda readings: (readings - calibration.hard_iron_uT) @ K.T


def heading_errors(loops: Sequence[Loop], name: str) -> tuple[Floats, Floats]:
    """Largest and rms heading difference in deg of each walk; infinite where the method refused."""
    differences = [np.degrees(loop.heading[name]) for loop in loops]
    largest = np.array([np.abs(d).max() if len(d) else np.inf for d in differences])
    return largest, np.array([np.sqrt((d**2).mean()) if len(d) else np.inf for d in differences])
