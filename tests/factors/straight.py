"""The straight walk as gtsam has robust factors: the change of course itself, under the mixture as a noise."""

from collections.abc import Sequence

import gtsam
import numpy as np

from fg_nav.factors import guarded_factor
from fg_nav.factors.walk_constraints import (
    StraightWalk,
    change_of_course,
    change_of_course_slopes,
    straight_probability,
    straight_walk_loss,
)


def straight_walk_noise(walk: StraightWalk = StraightWalk()) -> gtsam.noiseModel.Robust:
    """Mixture of straight and anything, of dimension 1."""
    c = walk.odds_of_curve
    estimator = gtsam.noiseModel.mEstimator.Custom(
        lambda x: float(straight_probability(float(x), c)), lambda x: float(straight_walk_loss(float(x), c))
    )
    return gtsam.noiseModel.Robust.Create(estimator, gtsam.noiseModel.Isotropic.Sigma(1, walk.sigma))


def straight_walk_factor(keys: Sequence[int], noise: gtsam.noiseModel.Base) -> gtsam.CustomFactor:
    """Change of course over the poses of three footfalls."""

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[np.ndarray, list[np.ndarray]]:
        poses = [values.atPose3(key) for key in keys]
        points = [pose.translation() for pose in poses]
        H = [np.zeros((1, 6)) for _ in keys]
        for H_, by, pose in zip(H, change_of_course_slopes(*points), poses, strict=True):
            H_[0, 3:] = by @ pose.rotation().matrix()
        return change_of_course(*points)[None], H if with_jacobians else []

    return guarded_factor("straight walk", list(keys), [6] * 3, noise, residual)
