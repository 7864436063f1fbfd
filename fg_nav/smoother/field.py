"""The magnetic field along a smoothed walk: factors of it, and rounds of making them and smoothing again.

    drift              -> values to start from, with a heading that drifted far bent back
    trajectory         -> line integrals of the field over the strides, which no heading changes
    repeat a few times
        attitudes      -> field at each footfall, in nav
        gate           -> how much more or less than the walk's spread a footfall's compass may deviate
        deviations     -> roughness of the field
        all of these   -> readings of the compass, prior of the field's state, direction in which it is expected
        evidence       -> noise of the line integrals
        walk and field -> solution, again without the line integrals across jumps of the potential

What deviates alike for metres and in whole regions are states (`field_factors`); `docs/field.md` has the reasons.

Drift. The residual of a compass has a second zero half a turn away, so a heading that drifted far is bent back to start
from. With z_k the field over ground at footfall k as the drifting heading has it, a complex number, and t_k the time,

    rate     r = argmax  |sum z_k exp(-i r t_k)| / mean |z| - r^2 / (2 sigma_r^2)        a constant bias
    drift_k  = r t_k + angle of the mean of z exp(-i r t) over `WINDOW` footfalls about k, less that of the first

Jumps. On a path through a circuit of current I one row of the potential is off by an unknown constant, mu_0 I. With r_k
the residual at the minimum, sigma its noise, J its Jacobian, P the covariance of its variables, twice the error falls
without it by (a deletion diagnostic; Cook 1977)

    T_k = r_k^2 / (sigma^2 - J P J^T)        chi^2 of one degree of freedom without a jump.

At the largest T the rows k-1, k, k+1 are left out, as the stride that passes the conductor is wrong in its shape too,
if twice the error falls by more than `MIN_FALL`: before the walk is solved again by r^T (I - H)^-1 r, H = J P J^T, and
as it comes out. Rows that were left out come back where the rise r^T (I + H)^-1 r is less.

Noise of the integrals. The change of the potential over a stride telescopes, and an error of the integral (iron and
delay of the magnetometer, tilt in the swing, currents) does not. With v the variance of both over a stride (sigma and
correlation a of the potential, as the walk shows them), a share s is error:

    v = 2 sigma^2 (1 - a),     noise of the integral^2 = sigma_u^2 + s v,     potential^2 = (1 - s) sigma^2.

s = 0: the integral is a coordinate along north that does not drift; s = 1: it drifts as a random walk does. The walk
uses the mean of s on `SHARES` by their evidence (`sensitivity`), with the nodes between footfalls eliminated once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X

from fg_nav.arrays import Brief, Floats, Ints, find_runs
from fg_nav.errors import EstimationError
from fg_nav.factors.magnetic_field import E_H, IRON, PHI, FieldPrior
from fg_nav.factors.residual import ResidualBlock
from fg_nav.frames import yaw_rotation
from fg_nav.magnetic import FootfallField
from fg_nav.magnetic.detectors import FieldVerdicts, apply_gate, weigh_statistic
from fg_nav.smoother.field_factors import (
    MIN_STEP_M,
    CompassReadings,
    FieldFactors,
    FieldPath,
    Roughness,
    compass_sigma,
    deviate_along,
    integrate_path,
    measure_roughness,
    split_potential,
    weigh_compass,
)
from fg_nav.smoother.graph import UNKNOWN_HEADING_DEG, Trajectory, WalkProblem, solve, turn_walk
from fg_nav.smoother.sensitivity import SharingFactors, average, shared_information
from fg_nav.smoother.solver import CONVERGENCE, FIRST_CONVERGENCE, Solved, list_attitudes, residuals_at_minimum
from fg_nav.smoother.square_root import LinearWalk
from fg_nav.smoother.strides import Nodes

STRENGTH_SIGMA_UT = 5.0  # Horizontal strength of the field about the walk's median, uT.
LEFT_IRON_LEVEL_UT = 0.3  # Hard iron that a calibration leaves, one sigma, level axes.
LEFT_IRON_UP_UT = 4.0  # Upward: all that adds up along the path alike, soft iron, delay, tilt; by 21 closed walks.
MIN_STRENGTH_UT = 3.0  # Horizontal strength below which there is no compass.
MIN_SEEN = 4  # Footfalls with a field without which it is not used.
FOUND_SIGMA_DEG = 60.0  # Sigma of the field's direction where only the field shows it.
DECLINATION_SIGMA_DEG = 0.05  # Where the heading was not given, north is magnetic north by definition.
MIN_WINDOW, MAX_WINDOW = 40, 1024  # Footfalls: 40 on a rough floor show a heading to 10 deg, a kilometre to 1 deg.
PIECES = 6  # Windows of a walk, within these bounds.
RATE_SIGMA_RAD_S = float(np.radians(0.3))  # Of the drift before the field has shown it: an uncalibrated bias.
MAX_RATES = 4096  # That are tried at most, half a radian apart at the end of the walk where there are enough.
MIN_DRIFT_RAD = 0.3  # Below it the solver needs no help.
MIN_JUMP_STATISTIC = 15.0  # T below which no row is tried: the largest of clean walks is 1 to 15, by 100 A it is 200.
MIN_FALL = 25.0  # Of twice the error, chi^2 of three degrees of freedom: by 2 to 19 on clean simulated walks.
MIN_JUMP_UT_M = 15.0  # Twelve amperes; less is in the tails of the potential next to large iron.
MAX_JUMPS = 20  # After so many the walk's field is not one that a potential describes.
MIN_VARIANCE = 1e-9  # Share of a row's noise that the walk leaves open, below which rounding decides.
UT_M_PER_AMPERE = 1.2566  # mu_0, uT m/A.
SHARES = (0.0, 0.01, 0.1, 1.0, 4.0)  # At 0 the sampling leaves a tenth of a uT m a stride; 4: a late sensor, currents.
SHARES_PRIOR = (1.0, 1.0, 1.0, 1.0, 0.1)  # Weights of the shares before the walk.


@dataclass(frozen=True)
class FieldVerdict(Brief):
    """Verdicts on the field at the footfalls, as in a stance table, and notes."""

    words: tuple[str, ...]  # Of the detector.
    reason: tuple[str, ...]
    notes: tuple[str, ...]
    statistic: Floats
    compass_weight: Floats


@dataclass(frozen=True)
class FieldSolution(Brief):
    """A walk solved with its field: the problem of the last round, its minimum, the states (F, 9), and the verdict."""

    problem: WalkProblem
    solved: Solved
    states: Floats
    verdict: FieldVerdict


def turn_to_field(problem: WalkProblem, field: FootfallField) -> WalkProblem:
    """Return the walk with a heading that drifted far bent back, and an unknown heading set by the field."""
    nav_R_body = list_attitudes(problem.nodes.result, problem.values)
    values = remove_drift(problem.values, problem.nodes, replace(field, nav_R_body=nav_R_body).nav_field, field.t)
    problem = replace(problem, values=values)
    if problem.heading_known:
        return problem
    # Turned about up, so that its mean field points north; its start is free.
    values = gtsam.Values(values)
    solved = replace(field, nav_R_body=list_attitudes(problem.nodes.result, values))
    mean = np.nanmean(solved.nav_field, axis=0)
    turn = float(np.arctan2(*mean[:2]))
    turn_walk(values, problem.nodes, turn)
    attitude, place = values.atPose3(X(0)).rotation().matrix(), yaw_rotation(turn) @ problem.start.place
    sigma = float(np.radians(UNKNOWN_HEADING_DEG))
    start = replace(problem.start, nav_R_body=attitude, heading_sigma=sigma, place=place)
    return replace(problem, values=values, start=start)


def solve_with_field(problem: WalkProblem, field: FootfallField, path: FieldPath) -> FieldSolution:
    """Smooth a walk with its field in rounds, at first with the `path` along the trajectory of the problem's values."""
    p, noise_notes = problem.parameters.magnetic, tuple[str, ...]()
    problem = turn_to_field(problem, field)
    values, states = gtsam.Values(problem.values), None
    for number in range(max(p.rounds, 1)):
        # Spread and weights of the compass by the walk as it stands; at first without the heading.
        problem, verdicts = add_field_factors(problem, field, values, path, states)
        factors = problem.get(FieldFactors)
        if number == 0:
            factors.insert(values)
        # The noise of the line integrals by its evidence.
        elif len(factors.potential):
            noise = average_path_noise(problem, values)
            problem, noise_notes = set_field(problem, factors.assume_lost_share(noise.lost_share)), (noise.note,)
        # And solved again.
        problem = replace(problem, values=values)
        close = FIRST_CONVERGENCE if number == 0 and p.rounds != 1 else CONVERGENCE
        problem, solved = free_jumps(problem, solve(problem, close), close)
        factors, values = problem.get(FieldFactors), solved.values
        path, states = factors.path, factors.states(values)
        if number < p.rounds - 1:
            del solved  # its triangle is as large as all else
    assert states is not None
    # Notes.
    east, north = np.median(states[:, E_H], axis=0)
    turned_deg = np.degrees(np.arctan2(east, north))
    turned = f", {turned_deg:+.1f} deg from north" if abs(turned_deg) >= 0.05 else ""
    iron = ", ".join(f"{one:z.1f}" for one in states[-1, IRON])
    rough, sigma_uT = factors.rough, factors.readings.sigma_uT
    used, count = int(np.isfinite(sigma_uT).sum()), len(sigma_uT)
    notes = (
        f"field over ground {np.hypot(east, north):.1f} uT{turned}; the compass of {used} of {count} footfalls weighs "
        f"(gate {verdicts.detector})",
        f"it deviates by {rough.white_uT:.1f} uT from stride to stride, {_write(rough.across, 'uT')}, by region "
        f"{_write(rough.regional, 'uT')}, its potential by {_write(rough.potential, 'uT m')}",
        f"hard iron left in the stance's axes: {iron} uT",
        *noise_notes,
        *describe_jumps(problem, solved),
    )
    verdict = FieldVerdict(verdicts.words, verdicts.reason, notes, verdicts.statistic, weigh_compass(sigma_uT, rough))
    return FieldSolution(problem, solved, states, verdict)


def measure_drift(nav_field: Floats, t: Floats) -> Floats:
    """Return the drift (F,) rad of the heading, by the field (F, 3) uT in nav at t (F,) s; zero on a short walk."""
    window = int(np.clip(len(nav_field) // PIECES, MIN_WINDOW, MAX_WINDOW))
    if len(nav_field) < 2 * window:
        return np.zeros(len(nav_field))
    level, since = np.nan_to_num(nav_field[:, 0] + 1j * nav_field[:, 1]), t - t[0]
    # Drift rate of a constant bias: the peak of the spectrum of the level field, with its prior.
    spread = np.abs(level).mean()
    count = min(MAX_RATES, 3 + 2 * int(8.0 * RATE_SIGMA_RAD_S * since[-1]))
    rates = np.linspace(-4.0, 4.0, count) * RATE_SIGMA_RAD_S
    shown = np.array([np.abs((level * np.exp(-1j * rate * since)).sum()) for rate in rates]) / spread
    rate = rates[np.argmax(shown - 0.5 * (rates / RATE_SIGMA_RAD_S) ** 2)]
    # Remaining drift, by the mean field direction in moving windows.
    total = np.append(0.0, np.cumsum(level * np.exp(-1j * rate * since)))
    middle = np.arange(window // 2, len(level) - window // 2 + 1)
    angle = np.unwrap(np.angle(total[middle + window // 2] - total[middle - window // 2]))
    return np.asarray(rate * since + np.interp(np.arange(len(level)), middle, angle - angle[0]))


def remove_drift(values: gtsam.Values, nodes: Nodes, nav_field: Floats, t: Floats) -> gtsam.Values:
    """Return the values of a walk with its heading bent back where it has drifted far, else as they are."""
    drift = measure_drift(nav_field, t)
    if np.ptp(drift) < MIN_DRIFT_RAD:
        return values
    bent = gtsam.Values(values)
    turn_walk(bent, nodes, -np.interp(np.arange(len(nodes)), nodes.result, drift))
    return bent


def find_obstacle(field: FootfallField | None) -> str:
    """Return why the field of a walk shows no heading; empty where it does."""
    if field is None:
        return "the magnetometer was not used"
    seen = np.isfinite(field.strength)
    if seen.sum() < MIN_SEEN:
        return f"the field was seen at {seen.sum()} footfalls only"
    level = float(np.median(np.hypot(field.level_field[seen, 0], field.level_field[seen, 1])))
    if level < MIN_STRENGTH_UT:
        return f"the field is {level:.1f} uT over ground, which is too little for a compass"
    return ""


def integrate_field(problem: WalkProblem, field: FootfallField, track: Trajectory) -> FieldPath:
    """Integrate the field along the strides of a walk."""
    recording, nodes = problem.recording, problem.nodes
    assert recording.mag is not None
    solved = replace(field, nav_R_body=list_attitudes(nodes.result, problem.values))
    up_uT = float(np.nanmedian(solved.nav_field[:, 2]))
    footfall = nodes.sample[nodes.result]
    return integrate_path(recording.t, recording.mag, track.position, track.nav_R_body, footfall, up_uT)


def add_field_factors(
    problem: WalkProblem, field: FootfallField, values: gtsam.Values, path: FieldPath, states: Floats | None
) -> tuple[WalkProblem, FieldVerdicts]:
    """Put the field's factors by a walk at `values`, `states` (F, 9) of the last round, into it; return verdicts."""
    # The field against its mean, level before the heading is known.
    p, nav_R_body = problem.parameters.magnetic, list_attitudes(problem.nodes.result, values)
    judged = replace(field, nav_R_body=nav_R_body)
    nav_field = judged.nav_field
    seen = np.isfinite(nav_field[:, 0])
    level = np.hypot(nav_field[:, 0], nav_field[:, 1])
    verdicts = apply_gate(judged, p.gate)
    if states is None:
        reference = np.tile([0.0, float(np.median(level[seen]))], (len(nav_field), 1))
        deviation = level - np.median(level[seen])
    else:
        reference = states[:, E_H]
        deviation = deviate_along(nav_field, reference)
    # How rough it is, and the worth of each compass.
    weight = weigh_statistic(verdicts, p.gate)
    used = seen & np.isfinite(weight)
    rough = measure_roughness(deviation, used, path.distance_m)
    sigma_uT = np.where(used & p.compass, compass_sigma(np.where(used, weight, 1.0), rough), np.inf)
    readings = CompassReadings(problem.nodes.result, field.body_field, nav_R_body, sigma_uT)
    # Prior of the first state: the mean field, north by definition where no heading was given, and the iron.
    strength = float(np.linalg.norm(np.median(reference, axis=0)))
    east, north, direction_sigma = 0.0, strength, np.radians(DECLINATION_SIGMA_DEG)
    if problem.heading_known:
        mean = np.nanmean(nav_field, axis=0)[:2]
        east, north = strength * mean / np.linalg.norm(mean)
        direction_sigma = np.radians(FOUND_SIGMA_DEG)
    left = np.array([LEFT_IRON_LEVEL_UT, LEFT_IRON_LEVEL_UT, LEFT_IRON_UP_UT])
    iron = np.sqrt(path.level_R_body**2 @ field.iron_sigma_uT[0] ** 2 + left**2)
    spreads = rough.potential.sigma, rough.across.sigma, rough.regional.sigma, rough.regional.sigma
    sigma = np.array([*spreads, direction_sigma * strength, STRENGTH_SIGMA_UT, *iron])
    prior = FieldPrior(np.array([0.0, 0.0, 0.0, 0.0, east, north, 0.0, 0.0, 0.0]), sigma)
    return set_field(problem, FieldFactors(readings, path, prior, rough, p)), verdicts


def set_field(problem: WalkProblem, field: FieldFactors) -> WalkProblem:
    """Return the walk with these factors of the field, in place of any others."""
    return problem.without(FieldFactors).join(field)


def _write(rough: Roughness, unit: str) -> str:
    return f"{rough.sigma:.1f} {unit} over {rough.length_m:.1f} m"


@dataclass(frozen=True)
class Jump:
    """Of the potential: between footfalls `first` and `last`, by `size_uT_m`."""

    first: int
    last: int
    size_uT_m: float


def free_jumps(problem: WalkProblem, solved: Solved, convergence: float = CONVERGENCE) -> tuple[WalkProblem, Solved]:
    """Return the walk solved without the line integrals across potential jumps; unchanged if there are none."""
    # Test earlier jumps again: the roughness they were found at included them.
    for stride in _freed_runs(problem):
        if predict_change(problem, solved, stride) >= MIN_FALL:
            continue
        restored = _solve_with(problem, solved, stride, False, convergence)
        if 2.0 * (restored[1].error - solved.error) < MIN_FALL:
            problem, solved = restored
    for _ in range(MAX_JUMPS):
        # The row without which the error falls most.
        statistic = compute_jump_statistic(problem.get(FieldFactors).potential, solved)
        if not len(statistic) or statistic.max() < MIN_JUMP_STATISTIC:
            break
        # Leave it out with its neighbors; stop where that gains too little.
        field = problem.get(FieldFactors)
        stride = field.strides[statistic.argmax()]
        near = np.arange(max(stride - 1, 0), min(stride + 2, len(field.path.u)))
        near = near[np.isfinite(field.path.sigma_uT_m[near])]
        if predict_change(problem, solved, near) < MIN_FALL:
            break
        try:
            freed = _solve_with(problem, solved, near, True, convergence)
        except EstimationError:
            break
        if 2.0 * (solved.error - freed[1].error) < MIN_FALL or abs(_size(*freed, near)) < MIN_JUMP_UT_M:
            break
        problem, solved = freed
    return problem, solved


def _freed_runs(problem: WalkProblem) -> list[Ints]:
    """Strides that were left out, in runs without a gap."""
    return [np.arange(*run) for run in zip(*find_runs(problem.get(FieldFactors).path.jumps), strict=True)]


def _solve_with(
    problem: WalkProblem, solved: Solved, stride: Ints, jumps: bool, convergence: float
) -> tuple[WalkProblem, Solved]:
    """Solve again with the potential free to jump at these strides, or not."""
    field = problem.get(FieldFactors).mark_jumps(stride, jumps)
    changed = replace(set_field(problem, field), values=solved.values)
    return changed, solve(changed, convergence)


def compute_jump_statistic(block: ResidualBlock, solved: Solved) -> Floats:
    """Return T (K,), squared residual over 1 - leverage: the fall of twice the error without that row, chi^2 of 1."""
    if not len(block):
        return np.zeros(0)
    residual, jacobians = block.evaluate(solved.linearized_at)
    jacobian = np.concatenate(jacobians, axis=2)
    left = residuals_at_minimum(solved.root, block.keys, residual, jacobian)[:, 0]
    # The front of the pose, which is eliminated first, holds all variables of the row.
    row, covariance = jacobian[:, 0], solved.root.joint_covariances(block.keys)
    open_share = 1.0 - np.einsum("ki,kij,kj->k", row, covariance, row)
    return np.asarray(left**2 / np.maximum(open_share, MIN_VARIANCE))


def predict_change(problem: WalkProblem, solved: Solved, stride: Ints) -> float:
    """Return the predicted change of twice the error if the line integrals of strides `stride` are toggled.

    By the last linearization: the fall without integrals that are in use, the rise with those that are left out.
    """
    field = problem.get(FieldFactors)
    used = np.intersect1d(stride, field.strides)
    sign, those = (-1.0, used) if len(used) else (1.0, stride)
    block = field.integrals_over(those)
    residual, jacobians = block.evaluate(solved.linearized_at)
    # A free offset on each integral is equivalent to leaving it out.
    own = np.eye(len(those))
    factors = SharingFactors(np.concatenate(jacobians, axis=2), -residual, block.keys, own[:, None])
    columns, _, pull = shared_information(solved.root, [factors], len(those))
    share, axes = np.linalg.eigh(own + sign * columns.explained)
    return float(((axes.T @ pull) ** 2 / np.maximum(share, MIN_VARIANCE)).sum())


def list_jumps(problem: WalkProblem, solved: Solved) -> list[Jump]:
    """List the jumps: runs of strides without line integrals, and the change of potential (uT m) over each."""
    runs = _freed_runs(problem)
    return [Jump(int(run[0]), int(run[-1]) + 1, _size(problem, solved, run)) for run in runs]


def _size(problem: WalkProblem, solved: Solved, stride: Ints) -> float:
    """Return the total jump of the potential over these strides, uT m: minus the residuals left out."""
    field = problem.get(FieldFactors)
    e, _ = field.integrals_over(stride).evaluate(solved.values, with_jacobians=False)
    return float((-e[:, 0] * field.sigma_of(stride)).sum())


def describe_jumps(problem: WalkProblem, solved: Solved) -> tuple[str, ...]:
    """Return one note for each jump of the potential."""
    nodes = problem.nodes
    t = problem.recording.t[nodes.sample[nodes.result]]
    return tuple(
        f"the potential jumps by {jump.size_uT_m:+.0f} uT m at {t[jump.first]:.0f} to {t[jump.last]:.0f} s, as through "
        f"a circuit of {abs(jump.size_uT_m / UT_M_PER_AMPERE):.0f} A: the line integral is not used there"
        for jump in list_jumps(problem, solved)
    )


@dataclass(frozen=True)
class PathNoise:
    """What a walk shows of its line integrals: the share s used, the drift that may be, m a stride, and the strides."""

    lost_share: float
    drift_m: float
    strides: int

    @property
    def note(self) -> str:
        """The same in words."""
        return (
            f"line integral of the field: {100 * self.lost_share:.1f} % of its changes do not telescope, a drift of "
            f"{self.drift_m:.2f} m a stride, by the evidence of {self.strides} strides"
        )


def average_path_noise(problem: WalkProblem, values: gtsam.Values) -> PathNoise:
    """Average the share of the integral's changes that does not telescope, the graph linearized at these values."""
    field = problem.get(FieldFactors)
    # The walk without its field, nodes between footfalls marginalized, which no share changes.
    between = np.delete(np.arange(len(problem.nodes)), problem.nodes.result)
    nodes, order = np.array([key(int(j)) for j in between for key in (X, V)], dtype=np.uint64), problem.time_order
    rest = LinearWalk.of(problem.without(FieldFactors).system.stack(values), order, np.isin(order, nodes))
    # Evidence of each share, up to a constant.
    nats = list[float]()
    for one in map(field.assume_lost_share, SHARES):
        sigmas = (one.integral_sigma, one.change_sigma[:, PHI], one.prior.sigma[PHI])
        log_noise = float(sum(np.log(sigma).sum() for sigma in sigmas))
        nats.append(rest.join(one.stack(values)).minus_log_evidence(log_noise))
    evidence = np.array(nats)
    share = float(average(np.array(SHARES), evidence, np.array(SHARES_PRIOR)))
    # The drift over the walk as a random walk's a stride.
    horizontal, strides = float(np.linalg.norm(field.prior.mean[E_H])), int((field.path.distance_m > MIN_STEP_M).sum())
    left = split_potential(field.rough.potential, share, field.path.distance_m)[1]
    drift_uT_m = float(np.sqrt(np.sum(left**2) / max(strides, 1)))
    return PathNoise(share, drift_uT_m / horizontal, len(field.potential))
