"""The two walks of Munoz Diaz et al. (2017), as simulated here, the fields they are walked in, and gyroscopes at rest.

=========== ========================================================================================================
first walk  `pocket-past-cars`: 3 km in 39 min, rates with the errors of Table 2, and fields computed for the same
            motion (`replace_field`): none, those of Table 1, and that of cars and lamps
second walk `pocket-long` in 6 round trips: 4.3 km in 44 min with an MTw, whose biases go from one end of Table 3 to the
            other; its iron is drawn, and calibrated by an ellipsoid from 400 readings, turned about all ways
=========== ========================================================================================================

Fields are in East-North-Up. Sensor axes: z along the thigh, up when standing; x and y are level then. The paper records
a walk once with a fibre-optic gyroscope and computes what a magnetometer would have read along it,

    mu = C^T H + v_mu                                                               MD (18)

C being the attitude and H the field in nav at the place. So the field is all that differs between experiments. Here
attitude and place are the truth's. A street's field jumps where one cylinder's cell ends and the next begins; the paper
takes no difference across such a border (2.2), and here there is no field for a while after it, longer than the
filter's longest difference (`fg_nav.pocket.filter`). Not printed and so ours: where cars and lamps stand, and the iron.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.calibration.ellipsoid import fit_ellipsoid
from fg_nav.frames import yaw_rotation
from fg_nav.lab.allan import compute_allan_curve
from fg_nav.lab.simulation import SCENARIOS, Choices, Scenario, SimulatedWalk, routes, simulate
from fg_nav.lab.simulation.fields import AS_PRINTED, Cylinders, Field, Homogeneous, Sum
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.simulation.sensors import ClockPrior, preset
from fg_nav.pocket import PocketParameters, estimate_pocket, level_start
from fg_nav.pocket.filter import compute_earth_rate
from fg_nav.recording import Recording

BORDER_S = 0.3  # For so long after a border there is no field.
LATITUDE_DEG = 48.0


def replace_field(
    walk: SimulatedWalk, field: Field | None, noise_sd_uT: float, rng: np.random.Generator, border_s: float = BORDER_S
) -> Recording:
    """The recording of a walk with the magnetometer that it would have had in another field, MD (18).

    The field is by places in the course's frame, as `walk.field` is; None for no magnetometer. `noise_sd_uT` is v_mu,
    white, of a sample and axis; `border_s` how long there is no field after a border between two cells of a street, 0
    leaves the jump in. Raises `SimulationError` if the walk leads through iron.
    """
    recording, truth = walk.recording, walk.truth
    if field is None:
        return replace(recording, mag=None)
    place = truth.position + walk.origin
    mag = np.einsum("nji,nj->ni", walk.attitude, field.at(place))
    mag += noise_sd_uT * rng.standard_normal(mag.shape)
    mag[mark_borders(recording.t, place, field, border_s)] = np.nan
    return replace(recording, mag=mag)


def mark_borders(t: Floats, position: Floats, field: Field, border_s: float = BORDER_S) -> Bools:
    """(N,) True where less than `border_s` ago at `position` (N, 3) m one came into another cylinder's cell."""
    inside = np.zeros(len(t), dtype=np.bool_)
    for street in list_streets(field):
        cell = street.cell(position)
        crossed = np.flatnonzero(np.diff(cell) != 0) + 1
        since = t - np.concatenate([[-np.inf], t[crossed]])[np.searchsorted(crossed, np.arange(len(t)), side="right")]
        inside |= since < border_s
    return inside


def list_streets(field: Field) -> list[Cylinders]:
    """Streets among the sources of a field."""
    if isinstance(field, Sum):
        return [street for part in field.parts for street in list_streets(part)]
    return [field] if isinstance(field, Cylinders) else []


_DIP = np.radians(64.0)

FIELDS_UT: Mapping[str, tuple[float, float, float]] = {
    "north-pole": (0.0, 0.0, -65.0),
    "equator": (0.0, 25.0, 0.0),
    "munich": (0.0, 48.0 * float(np.cos(_DIP)), -48.0 * float(np.sin(_DIP))),
}
"""Homogeneous fields in nav, uT (MD Table 1)."""

MAG_NOISE_UT = 0.015  # White error of a sample of the emulated magnetometer (MD Table 2).

SECOND_NOISES_UT = (0.05, 0.015, 0.106)
"""White errors of the MTw's magnetometer, uT, as its filters are given: the preset's, which lies between Table 2's and
that of its sheet as we remember it; then these two."""

ALL = PRINTED, FILTER, BATCH, ONLINE = "as printed", "filter", "batch", "online"  # Who estimates.


@dataclass(frozen=True)
class Case:
    """One walk in one field: its name, who is tried on it, and whether the field waits for the detector."""

    name: str
    by: tuple[str, ...] = ALL
    gated: bool = False
    mag_sigma_uT: float = MAG_NOISE_UT


# The graph has no way without its own weighing of perturbed fields, so "always" is the filters' alone.
FIRST = (
    *(Case(name) for name in ("gravity", "north-pole", "equator", "munich")),
    *(Case(f"{site}, north-south", (FILTER, BATCH, ONLINE)) for site in ("equator", "munich")),
    Case("cars", (PRINTED, FILTER)),
    Case("cars, detector", gated=True),
    Case("cars of MD (21) as printed, detector", (FILTER,), gated=True),
)
_STATES = ("raw", "calibrated")
SECOND = tuple(Case(f"MTw, {state}", mag_sigma_uT=SECOND_NOISES_UT[0]) for state in ("gravity", *_STATES))
OTHER_NOISES = tuple(
    Case(f"MTw, {state}, {noise}", (FILTER,), mag_sigma_uT=noise) for noise in SECOND_NOISES_UT[1:] for state in _STATES
)


def list_cases(quick: bool) -> tuple[Case, ...]:
    """All; quick without the other noises of the MTw's magnetometer."""
    return (*FIRST, *SECOND, *(() if quick else OTHER_NOISES))


@dataclass(frozen=True)
class Setting:
    """What is true of a walk."""

    ends: Floats  # (K,) s, of the strides that go somewhere.
    legs: Ints  # (K,) which time along the street each belongs to, from 0 on.
    length_m: float  # Of all of them together.
    path: Floats  # (K, 2) m, where the foot came down after each, from where it stood first.
    passed_min: Floats  # When one passes the cars and lamps that stand close, min.
    bias: Floats  # (M, 3) deg/s, true, as the rows of `Run`.


FIRST_WALK = SCENARIOS["pocket-past-cars"]
SECOND_WALK = replace(SCENARIOS["pocket-long"], route=partial(routes.pocket_long, trips=6), aligned=True)


def simulate_second(seed: int, noise_sd_uT: float) -> SimulatedWalk:
    """The walk with the MTw; but for the magnetometer's noise the same for all of them."""
    prior = preset("munoz-diaz-table-3")
    assert prior.mag is not None
    return simulate(replace(SECOND_WALK, sensor=replace(prior, mag=replace(prior.mag, noise_sd_uT=noise_sd_uT))), seed)


def record_first(walk: SimulatedWalk, case: str, seed: int) -> Recording:
    """The first walk in the field of a case, with the same noise in all of them.

    Turning the walk to the north turns the field to the east instead.
    """
    field: Field | None = None
    if case.startswith("cars"):
        [street] = list_streets(walk.field)
        field = replace(street, exponent=AS_PRINTED) if "printed" in case else street
    elif case != "gravity":
        site, _, turned = case.partition(", ")
        east, north, up = (float(part) for part in yaw_rotation(-np.pi / 2 if turned else 0.0) @ FIELDS_UT[site])
        field = Homogeneous((east, north, up))
    return replace_field(walk, field, MAG_NOISE_UT, np.random.default_rng([seed, 1]))


def record_second(walk: SimulatedWalk, case: str, seed: int) -> Recording:
    """The second walk without a magnetometer, with it as it is, or calibrated."""
    if "gravity" in case:
        return replace(walk.recording, mag=None)
    if "raw" in case:
        return walk.recording
    strength_uT = float(np.linalg.norm(walk.earth.vector))
    return fit_ellipsoid(turn_by_hand(walk, seed), strength_uT).apply_to(walk.recording)


def turn_by_hand(walk: SimulatedWalk, seed: int, count: int = 400) -> Floats:
    """Readings (N, 3) uT of the walk's sensor, turned about all ways in the Earth's field before the walk."""
    rng = np.random.default_rng([seed, 2])
    direction = rng.standard_normal((count, 3))
    direction *= np.linalg.norm(walk.earth.vector) / np.linalg.norm(direction, axis=1, keepdims=True)
    sensor, prior = walk.drawn["sensor"], walk.scenario.prior.mag
    assert prior is not None
    noise = prior.noise_sd_uT * rng.standard_normal((count, 3))
    return np.asarray(direction @ np.array(sensor["soft_iron"]).T + sensor["hard_iron_uT"] + noise)


def read_setting(walk: SimulatedWalk) -> Setting:
    """What is true of a walk."""
    strides = walk.strides
    walking = np.asarray(strides.style == Style.WALK)
    legs = np.concatenate([[0], np.cumsum((np.diff(walking.astype(int)) == 1).astype(int))])[walking]
    footprint = strides.footprint[1:][walking]
    where = footprint[:, 0] - strides.footprint[0, 0]
    passed = []
    for leg, (place, _) in routes.CLOSE_TO.items():
        on_leg = legs == leg
        nearest = np.argmin(np.abs(where[on_leg] - place)) if on_leg.any() else 0
        passed.append(strides.start[walking][on_leg][nearest] / 60.0 if on_leg.any() else math.nan)
    length = np.linalg.norm(np.diff(strides.footprint[:, :2], axis=0), axis=1)[walking]
    true_bias = np.degrees([np.interp(walk.recording.t[::100], walk.biases.t, axis) for axis in walk.biases.gyr.T]).T
    return Setting(
        ends=(strides.start + strides.duration)[walking],
        legs=legs,
        length_m=float(length.sum()),
        path=footprint[:, :2] - strides.footprint[0, :2],
        passed_min=np.array(passed),
        bias=true_bias,
    )


def measure_fog_errors(seed: int, hours: float) -> dict[str, float]:
    """Section 2.2: the fibre-optic gyroscope at rest, integrated for an hour; the Earth's rate added and taken off."""
    walk = simulate(lie_still(hours), seed, Choices(sensor="kvh-1750", rate_hz=10.0))
    truth_R = walk.attitude
    turning = np.einsum("nji,j->ni", truth_R, compute_earth_rate(LATITUDE_DEG))
    seen = replace(walk.recording, gyr=walk.recording.gyr + turning)
    found = {}
    for name, latitude in (("compensated", LATITUDE_DEG), ("not compensated", None)):
        parameters = PocketParameters(gravity_update=False, latitude_deg=latitude)
        R = estimate_pocket(seen, parameters, replace(level_start(seen), nav_R_body=truth_R[0])).nav_R_body
        turned = Rotation.from_matrix(R @ truth_R.transpose(0, 2, 1)).as_rotvec(degrees=True)
        found[name] = float(np.abs(turned).max())
    return found


def lie_still(hours: float) -> Scenario:
    """A sensor on a table."""
    return replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(3600.0 * hours)])


def measure_allan_curves(seed: int, hours: float) -> dict[str, Floats]:
    """Allan deviations (3, T) deg/s of the fibre-optic and the MEMS gyroscope at rest, at `tau_s` (T,) s (Figure 5)."""
    found: dict[str, Floats] = {}
    for name, sensor in (("fog", "kvh-1750"), ("mems", "xsens-mtw")):
        prior = replace(preset(sensor), rate_hz=10.0, clock=ClockPrior())  # no sample lost
        recording = simulate(replace(lie_still(hours), sensor=prior), seed).recording
        curves = [compute_allan_curve(np.degrees(axis), recording.period_s) for axis in recording.gyr.T]
        found |= {name: np.array([curve.deviation for curve in curves]), "tau_s": curves[0].tau_s}
    return found


def measure_sensor_errors(first: SimulatedWalk, second: SimulatedWalk) -> dict[str, Floats]:
    """Tables 2 and 3 as measured on the recordings, deg/s: against the truth, and standing at both ends.

    `across` (S,) uT is the rms field across the thigh at each of the sites: what shows the bias along it.
    """
    truth_R, h = first.attitude, first.recording.period_s
    R = Rotation.from_matrix(truth_R)
    wrong = np.degrees(first.recording.gyr[:-1] - (R[:-1].inv() * R[1:]).as_rotvec() / h)
    start, end = (np.degrees(part.mean(axis=0)) for part in (second.recording.gyr[:900], second.recording.gyr[-900:]))
    along = truth_R[:, :, 2]
    across = [math.sqrt(np.mean(np.dot(field, field) - (along @ field) ** 2)) for field in FIELDS_UT.values()]
    found = {"noise": wrong.std(axis=0), "bias": wrong.mean(axis=0), "start": start, "end": end}
    return found | {"across": np.array(across)}
