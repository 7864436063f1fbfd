"""The 15 errors, estimate minus truth, put on a state and read off again, without the filter's own code."""

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.mechanisation import NavState


def with_error(truth: NavState, error: Floats) -> NavState:
    turned = Rotation.from_rotvec(error[6:9]).as_matrix() @ truth.nav_R_body
    p, v, _, bg, ba = truth
    return NavState(p + error[:3], v + error[3:6], turned, bg + error[9:12], ba + error[12:])


def error_of(estimate: NavState, truth: NavState) -> Floats:
    turn = Rotation.from_matrix(estimate.nav_R_body @ truth.nav_R_body.T).as_rotvec()
    p, v, bg, ba = (estimate[k] - truth[k] for k in (0, 1, 3, 4))
    return np.concatenate([p, v, turn, bg, ba])


def random_state(rng: np.random.Generator) -> NavState:
    attitude = Rotation.random(rng=rng).as_matrix()
    return NavState(*rng.standard_normal((2, 3)), attitude, *(0.01 * rng.standard_normal((2, 3))))


def random_covariance(rng: np.random.Generator, size: int = 15) -> Floats:
    root = rng.standard_normal((size, size))
    return root @ root.T
