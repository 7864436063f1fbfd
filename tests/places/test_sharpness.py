"""How sharply the field shows a stretch along the path: a shift put in comes out, and a quiet field says so."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.places import Stretch
from fg_nav.places.recognition import REACH_M, SHIFTS_M, find_shift, weigh_shifts
from fg_nav.places.signature import whiten
from tests.places.floors import EARTH, LOOP, Floor, along, carry


def retrace(opposite):
    """Twice the same 96 m: the walk, and the stretch that is true of it."""
    there = along(LOOP)
    walk = carry(Floor.draw(1), np.vstack([there, there[::-1] if opposite else there]))
    later = np.arange(202.0, len(walk) - 10.0)
    earlier = 2.0 * 95.95 / 0.5 - 1.0 - later if opposite else later - 96.0 / 0.5
    return walk, Stretch(later, earlier, opposite, 100.0, 1e-9)


@pytest.mark.parametrize("opposite", [False, True])
def test_a_shift_that_was_put_in_comes_out_within_its_sigma(opposite):
    walk, true = retrace(opposite)
    features = whiten(walk)
    for shift_m in (-0.8, 0.0, 0.3):
        wrong = replace(true, earlier=true.move_earlier(-shift_m))
        ratio = weigh_shifts(features, wrong)
        found = np.array([find_shift(ratio[k : k + 40]) for k in range(0, 140, 40)])
        assert np.abs(found[:, 0] - shift_m).max() < 0.1
        assert found[:, 1].max() < 0.3
        np.testing.assert_allclose(wrong.move_earlier(shift_m), true.earlier)


def test_a_field_that_is_the_same_everywhere_shows_no_shift_and_none_is_out_of_reach():
    walk, true = retrace(False)
    quiet = replace(walk, field=np.tile(EARTH, (len(walk), 1)))
    shift, sigma = find_shift(weigh_shifts(whiten(quiet), true))
    assert shift == pytest.approx(0.0, abs=1e-6)
    assert sigma == pytest.approx(REACH_M / np.sqrt(3.0), rel=0.1)
    shift, sigma = find_shift(np.where(SHIFTS_M == REACH_M, 50.0, 0.0)[None])
    assert shift == pytest.approx(REACH_M)
    step = SHIFTS_M[1] - SHIFTS_M[0]
    assert sigma == pytest.approx(step / np.sqrt(12.0))  # of a shift somewhere in its step
