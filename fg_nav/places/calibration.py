"""How many alignments so good are expected where nothing returns.

The likelihood ratio of an alignment (`alignment`) is that of a model: values of neighboring points that are
independent, a field without favorite shapes, one pair of stretches and not the best of many. What a score is worth the
walk itself shows. With its field negated it is aligned with itself over the very same pairs of stretches. The negated
field is as rough, has the same spectra and the same relation of along to up (a potential's, of sources below or
above), and belongs to no place of the walk: all that is found are chance alignments, in the area that was searched or,
of a large one, in an even part of it.

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

from fg_nav.arrays import Floats
from fg_nav.places.alignment import MIN_LISTED

TINY = 1e-300  # Expected number that stands for none.

USUAL_RATE, RATE_WEIGHT = 20.0 / 1e4, 3.0
"""rate0, chance alignments a square meter (both axes along the path), and n0: 15 to 20 a 10^4 m^2 on rough floors."""

USUAL_DECAY, DECAY_WEIGHT = 0.75, 10.0  # lambda0 and m0: 0.7 to 0.95 on simulated walks on rough floors.


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
