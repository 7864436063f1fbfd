"""Orientation and gyro bias of a sensor in a trouser pocket, by a graph over all of a recording.

    nodes      every half second: attitude, gyro bias, the local field, and that of the region           (graph_chain)
    links      the gyroscope, preintegrated with its derivative by the bias; the field's means           (graph_links)
    up         a sensor that is worn does not run away; one that rests has no rate and no velocity      (graph_motion)
    field      one local vector from node to node, that keeps still, or steps where there is iron        (graph_field)

The paper compares each field with the last one. The noise of a difference does not grow with the time that the bias had
to turn it, so that nearly all is thrown away. Here a field is compared with all that has been seen of it: with a noise
of s uT a sample, n samples a second and a field of H uT across, the bias is known after T seconds to

    s / H sqrt(12 / (n T^3))                                          (least squares of a straight line)

and by turning of body and walk so are those about all axes, as far as the gyroscope's own noise lets it. Where a field
points is nobody's to know, for iron may be about. But that of the region is one, and what it is on the mean keeps the
heading, relative to that at the start.

Each round linearises all of the graph anew, weighs the robust factors anew, and solves exactly. The first estimate is
what the online estimator would have had: by the gyroscope alone, 0.1 deg/s are a full turn in an hour.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fg_nav.errors import EstimationError
from fg_nav.pocket.graph_chain import BIAS, Nodes, Solved
from fg_nav.pocket.graph_field import walk_of_strength
from fg_nav.pocket.graph_links import Links, links_between, node_samples
from fg_nav.pocket.graph_motion import rests_of
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.graph_solution import beliefs_of, factors_of, prior_of, reweighed, solve_round
from fg_nav.pocket.graph_track import smoothed_track
from fg_nav.pocket.graph_window import from_the_past
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.pocket.start import PocketStart, level_start
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording


def smooth_pocket(
    recording: Recording,
    parameters: PocketGraphParameters = PocketGraphParameters(),
    start: PocketStart | None = None,
    progress: Callable[[float], None] | None = None,
) -> PocketTrack:
    """Estimate orientation and gyro bias of a sensor in a trouser pocket from all of a recording.

    Parameters
    ----------
    recording : Recording
        Without a magnetometer, or where it has no samples, the gyroscope and gravity go on alone.
    parameters : PocketGraphParameters
        What is believed of sensor, leg and field.
    start : PocketStart
        Attitude at the first sample; level with heading 0 if None.
    progress : callable
        Told the share that is done.

    Returns
    -------
    PocketTrack
        Both NIS are of two degrees of freedom, by what came before a node; a field's, of three, is scaled to that.

    Raises
    ------
    EstimationError
        Where it cannot be levelled, or the solution diverges to infinity.
    """
    begun = level_start(recording, PocketParameters(gravity=parameters.gravity)) if start is None else start
    node = node_samples(recording.t, parameters.node_s)
    acc, gyr = recording.integrable
    links = links_between(node, recording.t, acc, gyr, recording.mag, np.zeros(3))
    nodes, solved = solve_links(links, begun, parameters, progress)
    return smoothed_track(recording, node, nodes, solved)


def solve_links(
    links: Links, start: PocketStart, p: PocketGraphParameters, progress: Callable[[float], None] | None = None
) -> tuple[Nodes, Solved]:
    """Solve the graph of all links; the nodes, and the last round's linear solution about those before it."""
    beliefs, prior = beliefs_of(p, links.bias), prior_of(start, links, p)
    nodes, weighed = from_the_past(links, start, p)
    walk, rests = walk_of_strength(links, p), rests_of(links, p)
    for done in range(p.iterations):
        nodes, solved = solve_round(prior, nodes, links, beliefs, factors_of(links, p, weighed, rests))
        change = float(np.degrees(np.abs(solved.x[:, BIAS : BIAS + 3]).max()))
        if not np.isfinite(change):
            raise EstimationError("the graph of the pocket diverged to infinity: check the samples of the recording.")
        weighed = reweighed(walk, links, solved, p)
        if progress is not None:
            progress((done + 1) / p.iterations)
        if change < p.enough_deg_s:
            break
    return nodes, solved
