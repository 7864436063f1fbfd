"""What a walk of two feet reports: lines of each foot, of the person between them, and of a foot that is lost.

A line of a foot is that of a walk of one (`estimates`) with two keys more:

========= ==========================================================================================================
foot      "left", "right" or "person"
frame     in which its positions are: "left", that of both; of the right foot "right", one of its own, until the steps
          show how the feet lie, which its next `turned` and `revised` lines put right
========= ==========================================================================================================

A person has `now` lines, one a step, and `revised`. A line of kind "foot" comes once when one is lost or is back: its
`state` is "silent", "back", "refused" or "parted" (its clock is not the other's any more); `reason` says it in words.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.feet import Side
from fg_nav.online.estimates import DIGITS, Revision, StanceEstimate, format_estimate, format_revision
from fg_nav.text import to_json

Who: TypeAlias = Literal["left", "right", "person"]
State: TypeAlias = Literal["silent", "back", "refused", "parted"]


@dataclass(frozen=True)
class PersonEstimate:
    """The middle of both feet when both stood, between two footfalls.

    Attributes
    ----------
    number : of the step, from 0. t : s, halfway between the footfalls.
    position : (3,) m. heading : rad clockwise from north, in which the person moved; None before that.
    pose_cov : (4, 4) of east, north, up (m) and yaw (rad): the mean of both feet's, which the covariance of the mean of
        two errors does not exceed, however they are correlated.
    """

    number: int
    t: float
    position: Floats
    heading: float | None
    pose_cov: Floats


@dataclass(frozen=True)
class FootState:
    """A foot that is lost, or back, at a time, s."""

    t: float
    state: State
    reason: str


@dataclass(frozen=True)
class FeetLine:
    """What is reported of a foot or of the person; `frame` in which it is, `continues` of an estimate of a foot."""

    foot: Who
    frame: Side
    content: StanceEstimate | Revision | PersonEstimate | FootState
    continues: bool = False


def format_feet_line(line: FeetLine) -> Iterator[str]:
    """Yield the lines of JSON."""
    match line.content:
        case StanceEstimate() as estimate:
            lines = iter([format_estimate(estimate, line.continues)])
        case Revision() as revision:
            lines = format_revision(revision)
        case PersonEstimate() as person:
            sigma = np.sqrt(np.diagonal(person.pose_cov))
            heading = None if person.heading is None else round(float(np.degrees(person.heading) % 360.0), DIGITS)
            content = {
                "kind": "now",
                "stance": person.number,
                "continues": False,
                "t": round(person.t, 9),
                "position_m": np.round(person.position, DIGITS),
                "heading_deg": heading,
                "position_sigma_m": np.round(sigma[:3], DIGITS),
                "east_north_cov_m2": round(float(person.pose_cov[0, 1]), 2 * DIGITS),
                "heading_sigma_deg": round(float(np.degrees(sigma[3])), DIGITS),
            }
            lines = iter([_dump(content)])
        case FootState() as state:
            content = {"kind": "foot", "t": round(state.t, 9), "state": state.state, "reason": state.reason}
            lines = iter([_dump(content)])
    yield from (tag_line(one, line.foot, line.frame) for one in lines)


def tag_line(line: str, foot: Who, frame: Side) -> str:
    """Return a line of JSON with whose it is, and in which frame."""
    content = json.loads(line)
    return _dump({"kind": content.pop("kind"), "foot": foot, "frame": frame, **content})


def _dump(content: dict[str, object]) -> str:
    return json.dumps(to_json(content), allow_nan=False)
