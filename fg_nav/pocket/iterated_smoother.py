"""Orientation and gyro bias of a sensor in a trouser pocket: an iterated Kalman smoother over all of a recording.

    nodes      every half second: attitude, gyro bias, the local field, and that of the region       (kalman_smoother)
    links      the gyroscope, preintegrated with its derivative by the bias; the field's means       (links)
    up         a sensor that is worn does not run away; one that rests has no rate and no velocity   (robust_variances)
    field      one local vector from node to node, that holds still, or steps where there is iron    (robust_variances)

MD compares each field with the last one. The noise of a difference does not grow with the time over which the bias
turns it, so that nearly all information is lost. Here a field is compared with all measurements of it: with a noise of
s uT a sample, n samples a second and a field of H uT across, the bias is known after T seconds to

    s / H sqrt(12 / (n T^3))                                          (least squares of a straight line)

and, by turns of body and walk, so are the biases about all axes, as far as the gyroscope's own noise allows. The
direction of the field is not observable, for iron may be near. But that of the region is constant, and its mean keeps
the heading, relative to that at the start.

Each round linearizes all nodes again, recomputes the robust weights, and solves exactly. The first estimate is that of
the fixed-lag smoother: by the gyroscope alone, 0.1 deg/s are a full turn in an hour.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.factors.rotation import relative_rotations, rotation_exp, unskew
from fg_nav.pocket.fixed_lag import assemble_inputs, build_noise, build_prior, initialize_nodes, iterate_once
from fg_nav.pocket.kalman_smoother import BIAS, Nodes, Smoothed
from fg_nav.pocket.links import Links, detect_rests, place_nodes, preintegrate_links
from fg_nav.pocket.parameters import PocketSmootherParameters
from fg_nav.pocket.robust_variances import estimate_field_walk, reweigh_variances
from fg_nav.pocket.track import STORED_EVERY_S, PocketStart, PocketTrack, level_start
from fg_nav.recording import Recording

MAX_ROUNDS = 20  # Most rounds, each with new weights ...
ENOUGH_DEG_S = 1e-4  # ... which end when no bias moves by more, deg/s.


def smooth_pocket(
    recording: Recording,
    parameters: PocketSmootherParameters = PocketSmootherParameters(),
    start: PocketStart | None = None,
    progress: Callable[[float], None] | None = None,
) -> PocketTrack:
    """Estimate orientation and gyro bias of a sensor in a trouser pocket from all of a recording.

    Parameters
    ----------
    recording : Recording
        Without a magnetometer, or where it has no samples, the gyroscope and gravity are used alone.
    parameters : PocketSmootherParameters
        Errors of the sensors.
    start : PocketStart
        Attitude at the first sample; level with heading 0 if None.
    progress : callable
        Called with the share that is done.

    Returns
    -------
    PocketTrack
        Both NIS are of two degrees of freedom, predicted at a node; a field's, of three, is scaled to that.

    Raises `EstimationError` if it cannot be levelled, or the solution diverges to infinity.
    """
    start = level_start(recording) if start is None else start
    node = place_nodes(recording.t)
    acc, gyr = recording.integrable
    links = preintegrate_links(node, recording.t, acc, gyr, recording.mag, np.zeros(3))
    nodes, smoothed = solve_links(links, start, parameters, progress)
    return interpolate_track(recording, node, nodes, smoothed)


def solve_links(
    links: Links, start: PocketStart, p: PocketSmootherParameters, progress: Callable[[float], None] | None = None
) -> tuple[Nodes, Smoothed]:
    """Iterate over all links; the nodes, and the last round's linear solution about those before it."""
    noise, prior = build_noise(p, links.bias), build_prior(start, links, p)
    nodes, variances = initialize_nodes(links, start, p)
    walk, rests = estimate_field_walk(links, p.mag_sigma_uT), detect_rests(links)
    for done in range(MAX_ROUNDS):
        # linearize and solve
        nodes, smoothed = iterate_once(prior, nodes, noise, assemble_inputs(links, variances, rests))
        change = float(np.degrees(np.abs(smoothed.x[:, BIAS : BIAS + 3]).max()))
        if not np.isfinite(change):
            raise EstimationError(
                "the smoother of the pocket diverged to infinity: check the samples of the recording."
            )
        # recompute the robust weights
        variances = reweigh_variances(walk, links, smoothed)
        if progress is not None:
            progress((done + 1) / MAX_ROUNDS)
        if change < ENOUGH_DEG_S:
            break
    return nodes, smoothed


# from nodes to samples


def interpolate_track(recording: Recording, node: Ints, nodes: Nodes, smoothed: Smoothed) -> PocketTrack:
    """Nodes at samples `node` (K + 1,), joined by the gyroscope; bias and sigmas linear between."""
    t, at = recording.t, recording.t[node]
    every = max(round(STORED_EVERY_S * (len(node) - 1) / (at[-1] - at[0])), 1)
    return PocketTrack(
        t=t,
        nav_R_body=_join_attitudes(recording, node, nodes),
        gyro_bias=_interpolate(t, at, nodes.b),
        sigma=_interpolate(t, at, np.sqrt(smoothed.P[:, range(6), range(6)])),
        covariance_sample=node[::every],
        covariance=np.ascontiguousarray(smoothed.P[::every, :6, :6]),
        gravity_nis=_scatter(node, smoothed.swing_nis, len(t)),
        field_nis=_scatter(node, smoothed.field_nis, len(t)) * (2.0 / 3.0),
    )


def propagate_track(
    recording: Recording, at: Ints, R: Floats, b: Floats, P: Floats, node: Ints, nis: Floats
) -> PocketTrack:
    """Estimates R (M, 3, 3), b (M, 3) and P (M, 6, 6) at samples `at` (M,), propagated by the gyroscope to the next.

    `nis` (K, 2) of force and field at samples `node` (K,).
    """
    n = len(recording)
    segment = np.repeat(np.arange(len(at)), np.diff(np.append(at, n)))
    periods = np.append(np.diff(recording.t), recording.period_s)
    turned, _ = relative_rotations(recording.integrable[1], periods, segment, b)
    return PocketTrack(
        t=recording.t,
        nav_R_body=R[segment] @ turned,
        gyro_bias=b[segment],
        sigma=np.sqrt(P[:, range(6), range(6)])[segment],
        covariance_sample=at,
        covariance=P,
        gravity_nis=_scatter(node, nis[:, 0], n),
        field_nis=_scatter(node, nis[:, 1], n) * (2.0 / 3.0),
    )


def _join_attitudes(recording: Recording, node: Ints, nodes: Nodes) -> Floats:
    """Attitudes (N, 3, 3): from each node on by the gyroscope, the misclosure at the next spread over the link."""
    gyr = recording.integrable[1]
    periods = np.append(np.diff(recording.t), recording.period_s)
    segment = np.append(np.repeat(np.arange(len(node) - 1), np.diff(node)), len(node) - 1)
    # propagate from each node
    R, _ = relative_rotations(gyr, periods, segment, nodes.b)
    # misclosure at the next one
    last = node[1:] - 1
    at_end = nodes.R[:-1] @ R[last] @ rotation_exp((gyr[last] - nodes.b[:-1]) * periods[last, None])
    misclosure = unskew(nodes.R[1:] @ np.swapaxes(at_end, 1, 2))
    axis = np.concatenate([misclosure, np.zeros((1, 3))])
    # spread it over time
    share = (recording.t - recording.t[node[segment]]) / np.append(np.diff(recording.t[node]), 1.0)[segment]
    return np.asarray(rotation_exp(axis[segment] * share[:, None]) @ nodes.R[segment] @ R)


def _interpolate(t: Floats, at: Floats, x: Floats) -> Floats:
    return np.stack([np.interp(t, at, column) for column in x.T], axis=1)


def _scatter(node: Ints, values: Floats, samples: int) -> Floats:
    out = np.full(samples, np.nan)
    out[node] = values
    return out
