"""Pictures for tests of what is not in them: coarse, and without a layout, which takes most of a picture's time."""

from typing import Any

import pytest
from matplotlib.figure import Figure

from fg_nav.report.plots import style


def sketch_pictures(patch: pytest.MonkeyPatch) -> None:
    """Draw all that is drawn, but in few pixels; how pictures look is tested in `tests.report`."""
    patch.setattr(style, "DPI", 20)
    patch.setattr(style, "Figure", _without_layout)


def _without_layout(**arguments: Any) -> Figure:
    return Figure(**{**arguments, "layout": None})
