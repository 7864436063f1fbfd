"""The factor-graph smoother: strides -> graph -> batch solution -> dense trajectory.

In the order of the data: `strides` (samples to nodes and inertial measurements, and a stride to factors), `graph` (a
walk as a problem, and its solution at the recording's rate), `problem` (the same with lever, bias and noise estimated
first), `bias_walk` (the random walk of the bias), `gauss_newton` and `solver` (the minimum of a walk, and its
covariances), `constraints`, `floors` and `field` (what joins the first solution), `bias_prior` and `gyro_scale` (what a
solution shows of the gyroscope, for which the walk is solved again), `directions` and `places`, `moving_foot` and
`combinations` (what all footfalls share, in the sigmas), and `batch`, which calls them.
"""

from fg_nav.smoother.batch import SmoothedWalk, smooth, smooth_graph
from fg_nav.smoother.own_factors import ExtraFactors, GraphNodes
from fg_nav.smoother.parameters import SmootherParameters

__all__ = ["ExtraFactors", "GraphNodes", "SmoothedWalk", "SmootherParameters", "smooth", "smooth_graph"]
