"""The differential field of a walk: what its stances and standings show of the gyro bias, and the factors of it.

    a solution   -> place at every sample, gyro bias to linearize at
    swings       -> variogram of the field, by turns with the iron that the stances show
    stances      -> information on each bias variable -> factors

A stretch is a stance and the samples within `MARGIN_S`, or a piece of a standing in which no rest was found. From each
follows what it shows of the gyro bias (`factors.differential_field`), with what this walk shows of its magnetometer:

    sigma_n      third differences of z_t in the stretches, whose variance is 20 sigma_n^2
    h            hard iron, the same in all stretches (`find_iron`)
    gamma(r)     half the mean square per axis of differences of the field, in nav, between two samples of one swing
                 that are r apart, less sigma_n^2; median for mean; fitted by sigma^2 (1 - exp(-(r / l)^a))

The stretches of a bias variable are added, and limited by what is common to all stances and to all standings
(`docs/field.md`). A variable that contradicts gravity about the level axes is weakened (`LevelBias`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B

from fg_nav.arrays import Bools, Brief, Floats, Ints, robust_sigma
from fg_nav.detection import Rest
from fg_nav.factors.differential_field import (
    GYRO,
    MIN_INFORMATION,
    BiasInformation,
    FieldNoise,
    FieldStretches,
    Iron,
    StretchInformation,
    Variogram,
    measure_bias,
)
from fg_nav.factors.residual import linear_factor_of, one_of
from fg_nav.factors.rotation import relative_rotations
from fg_nav.recording import Recording
from fg_nav.samples.gaps import find_holes
from fg_nav.smoother.graph import Trajectory, WalkProblem
from fg_nav.smoother.solver import GtsamFactors, list_biases
from fg_nav.smoother.strides import STANDS_S, Nodes
from fg_nav.text import format_count

MARGIN_S = 0.1  # Before and after a stance: what a stretch shows grows with the cube of its length, its drift by less.
MIN_S = 0.3  # A shorter stretch shows next to nothing.
MAX_S = 10.0  # Of a piece of a standing: a bias of 0.3 deg/s turns the sensor by 3 deg, half the square is 1e-3.
LEVEL_SIGMA_DEG_S = 0.05  # Of the bias about the level axes without the field: a tilt that is nudged by a moving foot.
MAX_LEVEL_RATIO = 2.0  # Chi^2 per freedom up to which a variable is left as it is: one in seven of the right has more.
MIN_RATIO = 1e-9
MIN_SAMPLES = 5  # Of the field in a stretch.
MAX_SAMPLES = 64  # Beyond, neighbours are averaged.
MAX_CHI_SQUARE = 25.0  # Per degree of freedom; beyond, the field changed by something that is not in the model.
STANCE_SIGMA_DEG_S = 0.2  # Error common to all stances: soft iron of 2 % in a rolling foot; rms 0.3 of 12 real walks.
STANDING_SIGMA_DEG_S = 0.05  # Error common to all standings of a walk.
IRON_UT = 30.0  # Hard iron per axis before the walk has shown it: shoe, battery and the sensor's own board.
MIN_IRON_UT = 2.0  # What is left of it at least: soft iron of four per cent in the field of the Earth looks like it.
MIN_NOISE_UT = 0.05  # Of a magnetometer: quantization and filters make third differences smaller than the noise.
MIN_VARIOGRAM_UT2 = 1e-3  # Below, a difference of the field is the attitude's error.
MAX_SWINGS, MAX_OF_SWING = 60, 40  # Swings, spread over the walk, and samples of each, of which all pairs are compared.
DISTANCES_M = np.geomspace(0.005, 1.0, 17)  # Limits of the classes: from what a foot rolls to most of a stride.
MIN_PAIRS, MIN_CLASSES = 30, 4  # In a class, and classes, without which there is no variogram.
LENGTHS_M, EXPONENTS = np.geomspace(0.02, 5.0, 40), np.linspace(0.6, 2.0, 15)  # Of the variogram: tried by turns.
MEDIAN_OF_CHI_SQUARE = 2.366  # Of the square of a normal vector of three components with unit variance each.
AT_ONCE = 1024  # Stretches that are turned at once.
MIN_ROUNDS, MAX_ROUNDS = 2, 4  # Of variogram and iron in turns: of 20 uT the first round leaves a few.
CLOSE_IRON_UT = 0.2  # A round that moves the iron by less is the last: a tenth of what may be left of it.


@dataclass(frozen=True)
class Stretches:
    """Samples `start <= i < stop` (S,) of each, the bias variable (S,) it belongs to, and whether it is a standing."""

    start: Ints
    stop: Ints
    bias: Ints
    is_standing: Bools


def find_stretches(recording: Recording, nodes: Nodes, rests: tuple[Rest, ...]) -> Stretches:
    """Find the stances and standings in which the field is seen and no rest was found."""
    # Stances extended by a margin, but not into their neighbours or across gaps.
    start, stop = nodes.sample[nodes.first[:-1]], nodes.sample[nodes.first[1:] - 1] + 1
    duration = recording.t[stop - 1] - recording.t[start]
    margin = np.where(duration > STANDS_S, 0, round(MARGIN_S / recording.period_s))
    edges = np.concatenate([[0], find_holes(recording.t) + 1, [len(recording)]])
    before = np.maximum(np.append(0, stop[:-1]), edges[np.searchsorted(edges, start, side="right") - 1])
    after = np.minimum(np.append(start[1:], len(recording)), edges[np.searchsorted(edges, stop)])
    start, stop = np.maximum(start - margin, before), np.minimum(stop + margin, after)
    # Standings in pieces of `MAX_S` at most.
    pieces = np.maximum(np.ceil(duration / MAX_S).astype(np.int64), 1)
    of = np.repeat(np.arange(len(start)), pieces)
    number, size = np.arange(len(of)) - np.searchsorted(of, of), (stop - start)[of]
    first, last = start[of] + number * size // pieces[of], start[of] + (number + 1) * size // pieces[of]
    # Those that are long enough, have no rest, and samples of the field.
    assert recording.mag is not None
    fields = np.concatenate([[0], np.cumsum(np.isfinite(recording.mag[:, 0]))])
    used = (recording.t[last - 1] - recording.t[first] >= MIN_S) & (fields[last] - fields[first] >= MIN_SAMPLES)
    for rest in rests:
        used &= ~((first < rest.stop) & (last > rest.start))
    return Stretches(first[used], last[used], nodes.bias[of][used], (duration > STANDS_S)[of][used])


def turn_stretches(recording: Recording, stretches: Stretches, position: Floats, gyro_bias: Floats) -> FieldStretches:
    """Return the field with the rotation of each sample to the first of its stretch, linearized at a bias (S, 3)."""
    most, filled = int((stretches.stop - stretches.start).sum()), 0
    samples, number = [np.empty((most, *shape)) for shape in ((3,), (3, 3), (3, 3), (3,))], np.empty(most, np.int64)
    assert recording.mag is not None
    for first in range(0, len(gyro_bias), AT_ONCE):
        # Samples of some stretches, numbered from the first of them.
        some = slice(first, first + AT_ONCE)
        count = (stretches.stop - stretches.start)[some]
        stretch = np.repeat(np.arange(len(count)), count)
        sample = np.arange(len(stretch)) - np.searchsorted(stretch, stretch) + stretches.start[some][stretch]
        after = np.minimum(sample + 1, len(recording) - 1)
        periods = np.where(after > sample, recording.t[after] - recording.t[sample], recording.period_s)
        turned = relative_rotations(recording.integrable[1][sample], periods, stretch, gyro_bias[some])
        # Those with a field.
        seen = np.isfinite(recording.mag[sample, 0])
        part = slice(filled, filled := filled + int(seen.sum()))
        number[part] = stretch[seen] + first
        of = recording.mag[sample[seen]], turned[0][seen], turned[1][seen], position[sample[seen]]
        for column, rows in zip(samples, of, strict=True):
            column[part] = rows
    field, rotation, jacobian, place = (column[:filled] for column in samples)
    return FieldStretches(field, rotation, jacobian, place, number[:filled], gyro_bias)


def measure_noise(turned: FieldStretches) -> float:
    """White noise of the magnetometer, uT, by third differences within the stretches."""
    third = np.diff(turned.in_first_frame(), n=3, axis=0)
    whole = turned.stretch[3:] == turned.stretch[:-3]
    if not whole.any():
        return MIN_NOISE_UT
    return float(max(robust_sigma(third[whole]) / np.sqrt(20.0), MIN_NOISE_UT))


def fit_variogram(mag: Floats, position: Floats, nav_R_body: Floats, nodes: Nodes, sigma_uT: float) -> Variogram | None:
    """Fit the field's variogram to its differences within swings (nav axes); None with too few samples."""
    # Squared field differences between samples of a swing, and the distance between them.
    begins, ends = nodes.sample[nodes.first[1:-1] - 1], nodes.sample[nodes.first[1:-1]]
    squares, distances = [np.empty(0)], [np.empty(0)]
    for swing in np.unique(np.linspace(0, len(begins) - 1, min(MAX_SWINGS, len(begins))).astype(np.int64)):
        sample = np.arange(begins[swing], ends[swing] + 1)
        sample = sample[np.isfinite(mag[sample, 0])]
        sample = sample[:: -(-max(len(sample), 1) // MAX_OF_SWING)]
        i, j = np.triu_indices(len(sample), 1)
        nav_field = np.einsum("nij,nj->ni", nav_R_body[sample], mag[sample])
        squares.append(((nav_field[i] - nav_field[j]) ** 2).sum(axis=1))
        distances.append(np.linalg.norm(position[sample[i]] - position[sample[j]], axis=1))
    square, distance = np.concatenate(squares), np.concatenate(distances)
    # The median of each class of distance.
    number = np.digitize(distance, DISTANCES_M)
    found = []
    for k in range(1, len(DISTANCES_M)):
        inside = number == k
        if inside.sum() >= MIN_PAIRS:
            gamma = float(np.median(square[inside])) / MEDIAN_OF_CHI_SQUARE / 2.0 - sigma_uT**2
            found.append((float(np.median(distance[inside])), max(gamma, MIN_VARIOGRAM_UT2)))
    if len(found) < MIN_CLASSES:
        return None
    # Least squares of log gamma over the classes.
    apart, gammas = np.array(found).T
    length, exponent = (grid.ravel() for grid in np.meshgrid(LENGTHS_M, EXPONENTS))
    off = np.log(gammas) - np.log(-np.expm1(-((apart / length[:, None]) ** exponent[:, None])))
    level = off.mean(axis=1)
    best = int(np.argmin(((off - level[:, None]) ** 2).sum(axis=1)))
    return Variogram(float(np.exp(level[best] / 2.0)), float(length[best]), float(exponent[best]))


@dataclass(frozen=True)
class StretchSum(Brief):
    """What the stretches of one kind show of K bias variables and the iron: information (K, 6, 6); how many (K,)."""

    information: BiasInformation
    count: Ints


@dataclass(frozen=True)
class LevelBias:
    """Gyro bias (K, 3), rad/s, of a solution without the factors, and the direction of up (3,) in the body frame."""

    gyro_bias: Floats
    body_up: Floats

    def weaken(self, information: BiasInformation) -> BiasInformation:
        """Scale down information (K, 3, 3) whose level bias contradicts gravity: chi^2 / dof > `MAX_LEVEL_RATIO`."""
        _, _, axes = np.linalg.svd(self.body_up[None])
        level = axes[1:]
        covariance = np.linalg.inv(information.matrix + MIN_INFORMATION * np.eye(3))
        off = ((covariance @ information.vector[..., None])[..., 0] - self.gyro_bias) @ level.T
        allowed = level @ covariance @ level.T + np.radians(LEVEL_SIGMA_DEG_S) ** 2 * np.eye(2)
        ratio = 0.5 * (off * np.linalg.solve(allowed, off[..., None])[..., 0]).sum(axis=-1)
        weight = np.minimum(1.0, MAX_LEVEL_RATIO / np.maximum(ratio, MIN_RATIO))
        return information.scale(weight)


class DifferentialFactors(GtsamFactors):
    """The factors of a walk: one of three rows on each bias variable that a stretch shows."""

    def __init__(self, stances: StretchSum, standings: StretchSum, noise: FieldNoise, known: LevelBias) -> None:
        self.stances, self.standings = stances, standings
        limited = _add_limited(stances.information, standings.information)
        self.information = known.weaken(limited.eliminate_iron(noise.iron))
        residual, seen = self.information.residual(), np.flatnonzero(stances.count + standings.count)
        factors = (linear_factor_of(one_of(residual, int(k)), [B(int(k))]) for k in seen)
        super().__init__(*factors, kind="differential_field")

    def find_sigma(self, bias: Ints, axis: Floats) -> Floats:
        """Return the sigma (F,) rad/s of bias variables `bias` (F,) about unit axes (F, 3), field only; NaN without."""
        information = np.einsum("fi,fij,fj->f", axis, self.information.matrix[bias], axis)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(information > 0.0, information**-0.5, np.nan)


def _add_limited(stances: BiasInformation, standings: BiasInformation) -> BiasInformation:
    """Add them, limited by what is common to all stances and to all standings: each variable has a share of it."""
    share = float(np.sqrt(len(stances.matrix)))
    of_stances = stances.limit(share * float(np.radians(STANCE_SIGMA_DEG_S)))
    return of_stances + standings.limit(share * float(np.radians(STANDING_SIGMA_DEG_S)))


def find_iron(stances: BiasInformation, standings: BiasInformation) -> Iron:
    """Find the iron of a walk, as that of all its bias variables together, and its bias too but for those limits."""
    total = _add_limited(stances, standings)
    found = BiasInformation(total.matrix.sum(axis=0), total.vector.sum(axis=0)).find_iron(Iron.unknown(IRON_UT))
    return replace(found, covariance=found.covariance + MIN_IRON_UT**2 * np.eye(3))


def measure_stretches(turned: FieldStretches, noise: FieldNoise) -> tuple[BiasInformation, Bools]:
    """Return the information of each of S stretches on the gyro bias, and which (S,) pass the chi^2 test."""
    parts = (turned.select(first, first + AT_ONCE) for first in range(0, len(turned.gyro_bias), AT_ONCE))
    whole = StretchInformation.join([measure_bias(part, noise, MAX_SAMPLES) for part in parts])
    # Covariance scaled by chi^2 per degree of freedom where that exceeds 1; left out where the model clearly fails.
    ratio = whole.chi_square / np.maximum(whole.freedom, 1.0)
    used = (whole.freedom > 0.0) & (ratio <= MAX_CHI_SQUARE)
    return whole.information.scale(np.where(used, 1.0 / np.maximum(ratio, 1.0), 0.0)), used


def add_differential_field(problem: WalkProblem, values: gtsam.Values, track: Trajectory) -> WalkProblem:
    """Return the problem with factors of the differential field, linearized once at these values, of path `track`."""
    recording, nodes = problem.recording, problem.nodes
    if not problem.parameters.magnetic.differential or recording.mag is None:
        return problem
    stretches = find_stretches(recording, nodes, problem.known.rests)
    if len(stretches.start) == 0:
        return problem
    biases = list_biases(nodes, values)[:, GYRO]
    turned = turn_stretches(recording, stretches, track.position, biases[stretches.bias])
    sigma_uT = measure_noise(turned)
    # Iron turns with the body in the swings, too, so that the field varies less once it is known.
    iron = Iron.unknown(IRON_UT)
    for done in range(1, MAX_ROUNDS + 1):
        variogram = fit_variogram(recording.mag - iron.mean_uT, track.position, track.nav_R_body, nodes, sigma_uT)
        if variogram is None:
            return problem
        noise = FieldNoise(variogram, sigma_uT, iron)
        information, used = measure_stretches(turned, noise)
        # What stances and standings show of each bias variable.
        sums = []
        for those in (used & ~stretches.is_standing, used & stretches.is_standing):
            bias, matrix, vector = stretches.bias[those], np.zeros((len(biases), 6, 6)), np.zeros((len(biases), 6))
            np.add.at(matrix, bias, information.matrix[those])
            np.add.at(vector, bias, information.vector[those])
            sums.append(StretchSum(BiasInformation(matrix, vector), np.bincount(bias, minlength=len(biases))))
        stances, standings = sums
        found = find_iron(stances.information, standings.information)
        if done >= MIN_ROUNDS and np.linalg.norm(found.mean_uT - iron.mean_uT) < CLOSE_IRON_UT:
            break
        iron = found
    known = LevelBias(biases, track.nav_R_body[nodes.sample, 2].mean(axis=0))
    return problem.join(DifferentialFactors(stances, standings, noise, known))


def write_note(differential: DifferentialFactors | None) -> tuple[str, ...]:
    """Write a note on how many stances and standings show the gyro bias, and how well."""
    if differential is None or len(differential) == 0:
        return ()
    stances, standings = (int(one.count.sum()) for one in (differential.stances, differential.standings))
    values = np.linalg.eigvalsh(differential.information.matrix)
    values = values[values[:, -1] > 0.0]
    worst, best = np.degrees(1.0 / np.sqrt(np.maximum(np.median(values, axis=0), 1.0)))[[0, -1]]
    where = f"{format_count(stances, 'stance')} and {format_count(standings, 'standing')}"
    return (
        f"gyro bias by the differential field of {where}: to {best:.2g} deg/s about the best axis and "
        f"{worst:.2g} about the worst, medians",
    )
