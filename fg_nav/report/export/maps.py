"""Maps: GeoJSON (RFC 7946), KML 2.2 and GPX 1.1 (docs/export.md).

Coordinates are longitude, latitude, height; colours in GeoJSON those that viewers of maps know (simplestyle). Styles of
KML stand with each feature, as not all programs follow references to shared ones. GPX has a point a footfall, so that
speed is that of the person, not of the swinging foot.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.report.charts import Ellipses, spread_rows
from fg_nav.report.export.track import DEGREE_DIGITS, FRAME, METER_DIGITS, POSITION, SIGMA, ExportTrack, Origin
from fg_nav.text import to_json

MAX_ELLIPSES = 200  # More of them hide each other on any map.
CORNERS = 33  # Of an outline, the first again as the last: within half a percent of the ellipse.
BLUE, LINE_WIDTH, FILL_OPACITY = "#0072b2", 3, 0.08  # The blue of the pictures.

KML = "http://www.opengis.net/kml/2.2"
DOT = "http://maps.google.com/mapfiles/kml/shapes/shaded_dot.png"
DOT_SCALE = 0.3

GPX = "http://www.topografix.com/GPX/1/1"
SIGMA_NAMESPACE = "urn:fg-nav:strides"  # A name, not an address.


def outline_ellipses(track: ExportTrack) -> tuple[Ints, Floats]:
    """Return footfalls (E,) evenly spread along the path, of those with a covariance, and their 95 % ellipses.

    These are closed outlines (E, CORNERS, 3) m, counter-clockwise.
    """
    cov = track.cov[:, :2, :2]
    claimed = np.flatnonzero(np.isfinite(cov).all(axis=(1, 2)))
    row = claimed[spread_rows(len(claimed), MAX_ELLIPSES)]
    place = track.footfalls[POSITION].to_numpy()[row]
    corner = np.repeat(place[:, None, :], CORNERS, axis=1)
    corner[:, :, :2] = Ellipses.of(place[:, :2], cov[row]).outline(CORNERS)
    return row, corner


def write_geojson(track: ExportTrack, path: Path, origin: Origin) -> None:
    """Write a track as GeoJSON, the features drawn first below the others."""

    def feature(kind: str, coordinates: object, properties: Mapping[Any, object]) -> dict[str, object]:
        return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}

    # ellipses
    features = []
    style: dict[str, object] = {
        "stroke": BLUE, "stroke-width": 1, "stroke-opacity": 0.4, "fill": BLUE, "fill-opacity": FILL_OPACITY,
    }  # fmt: skip
    for k, corner in zip(*outline_ellipses(track), strict=True):
        properties = {"kind": "ellipse", "index": int(k), "share": 0.95, **style}
        features.append(feature("Polygon", [origin.locate(corner).tolist()], properties))

    # path
    times = track.format_utc(track.t[[0, -1]])
    known: dict[Hashable, object] = {} if times is None else {"start_utc": times[0], "end_utc": times[1]}
    about = {"kind": "path", "name": track.name, "method": track.method}
    line = origin.locate(track.position[track.line]).tolist()
    features.append(feature("LineString", line, {**about, **known, "stroke": BLUE, "stroke-width": LINE_WIDTH}))

    # footfalls
    table = track.footfalls
    places = origin.locate(table[POSITION].to_numpy()).tolist()
    times = track.format_utc(table["time_s"].to_numpy())
    for k, row in enumerate(table.to_dict("records")):
        known = {} if times is None else {"time_utc": times[k]}
        mark = {"marker-size": "small", "marker-color": BLUE}
        features.append(feature("Point", places[k], {"kind": "footfall", **row, **known, **mark}))

    content = {"type": "FeatureCollection", "name": track.name, "description": FRAME, "features": features}
    path.write_text(json.dumps(to_json(content), allow_nan=False), encoding="utf-8")


def write_gpx(track: ExportTrack, path: Path, origin: Origin) -> None:
    """Write a track as GPX."""
    root = Xml.Element("gpx", {"xmlns": GPX, "xmlns:fg": SIGMA_NAMESPACE, "version": "1.1", "creator": "fg-nav"})
    line = Xml.SubElement(root, "trk")
    _add_texts(line, name=track.name, cmt=FRAME, src=f"fg-nav, {track.method}")
    segment = Xml.SubElement(line, "trkseg")
    table = track.footfalls
    times = track.format_utc(table["time_s"].to_numpy())
    sigmas = table[SIGMA].to_numpy().tolist()
    for k, (longitude, latitude, height) in enumerate(origin.locate(table[POSITION].to_numpy()).tolist()):
        at = {"lat": f"{latitude:.{DEGREE_DIGITS}f}", "lon": f"{longitude:.{DEGREE_DIGITS}f}"}
        point = Xml.SubElement(segment, "trkpt", at)
        _add_texts(point, ele=f"{height:.{METER_DIGITS}f}")
        if times is not None:
            _add_texts(point, time=times[k])
        known = {name: sigma for name, sigma in zip(SIGMA, sigmas[k], strict=True) if sigma == sigma}  # not NaN
        _add_texts(Xml.SubElement(point, "extensions"), **{f"fg:{name}": f"{one:.9g}" for name, one in known.items()})
    Xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def write_kml(track: ExportTrack, path: Path, origin: Origin) -> None:
    """Write a track as KML."""
    root = Xml.Element("kml", xmlns=KML)
    document = Xml.SubElement(root, "Document")
    _add_texts(document, name=track.name, description=FRAME)
    schema = Xml.SubElement(document, "Schema", id="strides", name="strides")
    for name, kind in track.footfalls.dtypes.items():
        of_kind = {"i": "int", "f": "double"}.get(kind.kind, "string")
        Xml.SubElement(schema, "SimpleField", type=of_kind, name=str(name))

    def folder(name: str) -> Xml.Element:
        made = Xml.SubElement(document, "Folder")
        _add_texts(made, name=name)
        return made

    # ellipses
    style, part = _style_line(0.4, 1, FILL_OPACITY), folder("ellipses")
    for k, corner in zip(*outline_ellipses(track), strict=True):
        placemark = _add_placemark(part, f"95 % at footfall {k}")
        placemark.append(style)
        ring = Xml.SubElement(_add_shape(placemark, "Polygon", origin), "outerBoundaryIs")
        _add_texts(Xml.SubElement(ring, "LinearRing"), coordinates=_format_places(origin.locate(corner)))

    # path
    placemark = _add_placemark(folder("path"), f"{track.name} by {track.method}")
    times = track.format_utc(track.t[[0, -1]])
    if times is not None:
        _add_texts(Xml.SubElement(placemark, "TimeSpan"), begin=times[0], end=times[1])
    placemark.append(_style_line(1.0, LINE_WIDTH))
    line = _format_places(origin.locate(track.position[track.line]))
    _add_texts(_add_shape(placemark, "LineString", origin), coordinates=line)

    # footfalls
    style = Xml.Element("Style")
    icon = Xml.SubElement(style, "IconStyle")
    _add_texts(icon, color=_format_color(1.0), scale=str(DOT_SCALE))
    _add_texts(Xml.SubElement(icon, "Icon"), href=DOT)
    _add_texts(Xml.SubElement(style, "LabelStyle"), scale="0")
    table, part = track.footfalls, folder("footfalls")
    places, times = origin.locate(table[POSITION].to_numpy()), track.format_utc(table["time_s"].to_numpy())
    for k, row in enumerate(table.to_dict("records")):
        placemark = _add_placemark(part, str(row["index"]))
        if times is not None:
            _add_texts(Xml.SubElement(placemark, "TimeStamp"), when=times[k])
        placemark.append(style)
        data = Xml.SubElement(Xml.SubElement(placemark, "ExtendedData"), "SchemaData", schemaUrl="#strides")
        for name, value in row.items():
            if value == value:  # NaN is unknown, and left out
                Xml.SubElement(data, "SimpleData", name=str(name)).text = str(value)
        _add_texts(_add_shape(placemark, "Point", origin), coordinates=_format_places(places[k]))
    Xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _add_texts(parent: Xml.Element, **texts: str) -> None:
    for name, text in texts.items():
        Xml.SubElement(parent, name).text = text


def _add_placemark(folder: Xml.Element, name: str) -> Xml.Element:
    placemark = Xml.SubElement(folder, "Placemark")
    _add_texts(placemark, name=name)
    return placemark


def _add_shape(parent: Xml.Element, kind: str, origin: Origin) -> Xml.Element:
    shape = Xml.SubElement(parent, kind)
    if kind == "LineString" and origin.height_m is None:
        _add_texts(shape, tessellate="1")
    _add_texts(shape, altitudeMode="clampToGround" if origin.height_m is None else "absolute")
    return shape


def _format_color(opacity: float) -> str:
    """The blue in the order of KML: opacity, blue, green, red."""
    red, green, blue = BLUE[1:3], BLUE[3:5], BLUE[5:7]
    return f"{round(255 * opacity):02x}{blue}{green}{red}"


def _style_line(opacity: float, width: int, fill_opacity: float | None = None) -> Xml.Element:
    style = Xml.Element("Style")
    _add_texts(Xml.SubElement(style, "LineStyle"), color=_format_color(opacity), width=str(width))
    if fill_opacity is not None:
        _add_texts(Xml.SubElement(style, "PolyStyle"), color=_format_color(fill_opacity))
    return style


def _format_places(place: Floats) -> str:
    number = f"{{:.{DEGREE_DIGITS}f}},{{:.{DEGREE_DIGITS}f}},{{:.{METER_DIGITS}f}}"
    return " ".join(number.format(*row) for row in np.atleast_2d(place).tolist())
