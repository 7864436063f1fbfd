"""
A graph of your own, with the compass of a foot
===============================================

Odometry that drifts, and the compass of ``fg_nav.factors``, solved by GTSAM. The field at a footfall is one variable of
nine numbers, m = (phi, delta, r_E, r_N, E_E, E_N, h_x, h_y, h_z): its potential (uT m, for line integrals), how far the
place deviates to the right of north (uT), this part of the building, its field over ground, and the iron on the shoe.
"""

import gtsam
import matplotlib.pyplot as plt
import numpy as np
from gtsam.symbol_shorthand import M, X

import fg_nav
from fg_nav import factors
from fg_nav.frames import yaw_rotation

walk = fg_nav.navigate(fg_nav.simulate("demo", seed=1).recording, "iez")
foot, field = walk.stances, walk.walk.field.body_field  # uT, in body axes
turn = yaw_rotation(np.radians(0.5) * np.arange(len(foot)))  # half a degree a stride, as of a poor gyroscope
R, moves = turn @ foot.nav_R_body, turn @ np.diff(foot.position, axis=0, prepend=np.zeros((1, 3)))[..., None]
odometry = [gtsam.Pose3(gtsam.Rot3(one), p) for one, p in zip(R, np.cumsum(moves[..., 0], axis=0), strict=True)]
m = np.array([0, 0, 0, 0, *np.mean(R[:20] @ field[:20, :, None], axis=0)[:2, 0], 0, 0, 0])
prior = factors.FieldPrior(m, np.array([25, 5, 2, 2, 9, 0.5, 1, 1, 1]))  # of E its direction, and its strength
change = factors.FieldTransition(np.array([0.9, 0.5, 0.98, 0.98, *5 * [1.0]]), np.array([11, 4, 0.4, 0.4, *5 * [0.05]]))
params, graph, values = gtsam.ISAM2Params(), gtsam.NonlinearFactorGraph(), gtsam.Values()
params.relinearizeSkip = 1
isam = gtsam.ISAM2(params)
for k, pose in enumerate(odometry):
    new, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    compass = factors.MagneticHeading(field[k], np.eye(3), R[k], np.array(1.0))  # levelled by R, with a sigma in uT
    new.push_back(factors.factor_of(compass, [X(k), M(k)]))
    if k == 0:
        new.push_back(factors.factor_of(prior, [M(0)]))
        new.addPriorPose3(X(0), pose, gtsam.noiseModel.Isotropic.Sigma(6, 1e-3))
    else:
        new.push_back(factors.linear_factor_of(change, [M(k - 1), M(k)]))
        cov = np.diag([0, 0, 0, 4e-4, 4e-4, 4e-4])  # m^2, and rad^2 below: a turn about up is the least known
        cov[:3, :3] = R[k].T @ np.diag([1e-6, 1e-6, 1e-3]) @ R[k]
        step = odometry[k - 1].between(pose), gtsam.noiseModel.Gaussian.Covariance(cov)
        new.add(gtsam.BetweenFactorPose3(X(k - 1), X(k), *step))
    start.insert(X(k), pose)
    start.insert(M(k), m)
    isam.update(new, start)
    graph.push_back(new)
    values.insert(start)
batch = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()

# %%
# The walk ended where it began.
for name, found in {"odometry": values, "iSAM2": isam.calculateBestEstimate(), "batch": batch}.items():
    path = np.array([found.atPose3(X(k)).translation() for k in range(len(foot))])
    print(f"{name:8s} ends {np.linalg.norm(path[-1, :2]):.2f} m from the start")
    plt.plot(*path.T[:2], label=name)
plt.axis("equal")
plt.legend()
