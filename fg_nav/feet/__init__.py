"""Two feet of one person: their steps, the clocks of their sensors, and which foot is which.

========= ==========================================================================
`steps`   which footfalls are beside each other, in the mean over cells
`clocks`  how far the clocks of both sensors are apart, by the swings
`heading` how both sensors are turned to each other, by the directions of the steps
`person`  the path between both feet
`sides`   left and right
`options` what is asked of one sensor, where there are two
========= ==========================================================================

Everything here is numpy: no graph and no estimator. The two feet in one graph are `fg_nav.smoother.feet`.
"""
