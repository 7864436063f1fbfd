"""Numbers that a walk shares and that are left at zero: their error about zero counts, and not about what is found."""

import numpy as np

from fg_nav.smoother.graph import solve
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.sensitivity import FORWARD_SIGMA, SIDEWAYS_SIGMA, weigh_moving_foot
from tests.simulated import RIGID
from tests.smoother.walks import DEFAULT, noise_free


def test_what_is_found_of_a_moving_foot_and_not_taken_off_is_in_the_spread():
    walk = noise_free(RIGID)
    problem = walk_problem(walk.recording, walk.stances, 0.0, DEFAULT)
    columns, information, _ = weigh_moving_foot(problem, solve(problem))
    prior, moved = np.diag([FORWARD_SIGMA**2, SIDEWAYS_SIGMA**2]), 3.0 * np.array([FORWARD_SIGMA, -SIDEWAYS_SIGMA])
    covariance = np.linalg.inv(information + np.linalg.inv(prior))
    found = covariance @ information @ moved
    assert (np.abs(found) > np.sqrt(np.diag(covariance))).any()
    X = columns.solve()[:60]
    S = columns.spread_untaken(information, information @ moved, prior)[:60]
    expected = X @ (covariance + np.outer(found, found)) @ X.T
    np.testing.assert_allclose(S @ S.T, expected, atol=1e-9 * np.abs(expected).max())
