"""Factors for pedestrian navigation with GTSAM: gtsam and numpy only, useful without the rest of fg-nav.

Vocabulary
----------
Pose keys hold `nav_T_body` (gtsam.Pose3), velocity keys hold nav_v (3-vector, m/s), bias keys hold
`imuBias.ConstantBias` (accelerometer m/s^2, gyroscope rad/s). Tangent-space order of a pose is rotation first, then
translation, both in the body frame (gtsam's convention); of a bias: accelerometer first, then gyroscope.
Residuals are "predicted minus measured".
"""
