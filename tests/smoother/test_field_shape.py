"""A field bends a walk that it refutes, and leaves alone one that it does not."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from fg_nav.factors.rotation import rotation_exp
from fg_nav.smoother.field_shape import refute_shape
from fg_nav.smoother.graph import turn_walk
from tests.smoother.test_field import NOT_RESTED, earth, in_field, inertial, plain, smoothed
from tests.smoother.test_potential import solved_in

KEPT = "keeps the shape"


def bent(values: gtsam.Values, node: list[int], end_deg: float) -> gtsam.Values:
    """Values with headings that drift away evenly."""
    out = gtsam.Values(values)
    for j, angle in zip(node, np.linspace(0.0, np.radians(end_deg), len(node)), strict=True):
        pose = values.atPose3(X(j))
        turned = rotation_exp(angle * np.array([0.0, 0.0, 1.0])) @ pose.rotation().matrix()
        out.update(X(j), gtsam.Pose3(gtsam.Rot3(turned), pose.translation()))
    return out


def test_no_turn_of_the_whole_walk_is_refuted_and_the_more_it_is_bent_the_more_it_is() -> None:
    found, _ = solved_in(0)
    values, nodes = found.solved.values, found.problem.nodes
    turned = gtsam.Values(values)
    turn_walk(turned, nodes, 0.6)
    assert refute_shape(found, values) == pytest.approx(0.0, abs=0.05)
    assert refute_shape(found, turned) == pytest.approx(refute_shape(found, values), abs=1e-6)
    bends = [refute_shape(found, bent(values, nodes.result.tolist(), angle)) for angle in (2.0, 4.0, 8.0)]
    np.testing.assert_allclose(np.array(bends[1:]) / bends[:-1], 4.0, rtol=0.2)  # squares of sigmas


def test_a_walk_that_a_rest_has_shown_the_bias_of_keeps_its_shape() -> None:
    found, without = smoothed(plain(), None), inertial(plain())
    assert any(KEPT in note for note in found.notes)
    moves = [np.linalg.norm(np.diff(one.stances.position[:, :2], axis=0), axis=1) for one in (found, without)]
    np.testing.assert_allclose(*moves, atol=1e-3)


def test_a_walk_with_a_bias_is_bent() -> None:
    found = smoothed(in_field(earth(), bias_deg_s=0.2), None, NOT_RESTED)
    assert not any(KEPT in note for note in found.notes)
