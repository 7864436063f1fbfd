"""What holds between footfalls of two feet, for whoever watches: keys as of one foot (`outlets`).

The place of the moment is that of the newest step, which its line has: `position_m` and `heading_deg` are null.
`standing` is whether both feet stand, `floor` and `returns` are the left foot's, and rate and losses those of both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fg_nav.online.estimates import DIGITS
from fg_nav.online.feet import FeetNavigator
from fg_nav.online.outlets import StatusReporter, list_ends


class FeetStatus(StatusReporter):
    """Measures while two sources are followed, and reports to a watcher."""

    def report_feet(self, feet: FeetNavigator, lost: Mapping[str, int], ended: bool = False) -> None:
        """Send the status."""
        self.report(lambda: _describe(feet), lost, ended)


def _describe(feet: FeetNavigator) -> dict[str, Any]:
    navigators, t = feet.navigators, feet.last_stamp
    return {
        "t": round(t, DIGITS) if np.isfinite(t) else None,
        "standing": all(one.stands for one in navigators.values()),
        "position_m": None,
        "heading_deg": None,
        "floor": navigators["left"].floor,
        "returns": [list_ends(one) for one in navigators["left"].returns],
    }
