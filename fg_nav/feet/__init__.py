"""Two feet of one person: their steps, the clocks of their sensors, and which foot is which.

========= ===================================================================
Everything here is numpy: no graph and no estimator. The two feet in one graph are `fg_nav.smoother.feet`.
"""
