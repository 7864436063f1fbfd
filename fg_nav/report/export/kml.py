"""KML 2.2: folders `path`, `footfalls` and `ellipses`, with their looks, for Google Earth and QGIS.

Data of footfalls are the columns of `strides.csv`, typed by a schema. Looks stand with each feature: not all programs
follow references to shared ones. Heights count only where that of the origin is known: all else lies on the ground.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.report.export.ellipse import outline_ellipses
from fg_nav.report.export.place import DEGREE_DIGITS, METER_DIGITS, Origin
from fg_nav.report.export.style import BLUE, FILL_OPACITY, LINE_WIDTH
from fg_nav.report.export.track import FRAME, POSITION, Track

NAMESPACE = "http://www.opengis.net/kml/2.2"
DOT = "http://maps.google.com/mapfiles/kml/shapes/shaded_dot.png"
DOT_SCALE = 0.3


def write(track: Track, path: Path, origin: Origin) -> None:
    """Write a track as a map."""
    root = Xml.Element("kml", xmlns=NAMESPACE)
    document = Xml.SubElement(root, "Document")
    _tell(document, name=track.name, description=FRAME)
    _add_schema(document, track)
    _add_ellipses(_add_folder(document, "ellipses"), track, origin)
    _add_path(_add_folder(document, "path"), track, origin)
    _add_footfalls(_add_folder(document, "footfalls"), track, origin)
    Xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _tell(parent: Xml.Element, **texts: str) -> None:
    for name, text in texts.items():
        Xml.SubElement(parent, name).text = text


def _add_folder(document: Xml.Element, name: str) -> Xml.Element:
    folder = Xml.SubElement(document, "Folder")
    _tell(folder, name=name)
    return folder


def _color(opacity: float) -> str:
    """The blue as KML has it: opacity, blue, green, red."""
    red, green, blue = BLUE[1:3], BLUE[3:5], BLUE[5:7]
    return f"{round(255 * opacity):02x}{blue}{green}{red}"


def _style_line(opacity: float, width: int, fill_opacity: float | None = None) -> Xml.Element:
    style = Xml.Element("Style")
    _tell(Xml.SubElement(style, "LineStyle"), color=_color(opacity), width=str(width))
    if fill_opacity is not None:
        _tell(Xml.SubElement(style, "PolyStyle"), color=_color(fill_opacity))
    return style


def _style_dot() -> Xml.Element:
    style = Xml.Element("Style")
    icon = Xml.SubElement(style, "IconStyle")
    _tell(icon, color=_color(1.0), scale=str(DOT_SCALE))
    _tell(Xml.SubElement(icon, "Icon"), href=DOT)
    _tell(Xml.SubElement(style, "LabelStyle"), scale="0")
    return style


def _add_schema(document: Xml.Element, track: Track) -> None:
    schema = Xml.SubElement(document, "Schema", id="strides", name="strides")
    for name, kind in track.footfalls.dtypes.items():
        of_kind = {"i": "int", "f": "double"}.get(kind.kind, "string")
        Xml.SubElement(schema, "SimpleField", type=of_kind, name=str(name))


def _place(folder: Xml.Element, name: str) -> Xml.Element:
    placemark = Xml.SubElement(folder, "Placemark")
    _tell(placemark, name=name)
    return placemark


def _shape(parent: Xml.Element, kind: str, origin: Origin) -> Xml.Element:
    shape = Xml.SubElement(parent, kind)
    if kind == "LineString" and origin.height_m is None:
        _tell(shape, tessellate="1")
    _tell(shape, altitudeMode="clampToGround" if origin.height_m is None else "absolute")
    return shape


def _tell_places(place: Floats) -> str:
    number = f"{{:.{DEGREE_DIGITS}f}},{{:.{DEGREE_DIGITS}f}},{{:.{METER_DIGITS}f}}"
    return " ".join(number.format(*row) for row in np.atleast_2d(place).tolist())


def _add_path(folder: Xml.Element, track: Track, origin: Origin) -> None:
    placemark = _place(folder, f"{track.name} by {track.method}")
    times = track.tell_time(track.t[[0, -1]])
    if times is not None:
        _tell(Xml.SubElement(placemark, "TimeSpan"), begin=times[0], end=times[1])
    placemark.append(_style_line(1.0, LINE_WIDTH))
    shape = _shape(placemark, "LineString", origin)
    _tell(shape, coordinates=_tell_places(origin.locate(track.position[track.line])))


def _add_footfalls(folder: Xml.Element, track: Track, origin: Origin) -> None:
    table = track.footfalls
    places = origin.locate(table[POSITION].to_numpy())
    times, style = track.tell_time(table["time_s"].to_numpy()), _style_dot()
    for k, row in enumerate(table.to_dict("records")):
        placemark = _place(folder, str(row["index"]))
        if times is not None:
            _tell(Xml.SubElement(placemark, "TimeStamp"), when=times[k])
        placemark.append(style)
        data = Xml.SubElement(Xml.SubElement(placemark, "ExtendedData"), "SchemaData", schemaUrl="#strides")
        for name, value in row.items():
            if value == value:  # NaN is not known, and is left out
                Xml.SubElement(data, "SimpleData", name=str(name)).text = str(value)
        _tell(_shape(placemark, "Point", origin), coordinates=_tell_places(places[k]))


def _add_ellipses(folder: Xml.Element, track: Track, origin: Origin) -> None:
    found, style = outline_ellipses(track), _style_line(0.4, 1, FILL_OPACITY)
    for k, corner in zip(found.row, found.corner, strict=True):
        placemark = _place(folder, f"95 % at footfall {k}")
        placemark.append(style)
        ring = Xml.SubElement(_shape(placemark, "Polygon", origin), "outerBoundaryIs")
        _tell(Xml.SubElement(ring, "LinearRing"), coordinates=_tell_places(origin.locate(corner)))
