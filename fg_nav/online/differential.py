"""The differential field of a walk in progress: what its stances show of each bias variable, one after the other.

Noise, variogram, iron and the number of bias variables that share the limit are those of the last re-solve. The
stances of a bias variable are added up until its ten seconds are over; then its factor joins the graph. What a re-solve
has put there of it is taken off first:

    in the graph:  F(L0),    to add:  F(L) - F(L0),    F(L) = (L^-1 + s^2 I)^-1,

which is never negative, as F grows with L. So the graph has the same factor in the end as a batch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B

from fg_nav.arrays import Floats
from fg_nav.detection import Rest
from fg_nav.factors.differential_field import BiasInformation, FieldNoise
from fg_nav.factors.residual import linear_factor_of
from fg_nav.online.strides import StrideWindow
from fg_nav.smoother.dense_path import Trajectory
from fg_nav.smoother.differential import (
    DifferentialFactors,
    LevelBias,
    find_stretches,
    limit_information,
    measure_stretches,
    sum_stretches,
    turn_stretches,
)

NOTHING = BiasInformation(np.zeros((6, 6)), np.zeros(6))
NOTHING_OF_BIAS = BiasInformation(np.zeros((3, 3)), np.zeros(3))


@dataclass(frozen=True)
class BiasLedger:
    """What the stances and the standings of the newest bias variable show, and what the graph has of it."""

    noise: FieldNoise
    variables: int
    stances: BiasInformation = NOTHING
    standings: BiasInformation = NOTHING
    in_graph: BiasInformation = NOTHING_OF_BIAS

    @classmethod
    def from_factors(cls, factors: DifferentialFactors | None) -> BiasLedger | None:
        """Return the ledger of a walk with these factors, all of them in its graph; None without."""
        if factors is None:
            return None
        stances, standings, limited = (
            BiasInformation(one.matrix[-1], one.vector[-1])
            for one in (factors.stances.information, factors.standings.information, factors.information)
        )
        return cls(factors.noise, len(factors.stances.count), stances, standings, limited)

    def begin(self) -> BiasLedger:
        """Return the ledger of a new variable, or of one whose graph begins again."""
        return BiasLedger(self.noise, self.variables)

    def complete(self, variable: int, known: LevelBias) -> gtsam.NonlinearFactor:
        """Return the factor that the graph lacks of the variable, whose present estimate is `known`."""
        limited = limit_information(self.stances, self.standings, self.noise.iron, self.variables)
        further = known.weaken(limited - self.in_graph)
        return linear_factor_of(further.residual(), [B(variable)])

    def add(
        self,
        window: StrideWindow,
        track: Trajectory,
        gyro_bias: Floats,
        counted: Rest | None,
    ) -> BiasLedger:
        """Add what the newest footfall shows.

        Parameters
        ----------
        window, track : of its stride, and the path at its samples.
        gyro_bias : (3,) rad/s, to linearize at.
        counted : the last rest of the walk, in samples of the walk.
        """
        recording, nodes, first = window.recording, window.nodes, window.first_sample
        if recording.mag is None:
            return self
        rests = () if counted is None else (replace(counted, start=counted.start - first, stop=counted.stop - first),)
        stretches = find_stretches(recording, nodes, rests)
        stretches = stretches.keep(stretches.stop > nodes.sample[nodes.first[1]])
        if len(stretches.start) == 0:
            return self
        bias = np.tile(gyro_bias, (len(stretches.start), 1))
        information, used = measure_stretches(turn_stretches(recording, stretches, track.position, bias), self.noise)
        stances, standings = (
            sum_stretches(information, np.zeros_like(stretches.bias), used & those, 1).information
            for those in (~stretches.is_standing, stretches.is_standing)
        )
        return replace(
            self,
            stances=self.stances + BiasInformation(stances.matrix[0], stances.vector[0]),
            standings=self.standings + BiasInformation(standings.matrix[0], standings.vector[0]),
        )
