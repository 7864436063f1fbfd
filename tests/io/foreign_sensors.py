"""Small files as the tools of sensor makers write them, from one recording: what is read is held against it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fg_nav.recording import RawRecording

_MT_LINES = (
    "// General information: ",
    "//  MT Manager version: 2022.2.0 ",
    "// Device information: ",
    "//  DeviceId: 00B42D4B",
    "//  Update Rate: {rate:.1f}Hz",
    "// Coordinate system: ENU",
)


def write_xsens_mt(raw: RawRecording, path: Path, separator: str = "\t", fine: bool = False, **_: object) -> None:
    """With empty columns of time and a counter that begins again; packet 7 is lost."""
    names = ["PacketCounter", "SampleTimeFine", "Year", *_axes("Acc"), *_axes("Gyr"), *_axes("Mag")]
    lines = [line.format(rate=_rate(raw)) for line in _MT_LINES] + [separator.join(names)]
    for k in range(len(raw.t)):
        stamp = str(round(864_000_000 - 100 + raw.t[k] * 1e4) % 864_000_000) if fine else ""
        fields = [f"{(65500 + k) % 65536:05d}", stamp, ""]
        fields += [f"{value:.6f}" for value in (*raw.acc[k], *raw.gyr[k], *raw.mag[k] / 48.0)]
        if k != 7:
            lines.append(separator.join(fields))
    path.write_text("\n".join(lines) + "\n")


def _axes(name: str, pattern: str = "{}_{}") -> list[str]:
    return [pattern.format(name, axis) for axis in "XYZ"]


def _rate(raw: RawRecording) -> float:
    return float(1.0 / np.median(np.diff(raw.t)))
