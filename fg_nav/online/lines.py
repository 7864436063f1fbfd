"""Estimates as JSON, one object a line; and a server of such lines.

========================= ======================================================================================
kind                      "now": as known when the footfall was complete; "smoothed": as known at the end
stance                    number of the row, from 0
continues                 of "now": a further piece of a long standing, no new footfall
t                         s, of its stillest sample
sensor_t                  s, the stamp that the sensor gave it, only where that is another: its clock was set on or back
position_m                [east, north, up]
heading_deg               of the body's x axis, clockwise from north, in [0, 360)
position_sigma_m          [east, north, up]
heading_sigma_deg
gyro_bias_deg_s           [x, y, z], body axes
gyro_bias_sigma_deg_s     [x, y, z]
field, field_reason       verdict on the magnetic field, in a word and in words
========================= ======================================================================================

Sigmas are one standard deviation. What is not finite is null.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import StreamError
from fg_nav.frames import compute_heading
from fg_nav.online.estimates import StanceEstimate
from fg_nav.solution import StanceTable
from fg_nav.text import to_json

SensorTime = Callable[[int, float], float]
"""The stamp, s, that the sensor gave a sample which was taken with this stamp (`SampleJudge.sensor_time`)."""

DIGITS = 6
"""After the point: a micrometre, a microdegree."""

SLOW_S = 0.2
"""A listener that does not take a line for so long is disconnected: the walk does not wait."""


def _same_time(sample: int, t: float) -> float:
    return t


def format_estimate(estimate: StanceEstimate, continues: bool, sensor_time: SensorTime = _same_time) -> str:
    """Return the line of an estimate of the moment."""
    return _format_line(
        "now",
        estimate.number,
        {"continues": continues},
        (estimate.t, sensor_time(estimate.sample, estimate.t)),
        estimate.position,
        np.degrees(estimate.heading),
        np.sqrt(np.diagonal(estimate.pose_cov)),
        estimate.gyro_bias,
        estimate.gyro_bias_sigma,
        (estimate.field, estimate.field_reason),
    )


def format_table(table: StanceTable, sensor_time: SensorTime = _same_time) -> Iterator[str]:
    """Yield the lines of the smoothed past."""
    heading = np.degrees(compute_heading(table.nav_R_body))
    for k in range(len(table)):
        yield _format_line(
            "smoothed",
            k,
            {},
            (float(table.t[k]), sensor_time(int(table.sample[k]), float(table.t[k]))),
            table.position[k],
            heading[k],
            np.append(table.position_sigma[k], table.heading_sigma[k]),
            table.gyro_bias[k],
            table.gyro_bias_sigma[k],
            (table.field[k], table.field_reason[k]),
        )


def _format_line(
    kind: str,
    number: int,
    more: dict[str, object],
    stamps: tuple[float, float],
    position: Floats,
    heading_deg: float,
    sigma: Floats,
    bias: Floats,
    bias_sigma: Floats,
    field: tuple[str, str],
) -> str:
    t, sensor_t = (round(stamp, 9) for stamp in stamps)
    content = {
        "kind": kind,
        "stance": number,
        **more,
        "t": t,
        **({} if sensor_t == t else {"sensor_t": sensor_t}),
        "position_m": np.round(position, DIGITS),
        "heading_deg": round(float(heading_deg % 360.0), DIGITS),
        "position_sigma_m": np.round(sigma[:3], DIGITS),
        "heading_sigma_deg": round(float(np.degrees(sigma[3])), DIGITS),
        "gyro_bias_deg_s": np.round(np.degrees(bias), DIGITS),
        "gyro_bias_sigma_deg_s": np.round(np.degrees(bias_sigma), DIGITS),
        "field": field[0],
        "field_reason": field[1],
    }
    return json.dumps(to_json(content), allow_nan=False)


class LineServer:
    """Serves lines on 127.0.0.1 at a port, to each listener from its connection on.

    `port` is the one it has; 0 asks for a free one.

    Raises
    ------
    StreamError
        If the port is taken.
    """

    def __init__(self, port: int) -> None:
        self._lock = threading.Lock()
        self._listeners: list[socket.socket] = []
        try:
            self._socket = socket.create_server(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            reason = (getattr(error, "strerror", None) or str(error)).lower()
            raise StreamError(f"port {port} cannot be served ({reason}): choose another --serve.") from None
        self.port = int(self._socket.getsockname()[1])
        threading.Thread(target=self._accept, daemon=True).start()

    def send(self, line: str) -> None:
        """Send a line to all listeners."""
        data = (line + "\n").encode()
        with self._lock:
            self._listeners = [listener for listener in self._listeners if _send(listener, data)]

    def close(self) -> None:
        """Disconnect all."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        with self._lock:
            for listener in self._listeners:
                listener.close()
            self._listeners = []

    def _accept(self) -> None:
        while True:
            try:
                listener, _ = self._socket.accept()
            except OSError:
                return
            listener.settimeout(SLOW_S)
            with self._lock:
                self._listeners.append(listener)


def _send(listener: socket.socket, data: bytes) -> bool:
    try:
        listener.sendall(data)
    except OSError:
        listener.close()
        return False
    return True
