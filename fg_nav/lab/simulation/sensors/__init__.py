"""Sensors that misread: from true rate, specific force and field to what a logger stores.

Symbols: w rate (rad/s), f specific force (m/s^2), each the mean over a sample's period; B field (uT), asked for
at the instants of the magnetometer's own samples; all in the body frame. A bar is the mean over the units of a
module, u counts them; every equation is explained in the file that is named.

    gyr = mean_u digits((I + E_u) w + G_u f + b_u + d_u(t) + n)     `triad`
    acc = mean_u digits((I + E_u) f + b_u + d_u(t) + n)             `triad`
    mag = mean_u digits(K_u (S B(t - lag) + h) + o_u + n)           `magnetometer`
    stamp = (1 + e) t + delay, in a queue; some samples are lost    `clock`

Three stages, three sources of chance, so that a sensor calibrated in one scenario is the same one in the next:

============= ============================================== ===============================================
`SensorPrior` what sensors of a make are like (`preset`)     an estimator may assume this
`Sensor`      one of them: E, G, K, S, h, o, e               `prior.draw(rng)`, the same on every walk
`SensorRun`   one walk with it: b, d(t), n, delays, losses   `sensor.switched_on(rng)`, new on every walk
============= ============================================== ===============================================

The sensors by name stand in `presets.toml`, with the source of each figure.

>>> sensor = preset("mpu-9250x8").draw(np.random.default_rng(1))
>>> run = sensor.switch_on(np.random.default_rng(2))
>>> samples = run.measure(t, rate, force, body_field)  # block after block; body_field(instants) is (M, 3) uT
>>> run.biases_at(np.arange(0.0, t[-1]))  # the truth
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from fg_nav.lab.simulation.checks import Table, check_known
from fg_nav.lab.simulation.sensors.clock import ClockPrior
from fg_nav.lab.simulation.sensors.magnetometer import IronPrior, MagnetometerPrior, ma_table_1, make_iron
from fg_nav.lab.simulation.sensors.sensor import BiasTruth, Samples, Sensor, SensorPrior, SensorRun
from fg_nav.lab.simulation.sensors.triad import Drift, TriadPrior

__all__ = [
    "PRESETS",
    "BiasTruth",
    "ClockPrior",
    "Drift",
    "IronPrior",
    "MagnetometerPrior",
    "Samples",
    "Sensor",
    "SensorPrior",
    "SensorRun",
    "TriadPrior",
    "ma_table_1",
    "make_iron",
    "preset",
    "read_sensor",
]

PRESETS: Mapping[str, Mapping[str, Any]] = tomllib.loads((Path(__file__).parent / "presets.toml").read_text("utf-8"))
"""Tables of the sensors that `preset` knows."""

PERFECT = SensorPrior("perfect", 1.0)


class _Table(Table):
    """A sensor as it stands in a file."""

    sensor: SensorPrior


@cache
def preset(name: str) -> SensorPrior:
    """Prior of a sensor by name; the names are in `PRESETS`.

    Raises `SimulationError` if there is no such sensor.
    """
    check_known("sensor", name, PRESETS)
    table = dict(PRESETS[name])
    like = table.pop("like", None)
    return read_sensor({**table, "name": name}, PERFECT if like is None else preset(like))


def read_sensor(table: Mapping[str, Any], like: SensorPrior) -> SensorPrior:
    """A sensor with what a table gives in place of the parameters of another; "none" leaves its magnetometer out.

    Raises `SimulationError` for the first parameter that is unknown or cannot be.
    """
    return _Table.read({"sensor": _update_nested(asdict(like), table)}).sensor


def _update_nested(base: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    changed = dict(base)
    for key, value in given.items():
        of = asdict(MagnetometerPrior()) if key == "mag" and base.get(key) is None else base.get(key)
        if isinstance(value, Mapping) and isinstance(of, Mapping):
            changed[key] = _update_nested(of, value)
        else:
            changed[key] = None if value == "none" else value
    return changed
