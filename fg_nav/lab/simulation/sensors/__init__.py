"""Sensors that misread: from true rate, specific force and field to what a logger stores.

Symbols: w rate (rad/s), f specific force (m/s^2), each the mean over a sample's period; B field (uT), asked for
at the instants of the magnetometer's own samples; all in the body frame. A bar is the mean over the units of a
module, u counts them; every equation is explained in the file that is named.

    gyr = mean_u digits((I + E_u) w + G_u f + b_u + d_u(t) + n)     `triad`, `drift`
    acc = mean_u digits((I + E_u) f + b_u + d_u(t) + n)             `triad`, `drift`
    mag = mean_u digits(K_u (S B(t - lag) + h) + o_u + n)           `magnetometer`, `iron`
    stamp = (1 + e) t + delay, in a queue; some samples are lost    `clock`

Three stages, three sources of chance, so that a sensor calibrated in one scenario is the same one in the next:

============= ============================================== ===============================================
`SensorPrior` what sensors of a make are like (`preset`)     an estimator may assume this
`Sensor`      one of them: E, G, K, S, h, o, e               `prior.draw(rng)`, the same on every walk
`SensorRun`   one walk with it: b, d(t), n, delays, losses   `sensor.switched_on(rng)`, new on every walk
============= ============================================== ===============================================

>>> sensor = preset("mpu-9250x8").draw(np.random.default_rng(1))
>>> run = sensor.switched_on(np.random.default_rng(2))
>>> samples = run.measure(t, rate, force, body_field)  # block after block; body_field(instants) is (M, 3) uT
>>> run.biases_at(np.arange(0.0, t[-1]))  # the truth

Drawn values and parameters are put into JSON by `as_dict`.
"""

from fg_nav.lab.simulation.sensors.clock import Clock, ClockPrior
from fg_nav.lab.simulation.sensors.magnetometer import (
    Iron,
    IronPrior,
    Magnetometer,
    MagnetometerPrior,
    ma_table_1,
    make_iron,
)
from fg_nav.lab.simulation.sensors.presets import PRESETS, preset
from fg_nav.lab.simulation.sensors.sensor import Biases, Samples, Sensor, SensorPrior, SensorRun, Unit
from fg_nav.lab.simulation.sensors.triad import Drift, Triad, TriadPrior

__all__ = [
    "PRESETS",
    "Biases",
    "Clock",
    "ClockPrior",
    "Drift",
    "Iron",
    "IronPrior",
    "Magnetometer",
    "MagnetometerPrior",
    "Samples",
    "Sensor",
    "SensorPrior",
    "SensorRun",
    "Triad",
    "TriadPrior",
    "Unit",
    "ma_table_1",
    "make_iron",
    "preset",
]
