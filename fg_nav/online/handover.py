"""What a walk so far leaves to whoever goes on with it: arrays, and no graph.

    batch solution of all footfalls      (`resolve`)  -> Handover
    a handover and the strides since it  (`stretch`)  -> Handover

It is of the newest footfall, whose variables are in its anchor. Estimates of the footfalls before are its past. All
that comes later follows from it and from the samples since, to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.online.anchor import MarginalPrior
from fg_nav.online.buffer import ReportedFootfall, SensorState
from fg_nav.online.differential import BiasLedger
from fg_nav.online.estimates import EstimateRow
from fg_nav.online.field import OnlineField, Verdict
from fg_nav.online.floor_number import FloorTrack
from fg_nav.online.strides import Place, RestLedger
from fg_nav.smoother.barometer import Barometer
from fg_nav.smoother.graph import Known
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.solution import Return
from fg_nav.truth import Fix


class PathNodes(NamedTuple):
    """Samples (M,) of the walk, and at each position (m), velocity (m/s), attitude, gyro (rad/s) and force bias."""

    sample: Ints
    position: Floats
    velocity: Floats
    nav_R_body: Floats
    gyro_bias: Floats
    acc_bias: Floats

    def cut(self, stop: int) -> PathNodes:
        """Return the nodes before one."""
        return PathNodes._make(part[:stop] for part in self)

    def join(self, later: PathNodes) -> PathNodes:
        """Return these nodes and those that follow."""
        return PathNodes._make(np.concatenate(both) for both in zip(self, later, strict=True))


NO_NODES = PathNodes(
    np.empty(0, dtype=np.int64),
    np.empty((0, 3)),
    np.empty((0, 3)),
    np.empty((0, 3, 3)),
    np.empty((0, 3)),
    np.empty((0, 3)),
)


@dataclass(frozen=True)
class Past:
    """Estimates of the footfalls from number `first` on: one row each, and the nodes of the path through them."""

    first: int = 0
    rows: tuple[EstimateRow, ...] = ()
    nodes: PathNodes = NO_NODES

    def before(self, place: Place) -> Past:
        """Return it without a footfall, and without those behind it."""
        stop = int(np.searchsorted(self.nodes.sample, place.samples[0]))
        return Past(self.first, self.rows[: place.number - self.first], self.nodes.cut(stop))

    def join(self, later: Past) -> Past:
        """Return it with what is known now of the footfalls from `later.first` on."""
        rows = self.rows[: later.first - self.first] + later.rows
        begins = later.nodes.sample[0] if len(later.nodes.sample) else np.iinfo(np.int64).max
        stop = int(np.searchsorted(self.nodes.sample, begins))
        return Past(self.first, rows, self.nodes.cut(stop).join(later.nodes))


@dataclass(frozen=True)
class Handover:
    """A walk up to its newest footfall.

    Attributes
    ----------
    place, verdict : of that footfall.
    anchor : what is known of its variables.
    past : of the footfalls before.
    footfalls : of the walk from number `first` on, as they are taken now.
    t_first : of the walk's first footfall, s.
    known, parameters : of sensor and walk, as they were estimated.
    field : to go on with; None where it is not used.
    barometer : noise and drift of the air's pressure; None where it is not used, or was not seen yet.
    rests, biases : what the graph has of the gyro bias.
    sensor : what the walk shows of it.
    counts : factors so far, by kind.
    fixes : of the walk, with those to come.
    floors : those of the building so far, and on which the footfall is.
    heading_known : whether the heading at the start was given, or fixes show it.
    returns : stretches at which the walk was before.
    notes : for the user.
    """

    place: Place
    verdict: Verdict
    anchor: MarginalPrior
    past: Past
    first: int
    footfalls: tuple[ReportedFootfall, ...]
    t_first: float
    known: Known
    parameters: SmootherParameters
    field: OnlineField | None
    barometer: Barometer | None
    rests: RestLedger
    biases: BiasLedger | None
    sensor: SensorState
    counts: dict[str, int]
    fixes: tuple[Fix, ...]
    floors: FloorTrack
    heading_known: bool
    returns: tuple[Return, ...]
    notes: tuple[str, ...]

    def forget_past(self) -> Handover:
        """Return it without its past, and of the footfalls the newest: all that the strides since depend on."""
        newest = self.place.number
        return replace(self, past=Past(newest), first=newest, footfalls=self.footfalls[newest - self.first :])


@dataclass(frozen=True)
class TiedHandover(Handover):
    """That of a foot whose walk was solved with the other foot's, in the frame of both; `number` of that solution."""

    number: int = 0


def list_untold(before: Sequence[ReportedFootfall], after: Sequence[ReportedFootfall]) -> list[ReportedFootfall]:
    """Return the footfalls that had a line and are none any more."""
    kept = {one.told for one in after}
    return [one for one in before if one.told >= 0 and one.told not in kept]


def window_anchors(
    earlier: Sequence[Handover],
    newest: Handover,
    footfalls: Sequence[ReportedFootfall],
    lag_s: float | None,
    window: int,
) -> list[Handover]:
    """Return the handovers that a window of footfalls, or of a lag, may begin at: from the newest old enough on.

    One behind a footfall that was taken back, or put in, holds what is not so.
    """
    valid = [one for one in earlier if _has_footfall(footfalls, one.place)]
    starts, place = [*valid, newest.forget_past()], newest.place
    if lag_s is None:
        enough = sum(place.number - one.place.number >= window for one in starts)
    else:
        enough = sum(place.t - one.place.t >= lag_s for one in starts)
    return starts[max(enough - 1, 0) :]


def _has_footfall(footfalls: Sequence[ReportedFootfall], place: Place) -> bool:
    return any(one.footfall.stillest == place.sample for one in footfalls[place.number : place.number + 1])
