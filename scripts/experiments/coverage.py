"""Errors of a walk over what its solution claims for them, with all that its footfalls have in common.

The estimate p_k and the truth q_k at the footfalls that the truth saw, 0 to K, are taken relative to the first. Where
the heading is a gauge (the truth has a frame of its own, or none was given), the truth is turned by the yaw psi that
makes the errors most likely, the footfalls taken as independent of each other:

    e_k = (p_k - p_0) - R_z(psi) (q_k - q_0),      psi = argmin sum_k e_k^T W_k e_k,    W_k = cov(p_k - p_0)^-1, level.

A fit is a linear combination of the errors it is made of, so is what it leaves, and the covariance of that is exact by
the joint covariance of the footfalls (`fg_nav.smoother.sensitivity`): the degree of freedom that a fit takes counts
where it takes it. With d_k the error of p_k, h_k = de_k / dpsi and s the sigma of each true position,

    e_k = d_k - d_0 + h_k psi',    psi' = sum_l w_l^T (d_l - d_0),    w_l = -W_l h_l / sum_j h_j^T W_j h_j.

============= =========================================================================================================
horizontal    e_k, 2 degrees of freedom
along, across e_k along the move that led to footfall k, and left of it
height        e_k, up; where the truth has heights
heading       yaw at the footfalls, less psi; of a truth without attitude: by how much a quarter of the walk is turned
              about its middle, by least squares, less psi. A rotation of feet is not what is surveyed; a stretch of
              footprints is, and it is turned by as much as the heading is wrong in it
length        of the path over the ground through these footfalls, from the first to `PLACES` of them
============= =========================================================================================================

Each is squared over its variance; an honest claim makes it chi-square, and 95 % of it less than the 95 % quantile.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import walks
from harness import option, seeds_of
from scipy.stats import chi2
from walks import Real

from experiments import Asked, Column, Experiment, Found, Task, find_truth, give_heading
from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import align, interpolate_truth, lift_to_space, match_footprints, yaw_between
from fg_nav.frames import wrap_angle, yaw_rotation
from fg_nav.lab.simulation import Choices, scenario, simulate
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Section, Stand
from fg_nav.lab.simulation.plan import Walk as Walking
from fg_nav.lab.simulation.sensors import preset
from fg_nav.lab.simulation.sensors.triad import Drift
from fg_nav.pipeline import prepare_walk
from fg_nav.smoother.batch import smooth_graph
from fg_nav.smoother.sensitivity import FootfallCovariance, weigh_path
from fg_nav.solution import StanceTable
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from fg_nav.walk import Options, Walk

FREEDOM = {"horizontal": 2, "along": 1, "across": 1, "height": 1, "heading": 1, "length": 1}
"""Degrees of freedom of what is measured."""
REGION, COVERED = 0.95, (0.88, 0.99)  # of the errors, and what is asked of the share within it
PLACES = 8  # Lengths of the path are taken from the start to so many footfalls.
STRETCHES = 4  # A walk without true attitudes is turned in so many of its parts.
FEWEST = 3  # Surveyed footfalls that show anything.
ROUNDS = 10  # of the fit of the yaw
MIN_MOVE_M = 0.3  # A shorter move has no direction.
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])  # A quarter to the left.


class JointErrors:
    """The errors of a walk after its gauge, and the weights (F, 4, N) of the footfalls' errors in them.

    Parameters
    ----------
    stances, joint : of the solution.
    row : (M,) of the footfalls that the truth saw.
    place : (M, 3) m, true; heights of zero where there are none.
    sigma_m : of each true place, per axis.
    nav_R_body : (M, 3, 3) true attitude; None without.
    is_aligned : whether the truth is in the solution's frame but for its origin; else its yaw is fitted.
    """

    def __init__(
        self, stances: StanceTable, joint: FootfallCovariance, row: Ints, place: Floats, sigma_m: float,
        nav_R_body: Floats | None, is_aligned: bool,
    ) -> None:  # fmt: skip
        assert stances.pose_cov is not None
        self.stances, self.joint, self.own, self.nav_R_body = stances, joint, stances.pose_cov, nav_R_body
        self.row, self.first, self.later = row, row[0], row[1:]
        self.has_height, self.variance = bool(place[:, 2].any()), sigma_m**2
        # errors relative to the first footfall
        unit = np.zeros((len(stances), 4, 4))
        unit[self.first] = np.eye(4)
        start, with_start = joint.combine(unit)
        with_start = with_start[self.later]
        self.relative = self.own[self.later] - with_start - np.swapaxes(with_start, 1, 2) + start
        self.relative[:, :3, :3] += 2 * self.variance * np.eye(3)
        p = stances.position[row]
        self.p, q = p - p[0], place - place[0]
        # the yaw of the truth, and the weights of the errors in it
        self.yaw, self.slope, self.weight = 0.0, np.zeros((len(self.later), 2)), np.zeros((len(self.later), 2))
        if not is_aligned:
            turn, W = align(q, self.p).truth_R_nav, np.linalg.inv(self.relative[:, :2, :2])
            self.yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
            for _ in range(ROUNDS):
                turned = (q @ yaw_rotation(self.yaw).T)[1:, :2]
                self.slope = -turned @ TURN.T
                pull = np.einsum("kij,kj->ki", W, self.slope)
                self.weight = -pull / np.sum(pull * self.slope)
                self.yaw += float(np.sum(self.weight * (self.p[1:, :2] - turned)))
        self.q = q @ yaw_rotation(self.yaw).T
        self.of_yaw = np.zeros((len(stances), 4, 1))
        self.of_yaw[self.later, :2, 0] += self.weight
        self.of_yaw[self.first, :2, 0] -= self.weight.sum(axis=0)
        self.yaw_variance, self.with_yaw = joint.combine(self.of_yaw)

    def measure(self) -> dict[str, Floats]:
        """Errors of each kind of `FREEDOM`, squared over the claim (N,)."""
        heading = self.measure_stretches() if self.nav_R_body is None else self.measure_yaws(self.nav_R_body)
        return {**self.measure_places(), "length": self.measure_lengths(), "heading": heading}

    def measure_places(self) -> dict[str, Floats]:
        """Measure the positions relative to the first."""
        s2, h, total = self.variance, self.slope, self.weight.sum(axis=0)
        # cov(d_k - d_0 + errors of the truth, psi'), and the variance of psi'
        cross = (self.with_yaw[self.later] - self.with_yaw[self.first])[:, :2, 0] + s2 * (self.weight + total)
        variance = self.yaw_variance[0, 0] + s2 * (np.sum(self.weight**2) + total @ total)
        C = self.relative[:, :2, :2] + h[:, :, None] * cross[:, None] + cross[:, :, None] * h[:, None]
        C = C + variance * h[:, :, None] * h[:, None]
        e = (self.p - self.q)[1:]
        squared = np.einsum("ki,kij,kj->k", e[:, :2], np.linalg.inv(C), e[:, :2])
        found = {"horizontal": squared}
        # along each move, and left of it
        move = np.diff(self.q[:, :2], axis=0)
        length = np.linalg.norm(move, axis=1)
        moved = length > MIN_MOVE_M
        ahead = move[moved] / length[moved, None]
        for name, axis in (("along", ahead), ("across", ahead @ TURN.T)) if moved.any() else ():
            error = np.sum(axis * e[moved, :2], axis=1)
            found[name] = error**2 / np.einsum("ki,kij,kj->k", axis, C[moved], axis)
        if self.has_height:
            found["height"] = e[:, 2] ** 2 / self.relative[:, 2, 2]
        return found

    def measure_lengths(self) -> Floats:
        """Measure the path over the ground, up to some of the footfalls."""
        until = np.unique(np.linspace(0, len(self.p) - 1, PLACES + 1).round().astype(int))[1:]
        level = self.p * [1.0, 1.0, 0.0]
        weights = np.zeros((len(self.stances), 4, len(until)))
        for n, k in enumerate(until):
            weights[self.row[: k + 1], :, n] = weigh_path(level[: k + 1])
        longer = np.diff([np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1) for path in (self.q, self.p)], axis=0)[0]
        return self.weigh(np.cumsum(longer)[until - 1], weights)

    def measure_yaws(self, nav_R_body: Floats) -> Floats:
        """Measure the heading at each footfall but the first, whose own is the gauge."""
        error = wrap_angle(yaw_between(nav_R_body, self.stances.nav_R_body[self.row])[1:] - self.yaw)
        of_fit = self.yaw_variance[0, 0] + self.variance * np.sum(self.of_yaw[:, :3] ** 2)
        return np.asarray(error**2 / (self.own[self.later, 3, 3] - 2 * self.with_yaw[self.later, 3, 0] + of_fit))

    def measure_stretches(self) -> Floats:
        """Measure by how much each part of the walk is turned."""
        edges = np.unique(np.linspace(0, len(self.p) - 1, STRETCHES + 1).round().astype(int))
        error, columns = [], []
        for first, last in pairwise(edges):
            some = slice(first, last + 1)
            p, q = (path[some, :2] - path[some, :2].mean(axis=0) for path in (self.p, self.q))
            column = -self.of_yaw[:, :, 0]
            column[self.row[some], :2] += p @ TURN.T / np.sum(p**2)
            columns.append(column)
            error.append(np.arctan2(np.sum(p * (q @ TURN.T)), np.sum(p * q)))
        return self.weigh(np.array(error), np.stack(columns, axis=2))

    def weigh(self, error: Floats, weights: Floats) -> Floats:
        """Measure combinations (N,) of the errors with weights (F, 4, N)."""
        of_truth = self.variance * np.sum(weights[:, :3] ** 2, axis=(0, 1))
        return np.asarray(error**2 / (np.diagonal(self.joint.combine(weights)[0]) + of_truth))


# --- do the sigmas hold ----------------------------------------------------------------------------------------------

FOOTPRINT_SIGMA_M, CAPTURE_SIGMA_M = 0.01, 0.001  # A foot on a mark on the floor, and a marker on a shoe.
LEGS_M, TURNED_DEG = (50.0, 120.0), 60.0
WITHIN_S = 0.3  # A footprint is that of the stance so near to its instant; else its stance was not found.
SIMULATED = {
    f"simulated, {field or 'no magnetometer'}, heading {'given' if given else 'not given'}": (field, given)
    for field in (None, "smooth", "indoor")
    for given in (True, False)
}


def list_coverage(chosen: Namespace) -> list[Task]:
    """Real walks without their magnetometer, gdin with it too, and simulated ways."""
    data, tasks = walks.data_folder(chosen.data), []
    for section in ("vicon", "gdin", "gdin, magnetometer", "gdlbio"):
        name, _, mag = section.partition(", ")
        tasks += [Task(section, one.name, partial(cover_real, one, bool(mag))) for one in walks.list_set(data, name)]
    for section, case in SIMULATED.items():
        way = partial(cover_way, chosen.length, *case)
        tasks += [Task(section, f"{seed}", partial(way, seed)) for seed in seeds_of(chosen)]
    return tasks


def cover_real(real: Real, with_mag: bool) -> Found:
    """Measure one real walk; with its magnetometer the heading at the start is not given."""
    walk = real.prepare(Options() if with_mag else None)
    return {"smoother": partial(cover, walk, None if with_mag else 0.0, None)}


def cover_way(length_m: float, field: str | None, given: bool, seed: int) -> Found:
    """Measure one simulated way; without a field the heading given or not differs in what is open alone."""
    demo = preset("demo")
    assert demo.mag is not None
    gyr = replace(demo.gyr, bias_sd=float(np.deg2rad(0.15)), drift=Drift(walk=float(np.deg2rad(6e-4))), scale_sd=0.0)
    mag = replace(demo.mag, rate_hz=100.0, noise_sd_uT=0.5) if field else None
    sensor = replace(demo, rate_hz=100.0, gyr=gyr, mag=mag)

    def draw_route(rng: np.random.Generator) -> list[Section]:
        """Straight legs, standing before and after."""
        legs = max(round(length_m / float(np.mean(LEGS_M))), 1)
        heading = np.deg2rad(rng.uniform(-TURNED_DEG, TURNED_DEG, legs))
        moves = rng.uniform(*LEGS_M, legs)[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1)
        path = polyline(np.vstack([np.zeros(2), np.cumsum(moves, axis=0)]), 1.2).scale_to(length_m)
        return [Stand(5.0), Walking(path), Stand(5.0)]

    base = replace(scenario("demo"), name="way", route=draw_route, worn="heel", sensor=sensor)
    recording = simulate(base, seed, Choices(field=field or "homogeneous", feet="moving")).recording
    options = give_heading(recording) if given or field is None else Options()
    walk = prepare_walk(Walk.of(recording, options))
    return {"smoother": partial(cover, walk, walk.options.heading_rad, field is not None or given)}


def cover(walk: Walk, heading: float | None, is_aligned: bool | None) -> dict[str, float]:
    """Smooth a walk, and measure its errors over their claim where the truth saw it.

    `is_aligned` is that of a simulated truth, which saw all footfalls with their attitudes; None with a real one, which
    has a frame of its own. Raises `EvaluationError` where that saw fewer than `FEWEST`.
    """
    smoothed = smooth_graph(walk.recording, walk.stances, heading=heading, field=walk.field)
    table, truth, t = smoothed.solution.stances, walk.truth, smoothed.solution.t
    assert truth is not None
    # rows that the truth saw, and true places, of footprints with heights of zero
    if isinstance(truth, TrajectoryTruth):
        row, place = interpolate_truth(truth, table.t)
    elif truth.t is None:
        match = match_footprints(table.position[:, :2], truth)
        row, place = match.stance[match.found], lift_to_space(truth.xy[match.found])
    else:
        instant = truth.t[:, None]
        outside = np.maximum(t[walk.stances.start] - instant, instant - t[walk.stances.stop - 1])
        found = outside.min(axis=1) < WITHIN_S
        row, first = np.unique(walk.stances.footfall[outside.argmin(axis=1)[found]], return_index=True)
        place = lift_to_space(truth.xy[found][first])
    if len(row) < FEWEST:
        raise EvaluationError(f"the truth saw {len(row)} footfalls: {FEWEST} are needed.")
    # errors over their claim
    if is_aligned is None:
        sigma_m = FOOTPRINT_SIGMA_M if isinstance(truth, FootprintTruth) else CAPTURE_SIGMA_M
        errors = JointErrors(table, smoothed.joint, row, place, sigma_m, None, False)
    else:
        nav_R_body = find_truth(walk.recording)[1][table.sample[row]]
        errors = JointErrors(table, smoothed.joint, row, place, 0.0, nav_R_body, is_aligned)
    figures = dict[str, float]()
    for kind, squared in errors.measure().items():
        figures[kind] = float(np.mean(squared < chi2.ppf(REGION, FREEDOM[kind])))
        figures[f"{kind} ratio"] = float(np.sqrt(squared.mean() / FREEDOM[kind]))
    return figures


EXPERIMENTS: Mapping[str, Experiment] = {
    "coverage": Experiment(
        """Do the sigmas hold 95 % of the errors: real walks, and simulated ways that do not come back.

        Ways of 700 m, a sensor in the heel, feet that move on in stance as real ones do. Share of the footfalls whose
        error lies in the region of 95 %, after the gauge that the walk leaves open, the mean over the walks; then error
        over sigma, rms over the footfalls, median over the walks: 1 for true sigmas.""",
        list_coverage,
        tuple(
            column
            for kind in FREEDOM
            for column in (Column(kind, kind, "mean", "{:.2f}"), Column(f"{kind} ratio", "/ sigma", "median", "{:.2f}"))
        ),
        [Asked(kind, "mean", *COVERED, pattern="{:.2f}") for kind in FREEDOM],
        seeds=20,
        first=401,  # of ways that no estimator was tuned on
        options={"length": option(700.0, "of the simulated ways, m", metavar="M")},
    )
}
