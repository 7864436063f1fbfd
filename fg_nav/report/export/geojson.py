"""GeoJSON (RFC 7946): ellipses, path and footfalls, with colors that viewers of maps know (simplestyle).

Coordinates are longitude, latitude, height. `kind` tells the features apart: `ellipse`, `path`, `footfall`. Of a
footfall the properties are the columns of `strides.csv`; `time_s` is the recording's clock, `time_utc` stands beside it
where it is known.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

from fg_nav.report.export.ellipse import outline_ellipses
from fg_nav.report.export.place import Origin
from fg_nav.report.export.style import BLUE, FILL_OPACITY, LINE_WIDTH
from fg_nav.report.export.track import FRAME, POSITION, Track
from fg_nav.text import to_json


def write(track: Track, path: Path, origin: Origin) -> None:
    """Write a track as a map."""
    content = {
        "type": "FeatureCollection",
        "name": track.name,
        "description": FRAME,
        "features": _features(track, origin),
    }
    path.write_text(json.dumps(to_json(content), allow_nan=False), encoding="utf-8")


def _features(track: Track, origin: Origin) -> list[dict[str, object]]:
    """What is drawn first is below."""
    return [*_ellipses(track, origin), _path(track, origin), *_footfalls(track, origin)]


def _path(track: Track, origin: Origin) -> dict[str, object]:
    times = track.tell_time(track.t[[0, -1]])
    known = {} if times is None else {"start_utc": times[0], "end_utc": times[1]}
    style = {"stroke": BLUE, "stroke-width": LINE_WIDTH}
    properties = {"kind": "path", "name": track.name, "method": track.method, **known, **style}
    return _feature("LineString", origin.locate(track.position[track.line]).tolist(), properties)


def _footfalls(track: Track, origin: Origin) -> list[dict[str, object]]:
    table = track.footfalls
    places = origin.locate(table[POSITION].to_numpy()).tolist()
    times = track.tell_time(table["time_s"].to_numpy())
    features = []
    for k, row in enumerate(table.to_dict("records")):
        known: dict[Hashable, object] = {} if times is None else {"time_utc": times[k]}
        style = {"marker-size": "small", "marker-color": BLUE}
        features.append(_feature("Point", places[k], {"kind": "footfall", **row, **known, **style}))
    return features


def _ellipses(track: Track, origin: Origin) -> list[dict[str, object]]:
    found = outline_ellipses(track)
    style = {"stroke": BLUE, "stroke-width": 1, "stroke-opacity": 0.4, "fill": BLUE, "fill-opacity": FILL_OPACITY}
    features = []
    for k, corner in zip(found.row, found.corner, strict=True):
        properties = {"kind": "ellipse", "index": int(k), "share": 0.95, **style}
        features.append(_feature("Polygon", [origin.locate(corner).tolist()], properties))
    return features


def _feature(kind: str, coordinates: object, properties: Mapping[Any, object]) -> dict[str, object]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
