"""What the smoother believes of people and buildings: nothing, unless asked to."""

from __future__ import annotations

from dataclasses import dataclass, field

from fg_nav.factors.floor_height import FloorParameters
from fg_nav.factors.straight_walk import StraightParameters


@dataclass(frozen=True)
class WalkParameters:
    """Ties between footfalls (`walk_ties`), and what is needed to use fixes (`walk_fixes`)."""

    straight: bool = False
    """People mostly walk straight on. Off: a corridor that bends by less than a degree over ten strides is believed to
    be straight, and nothing in the recording can tell."""
    straight_walk: StraightParameters = field(default_factory=StraightParameters)
    straight_within_m: float = 0.15
    """Off the line between its ends within which a stretch may be straight: two sigmas of weaving by 7 cm."""

    floors: bool = False
    """All footfalls on one floor are at one height. Off: a ramp looks like drift, and is made level."""
    floor_sigma_m: float = 0.02
    """Height of the sensor in a stance above its floor: mats, thresholds, and how the foot is set down, a centimetre
    each."""
    floor: FloorParameters = field(default_factory=FloorParameters)
    """What is a step, and what is another floor."""

    told_heading_deg: float = 5.0
    """Sigma of the heading at the start that was told, where fixes tell it as well: a compass held by hand, or a line
    on a plan. Fixes tell it once they leave less doubt than this."""
    fix_reach_s: float = 1.5
    """Farther than a stride from any node there is nothing to tie a fix to."""
    fix_speed_m_s: float = 1.4
    """Walking pace: for so much a second between a fix and the node it is tied to its sigma grows."""
