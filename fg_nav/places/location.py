"""Where a walk is on the places of an earlier one: from stretches that were recognized to its start and heading there.

Symbols: b (P, 3) m the mean places of pieces of the walk in its own frame, q (P, 3) those of the known walk that they
were recognized as, h the direction of walking there; c the origin of the walk's frame, its start, in the known frame
and psi the turn about up that takes the walk's frame into the known one. Frames: both East-North-Up, their north may
differ.

    q = c + Rot(psi) b + error,      h_known - h = psi + error.

Each stretch is cut into pieces of `PIECE_M`. The errors of a piece have three parts,

    tie     as in `recognition`: along the path ALONG_SIGMA_M, to its side LATERAL_SIGMA_M, up UP_SIGMA_M, with an
            independent error every `AVERAGE_M`; of the direction HEADING_SIGMA_RAD; independent from piece to piece
    drift   of the walk since its start, sigma(d) of `Uncertainty`: two pieces share that of the earlier one, of the
            direction too
    map     of the known walk, its own sigma: two pieces share the smaller one

and c and psi are those of generalized least squares, with their covariance.

Stretches that do not agree are left out. A set is grown from each of the heaviest stretches, heaviest first: one joins
if its pieces lie within `MAX_CHI2` of the transform of those that are in already, with the covariance of both. The set
with the largest score is taken. Its expected number of false recognitions is that of its surest stretch, and the odds
of each set that lies elsewhere, or leads elsewhere (`ELSEWHERE_SIGMAS`),

    expected = min over the set of expected(S) + sum over other sets of exp(-lambda (S_set - S_other)),

S_set the sum of scores of its stretches where they do not overlap. Above `LONE_EXPECTED` there is no location.

Where the alignments of `recognition` show nothing, the same is done with the pieces that lie on the known walk as a
whole (`overlay`), if their own shape is that of the known path: all pieces within `MAX_CHI2` of their transform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats, Ints, interpolate_columns
from fg_nav.frames import average_angles, wrap_angle, yaw_rotation
from fg_nav.places.candidates import Drift
from fg_nav.places.overlay import overlay_known
from fg_nav.places.recognition import (
    ALONG_SIGMA_M,
    AVERAGE_M,
    HEADING_SIGMA_RAD,
    LATERAL_SIGMA_M,
    LONE_EXPECTED,
    UP_SIGMA_M,
    Recognition,
    Stretch,
    recognize_known,
)
from fg_nav.places.saved import SavedPlaces
from fg_nav.places.signature import SPACING_M, Signature

PIECE_M, MAX_PIECES = 8.0, 100  # Of a stretch: some strides, longer on a long walk, for all are solved at once.
MAX_STRETCHES = 50  # That are looked at, the best ones.
MAX_CHI2 = 18.5  # chi^2 of four degrees of freedom that one true piece in a thousand exceeds.
MAX_SETS = 20  # Stretches that a set is grown from.
ELSEWHERE_SIGMAS, ELSEWHERE_M, ELSEWHERE_RAD = 4.0, 2.0, np.deg2rad(10.0)  # Starts or turns further apart are rivals.
STEPS = 4  # Of Gauss-Newton, from a turn that is right to some degrees.
DRIFT = Drift(position_share=0.01)  # Of the solution over the first hundreds of metres.


@dataclass(frozen=True)
class Pieces:
    """P pieces of recognized stretches, means over each."""

    stretch: Ints  # (P,) number of the stretch
    t: Floats  # (P,) s, when it was walked
    walked_m: Floats  # (P,) since the start of the walk
    place: Floats  # (P, 3) m, in the walk's frame
    known: Floats  # (P, 3) m, in the known frame
    heading: Floats  # (P,) rad, direction of walking in the known frame
    turn: Floats  # (P,) rad, of that from the one in the walk's frame
    map_sigma: Floats  # (P, 3) m, of the known walk
    count: Floats  # (P,) independent errors that the means are of

    def of(self, members: Sequence[int]) -> Pieces:
        """Return those of some stretches."""
        rows = np.isin(self.stretch, members)
        return Pieces(**{name: value[rows] for name, value in vars(self).items()})

    @property
    def tie_covariance(self) -> Floats:
        """Covariance (P, 3, 3) m^2 of the place of each, without drift and map."""
        axes, one = yaw_rotation(self.heading), np.ones(len(self.heading))
        variance = np.array([ALONG_SIGMA_M, LATERAL_SIGMA_M, UP_SIGMA_M]) ** 2
        of_each = variance / np.stack([self.count, self.count, one], axis=1)
        return np.asarray((axes * of_each[:, None, :]) @ np.swapaxes(axes, 1, 2))


@dataclass(frozen=True)
class Location:
    """Where a walk is in the frame of a known one."""

    start: Floats  #: (3,) m, the origin of the walk's frame in the known one.
    turn_rad: float  #: Counterclockwise, from the walk's frame to the known one.
    covariance: Floats  #: (4, 4) of start (m) and turn (rad).
    expected_false: float  #: Recognitions as good as this one that chance would make.
    stretches: tuple[Stretch, ...]  #: That agree on it; their `earlier` are points of the known walk.
    pieces: Pieces  #: Of these.

    @property
    def map_variance(self) -> Floats:
        """(3,) m^2 of the known walk itself at the places that were recognized."""
        return np.asarray(np.mean(self.pieces.map_sigma**2, axis=0))


@dataclass(frozen=True)
class _Transform:
    """Transform x (4,), start and turn, with its covariance (4, 4), by some pieces."""

    x: Floats
    covariance: Floats


def locate(path: Signature, known: SavedPlaces) -> Location | None:
    """Return the transform of a walk onto known places, with covariance; None if unrecognized or ambiguous."""
    location = _place(path, known, recognize_known(path, known.path))
    if location is not None:
        return location
    # pieces that lie on the known walk as a whole, and keep the shape of its path
    found, kept = overlay_known(path, known.path), list[Stretch]()
    for stretch in found.stretches:
        pieces = _cut_pieces(path, known, [stretch])
        if _agrees(pieces, _fit_transform(pieces)):
            kept.append(stretch)
    return _place(path, known, replace(found, stretches=tuple(kept)))


def _place(path: Signature, known: SavedPlaces, found: Recognition) -> Location | None:
    """Return the transform of the best consistent set of stretches; None if false or rival places are too likely."""
    if not found.stretches:
        return None
    stretches = found.stretches[:MAX_STRETCHES]
    pieces = _cut_pieces(path, known, stretches)
    # consistent sets of stretches, scored without counting a part of the walk twice
    sets = [_grow(pieces, len(stretches), start) for start in range(min(len(stretches), MAX_SETS))]
    scores = []
    for members, _ in sets:
        # of stretches that overlap on the walk, the best alone counts
        total, covered = 0.0, np.zeros(0)
        for k in sorted(members, key=lambda number: -stretches[number].score):
            if not np.isin(stretches[k].later, covered).any():
                total += stretches[k].score
                covered = np.concatenate([covered, stretches[k].later])
        scores.append(total)
    best = int(np.argmax(scores))
    members, fit = sets[best]
    # odds of rival sets, which put the walk elsewhere: the best set of each place
    places, odds = [fit], 0.0
    for k in np.argsort(-np.array(scores), kind="stable").tolist():
        other = sets[k][1]
        if all(_is_elsewhere(other, place) for place in places):
            places.append(other)
            odds += float(np.exp(-found.chance.decay * max(scores[best] - scores[k], 0.0)))
    expected = min(stretches[k].expected_false for k in members) + odds
    if expected >= LONE_EXPECTED:
        return None
    of_set = tuple(stretches[k] for k in members)
    return Location(fit.x[:3], average_angles(fit.x[3:]), fit.covariance, expected, of_set, pieces.of(members))


def _cut_pieces(path: Signature, known: SavedPlaces, stretches: Sequence[Stretch]) -> Pieces:
    """Cut stretches into pieces and average each: time, distance, positions, headings and sigmas."""
    length, rows = max(PIECE_M, sum(stretch.length_m for stretch in stretches) / MAX_PIECES), []
    points, known_points = np.arange(len(path), dtype=float), np.arange(len(known.path), dtype=float)
    for number, stretch in enumerate(stretches):
        count = max(round(stretch.length_m / length), 1)
        parts = (np.array_split(one, count) for one in (stretch.later, stretch.earlier))
        for later, earlier in zip(*parts, strict=True):
            heading = average_angles(np.interp(earlier, known_points, known.path.heading))
            heading += np.pi if stretch.opposite else 0.0
            row = (
                number,
                float(np.interp(later, points, path.t).mean()),
                float(np.interp(later, points, path.distance_m).mean()),
                interpolate_columns(later, points, path.position).mean(axis=0),
                interpolate_columns(earlier, known_points, known.path.position).mean(axis=0),
                heading,
                average_angles(heading - np.interp(later, points, path.heading)),
                interpolate_columns(earlier, known_points, known.sigma_m).mean(axis=0),
                max(len(later) * SPACING_M / AVERAGE_M, 1.0),
            )
            rows.append(row)
    return Pieces(*(np.array(column) for column in zip(*rows, strict=True)))


def _grow(pieces: Pieces, count: int, start: int) -> tuple[list[int], _Transform]:
    """Return the stretches consistent with `start`, greedily the best of `count` first, and the transform by them."""
    members = [start]
    fit = _fit_transform(pieces.of(members))
    for k in range(count):
        if k != start and _agrees(pieces.of([k]), fit):
            members.append(k)
            fit = _fit_transform(pieces.of(members))
    return members, fit


def _agrees(one: Pieces, fit: _Transform) -> bool:
    """Whether the squared Mahalanobis distance of each piece of a stretch from the transform is at most `MAX_CHI2`."""
    residual, jacobian = _linearize(one, fit.x)
    covariance = _covariance_of(one) + jacobian @ fit.covariance @ jacobian.T
    each = residual.reshape(-1, 4)
    blocks = [covariance[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] for k in range(len(each))]
    chi2 = [r @ np.linalg.solve(block, r) for r, block in zip(each, blocks, strict=True)]
    return bool(np.max(chi2) <= MAX_CHI2)


def _fit_transform(pieces: Pieces) -> _Transform:
    """Gauss-Newton generalized least squares of translation and heading, from the mean turn."""
    x = np.append(np.zeros(3), average_angles(pieces.turn))
    weight = np.linalg.inv(_covariance_of(pieces))
    information = np.eye(4)
    for _ in range(STEPS):
        residual, jacobian = _linearize(pieces, x)
        information = jacobian.T @ weight @ jacobian
        x = x + np.linalg.solve(information, jacobian.T @ weight @ residual)
    return _Transform(x, np.asarray(np.linalg.inv(information)))


def _linearize(pieces: Pieces, x: Floats) -> tuple[Floats, Floats]:
    """Residuals (4 P,), place and direction of each piece, and their Jacobian (4 P, 4), of known minus transformed."""
    turned = pieces.place @ yaw_rotation(x[3]).T
    residual = np.column_stack([pieces.known - x[:3] - turned, wrap_angle(pieces.turn - x[3])])
    jacobian = np.tile(np.eye(4), (len(turned), 1, 1))
    jacobian[:, 0, 3], jacobian[:, 1, 3] = -turned[:, 1], turned[:, 0]
    return residual.ravel(), jacobian.reshape(-1, 4)


def _covariance_of(pieces: Pieces) -> Floats:
    """Covariance (4 P, 4 P) of the residuals, m and rad: common drift and map errors, independent tie errors."""
    count, d = len(pieces.t), pieces.walked_m
    common = np.zeros((count, 4, count, 4))
    # Common to two pieces: the drift until the first, and the smaller map sigma.
    first, none = np.minimum(d[:, None], d[None, :]), np.zeros((count, count))
    drift = [DRIFT.position_m(none, first) ** 2] * 2 + [DRIFT.height_m(none, first) ** 2]
    for axis in range(3):
        sigma = pieces.map_sigma[:, axis]
        common[:, axis, :, axis] = drift[axis] + np.minimum(sigma[:, None], sigma[None, :]) ** 2
    common[:, 3, :, 3] = DRIFT.heading_rad(none, first) ** 2
    # What each has alone.
    each = np.arange(count)
    common[each, :3, each, :3] += pieces.tie_covariance
    common[each, 3, each, 3] += HEADING_SIGMA_RAD**2 / pieces.count
    return common.reshape(4 * count, 4 * count)


def _is_elsewhere(one: _Transform, other: _Transform) -> bool:
    """Whether two transforms put the start at two places, or lead from one place in two directions."""
    variance = np.diag(one.covariance + other.covariance)
    apart, turned = np.linalg.norm(one.x[:2] - other.x[:2]), abs(float(wrap_angle(one.x[3:] - other.x[3:])[0]))
    is_moved = apart > ELSEWHERE_SIGMAS * np.sqrt(variance[:2].sum()) + ELSEWHERE_M
    is_turned = turned > ELSEWHERE_SIGMAS * np.sqrt(variance[3]) + ELSEWHERE_RAD
    return bool(is_moved or is_turned)
