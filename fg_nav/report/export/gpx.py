"""GPX 1.1: one track with a point a footfall, so that speed is that of the person and not of the swinging foot.

`ele` is the height of the origin, where it is known, and what was climbed since; `time` is there where it is known. The
horizontal sigmas stand in the extensions of a point.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml

from fg_nav.report.export.place import DEGREE_DIGITS, METER_DIGITS, Origin
from fg_nav.report.export.track import FRAME, POSITION, SIGMA, Track

NAMESPACE = "http://www.topografix.com/GPX/1/1"
SIGMA_NAMESPACE = "urn:fg-nav:strides"  # Of the sigmas: a name, not an address.


def write(track: Track, path: Path, origin: Origin) -> None:
    """Write a track as a map."""
    root = Xml.Element("gpx", {"xmlns": NAMESPACE, "xmlns:fg": SIGMA_NAMESPACE, "version": "1.1", "creator": "fg-nav"})
    line = Xml.SubElement(root, "trk")
    for name, text in {"name": track.name, "cmt": FRAME, "src": f"fg-nav, {track.method}"}.items():
        Xml.SubElement(line, name).text = text
    segment = Xml.SubElement(line, "trkseg")
    table = track.footfalls
    times = track.tell_time(table["time_s"].to_numpy())
    sigmas = table[SIGMA].to_numpy().tolist()
    for k, (longitude, latitude, height) in enumerate(origin.locate(table[POSITION].to_numpy()).tolist()):
        at = {"lat": f"{latitude:.{DEGREE_DIGITS}f}", "lon": f"{longitude:.{DEGREE_DIGITS}f}"}
        point = Xml.SubElement(segment, "trkpt", at)
        Xml.SubElement(point, "ele").text = f"{height:.{METER_DIGITS}f}"
        if times is not None:
            Xml.SubElement(point, "time").text = times[k]
        extensions = Xml.SubElement(point, "extensions")
        for name, sigma in zip(SIGMA, sigmas[k], strict=True):
            if sigma == sigma:  # NaN is not known
                Xml.SubElement(extensions, f"fg:{name}").text = f"{sigma:.9g}"
    Xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
