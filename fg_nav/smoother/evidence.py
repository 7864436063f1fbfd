"""The evidence for an assumption, by the linear graph at its minimum (Laplace; MacKay 2003, section 27).

    -log p(z | assumed) = E + log|R| + 1/2 sum_i log|S_i|

E the error at the minimum, R the triangle of the square-root information, S_i the noise covariances of the factors; of
these each caller adds those that its assumption changes. All else is left out.

A few numbers s shared by many factors, with the prior 0 and S: of the walk that is eliminated without them
(`sensitivity`) there is left the information L on s and its product eta with the estimate, and

    s = P eta,     P = (L + S^-1)^-1,     log p(z | S) = 1/2 eta^T P eta - 1/2 log|I + S L| + const.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats

MAX_NATS = 3.0  # Twenty to one: what counts as strong evidence (Kass and Raftery 1995).


def average(values: Floats, minus_log_evidence: Floats, prior: Floats | None = None) -> Floats:
    """Mean of values (L, ...) of L models, weighted by their evidence (L,) and, if given, by prior weights (L,)."""
    weight = np.exp(minus_log_evidence.min() - minus_log_evidence) * (1.0 if prior is None else prior)
    return np.asarray(np.tensordot(weight / weight.sum(), values, axes=1))


def fit_shared(information: Floats, pull: Floats, prior: Floats) -> tuple[Floats, Floats, float]:
    """Return s (n,), P (n, n) and log p(z | S), by L (n, n), eta (n,) and the prior S (n, n)."""
    covariance = np.asarray(np.linalg.inv(information + np.linalg.inv(prior)))
    found = covariance @ pull
    occam = 0.5 * np.linalg.slogdet(np.eye(len(prior)) + prior @ information)[1]
    return found, covariance, float(0.5 * pull @ found - occam)
