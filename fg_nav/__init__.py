"""fg-nav: pedestrian inertial navigation as a factor graph.

This page is the constitution: every module keeps to it.

Frames
------
nav
    Navigation frame, East-North-Up: x east, y north, z up, gravity (0, 0, -g). Without a magnetometer and
    without a given heading, "north" is the direction of the body's x axis at the start.
body
    The sensor's axes: forward-left-up or any other right-handed set, as mounted.

A frame stands in the name of what is expressed in it: `nav_R_body` maps body vectors to navigation vectors,
`body_field` is a field seen in the body frame. Positions and velocities without a frame in the name are in nav.

Units
-----
SI inside: s, m, m/s, m/s^2, rad, rad/s; magnetic flux density in uT. `acc` is specific force: +g on the up axis
of a sensor at rest. Heading for people is in degrees clockwise from north. Where a reader could doubt, the unit
stands in the name (`_deg_s`, `_uT`, `_m_s2`).

Types
-----
Recording
    What the sensor recorded (`fg_nav.recording`).
Stances
    When the foot stood: found once, shared by all estimators (`fg_nav.stances`).
Solution
    What every estimator returns: the dense trajectory and one row a stance (`fg_nav.solution`).

The data's way: `fg_nav.io` -> `Recording` -> `fg_nav.detection` -> `Stances` -> `fg_nav.smoother` or `fg_nav.ekf`
-> `Solution` -> `fg_nav.evaluation`, `fg_nav.report`.
"""
