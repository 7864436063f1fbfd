"""A plan of the building under the paths of a live page: a picture, laid by two of its points.

With a pixel (px, py), py downward, as w = px - i py, and its place (x, y) m as z = x + i y, the two points give the
similarity z = a w + b: one scale and one turn, no reflection.
"""

from __future__ import annotations

import mimetypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fg_nav.errors import StreamError


@dataclass(frozen=True)
class Plan:
    """A picture of this media `type` in a file; `origin` m of its upper left corner, `right` m of a pixel to the right.

    Both are complex, east + i north; a pixel down is -i `right`.
    """

    path: Path
    type: str
    origin: complex
    right: complex

    @classmethod
    def read(cls, path: Path | None, points: str | None, is_shown: bool = True) -> Plan | None:
        """Return the plan of "px,py=x,y px,py=x,y", pixels and m; None for neither; raises `StreamError`."""
        if path is None and points is None:
            return None
        if not is_shown:
            raise StreamError("a plan is for the page: add --view, or leave --plan and --plan-points out.")
        if path is None or points is None:
            missing = "--plan PICTURE" if path is None else "--plan-points PX,PY=X,Y PX,PY=X,Y"
            raise StreamError(f"a plan is laid by two points whose places are known: add {missing}.")
        try:
            pairs = [[[float(n) for n in side.split(",")] for side in pair.split("=")] for pair in points.split()]
            (w1, z1), (w2, z2) = [(complex(px, -py), complex(x, y)) for (px, py), (x, y) in pairs]
            right = (z2 - z1) / (w2 - w1)
            if not 0.0 < abs(right) < float("inf"):
                raise ValueError
        except (ValueError, ZeroDivisionError):
            raise StreamError(
                f"--plan-points {points} lay no plan: give two pixels apart from each other with their places in m "
                'east and north of the start, as "120,80=0,0 940,80=41.5,0".'
            ) from None
        kind = mimetypes.guess_type(path.name)[0] or ""
        if not (kind.startswith("image/") and path.is_file()):
            raise StreamError(f"{path} is no picture of a plan: name a PNG, JPEG or WebP.")
        return cls(path, kind, z1 - right * w1, right)

    def describe(self) -> dict[str, Any]:
        """Return what a page is sent of it."""
        places = {"origin_m": self.origin, "right_m": self.right, "down_m": -1j * self.right}
        return {"kind": "plan", **{name: [place.real, place.imag] for name, place in places.items()}}
