"""A piece of a walk laid on an earlier one as a whole: for fields that only long wavelengths show.

Symbols: f (3 n,) uT the field at the n points of the piece, along, left and up (`signature`), g_j that at the points
from j on of the known walk, which is C, a covariance (3 n, 3 n), about its mean; psi_i the heading of the piece.

Common part. What the Earth, hard and soft iron add to a component is constant or turns with the heading: nine vectors,
1, cos(psi_i), sin(psi_i) for each. The piece shows nothing of the building in these. With U the eigenvectors of C in
the rest of the space, l its eigenvalues,

    a = U^T f / sqrt(l),    b_j = U^T g_j / sqrt(l),

each scaled to a mean square of 1, as a quiet corridor compares like a rough one. A field is limited to
`MAX_SIGMAS` robust deviations: one large object does not decide.

One place or two. Of one place a and b_j have correlations r, of two places none. The log likelihood ratio, nats, is

    S_j = sum over all r of  -1/2 log(1 - r^2) - (r^2 (a^2 + b_j^2) - 2 r a b_j) / (2 (1 - r^2)),

    r = 1 - (noise^2 + sum over components c of share_c l |U_c|^2) / l,

where noise is that of a reading, and share_c of the field's variance differs between two passes, which are not in each
other's footprints. How much follows from how near the steel is: the ratio is the mean of those of `LEVELS`.

Chance. Where the model is right, the mean of exp(S_j) over places that are none of the piece's is 1, so that of J
comparisons J exp(-S) come out above S. With the known field negated (`alignment`) the decay lambda is found for which

    mean of exp(lambda S_j) = 1    (Karlin and Altschul 1990),    expected(S) = J exp(-lambda S),

and it is at most `USUAL_DECAY`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import MAD_TO_SIGMA, Floats
from fg_nav.places.alignment import BESIDE, MIN_LISTED, USUAL_DECAY, ChanceLevel
from fg_nav.places.recognition import MAX_EXPECTED, NOTHING, Recognition, Stretch
from fg_nav.places.signature import MIN_POINTS, TURNED, Signature, remove_common_field

PIECE = 80  # Points, 40 m: over as much odometry is good to 0.4 m.
HOP = PIECE // 2  # Points from piece to piece.
MAX_SIGMAS = 3.0  # Of the field about its mean.

# noise (uT) and share (along, left, up): steel some metres away, a floor of concrete, one that is rougher
LEVELS = ((0.15, (0.06, 0.06, 0.06)), (0.3, (0.1, 0.4, 0.2)), (0.5, (0.3, 0.7, 0.4)))
MAX_CHANCES = 1_000_000  # Comparisons with the negated field: those of some pieces of a long walk show the decay of all
MIN_DECAY = 1e-3  # lambda at least: nothing is recognized with it, where chance scores as well as one place.
WINDOWS = 4096  # That are compared at once, 10 MB.
MIN_VARIANCE = 1.3 * LEVELS[0][0] ** 2  # uT^2, of an eigenvector that shows something.
COMMON_RANK = 1e-3  # Singular value of the nine vectors below which one depends on the rest, as on a straight piece.


@dataclass(frozen=True)
class _Known:
    """Field (K, 3) uT of a known walk about its mean, its limit (3,) uT and its covariance (3 n, 3 n)."""

    field: Floats
    limit: Floats
    covariance: Floats


@dataclass(frozen=True)
class _Piece:
    """What is compared: vectors (3 n, R) in which the piece is a (R,), and correlations r (L, R) of one place."""

    vectors: Floats
    a: Floats
    r: Floats


def overlay_known(path: Signature, known: Signature) -> Recognition:
    """Find the pieces of a path that lie on that of an earlier walk; `earlier` are points of that one."""
    size = min(PIECE, len(path), len(known))
    if size < MIN_POINTS:
        return NOTHING
    # the known field within its limits, and its covariance
    field = remove_common_field(known.field, known.heading) * known.seen[:, None]
    limit = MAX_SIGMAS * MAD_TO_SIGMA * np.median(np.abs(field), axis=0)
    field = np.clip(field, -limit, limit)
    spectrum = np.fft.rfft(field, 2 * len(field), axis=0)
    lagged = np.fft.irfft(np.conj(spectrum)[:, :, None] * spectrum[:, None, :], 2 * len(field), axis=0) / len(field)
    covariance = lagged[np.arange(size) - np.arange(size)[:, None]].transpose(0, 2, 1, 3)
    old = _Known(field, limit, covariance.reshape(3 * size, 3 * size))
    # pieces, which cover the path
    n_pieces = 1 + round((len(path) - size) / HOP)
    begins = [round(k) for k in np.linspace(0, len(path) - size, n_pieces).tolist()]
    count = len(begins) * 2 * (len(known) - size + 1)
    # chance, by the negated field
    some = begins[:: int(np.ceil(count / MAX_CHANCES))]
    decay = find_decay(np.concatenate([_compare(_describe(path, k, old), -old.field).ravel() for k in some]))
    chance = ChanceLevel(count * float(np.exp(-decay * MIN_LISTED)), decay)
    found = list[Stretch]()
    least = chance.score_of(MAX_EXPECTED)
    for k in begins:
        # what chance does not explain of a piece, the best of those that lie next to each other
        later, left = np.arange(k, k + size, dtype=float), _compare(_describe(path, k, old), old.field)
        while left.max() >= least:
            way, j = np.unravel_index(left.argmax(), left.shape)
            earlier, score = np.arange(j, j + size, dtype=float), float(left[way, j])
            expected = float(chance.expected(np.array(score)))
            found.append(Stretch(later, earlier[::-1] if way else earlier, bool(way), score, expected))
            left[way, max(j - BESIDE, 0) : j + BESIDE + 1] = -np.inf
    return Recognition(tuple(sorted(found, key=lambda one: -one.score)), chance)


def _describe(path: Signature, begin: int, known: _Known) -> _Piece:
    """Whiten the field of the piece at point `begin` by eigenvectors of its covariance; r: correlation per level."""
    size = len(known.covariance) // 3
    rows = slice(begin, begin + size)
    # orthonormal vectors without the common part: what is constant, and what turns with the heading
    heading = path.heading[rows]
    u, s, _ = np.linalg.svd(np.stack([np.ones(size), np.cos(heading), np.sin(heading)], axis=1))
    rest = np.kron(u[:, int(np.sum(s > COMMON_RANK * s[0])) :], np.eye(3))
    variance, turned = np.linalg.eigh(rest.T @ known.covariance @ rest)
    shows = variance > MIN_VARIANCE
    vectors, variance = rest @ turned[:, shows], variance[shows]
    # correlations of two passes at one place, at each level
    parts = np.sum(vectors.reshape(-1, 3, len(variance)) ** 2, axis=0)
    r = [1.0 - noise**2 / variance - np.array(share) @ parts for noise, share in LEVELS]
    # the field about the common part, within the limits of the known one
    field = (rest @ (rest.T @ path.field[rows].ravel())).reshape(-1, 3) * path.seen[rows, None]
    scaled = vectors / np.sqrt(variance)
    a = _normalize(np.clip(field, -known.limit, known.limit).ravel() @ scaled)
    return _Piece(scaled, a, np.clip(r, 0.0, 1.0))


def _normalize(values: Floats) -> Floats:
    """Scale rows (..., R) to a mean square of one."""
    power = np.sum(values**2, axis=-1, keepdims=True) / max(values.shape[-1], 1)
    return np.asarray(values / np.sqrt(np.maximum(power, np.finfo(float).tiny)))


def _compare(piece: _Piece, field: Floats) -> Floats:
    """S (2, J) of a piece with a known field (K, 3) from each point on, in the same and in the opposite direction."""
    ahead = np.lib.stride_tricks.sliding_window_view(field, len(piece.vectors) // 3, axis=0).transpose(0, 2, 1)
    parts = (ahead[k : k + WINDOWS] for k in range(0, len(ahead), WINDOWS))
    scores = [[_ratio(piece, part), _ratio(piece, part[:, ::-1] * TURNED)] for part in parts]
    return np.concatenate(scores, axis=1)


def _ratio(piece: _Piece, ahead: Floats) -> Floats:
    """S (J,) of windows (J, n, 3)."""
    b = _normalize(ahead.reshape(len(ahead), -1) @ piece.vectors)
    r, left = piece.r, 1.0 - piece.r**2
    own = np.sum(-0.5 * np.log(left) - 0.5 * piece.a**2 * r**2 / left, axis=1)
    each = own - 0.5 * b**2 @ (r**2 / left).T + b @ (piece.a * r / left).T
    return np.asarray(np.logaddexp.reduce(each, axis=1) - np.log(len(r)))


def find_decay(scores: Floats) -> float:
    """Decay rate lambda of chance scores (M,): E exp(lambda score) = 1, bounded by `MIN_DECAY` and `USUAL_DECAY`."""
    from scipy.optimize import brentq

    def excess(decay: float) -> float:
        return float(np.logaddexp.reduce(decay * scores) - np.log(len(scores)))

    if excess(USUAL_DECAY) <= 0.0:
        return USUAL_DECAY
    return float(brentq(excess, MIN_DECAY, USUAL_DECAY)) if excess(MIN_DECAY) < 0.0 else MIN_DECAY
