"""The factor-graph smoother: strides -> graph -> batch solution -> dense trajectory.

In the order of the data: `strides` (samples to nodes and inertial measurements, and a stride to factors), `graph` (a
walk as a problem, and its solution at the recording's rate), `problem` (the same with lever, bias and noise estimated
first), `bias_walk` and `bias_prior` (how far the bias walks, and how large it may be), `solver` (Gauss-Newton, covariances), `constraints` and `field` (what
joins the first solution), `gyro_scale` (which corrects the samples by it), and `batch`, which calls them.
"""

from fg_nav.smoother.batch import smooth
from fg_nav.smoother.parameters import SmootherParameters

__all__ = ["SmootherParameters", "smooth"]
