"""The factor-graph smoother: strides -> graph -> batch solution -> dense trajectory.

The data's way: `nodes` (where the graph has variables), `preintegration` (samples to IMU measurements),
`strides` (one function turns a stride into factors), `initial` (where the solver starts), `solver` (Gauss-Newton),
`dense` (back to the recording's rate), and `batch`, which calls them in this order.
"""

from fg_nav.smoother.batch import smooth
from fg_nav.smoother.parameters import SmootherParameters

__all__ = ["SmootherParameters", "smooth"]
