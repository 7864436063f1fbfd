"""The factor-graph smoother: strides -> graph -> batch solution -> dense trajectory (`batch` has the steps)."""

from fg_nav.smoother.batch import SmoothedWalk, smooth, smooth_graph
from fg_nav.smoother.constraints import ExtraFactors, GraphNodes
from fg_nav.smoother.parameters import SmootherParameters

__all__ = ["ExtraFactors", "GraphNodes", "SmoothedWalk", "SmootherParameters", "smooth", "smooth_graph"]
