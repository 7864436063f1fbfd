"""The same place again: stretches of a walk that are recognized by the magnetic field along them.

A building's steel bends the field differently at every place, and the field at one place stays. A walk that comes back
to a corridor reads the same field along it again, in the same or in the opposite direction of walking. What is
compared is the field along the path; positions enter only to say which stretches could be the same place at all.

=============== =====================================================================================================
`signature`     the field along the path, by distance: along the walking direction, to its left, up; and the part of it
                that repeats, with equal weight to all its wavelengths
`candidates`    pairs of stretches that lie within the path's own uncertainty of each other
`alignment`     the best local alignments of the walk with itself, among these pairs, and how many as good chance makes
`recognition`   all of that: from a path with its field to stretches that are one place; how sharply the field shows
                where, and which agree with each other and with the odometry
`overlay`       pieces of a later walk that lie on an earlier one as a whole
`saved`         the places of a walk in a file
`location`      where a later walk is on them
=============== =====================================================================================================

Everything here is numpy and numba: no graph and no estimator.
"""

from fg_nav.places.candidates import Drift
from fg_nav.places.location import Location, locate
from fg_nav.places.recognition import Stretch, recognize, recognize_known, select_consistent
from fg_nav.places.saved import SavedPlaces, read_places, trace_places, write_places
from fg_nav.places.signature import Signature, trace_signature

__all__ = [
    "Drift",
    "Location",
    "SavedPlaces",
    "Signature",
    "Stretch",
    "locate",
    "read_places",
    "recognize",
    "recognize_known",
    "select_consistent",
    "trace_places",
    "trace_signature",
    "write_places",
]
