"""The best local alignments of a path with itself, and how many as good chance makes.

Symbols: features x_i, y_j (3,) of points i and j (`signature`), s_i, s_j the square roots of their signal shares,
rho (3,) the correlation of two passes at one place.

A pair of points. Of one place, x and y are jointly normal with correlation r = rho s_i s_j; of two places they are
independent. The log likelihood ratio, nats, summed over the components, is

    L(i, j) = sum -1/2 log(1 - r^2) - (r^2 (x^2 + y^2) - 2 r x y) / (2 (1 - r^2)),

times `SHARE`, for points that lie closer than the field's band allows are no independent ones. Its mean is positive at
one place, and negative at two.

A stretch. The best local alignment (Smith and Waterman 1981) ending at (i, j) has

    S(i, j) = max(0, S(i-1, j-1) + L(i, j), S(i-1, j) - g, S(i, j-1) - g),

where a step without its counterpart is a stride walked shorter or longer, about one point in twenty (5 %): g is minus
the logarithm of its odds. How long a stretch is follows from the data: it goes on while it gains. Over the pairs of
blocks that are candidates all S are computed row by row. Each alignment carries its begin, and what is listed of each
begin is the best end. The opposite direction is the same on reversed features: j then counts from the end.

Chance. With its field negated the walk is aligned with itself over the very same pairs of stretches: the negated field
is as rough, has the same spectra, and belongs to no place of the walk.

The scores of best local alignments of unrelated sequences have an exponential tail (Karlin and Altschul 1990). Of those
above u = `MIN_LISTED` there were n in an area A. Then

    expected(S) = N exp(-lambda (S - u)),    N = searched area (n + n0) / (A + n0 / rate0),
    lambda = (n + m0) / (sum (S_k - u) + m0 / lambda0),

where n0, rate0, m0 and lambda0 are what many simulated walks show, with the weight of so many alignments: a short walk
has few of its own. lambda is 1 where the model is right. expected(S) is the number of false recognitions with a score
of S or more on the whole walk (the "number of false alarms" of a-contrario detection, Desolneux, Moisan and Morel
2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.places.candidates import BlockPairs
from fg_nav.places.signature import BLOCK, MAX_M, MIN_M, SPACING_M, Features
from fg_nav.system.compiled import njit

RHO = np.array([0.88, 0.6, 0.4])  # Of below, left, above, of passes 0.35 m apart: what comes from below repeats best.
SHARE = 2.0 * SPACING_M * (1.0 / MIN_M - 1.0 / MAX_M)  # Independent values a point of this bandwidth (Nyquist).
MIN_RATIO = -4.0  # L at least, nats: a point in fifty is not that of its place, as next to something that was moved.
GAP = 3.0  # g, nats: a step without counterpart in twenty.
BESIDE = 16  # Points, 8 m: steps beside each other within which alignments are variants of one.
BAND, BAND_SHARE = 40, 0.01  # Points, and share of its length, by which an alignment may leave the line of its ends.
MIN_LISTED = 5.0  # S from which alignments are listed, nats: there are some of these by chance in any walk.
TINY = 1e-300  # Expected number that stands for none.
USUAL_RATE, RATE_WEIGHT = 20.0 / 1e4, 3.0  # rate0, of both axes along the path, 1/m^2 (15 to 20 a 10^4 m^2), and n0.
USUAL_DECAY, DECAY_WEIGHT = 0.75, 10.0  # lambda0 and m0: 0.7 to 0.95 on simulated walks on rough floors.


@dataclass(frozen=True)
class Alignments:
    """A local alignment a row."""

    score: Floats  # (A,) nats.
    begin: Ints  # (A, 2), first points (i, j) of it; j is a point of the second sequence.
    end: Ints  # (A, 2), last ones.

    def __len__(self) -> int:
        return len(self.score)


def separate(found: Alignments) -> Alignments:
    """Keep the best of alignments that are variants of each other: that overlap, a few steps beside each other."""
    order = np.argsort(-found.score, kind="stable")
    best = order[_is_best(found.begin[order], found.end[order], BESIDE)]
    return Alignments(found.score[best], found.begin[best], found.end[best])


@njit(cache=True)
def _is_best(begin: Ints, end: Ints, beside: int) -> Bools:
    """Flags (A,) of alignments, best first, that overlap no better one within `beside` points of its diagonal."""
    n = len(begin)
    kept, is_kept, count = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.bool_), 0
    for a in range(n):
        shift, best = begin[a, 0] - begin[a, 1], True
        for b in kept[:count]:
            overlap = begin[a, 0] <= end[b, 0] and begin[b, 0] <= end[a, 0]
            overlap = overlap and begin[a, 1] <= end[b, 1] and begin[b, 1] <= end[a, 1]
            first, last = begin[b, 0] - begin[b, 1], end[b, 0] - end[b, 1]
            if overlap and min(first, last) - beside < shift < max(first, last) + beside:
                best = False
                break
        if best:
            kept[count], is_kept[a] = a, True
            count += 1
    return is_kept


def align(x: Features, y: Features, pairs: BlockPairs, least: float = MIN_LISTED) -> Alignments:
    """List alignments of features x with features y over pairs of their blocks, from a score of `least` nats on."""
    score, begin, end, count = _align(
        x.values, x.signal, y.values, y.signal, pairs.start, pairs.earlier, RHO, SHARE, GAP, least, BLOCK
    )
    return Alignments(score[:count], begin[:count], end[:count])


@njit(cache=True)
def _pair_ratio(x: Floats, sx: Floats, i: int, y: Floats, sy: Floats, j: int, rho: Floats) -> float:
    """Log-likelihood ratio, nats, same place against chance, of points i and j; one division for three components."""
    total, left = 0.0, 1.0
    for c in range(3):
        r = rho[c] * sx[i, c] * sy[j, c]
        one = 1.0 - r * r
        total = total * one + left * r * (r * (x[i, c] * x[i, c] + y[j, c] * y[j, c]) - 2.0 * x[i, c] * y[j, c])
        left *= one
    ratio: float = max(-0.5 * (total / left + np.log(left)), MIN_RATIO)
    return ratio


@njit(cache=True)
def _align(
    x: Floats, sx: Floats, y: Floats, sy: Floats, start: Ints, earlier: Ints, rho: Floats, share: float, gap: float,
    least: float, block: int,
) -> tuple[Floats, Ints, Ints, int]:  # fmt: skip
    n, m = len(x), len(y)
    # The row before and this one: score, begin, and the row they were written in.
    score, origin = np.zeros((2, m)), np.zeros((2, m), dtype=np.int64)
    row = np.full((2, m), -2, dtype=np.int64)
    room = 1024
    best, begin, end = np.zeros(room), np.zeros((room, 2), dtype=np.int64), np.zeros((room, 2), dtype=np.int64)
    # Where the alignment that began there is listed: the newest one of each column, and its row.
    listed, listed_row = np.zeros(m, dtype=np.int64), np.full(m, -1, dtype=np.int64)
    count = 0
    for i in range(n):
        now, old = i % 2, 1 - i % 2
        for b in range(start[i // block], start[i // block + 1]):
            for j in range(earlier[b] * block, min((earlier[b] + 1) * block, m)):
                # From the diagonal, or one step along one path alone; a new one begins where nothing is left.
                ratio = share * _pair_ratio(x, sx, i, y, sy, j, rho)
                s, o = 0.0, i * m + j
                if j > 0 and row[old, j - 1] == i - 1 and score[old, j - 1] > 0.0:
                    s, o = score[old, j - 1], origin[old, j - 1]
                s += ratio
                if row[old, j] == i - 1 and score[old, j] - gap > s:
                    s, o = score[old, j] - gap, origin[old, j]
                if j > 0 and row[now, j - 1] == i and score[now, j - 1] - gap > s:
                    s, o = score[now, j - 1] - gap, origin[now, j - 1]
                row[now, j], score[now, j], origin[now, j] = i, max(s, 0.0), o
                if s < least:
                    continue
                # Of all alignments from one begin only the best end is listed.
                column = o % m
                if listed_row[column] != o // m:
                    if count == room:
                        best = np.concatenate((best, np.zeros_like(best)))
                        begin = np.concatenate((begin, np.zeros_like(begin)))
                        end = np.concatenate((end, np.zeros_like(end)))
                        room *= 2
                    listed_row[column], listed[column] = o // m, count
                    begin[count, 0], begin[count, 1] = o // m, column
                    count += 1
                k = listed[column]
                if s > best[k]:
                    best[k], end[k, 0], end[k, 1] = s, i, j
    return best, begin, end, count


def trace(x: Features, y: Features, begin: Ints, end: Ints) -> Ints:
    """Points (M, 2) along the best alignment from a begin to an end (2,), both included."""
    i, j = slice(begin[0], end[0] + 1), slice(begin[1], end[1] + 1)
    back = _trace(x.values[i], x.signal[i], y.values[j], y.signal[j], RHO, SHARE, GAP, BAND, BAND_SHARE)
    return np.asarray(back + begin)


@njit(cache=True)
def _trace(
    x: Floats, sx: Floats, y: Floats, sy: Floats, rho: Floats, share: float, gap: float, band: int, band_share: float
) -> Ints:
    n, m = len(x), len(y)
    # A band about the straight line from begin to end; column k of row i is j = first[i] + k.
    half = band + int(band_share * n)
    slope = (m - 1) / max(n - 1, 1)
    width = 2 * half + 1
    came = np.zeros((n, width), dtype=np.int8)
    score, old = np.full(width, -np.inf), np.full(width, -np.inf)
    before = 0
    for i in range(n):
        first = int(i * slope) - half
        for k in range(width):
            j = first + k
            score[k] = -np.inf
            if j < 0 or j >= m:
                continue
            ratio = share * _pair_ratio(x, sx, i, y, sy, j, rho)
            if i == 0 and j == 0:
                score[k] = ratio
            diagonal, above = j - 1 - before, j - before
            if i > 0 and 0 <= diagonal < width:
                score[k] = old[diagonal] + ratio
            if i > 0 and 0 <= above < width and old[above] - gap > score[k]:
                score[k], came[i, k] = old[above] - gap, 1
            if k > 0 and score[k - 1] - gap > score[k]:
                score[k], came[i, k] = score[k - 1] - gap, 2
        score, old, before = old, score, first
    # Back from the end.
    points, count, i, j = np.zeros((n + m, 2), dtype=np.int64), 0, n - 1, m - 1
    while True:
        points[count, 0], points[count, 1] = i, j
        count += 1
        if i <= 0 or j <= 0:
            break
        step = came[i, j - (int(i * slope) - half)]
        i, j = (i - 1 if step != 2 else i), (j - 1 if step != 1 else j)
    return points[:count][::-1].copy()


# chance


@dataclass(frozen=True)
class ChanceLevel:
    """Expected number of chance alignments above `MIN_LISTED` in the searched area, and the decay of their scores."""

    count: float
    decay: float

    def score_of(self, expected: float) -> float:
        """Score (nats) at which so many are expected; at least `MIN_LISTED`."""
        return MIN_LISTED + max(float(np.log(max(self.count, TINY) / expected)) / self.decay, 0.0)

    def expected(self, score: Floats) -> Floats:
        """Expected number (A,) of chance alignments of these scores (A,) or more."""
        return np.asarray(self.count * np.exp(-self.decay * (score - MIN_LISTED)))


def measure_chance(scores: Floats, area_m2: float, searched_m2: float) -> ChanceLevel:
    """Fit the tail of the scores (n,) of chance alignments that were found in an area, for that which was searched."""
    n, excess = len(scores), float(np.sum(scores - MIN_LISTED))
    count = searched_m2 * (n + RATE_WEIGHT) / (area_m2 + RATE_WEIGHT / USUAL_RATE)
    return ChanceLevel(count, (n + DECAY_WEIGHT) / (excess + DECAY_WEIGHT / USUAL_DECAY))
