"""
Calibrate a magnetometer
========================

Walking in circles, to the right and to the left, shows what the sensor's own iron adds to the field. An ordinary walk
that turns shows it too, with larger sigmas (:doc:`/magnetic`).
"""

import matplotlib.pyplot as plt
import numpy as np

import fg_nav
from fg_nav.calibration.of_recording import calibrate

recording = fg_nav.simulate("calibration-loop", seed=1).recording
result = calibrate(recording)
found = result.calibration.magnetometer
print("hard iron (uT):", found.hard_iron_uT.round(2), "+-", np.sqrt(np.diag(found.covariance))[:3].round(2))
effect = result.effect
print(f"strength (sd): {effect.strength_before_uT:.2f} uT before, {effect.strength_after_uT:.2f} uT after")
print(f"compass minus gyroscope (sd): {effect.heading_before_deg:.1f} deg, {effect.heading_after_deg:.1f} deg")

# %%
# Each dot is a reading along two axes of the sensor. ``fg-nav run walk.csv --calibration cal.json`` uses what
# ``fg_nav.calibration.of_recording.write_calibration`` writes.
fig, axes = plt.subplots()
readings = recording.mag[np.isfinite(recording.mag).all(axis=1)][::5]
for name, mag in (("as read", readings), ("corrected", found.correct(readings))):
    axes.plot(mag[:, 0], mag[:, 1], ".", markersize=3, label=name)
axes.set(xlabel="x (uT)", ylabel="y (uT)", aspect="equal")
axes.legend()
