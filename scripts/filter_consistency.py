"""Whether the filters and their smoothers are as sure as they may be, on walks drawn from their own models.

    python scripts/filter_consistency.py [--seeds N] [--methods NAME ...] [--preset NAME] [--scenario NAME]

The motion is that of a simulated walk, at 25 Hz. A seed draws the truth about it as a filter assumes it to be:

    start         velocity, tilt, heading and biases apart from the estimate by a draw from its P
    in stance     velocity of the sensor = rate x lever + white noise of the filter's density
    sensors       biases that walk, white noise of the densities of each sample
    footfalls     the compass and the direction of up wrong by their sigmas; a compass is used or not by the toss
                  of a coin, as a detector may decide

Then innovations over their sigmas are white with variance 1 (NIS), and errors over the covariance chi-square with as
many degrees of freedom as components (NEES; position, velocity, attitude and gyro bias: 12), both within the 95 % band
of their number (Bar-Shalom et al. 2001, 5.4). A footfall's NEES is taken once a walk.

Not drawn, and so left out here: an uncertainty that depends on the sample's own force (`unsteady_s`), and a course
(HDR), which is compared with what the filter itself estimated before, shares its error, and has no NIS that could be
asked for. What is left of the first kind, noises in proportion to the sample, takes up to about one percent off the
NIS of the velocity at the rate chosen here: a white velocity in stance asks for forces, and a large one then has a
larger uncertainty.

25 Hz was chosen after 200 and 50 Hz had been tried, because the forces so asked for grow with the rate. The NIS of the
velocity of IEZ and `matched`, one sigma of the mean 0.002, was 0.976 and 0.973 at 200 Hz, outside the band; 0.994 at
50 Hz; 1.001 and 1.000 at 25 Hz. The cause is the draw, not the filters: no foot has a velocity that is white from
sample to sample. So nothing is shown here of the NIS at 200 Hz. The NEES were within their bands at all three rates.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import harness
import numpy as np
from harness import option
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection import Rest
from fg_nav.detection.rest import Start
from fg_nav.ekf.compass import AiezParameters
from fg_nav.ekf.core import (
    ACC_BIAS_SIGMA,
    GAUGE_SIGMA,
    VELOCITY_SIGMA,
    IezParameters,
    filter_walk,
    make_initial_state,
    make_noise_models,
)
from fg_nav.ekf.covariance import ATTITUDE, compute_densities
from fg_nav.ekf.measurements import COMPASS, TILT, PseudoMeasurements, make_pseudo_measurements
from fg_nav.ekf.presets import MatchedParameters, Parameters, find_parameters
from fg_nav.ekf.rts import Track
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Options, Walk

METHODS = ("iez", "qsf", "iqsf", "ma2018", "aiez", "matched")
BAND = 0.95
PARTS = 12
REST_S = 5.0
RATE_HZ = 25.0
SCENARIO = "demo"
LEVER_M = (0.0, 0.0, 0.08)
NAV_FIELD_UT = np.array([0.0, 20.0, -45.0])


@dataclass(frozen=True)
class Motion:
    """A walk to draw about: times (N,), attitude (N, 3, 3), velocity (N, 3), when the foot stands, its footfalls."""

    t: Floats
    nav_R_body: Floats
    velocity: Floats
    stands: Bools
    rows: Ints


@dataclass(frozen=True)
class Drawn:
    """A walk drawn from a filter's model; the truth at its footfalls, and what the filter is given of them."""

    recording: Recording
    start: Start
    evidence: PseudoMeasurements
    truth: list[NavState]


@dataclass(frozen=True)
class Scores:
    """Of one walk: mean NIS per component and the number of these, by measurement; NEES, by footfall."""

    nis: dict[str, tuple[float, int]]
    nees: dict[str, float]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        seeds=50,
        methods=METHODS,
        preset=option("tuned", "of the filters", metavar="NAME"),
        scenario=option(SCENARIO, "whose motion it is", metavar="NAME"),
    )
    motion = motion_of(chosen.scenario)
    figures: list[harness.Figure] = []
    for method in chosen.methods:
        parameters = drawable(find_parameters(method, chosen.preset))
        seeds = harness.seeds_of(chosen)
        scores = [scores_of(motion, parameters, np.random.default_rng([seed, 5])) for seed in seeds]
        figures += list(figures_of(method, scores))
    harness.print_heading(f"{chosen.seeds} walks of {motion.t[-1]:.0f} s, {len(motion.rows)} footfalls; bands of 95 %")
    harness.print_figures(figures)
    harness.print_verdict(figures)


def motion_of(scenario: str) -> Motion:
    """True motion of a simulated walk, from its first stance on."""
    recording = simulate(scenario, 1, Choices(calibrated=True, field="smooth")).recording
    walk = prepare_walk(Walk.of(recording, Options()))
    truth, stances = recording.truth, walk.stances
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    cut = int(stances.start[0])
    stands = stances.mask[cut:].copy()
    stands[0] = False  # the velocity there is drawn from the prior, and is not measured
    step = max(1, round(1.0 / (RATE_HZ * walk.recording.period_s)))
    rows = (stances.stillest(walk.recording.gyr) - cut) // step
    return Motion(
        t=truth.t[cut::step] - truth.t[cut],
        nav_R_body=truth.nav_R_body[cut::step],
        velocity=np.gradient(truth.position[cut:], truth.t[cut:], axis=0)[::step],
        stands=stands[::step],
        rows=np.maximum(rows, 1),
    )


def drawable(parameters: Parameters) -> Parameters:
    """Return the parameters without what cannot be drawn, and with a lever where one would be estimated."""
    core = parameters if isinstance(parameters, IezParameters) else parameters.inertial
    core = replace(core, unsteady_s=0.0)
    if isinstance(parameters, IezParameters):
        return core
    if isinstance(parameters, MatchedParameters):
        core = replace(core, rolling_lever_m=LEVER_M)
    return replace(parameters, inertial=core)


def scores_of(
    motion: Motion, parameters: Parameters, rng: np.random.Generator, claimed: IezParameters | None = None
) -> Scores:
    """Draw a walk, run the filter and its smoother, and score them; `claimed` by a filter that assumes otherwise."""
    core = parameters if isinstance(parameters, IezParameters) else parameters.inertial
    walk = drawn(motion, core, parameters, rng)
    core = claimed or core
    given = (walk.recording, motion.stands, motion.rows, walk.start)
    forward, back = (filter_walk(*given, replace(core, smoothed=way), walk.evidence) for way in (False, True))
    per = {"velocity": forward.nis / 3, "compass": forward.innovation[:, COMPASS] ** 2, "tilt": _tilt(forward)}
    width = {"velocity": 3, "compass": 1, "tilt": 2}
    nis = {
        name: (float(np.nanmean(found)), width[name] * int(np.isfinite(found).sum()))
        for name, found in per.items()
        if np.isfinite(found).any()
    }
    middle, end = len(motion.rows) // 2, len(motion.rows) - 1
    nees = {
        "filter, middle": nees_at(forward, motion.rows, middle, walk.truth),
        "filter, end": nees_at(forward, motion.rows, end, walk.truth),
        "smoother, start": nees_at(back, motion.rows, 1, walk.truth),
        "smoother, middle": nees_at(back, motion.rows, middle, walk.truth),
    }
    return Scores(nis, nees)


def figures_of(method: str, scores: Sequence[Scores]) -> Iterator[harness.Figure]:
    """Means over the walks against the band of their number."""
    for name in scores[0].nis:
        number = sum(score.nis[name][1] for score in scores)
        mean = sum(score.nis[name][0] * score.nis[name][1] for score in scores) / number
        yield harness.Figure("NIS", f"NIS of {name}", method, mean, *band(number), "{:.4f}")
    for name in scores[0].nees:
        mean = float(np.mean([score.nees[name] for score in scores])) / PARTS
        yield harness.Figure("NEES", f"NEES, {name}", method, mean, *band(PARTS * len(scores)), "{:.3f}")


def band(number: int) -> tuple[float, float]:
    """Of the mean of so many squares of standard normal numbers."""
    low, high = np.asarray(chi2.ppf([(1 - BAND) / 2, (1 + BAND) / 2], number)) / number
    return float(low), float(high)


def nees_at(track: Track, rows: Ints, k: int, truth: Sequence[NavState]) -> float:
    """Squared error (position, velocity, attitude, gyro bias) at a footfall over its covariance."""
    i, true = rows[k], truth[k]
    turn = Rotation.from_matrix(track.nav_R_body[i] @ true.nav_R_body.T).as_rotvec()
    e = np.concatenate(
        [
            track.position[i] - true.position,
            track.velocity[i] - true.velocity,
            turn,
            track.gyro_bias[k] - true.gyro_bias,
        ]
    )
    return float(e @ np.linalg.solve(track.covariance[k, :PARTS, :PARTS], e))


def _tilt(track: Track) -> Floats:
    return np.asarray(track.innovation[:, TILT] ** 2)


def drawn(motion: Motion, core: IezParameters, parameters: Parameters, rng: np.random.Generator) -> Drawn:
    """Draw a walk about a motion from the model of a filter."""
    h = np.append(np.diff(motion.t), np.median(np.diff(motion.t)))
    noise, _ = make_noise_models(core)
    rate = rates_of(motion.nav_R_body, h)
    velocity = velocities(motion, core, rate, h, rng)
    bias = np.radians(core.gyro_bias_sigma_deg_s) * rng.standard_normal(3)
    start, state = begun(motion, core, bias, velocity[0], rng)
    state.acc_bias[:] = ACC_BIAS_SIGMA * rng.standard_normal(3)
    acc, gyr, truth = np.empty((len(h), 3)), np.empty((len(h), 3)), []
    xi = rng.standard_normal((len(h), 12))
    turn, push, footfalls = np.empty((3, 3)), np.empty(3), set(motion.rows.tolist())
    still = np.zeros(3)
    for i in range(len(h)):
        if i in footfalls:
            truth.append(NavState(*(part.copy() for part in state)))
        unbiased = NavState(still.copy(), still.copy(), state.nav_R_body.copy(), still, still)
        strapdown(unbiased, still, rate[i], h[i], core.gravity, turn, push)
        gained = velocity[min(i + 1, len(h) - 1)] - state.velocity + np.array([0.0, 0.0, core.gravity * h[i]])
        force = np.linalg.solve(turn, gained)
        q = compute_densities(noise, rate[i], gained, h[i], core.gravity)
        acc[i] = force + state.acc_bias + np.sqrt(q.acc / h[i]) * xi[i, :3]
        gyr[i] = rate[i] + state.gyro_bias + np.sqrt(q.gyr / h[i]) * xi[i, 3:6]
        strapdown(state, force + state.acc_bias, rate[i] + state.gyro_bias, h[i], core.gravity, turn, push)
        state.gyro_bias[:] += np.sqrt(q.gyro_bias * h[i]) * xi[i, 6:9]
        state.acc_bias[:] += np.sqrt(q.acc_bias * h[i]) * xi[i, 9:]
    known = draw_measurements(np.array([true.nav_R_body for true in truth]), parameters, rng)
    return Drawn(Recording(t=motion.t, acc=acc, gyr=gyr), start, known, truth)


def rates_of(nav_R_body: Floats, h: Floats) -> Floats:
    """Body rates (N, 3) that lead from each attitude to the next."""
    turned = np.swapaxes(nav_R_body[:-1], 1, 2) @ nav_R_body[1:]
    return np.vstack([Rotation.from_matrix(turned).as_rotvec() / h[:-1, None], np.zeros(3)])


def velocities(motion: Motion, core: IezParameters, rate: Floats, h: Floats, rng: np.random.Generator) -> Floats:
    """Velocity (N, 3): in stance of a rolling foot, with the filter's noise; bent to that between the stances."""
    _, stance = make_noise_models(core)
    nav_rate = np.einsum("nij,nj->ni", motion.nav_R_body, rate)
    rolling = np.cross(nav_rate, [0.0, 0.0, stance.height])
    rolling += np.einsum("nij,nj->ni", motion.nav_R_body, np.cross(rate, stance.lever))
    variance = (stance.floor + stance.rolling * (rate**2).sum(axis=1)) / h
    wanted = rolling + np.sqrt(variance)[:, None] * rng.standard_normal(rolling.shape)
    wanted[0] = VELOCITY_SIGMA * rng.standard_normal(3)
    known = np.flatnonzero(motion.stands | (np.arange(len(h)) == 0))
    off = (wanted - motion.velocity)[known]
    return np.asarray(
        motion.velocity + np.stack([np.interp(np.arange(len(h)), known, off[:, a]) for a in range(3)], axis=1)
    )


def begun(
    motion: Motion, core: IezParameters, bias: Floats, velocity: Floats, rng: np.random.Generator
) -> tuple[Start, NavState]:
    """Where the filter begins, after a rest that showed the `bias`; and the truth there."""
    sigma = np.radians(core.gyr_density_deg) / np.sqrt(REST_S)
    rest = Rest(0, 1, bias + sigma * rng.standard_normal(3), sigma**2 * np.eye(3), np.zeros(3))
    attitude = motion.nav_R_body[0]
    start = Start(0, attitude, True, rest, (rest,))
    _, P = make_initial_state(start, core, GAUGE_SIGMA)
    error = np.sqrt(np.diag(P)) * rng.standard_normal(len(P))
    turned = Rotation.from_rotvec(error[ATTITUDE : ATTITUDE + 3]).as_matrix() @ attitude
    truth = NavState(-error[:3], velocity.copy(), attitude.copy(), bias.copy(), np.zeros(3))
    return replace(start, nav_R_body=turned), truth


def draw_measurements(nav_R_body: Floats, parameters: Parameters, rng: np.random.Generator) -> PseudoMeasurements:
    """Compass and up at K footfalls, wrong by their sigmas, a coin deciding which compass is used."""
    k = len(nav_R_body)
    if isinstance(parameters, IezParameters):
        return make_pseudo_measurements(k)
    sigma = np.radians(parameters.compass_sigma_deg)
    wrong = sigma * rng.standard_normal(k)
    field = np.array([R.T @ (yaw_rotation(float(a)) @ NAV_FIELD_UT) for R, a in zip(nav_R_body, wrong, strict=True)])
    known = make_pseudo_measurements(k)._replace(
        body_field=field, compass_variance=np.where(rng.uniform(size=k) < 0.5, sigma**2, np.nan)
    )
    if parameters.levelled_by_force:
        known = known._replace(compass_heading=compute_heading(nav_R_body) + wrong)
    if not isinstance(parameters, AiezParameters):
        return known
    tilt = np.radians(parameters.tilt_sigma_deg)
    up = np.column_stack([tilt * rng.standard_normal((k, 2)), np.ones(k)])
    return known._replace(body_force=9.8 * np.einsum("kji,kj->ki", nav_R_body, up), tilt_variance=np.full(k, tilt**2))


if __name__ == "__main__":
    harness.run(main)
