"""Stretches that agree: a false one does not survive among true ones."""

from dataclasses import replace

import numpy as np

from fg_nav.places import Drift, recognize, select_consistent
from fg_nav.places.recognition import Stretch
from tests.places.floors import LOOP, Floor, along, carry

WALK = carry(Floor.draw(1), np.vstack([along(LOOP)] * 2), 0.02)
SURE = Drift(position_share=0.01)


def between(later_m, earlier_m, length_m=20.0, expected=1e-5):
    """A stretch of the walk that is said to be an earlier one."""
    n = np.arange(length_m / 0.5)
    return Stretch(later_m / 0.5 + n, earlier_m / 0.5 + n, False, 30.0, expected)


def test_true_stretches_agree_and_a_false_one_is_left_out():
    true = [between(100.0 + at, at + 4.0) for at in (10.0, 40.0, 70.0)]
    false = between(126.0, 22.0, 8.0)
    kept = select_consistent(WALK, [*true, false], SURE)
    assert len(kept) == 3
    assert all(any(s is t for t in true) for s in kept)


def test_a_stretch_alone_has_to_be_sure_and_the_recognized_ones_agree():
    alone = between(110.0, 14.0, expected=1e-2)
    assert select_consistent(WALK, [], SURE) == select_consistent(WALK, [alone], SURE) == ()
    assert select_consistent(WALK, [alone, replace(between(140.0, 44.0), expected_false=1e-6)], SURE)
    found = recognize(WALK, SURE).stretches
    assert len(select_consistent(WALK, found, SURE)) == len(found) > 0
