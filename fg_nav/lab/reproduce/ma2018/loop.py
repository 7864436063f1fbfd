"""Ma's calibration on the shoe against his Table 1 and his Figure 7, on one simulated loop (M-E1).

Scenario `calibration-loop`: circles to the right and left in a homogeneous field, eight MPU-9250 on the heel, 400 Hz.
What shoe and floor do to the readings of the standing foot is the levelled line of Table 1: offsets 137.95 and 75.26
mG, long axis at 0.973 rad, ratio of the axes 0.896 (`ma_table_1`, in the mean true attitude of this walk's stances).
Table 1 does not give the vertical iron on the shoe; there is none here.

Heading: magnetic heading of the corrected footfalls minus that of the gyroscope, less its circular mean.

==================== ================================================================================================
ellipse, fitted      ours (`fg_nav.calibration.ellipsoid`)
ellipse, as printed  Ma (6)-(12) to the letter
ellipse, by extremes the same with Ma (8) in the right quadrant
CLSEF, bare          the sensor tumbled for a minute without the shoe, where it has the other line of Table 1, the K_c
                     and B_c of the CLSEF method, along the levelled axes; shoe and floor make up the difference of the
                     two lines. C is taken upper triangular, as the paper has it
==================== ================================================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, interpolate_columns
from fg_nav.calibration.ellipsoid import Ellipse, calibrate_on_loop, fit_ellipsoid
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap_angle
from fg_nav.lab.extremes import find_ellipse_as_printed, find_ellipse_by_extremes, upper_triangular
from fg_nav.lab.simulation import Choices, SimulatedWalk, scenario, simulate
from fg_nav.lab.simulation.fields import SITES
from fg_nav.lab.simulation.sensors import IronPrior, SensorPrior, ma_table_1, make_iron, preset
from fg_nav.lab.simulation.walk import Streams
from fg_nav.lab.store.results import Arrays, Measurement
from fg_nav.magnetic import FootfallField, average_footfall_field
from fg_nav.magnetic.footfall_field import compute_field_heading, compute_level_R_body, rotate_to_level
from fg_nav.truth import TrajectoryTruth

LOOP, SENSOR = "calibration-loop", "mpu-9250x8"

MA_K = np.array([[1.027, 0.037, 0.046], [0.0, 1.018, -0.002], [0.0, 0.0, 1.062]])
"""K_c of Table 1, CLSEF: what brings readings less B_c to the field."""

MA_B_UT = np.array([14.336, 7.975, -5.641])  # B_c of Table 1, CLSEF.

TUMBLED_S, MG_PER_UT = 60.0, 10.0

CLSEF = "CLSEF, bare"

ELLIPSES: dict[str, Callable[[FootfallField], Ellipse]] = {
    "ellipse, fitted": lambda field: calibrate_on_loop(field)[0],
    "ellipse, as printed": lambda field: find_ellipse_as_printed(field.level_field[:, :2]),
    "ellipse, by extremes": lambda field: find_ellipse_by_extremes(field.level_field[:, :2]),
}


@dataclass(frozen=True)
class Loop:
    """One walked loop: what each method finds and makes of the headings; empty or infinite where it refused.

    `ellipse` holds by method offset x, y uT, eta rad and tau; `heading` the differences (F,) rad. `K` (3, 3) and `B_uT`
    (3,) are what the readings without the shoe give, as in the CLSEF line of Table 1, the scale of K being unknown.
    """

    ellipse: dict[str, Floats]
    heading: dict[str, Floats]
    K: Floats
    B_uT: Floats


def walk_loop(seed: int) -> Loop:
    """Walk the loop of a seed with Ma's iron, and calibrate by each method."""
    choices = Choices(field="homogeneous")
    R = standing_attitude(simulate(LOOP, seed, choices))
    on_shoe = replace(scenario(LOOP), sensor=preset(SENSOR).with_iron(ma_table_1(R)))
    recording = simulate(on_shoe, seed, choices).recording
    field = average_footfall_field(recording, detect_stances(recording))
    ellipse, heading = {}, {}
    # on the shoe, by each way to the ellipse of the levelled field
    for name, find in ELLIPSES.items():
        ellipse[name], heading[name] = np.full(4, np.inf), np.empty(0)
        with suppress(CalibrationError):
            found = find(field)
            ellipse[name] = np.array([*found.offset_uT, found.eta_rad % np.pi, found.tau])
            heading[name] = compute_difference(field, found.correct(field.level_field[:, :2]))
    # without the shoe, by an ellipsoid
    K, B, heading[CLSEF] = np.full((3, 3), np.nan), np.full(3, np.nan), np.empty(0)
    with suppress(CalibrationError):
        bare = fit_ellipsoid(tumble(preset(SENSOR).with_iron(bare_of_table_1(R)), seed))
        K, B = upper_triangular(R @ bare.correction @ R.T), R @ bare.hard_iron_uT
        corrected = (field.body_field - bare.hard_iron_uT) @ (R.T @ K @ R).T
        heading[CLSEF] = compute_difference(field, rotate_to_level(corrected, field.nav_R_body[:, 2]))
    return Loop(ellipse, heading, K, B)


def loop_part(seed: int) -> Measurement:
    """What `loop_of` reads of one loop."""
    return Measurement(f"ma2018_loop_{seed}", partial(_loop_arrays, seed))


def _loop_arrays(seed: int) -> Arrays:
    loop = walk_loop(seed)
    arrays = {"K": loop.K, "B_uT": loop.B_uT}
    for group in ("ellipse", "heading"):
        arrays |= {f"{group}/{name}": values for name, values in getattr(loop, group).items()}
    return arrays


def loop_of(arrays: Arrays) -> Loop:
    """One loop as it is stored."""
    ellipse, heading = (
        {key.partition("/")[2]: found for key, found in arrays.items() if key.startswith(f"{group}/")}
        for group in ("ellipse", "heading")
    )
    return Loop(ellipse, heading, arrays["K"], arrays["B_uT"])


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


def tumble(prior: SensorPrior, seed: int) -> Floats:
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
    mag = run.measure(t, still, still, lambda at: interpolate_columns(at, t, body_field)).mag
    assert mag is not None
    return mag


def compute_difference(field: FootfallField, level_field: Floats) -> Floats:
    """Magnetic minus gyro heading (F,) rad of footfalls with a field, less the mean direction."""
    known = np.isfinite(level_field).all(axis=1)
    turned = wrap_angle(compute_field_heading(level_field) - field.gyro_heading)[known]
    return wrap_angle(turned - np.angle(np.exp(1j * turned).mean()))


def heading_errors(loops: Sequence[Loop], name: str) -> tuple[Floats, Floats]:
    """Largest and rms heading difference in deg of each walk; infinite where the method refused."""
    differences = [np.degrees(loop.heading[name]) for loop in loops]
    largest = np.array([np.abs(d).max() if len(d) else np.inf for d in differences])
    return largest, np.array([np.sqrt((d**2).mean()) if len(d) else np.inf for d in differences])
