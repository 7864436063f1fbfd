"""A walk on the places of an earlier one (`--places`), and its own places for later ones (`--save-places`).

    path      of the solution, with the field along it                     (`fg_nav.places.signature`)
    location  start and heading in the known frame, by what is recognized  (`fg_nav.places.location`)
    solution  again, tied to the known places, in axes of the known frame  (`fg_nav.smoother.constraints`)

Its sigmas are those in the known frame: of the ties, of the walk between them, and of the known walk itself at the
places that were recognized, which all footfalls share. A walk that is not recognized stays as it is, in its own frame.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError, PlacesError
from fg_nav.estimators import Progress, estimate
from fg_nav.frames import compute_heading
from fg_nav.solution import KnownStretch, Located, Solution, StanceTable
from fg_nav.walk import Mount, Walk

if TYPE_CHECKING:
    from fg_nav.places import Location, SavedPlaces, Signature
    from fg_nav.places.location import Pieces
    from fg_nav.smoother.constraints import KnownTies

ON_PLACES = ("smoother", "inertial")  # Methods that can be solved on known places.

NOTHING = "nothing of the saved places was recognized: the walk is in a frame of its own"


def check_method(method: str, mount: Mount | None) -> None:
    """Raise `EstimationError` if a method has no use of known places."""
    if method not in ON_PLACES or mount == "pocket":
        raise EstimationError(
            f"{method} makes no use of saved places: leave them out, or choose {' or '.join(ON_PLACES)}."
        )


def _check_walk(walk: Walk) -> None:
    if walk.fixes or walk.extra is not None:
        raise PlacesError("fixes and saved places are in frames of their own: give one of them.")
    require_mag(walk)


def estimate_on_places(walk: Walk, method: str, progress: Progress | None = None) -> Solution:
    """Solve a walk, and again on its known places where it has some that are recognized.

    Raises
    ------
    EstimationError, PlacesError
        For known places where the method has no use of them, with fixes, or without a magnetometer.
    """
    if walk.places is None:
        return estimate(walk, method, progress)
    from fg_nav.places import locate

    check_method(method, walk.options.mount)
    _check_walk(walk)
    solution = estimate(walk, method, progress)
    path = _trace(walk, solution)
    location = locate(path, walk.places)
    if location is None:
        return replace(solution, notes=(*solution.notes, NOTHING))
    # The same walk in axes of the known frame, tied to its places.
    first = solution.stances
    heading_deg = np.rad2deg(compute_heading(first.nav_R_body[0]) - location.turn_rad)
    options = replace(walk.options, heading_deg=float(heading_deg))
    tied = replace(walk, options=options, known=_tie(location, first))
    again = _move(estimate(tied, method, progress), location)
    located = _describe(again.stances, location, path, walk.places)
    return replace(again, located=located, notes=(*again.notes, located.sentence))


def take_places(walk: Walk, solution: Solution) -> SavedPlaces:
    """Take the places of a solved walk, to be saved.

    Raises
    ------
    PlacesError
        Without a magnetometer, or where the walk is too short.
    """
    from fg_nav.places import trace_places

    table, name = solution.stances, walk.recording.provenance.path
    mag = require_mag(walk)
    path = (walk.recording.t, solution.position, solution.nav_R_body)
    return replace(trace_places(*path, mag, table.t, table.position_sigma), recording="" if name is None else name.name)


def require_mag(walk: Walk) -> Floats:
    """Return the readings of the magnetometer; raise `PlacesError` where there are none."""
    if walk.recording.mag is None:
        raise PlacesError("places are known by their magnetic field, and there is no magnetometer: leave them out.")
    return walk.recording.mag


def _trace(walk: Walk, solution: Solution) -> Signature:
    from fg_nav.places import trace_signature

    return trace_signature(walk.recording.t, solution.position, solution.nav_R_body, require_mag(walk))


def _tie(location: Location, footfalls: StanceTable) -> KnownTies:
    """Tie the footfall nearest to each recognized piece, relative to the located start, in axes of the known frame."""
    from fg_nav.smoother.constraints import KnownTies

    pieces: Pieces = location.pieces
    nearest = np.abs(pieces.t[:, None] - footfalls.t).argmin(axis=1)
    apart = pieces.place - footfalls.position[nearest]
    in_body = np.einsum("kji,kj->ki", footfalls.nav_R_body[nearest], apart)
    return KnownTies(footfalls.t[nearest], in_body, pieces.known - location.start, pieces.tie_covariance)


def _move(solution: Solution, location: Location) -> Solution:
    """Move a walk that was solved about its located start to there, with the sigma of the known walk itself."""
    table, variance = solution.stances, np.diag(location.map_variance)
    pose_cov = table.pose_cov
    if pose_cov is not None:
        pose_cov = pose_cov.copy()
        pose_cov[:, :3, :3] += variance
    stances = replace(
        table,
        position=table.position + location.start,
        position_cov=table.position_cov + variance,
        pose_cov=pose_cov,
    )
    return replace(solution, position=solution.position + location.start, stances=stances)


def _describe(table: StanceTable, location: Location, path: Signature, known: SavedPlaces) -> Located:
    sigma = np.append(table.position_sigma[0], table.heading_sigma[0])
    heading = float(compute_heading(table.nav_R_body[0]))
    stretches = []
    for one in location.stretches:
        t, known_t = _find_times(one.later, path), _find_times(one.earlier, known.path)
        stretches.append(KnownStretch(t, known_t, one.opposite, one.length_m, one.score, one.expected_false))
    return Located(table.position[0], heading, sigma, location.expected_false, known.recording, tuple(stretches))


def _find_times(points: Floats, path: Signature) -> Floats:
    return np.interp(points, np.arange(len(path)), path.t)
