"""What a recording shows of sensor and mounting, and with it the problem that is solved.

    find_start             -> start in the first stance, rests
    rests                  -> gyro bias and its sigma
    estimate_lever         -> lever of the rolling foot
    choose_peak_height     -> height of clipped peaks of the rate above the range, by the evidence below
    choose_swing_noise     -> noise of a swing, by the evidence below
    graph.build_problem    -> nodes, factors and initial values
    add_barometer          -> heights by the pressure of the air (`heights`)
    solve                  -> values near the minimum
    weaken_refused_stances -> the same, with ties weakened that the walk refuses
    average_bias_walk      -> random walk of the gyro bias

`walk_problem` is all of it. Why the levels are what they are: `docs/models.md`.

Swing noise. `gyr_relative_density` k (1/sqrt(Hz)) makes the rate noise of a swinging foot: s_w^2 = density^2 + (k
|w|)^2. The walk has the mean of k^2 over `LEVELS`, weighted by evidence (`sensitivity`) of a few dozen strides, in up
to `PIECES` stretches. The noise covariance of an interval is linear in k^2, so two preintegrations give it for every k:

    S(k) = S(k0) + (k^2 - k0^2) / (k1^2 - k0^2) (S(k1) - S(k0))

Refused stances. Let the velocity of the stance of footfall k be off by a constant d_k (nav, m/s) in all its rows. With
their residuals e_k at the minimum, whitened, H_k how they change with d_k, J their Jacobian and P the covariance of
their variables,

    M_k = I - J P J^T,     F_k = H_k^T M_k H_k,     d_k = F_k^-1 H_k^T e_k,     T_k = d_k^T F_k d_k

T_k is by how much twice the error falls at the minimum where d_k is free (a deletion diagnostic; Cook 1977), chi^2 of
three degrees of freedom where the stance is one: one pass down the triangle, each footfall a group with G = J^T H.

Bias walk. From one bias variable to the next, t seconds later, each axis changes by q sqrt(t), one sigma. The walk has
the mean of q^2 over `WALK_LEVELS_DEG_S`, weighted by evidence and `WALK_PRIOR`: so no level has to win.

Bias prior, a mixture p(b) = sum_l p_l N(b; mu, s_l^2 I), s_l = (`SIGMA_LEVELS`) s0. The walk is solved with s0 first:
mean m and covariance P of the bias. With the information of the walk alone, posterior and evidence of each level are,
up to a constant, in closed form (MacKay 2003, section 28)

    Lambda = P^-1 - I / s0^2,     eta = P^-1 m - mu / s0^2,     d = eta - Lambda mu,
    P_l = (Lambda + I / s_l^2)^-1,     m_l = P_l (eta + mu / s_l^2),
    log p(z | s_l) = 1/2 d^T (Lambda + I / s_l^2)^-1 d - 1/2 log|I + s_l^2 Lambda|.

The Gaussian prior that leads to mean and covariance P* of the mixture, of information P*^-1 - Lambda, takes its place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import cast

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from scipy.linalg import block_diag
from scipy.ndimage import maximum_filter1d

from fg_nav.arrays import Floats
from fg_nav.detection import Rest
from fg_nav.detection.rest import RollingLever, estimate_lever, find_start
from fg_nav.detection.stance import Stances
from fg_nav.errors import EstimationError
from fg_nav.factors.differential_field import GYRO
from fg_nav.factors.residual import LETTER_SHIFT, ResidualBlock, Stack
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.recording import Recording
from fg_nav.samples.readings import OFF_SHARE
from fg_nav.smoother.graph import Known, WalkProblem, build_problem, solve
from fg_nav.smoother.heights import add_barometer
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.sensitivity import average
from fg_nav.smoother.solver import FIRST_CONVERGENCE, Solved, find_minimum, residuals_at_minimum
from fg_nav.smoother.square_root import Groups, LinearWalk, SquareRoot
from fg_nav.smoother.strides import ACC_BIAS_SIGMA, INERTIAL_KEYS, MIN_WALK_DEG_S, Nodes, join_velocities, preintegrate
from fg_nav.text import format_count

MIN_STATISTIC = 40.0  # T of stances: median 0.1 to 2, beside a shock 15 to 35, of a foot at 0.35 m/s 52.
SWINGS_M_S = 1.5  # |d| of a mid-swing: no shock makes a stance look like one.
MIN_OF_SWING = 20.0  # T of a mid-swing: it raises the noise of all swings, by which its T comes down to 21 to 40.
MIN_SPEED_M_S = 0.15  # |d| below which none is refused: feet that walk fast roll with as much.
NEIGHBORS = 2  # Footfalls on either side whose T a wrong tie swells.
ROUNDS = 4  # Of solving again.
MIN_STRENGTH = 1e-6  # Of the strongest direction of F, below which rounding decides.
LEVELS = (8e-3, 4e-3, 2e-3, 1e-3)  # 1/sqrt(Hz): from a consumer sensor in a run to what strides of all sensors share.
PIECES, PIECE_STRIDES = 3, 50  # 150 strides separate 2e-3 from 1e-3 by some 20 nats.
MAX_PIECE_S = 90.0  # A third more than 50 strides take; standing in between shows nothing of a swing.
STANDING_S = 1.0  # Of the standing before the first swing and after the last.
MIN_STRIDES = 8  # A walk of fewer keeps the level it was given.
HEIGHTS = (0.7, 1.0, 1.4, 1.8, 2.2)  # Of rebuilt peaks of the rate over what their flanks say: common to a gait.
MIN_PEAKS = 8  # Fewer that were cut show no height.
_BASE = (0.0, 1e-3)  # The two levels that are integrated, 1/sqrt(Hz): without noise of the swing, and with some.
WALK_LEVELS_DEG_S = (6e-4, 2e-3, 6e-3, 2e-2)  # 0.04 to 1.2 deg/s an hour; less also holds scale errors, uneven field.
WALK_PRIOR = (0.9, 0.09, 0.009, 0.001)  # Before the walk: gyroscopes by their sheets, and one in ten that warms up.
SIGMA_LEVELS = (1 / 3, 0.6, 1.0, 1.8, 10 / 3, 6.0, 10.0, 18.0, 33.0)  # Of s0: 0.05 to 5 deg/s.
SIGMA_PRIOR = (0.13, 0.13, 0.15, 0.15, 0.13, 0.1, 0.08, 0.07, 0.06)  # Before the walk, of sensors as sold and worn.
MIN_SHOWN = 1e-9  # Of the prior's information, below which the walk shows nothing: rounding.
Change = gtsam.BetweenFactorConstantBias  # From one bias variable to the next; `strides` alone makes them.
MIN_SHIFT_SIGMAS, MIN_CHANGE = 0.05, 0.02  # Of the bias and its sigma: below them the walk would stay as it is.


@dataclass(frozen=True)
class StanceStatistics:
    """Of each footfall: `statistic` T (F,), and the velocity d (F, 3) m/s, nav, that the rest of the walk gives it."""

    statistic: Floats
    velocity: Floats


def weaken_refused_stances(problem: WalkProblem, solved: Solved) -> tuple[WalkProblem, Solved]:
    """Return the problem with inflated sigmas on stances that fail their test (T too large), and its new solution."""
    refused = np.zeros(len(problem.nodes.result), dtype=np.bool_)
    for _ in range(ROUNDS):
        # Refused: T above its threshold and a local maximum, |d| beyond rolling.
        found = compute_stance_statistics(problem, solved)
        speed = np.linalg.norm(found.velocity, axis=1)
        limit = np.where(speed > SWINGS_M_S, MIN_OF_SWING, MIN_STATISTIC)
        largest = found.statistic >= maximum_filter1d(found.statistic, 2 * NEIGHBORS + 1)
        now = largest & (found.statistic > limit) & (speed > MIN_SPEED_M_S)
        if not now.any():
            break
        # Inflate their sigma to the speed found, and solve again.
        refused |= now
        off = np.where(now, speed, 0.0)[problem.nodes.footfall]
        ties = problem.velocities.residuals
        assert isinstance(ties, StanceVelocity)
        ties = replace(ties, sigma=np.hypot(ties.sigma, off[:, None]))
        problem = replace(problem, velocities=join_velocities(ties, problem.nodes))
        solved = solve(problem, FIRST_CONVERGENCE, with_stacks=True)
        problem = replace(problem, values=solved.values)
    if refused.any():
        first = problem.recording.t[problem.nodes.sample[problem.nodes.result[refused]]][0]
        problem = problem.with_note(
            f"{format_count(int(refused.sum()), 'stance')} of {len(refused)} trusted less, the first at {first:.1f} s: "
            "by the rest of the walk the foot moves there"
        )
    return problem, solved


def compute_stance_statistics(problem: WalkProblem, solved: Solved) -> StanceStatistics:
    """Return T = d^T F d (chi^2 of 3) and d = F^-1 H^T e (F, 3) m/s of each footfall, F as above, at the minimum."""
    nodes, block = problem.nodes, problem.velocities
    residual, jacobians = block.evaluate(solved.linearized_at)
    jacobian, root = np.concatenate(jacobians, axis=2), solved.root
    left = residuals_at_minimum(root, block.keys, residual, jacobian)
    # H^T H and H^T e of each footfall; F = H^T H - H^T J P J^T H, the Schur complement on its velocity.
    H, begins = jacobians[1], nodes.first[:-1]
    seen = np.add.reduceat(np.swapaxes(H, 1, 2) @ H, begins)
    by = np.add.reduceat((np.swapaxes(H, 1, 2) @ left[..., None])[..., 0], begins)
    F = seen - root.quadratic_forms(_group_ties(root, block, nodes, np.swapaxes(jacobian, 1, 2) @ H))
    # Pseudo-inverse; directions without information are dropped.
    strength, axes = np.linalg.eigh(F)
    along = (np.swapaxes(axes, 1, 2) @ by[..., None])[..., 0]
    along = np.divide(along, strength, out=np.zeros_like(along), where=strength > MIN_STRENGTH * strength[:, -1:])
    velocity = (axes @ along[..., None])[..., 0]
    return StanceStatistics((velocity * by).sum(axis=1), velocity)


def _group_ties(root: SquareRoot, block: ResidualBlock, nodes: Nodes, products: Floats) -> Groups:
    """Return the variables of each footfall's ties with G = J^T H (M, d, 3); S, the last, is shared by footfalls."""
    columns, begins = root.find_columns(block.keys), nodes.first[:-1]
    groups = Groups(
        np.full(root.total, -1),
        np.zeros((root.total, 3)),
        columns[begins, -1:],
        np.add.reduceat(products[:, -1:], begins),
    )
    groups.of_column[columns[:, :-1]] = nodes.footfall[:, None]
    groups.G[columns[:, :-1]] = products[:, :-1]
    return groups


def choose_swing_noise(evidence: Floats, strides: int, p: SmootherParameters) -> tuple[float, str]:
    """Return the swing noise, 1/sqrt(Hz), the mean over `LEVELS` by evidence, of a short walk that of `p`; a note."""
    level, source = p.gyr_relative_density, ": too few strides to see it from"
    if len(evidence):
        level, source = average_level(LEVELS, evidence), f", the evidence of {format_count(strides, 'stride')}"
    return level, f"swing noise {np.degrees(level):.2g} deg/s/sqrt(Hz) per rad/s{source}"


def measure_evidence(recording: Recording, stances: Stances, known: Known, p: SmootherParameters) -> tuple[Floats, int]:
    """Return -log evidence (pieces, levels) of the swing noise levels, and the number of strides in all pieces."""
    evidences, strides = [], 0
    for piece_recording, piece_stances in _pieces(recording, stances):
        try:
            evidences.append(_Piece(piece_recording, piece_stances, known, p).measure_evidence(LEVELS))
        except (EstimationError, np.linalg.LinAlgError):
            continue
        strides += piece_stances.n_footfalls - 1
    return np.array(evidences), strides


def choose_peak_height(
    recording: Recording, stances: Stances, known: Known, p: SmootherParameters
) -> tuple[float, Floats, int]:
    """Return the likeliest height of rebuilt (clipped) rate peaks over what their flanks show, and its evidence."""
    run, heights = recording.peaks[1].run, np.ones(1)
    if np.round((1.0 / run[run > 0]).sum()) >= MIN_PEAKS:
        heights = np.array([1.0, *(height for height in HEIGHTS if height != 1.0)])
    found = [measure_evidence(recording.raise_peaks(height), stances, known, p) for height in heights]
    # A height at which a piece has no solution is out; the prior is the sigma of a rebuilt peak.
    cost = [one.sum(axis=0).min() if len(one) == len(found[0][0]) > 0 else np.inf for one, _ in found]
    best = int(np.argmin(cost + 0.5 * ((heights - 1.0) / OFF_SHARE) ** 2))
    return float(heights[best]), *found[best]


def average_level(levels: tuple[float, ...], minus_log_evidence: Floats) -> float:
    """Return the mean level, rms, by the evidence (pieces, levels) of all pieces; by that of one, where larger."""
    squared = np.square(levels)
    together = average(squared, minus_log_evidence.sum(axis=0))
    return float(np.sqrt(max(together, *(average(squared, piece) for piece in minus_log_evidence))))


def _pieces(recording: Recording, stances: Stances) -> Iterator[tuple[Recording, Stances]]:
    """Yield evenly spaced pieces of the walk, without overlap, to evaluate hyperparameters on."""
    strides = stances.n_footfalls - 1
    if strides < MIN_STRIDES:
        return
    pieces = min(PIECES, -(-strides // PIECE_STRIDES))
    length = min(strides // pieces, PIECE_STRIDES)
    for first in np.linspace(0, strides - length, pieces).astype(int):
        cut = _cut(recording, stances, first, first + length)
        if cut[1].n_footfalls > MIN_STRIDES:
            yield cut


def _cut(recording: Recording, stances: Stances, first: int, last: int) -> tuple[Recording, Stances]:
    """Return recording and stances of footfalls `first <= k <= last`, `MAX_PIECE_S` at most, standings trimmed."""
    t = recording.t
    arrives, leaves = (ends[first : last + 1] for ends in stances.spans)
    begin = max(int(arrives[0]), int(np.searchsorted(t, t[leaves[0] - 1] - STANDING_S)))
    held = arrives[t[arrives] <= t[begin] + MAX_PIECE_S][-1]
    leaves_last = int(leaves[arrives == held][0])
    end = min(leaves_last, int(np.searchsorted(t, t[held] + STANDING_S)) + 1)
    inside = (stances.stop > begin) & (stances.start < end)
    footfall = stances.footfall[inside]
    cut = replace(
        stances,
        start=np.maximum(stances.start[inside], begin) - begin,
        stop=np.minimum(stances.stop[inside], end) - begin,
        footfall=footfall - footfall[0],
        n_samples=end - begin,
        statistic=None if stances.statistic is None else stances.statistic[begin:end],
    )
    return recording.slice(begin, end), cut


class _Piece:
    """The problem of a piece of a walk, whose swing noise can be varied without a rebuild."""

    def __init__(self, recording: Recording, stances: Stances, known: Known, p: SmootherParameters) -> None:
        nav_R_body = find_start(recording, stances, 0.0, p.rest).nav_R_body
        without_swing, with_some = (replace(p, gyr_relative_density=level) for level in _BASE)
        self._problem = build_problem(recording, stances, nav_R_body, replace(known, rests=()), without_swing)
        factors = ((i, self._problem.graph.at(i)) for i in range(self._problem.graph.size()))
        self._inertial = [(i, cast("gtsam.GalileanImuFactor", f)) for i, f in factors if f.size() == INERTIAL_KEYS]
        bias = gtsam.imuBias.ConstantBias(np.zeros(3), known.gyro_bias)
        high = preintegrate(recording, self._problem.nodes.sample, bias, with_some)
        self._at_zero = np.array([f.preintegratedMeasurements().preintMeasCov() for _, f in self._inertial])
        seen = (measured for measured in high if isinstance(measured, gtsam.PreintegratedImuMeasurementsG))
        self._by_square = np.array([measured.preintMeasCov() for measured in seen]) - self._at_zero

    def measure_evidence(self, levels: Sequence[float]) -> list[float]:
        """Return -log evidence of each swing noise level, up to a constant, linearized at the minimum of the first."""
        graph, keys = self._problem.graph, self._problem.time_order
        noise = map(gtsam.noiseModel.Gaussian.Covariance, self.covariances(levels[0]))
        for (i, factor), one in zip(self._inertial, noise, strict=True):
            graph.replace(i, factor.cloneWithNewNoiseModel(one))
        solved = find_minimum(self._problem.system, self._problem.values, keys)
        self._problem = replace(self._problem, values=solved.linearized_at)
        # Undo the whitening of the inertial factors once; each level whitens them anew.
        inertial = next(one for one in solved.stacks if one.keys.shape[1] == INERTIAL_KEYS)
        others = [one for one in solved.stacks if one is not inertial]
        root = np.linalg.cholesky(np.linalg.inv(self.covariances(levels[0])))  # of gtsam's whitening, transposed
        unit = Stack(inertial.keys, np.asarray(np.linalg.solve(root.transpose(0, 2, 1), inertial.rows)))
        # Each level: whitened, and eliminated.
        evidence = []
        for level in levels:
            root = np.linalg.cholesky(self.covariances(level))
            whitened = Stack(unit.keys, np.linalg.solve(root, unit.rows))
            log_noise = float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
            evidence.append(LinearWalk.of([whitened, *others], keys).minus_log_evidence(log_noise))
        return evidence

    def covariances(self, level: float) -> Floats:
        """Noise covariances (K, 9, 9) of the inertial factors."""
        return np.asarray(self._at_zero + (level / _BASE[1]) ** 2 * self._by_square)


def walk_problem(
    recording: Recording,
    stances: Stances,
    heading: float | None,
    p: SmootherParameters,
    progress: Callable[[float], None] | None = None,
    in_progress: bool = False,
) -> WalkProblem:
    """Make the problem of a walk from what its recording shows, with values near its minimum; `heading` as `smooth`."""
    # Start and rests; of a walk in progress without one that is accepted only because it touches the recording's end.
    start = find_start(recording, stances, heading or 0.0, p.rest)
    rests, first = start.rests, recording.t[0] + 1.0
    if in_progress:
        rests = tuple(one for one in rests if one.lasts(recording, p.rest.shortest_s) or recording.t[one.start] < first)
    # Bias, lever and swing noise.
    recording, known, swing_noise = _estimate_known(recording, stances, rests, p)
    p = replace(p, gyr_relative_density=swing_noise)
    # Nodes, factors and initial values.
    problem = build_problem(recording, stances, start.nav_R_body, known, p, heading is not None, progress)
    problem = add_barometer(problem, stances)
    # First solution, and ties that the walk refuses.
    solved = solve(problem, FIRST_CONVERGENCE, with_stacks=True)
    problem = replace(problem, values=solved.values)
    if p.refuse_stances:
        problem, solved = weaken_refused_stances(problem, solved)
    # Random walk of the bias.
    stacks = solved.stacks
    del solved  # its triangle is as large as all else
    return average_bias_walk(problem, stacks) if p.choose_bias_walk else problem


def estimate_swing_noise(recording: Recording, stances: Stances, p: SmootherParameters) -> float:
    """Return the noise of the rate in a swing, 1/sqrt(Hz), that the smoother uses on this walk."""
    rests = find_start(recording, stances, parameters=p.rest).rests
    return _estimate_known(recording, stances, rests, p)[2]


def _estimate_known(
    recording: Recording, stances: Stances, rests: tuple[Rest, ...], p: SmootherParameters
) -> tuple[Recording, Known, float]:
    """Return the recording with scaled rebuilt peaks, bias prior, lever and rests (`Known`), and the swing noise."""
    mean = np.radians(p.gyro_bias_deg_s)
    # Bias to start from, and sigma of the prior about its mean that the walk is solved with first. Where rests show a
    # bias far outside the prior the sensor was not calibrated: the prior widens to it.
    bias, sigma = mean, float(np.radians(p.gyro_bias_sigma_deg_s))
    if rests:
        weight = [np.linalg.inv(rest.covariance) for rest in rests]
        shown_by_rests = sum(one @ (rest.rate - mean) for one, rest in zip(weight, rests, strict=True))
        sigma = float(np.hypot(sigma, np.linalg.norm(np.linalg.solve(sum(weight), shown_by_rests))))
        bias = np.asarray(mean + np.linalg.solve(sum(weight) + np.eye(3) / sigma**2, shown_by_rests))
    if p.known_lever is not None:
        lever = RollingLever(np.array(p.known_lever), np.zeros((3, 3)), 0)
    else:
        lever = estimate_lever(recording, stances)
    known = Known(bias, mean, sigma, rests, lever)
    swing_noise, note = p.gyr_relative_density, "swing noise as given"
    if p.choose_swing_noise:
        peak_height, evidence, strides = choose_peak_height(recording, stances, known, p)
        known, recording = replace(known, peak_height=peak_height), recording.raise_peaks(peak_height)
        swing_noise, note = choose_swing_noise(evidence, strides, p)
    # The same in words.
    notes = []
    if any(p.gyro_bias_deg_s):
        prior = ", ".join(f"{one:.3f}" for one in p.gyro_bias_deg_s)
        within = f"({prior}) deg/s within {p.gyro_bias_sigma_deg_s:.2g}"
        notes.append(f"gyro bias of {within} before the walk, from the calibration")
    if known.rests:
        shown = np.round(np.degrees(known.gyro_bias), 3).tolist()
        notes.append(f"gyro bias {shown} deg/s from {format_count(len(known.rests), 'rest')}")
    else:
        notes.append("gyro bias from the walk alone, there is no rest in it")
    if lever.lever.any():
        x, y, z = lever.lever * 1000
        place = f"({x:.0f}, {y:.0f}, {z:.0f}) mm"
        notes.append(f"sensor at {place} from the point about which the foot rolls, body axes")
    else:
        notes.append("sensor taken to stand where the foot rolls: plain zero velocity")
    if known.peak_height != 1.0:
        times = f"{known.peak_height:g} times"
        notes.append(f"clipped peaks of the rate are taken {times} as high above the range as their flanks say")
    return recording, replace(known, notes=(*notes, note)), swing_noise


def average_bias_walk(problem: WalkProblem, stacks: Sequence[Stack]) -> WalkProblem:
    """Return the problem with its gyro-bias random walk averaged over levels by evidence; `stacks`: linear factors."""
    assumed = max(problem.parameters.gyro_bias_walk_deg_s, MIN_WALK_DEG_S)
    # The factors from one bias variable to the next.
    is_change = [one.keys.shape[1] == 2 and (one.keys >> np.uint64(LETTER_SHIFT) == ord("b")).all() for one in stacks]
    changes = list(compress(stacks, is_change))
    if not changes:
        return problem.with_note(f"gyro bias walk {assumed:.2g} deg/s/sqrt(s), as assumed")
    # Marginalize the nodes of each bias variable once, without the random-walk factors, which vary by level.
    nodes = problem.nodes
    begins = np.flatnonzero(np.diff(nodes.bias[nodes.footfall])) + 1
    at_change = np.array([key(int(j)) for j in begins for key in (X, V)], dtype=np.uint64)
    keys = problem.time_order
    between = np.isin(keys >> np.uint64(LETTER_SHIFT), list(map(ord, "xvp"))) & ~np.isin(keys, at_change)
    chain = LinearWalk.of(compress(stacks, np.logical_not(is_change)), keys, between)
    # The evidence of each level, and the mean variance.
    levels = assumed / WALK_LEVELS_DEG_S[0] * np.array(WALK_LEVELS_DEG_S)
    evidence = np.zeros(len(levels))
    for k, by in enumerate(levels / assumed):
        scaled, noise = [], 0.0
        for bias_keys, rows in changes:
            rows = rows.copy()
            rows[:, GYRO] /= by
            scaled.append(Stack(bias_keys, rows))
            noise += 3 * len(bias_keys) * np.log(by)
        evidence[k] = chain.join(scaled).minus_log_evidence(noise)
    level = float(np.sqrt(average(levels**2, evidence, np.array(WALK_PRIOR))))
    # The random-walk factors with the averaged sigma.
    graph = gtsam.NonlinearFactorGraph()
    for factor in map(problem.graph.at, range(problem.graph.size())):
        if isinstance(factor, Change):
            sigmas = np.array(cast("gtsam.noiseModel.Diagonal", factor.noiseModel()).sigmas())
            sigmas[GYRO] *= level / assumed
            before, after = factor.keys()
            factor = Change(before, after, factor.measured(), gtsam.noiseModel.Diagonal.Sigmas(sigmas))
        graph.push_back(factor)
    problem = replace(problem, graph=graph, parameters=replace(problem.parameters, gyro_bias_walk_deg_s=level))
    count = sum(len(one.keys) for one in changes)
    return problem.with_note(
        f"gyro bias walk {level:.2g} deg/s/sqrt(s), the mean over the evidence of {format_count(count, 'change')} of it"
    )


def average_bias_prior(problem: WalkProblem, solved: Solved) -> WalkProblem | None:
    """Return the problem with the prior of the gyro bias that its solution shows; None where the walk would stay."""
    known, mean = problem.known, solved.values.atConstantBias(B(0)).gyroscope()
    covariance = solved.root.joint_covariances([[B(0)]])[0][GYRO, GYRO]
    prior_mean, prior, shift, level = match_mixture(mean, covariance, known.gyro_bias_mean, known.gyro_bias_sigma)
    if shift < 1.0:
        return None
    graph = gtsam.NonlinearFactorGraph(problem.graph)
    at = next(i for i in range(graph.size()) if isinstance(graph.at(i), gtsam.PriorFactorConstantBias))
    noise = gtsam.noiseModel.Gaussian.Covariance(block_diag(ACC_BIAS_SIGMA**2 * np.eye(3), prior))
    graph.replace(at, gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(np.zeros(3), prior_mean), noise))
    note = f"gyro bias of {np.degrees(level):.2g} deg/s before the walk, one sigma, the mean over the evidence"
    return replace(problem, graph=graph, values=solved.values).with_note(note)


def match_mixture(mean: Floats, covariance: Floats, mu: Floats, s0: float) -> tuple[Floats, Floats, float, float]:
    """Return mean (3,) rad/s and covariance (3, 3) of the Gaussian prior that leads to the mixture's posterior.

    `mean` (3,) and `covariance` (3, 3) are those of the bias under the prior N(mu, s0^2). The third is by how much the
    posterior changes, in multiples of what matters, the last the levels' root mean square by the evidence, rad/s.
    """
    posterior, size = np.linalg.inv(covariance), np.eye(3)
    # Likelihood of the walk: posterior information less the prior's, negative rounding clipped.
    values, axes = np.linalg.eigh(posterior - size / s0**2)
    shown = np.where(values > MIN_SHOWN / s0**2, values, 0.0)
    eta = axes.T @ (posterior @ mean - mu / s0**2)
    off = eta - shown * (axes.T @ mu)
    # Posterior and evidence of each prior sigma, in the eigenvectors of the likelihood.
    variance = (s0 * np.array(SIGMA_LEVELS))[:, None] ** 2
    spread = 1.0 / (shown + 1.0 / variance)
    means = spread * (eta + (axes.T @ mu) / variance)
    minus_log = -0.5 * np.sum(off**2 * spread - np.log1p(variance * shown), axis=1)
    # Moment matching: mean and covariance of the mixture.
    centre = average(means, minus_log, np.array(SIGMA_PRIOR))
    apart = means - centre
    moments = spread[:, :, None] * size + apart[:, :, None] * apart[:, None, :]
    matched = average(moments, minus_log, np.array(SIGMA_PRIOR))
    # Divide by the likelihood to obtain the prior; never wider than the widest level.
    information, turn = np.linalg.eigh(np.linalg.inv(matched) - np.diag(shown))
    information = np.maximum(information, 1.0 / variance[-1])
    prior = axes @ (turn / information) @ turn.T @ axes.T
    prior_mean = axes @ centre + prior @ axes @ (shown * centre - eta)
    before = axes.T @ mean
    shift = float((centre - before) @ (axes.T @ posterior @ axes) @ (centre - before)) ** 0.5 / MIN_SHIFT_SIGMAS
    change = np.abs(np.log(np.diagonal(matched) / np.diagonal(axes.T @ covariance @ axes))).max() / (2.0 * MIN_CHANGE)
    level = float(np.sqrt(average(variance[:, 0], minus_log, np.array(SIGMA_PRIOR))))
    return np.asarray(prior_mean), np.asarray(0.5 * (prior + prior.T)), max(shift, float(change)), level
