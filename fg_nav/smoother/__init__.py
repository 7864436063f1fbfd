"""The factor-graph smoother: strides -> graph -> batch solution -> dense trajectory.

In the order of the data: `strides` (samples to nodes and measurements, and a stride to factors),
`graph` (a walk as a problem, and its path at the recording's rate), `problem` (the same with lever, bias and noise
estimated first), `elimination`, `square_root` and `solver` (the minimum of a walk, and its covariances), `constraints`,
`heights`, `differential` and `field` (what joins the first solution), `building` (directions and places),
`sensitivity` (what all footfalls share, in the sigmas), and `batch`, which calls them. `feet` solves two walks as one.
"""

from fg_nav.smoother.batch import SmoothedWalk, smooth, smooth_graph
from fg_nav.smoother.constraints import ExtraFactors, GraphNodes
from fg_nav.smoother.parameters import SmootherParameters

__all__ = ["ExtraFactors", "GraphNodes", "SmoothedWalk", "SmootherParameters", "smooth", "smooth_graph"]
