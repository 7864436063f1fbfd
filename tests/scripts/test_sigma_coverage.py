"""The script that counts how many errors lie in their regions of 95 %."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.frames import yaw_rotation
from fg_nav.smoother.batch import smooth_graph
from fg_nav.truth import FootprintTruth
from tests.real_data import DATA, needs_data
from tests.scripts import load_script
from tests.smoother.walks import demo, part

joint_errors = load_script("joint_errors")
coverage = load_script("sigma_coverage")

DRAWS, YAW = 200, 0.7


@cache
def walked():
    """A short walk, its solution, and the covariance (4 F, 4 F) of all its footfalls."""
    walk = part(demo(), 14)
    smoothed = smooth_graph(walk.recording, walk.stances)
    solution, joint = smoothed.solution, smoothed.joint
    count = len(solution.stances)
    covariance = joint.combine(np.eye(4 * count).reshape(count, 4, 4 * count))[0]
    return solution, joint, covariance


def draw_truths(sigma_m, is_aligned, claimed=1.0):
    """Truths whose errors are as the solution claims, each in a frame of its own unless it is aligned."""
    solution, joint, covariance = walked()
    rng = np.random.default_rng(3)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    turn = np.eye(3) if is_aligned else yaw_rotation(YAW)
    row = np.arange(1, len(solution.stances))
    for _ in range(DRAWS):
        error = claimed * (root @ rng.standard_normal(len(root))).reshape(-1, 4)[row]
        place = solution.stances.position[row] - error[:, :3] + sigma_m * rng.standard_normal((len(row), 3))
        back = Rotation.from_rotvec(np.outer(-error[:, 3], [0.0, 0.0, 1.0])).as_matrix()
        attitude = turn @ back @ solution.stances.nav_R_body[row]
        yield solution, joint, joint_errors.Seen(row, place @ turn.T, sigma_m, True, attitude, is_aligned)


@pytest.mark.parametrize("is_aligned", [True, False])
@pytest.mark.parametrize("surveyed", [False, True])
def test_errors_that_are_as_claimed_are_chi_square_after_the_fit(is_aligned, surveyed):
    """Of the mean over draws at any place the sigma is sqrt(2 / DRAWS); one seed is fixed."""
    found = []
    for solution, joint, seen in draw_truths(0.01 if surveyed else 0.0, is_aligned):
        given = replace(seen, nav_R_body=None) if surveyed else seen
        found.append(joint_errors.measure_errors(solution.stances, joint, given))
    assert found[0].keys() == joint_errors.FREEDOM.keys()
    for name, freedom in joint_errors.FREEDOM.items():
        squared = np.mean([one[name].squared for one in found], axis=0)
        assert squared == pytest.approx(freedom, rel=5 * np.sqrt(2 / freedom / DRAWS)), name
        assert np.mean([one[name].inside for one in found]) == pytest.approx(0.95, abs=0.04), name


def test_claims_of_half_the_errors_are_found_out():
    found = [joint_errors.measure_errors(s.stances, joint, seen) for s, joint, seen in draw_truths(0.0, False, 2.0)]
    for name in joint_errors.FREEDOM:
        assert np.sqrt(np.mean([one[name].ratio ** 2 for one in found])) == pytest.approx(2.0, rel=0.15), name
        assert np.mean([one[name].inside for one in found]) < 0.8, name


def test_ways_do_not_come_back():
    for seed in range(5):
        _, walk, _ = coverage.draw_route(700.0, np.random.default_rng(seed))
        place, _ = walk.path.at([0.0, walk.path.length_m])
        assert walk.path.length_m == pytest.approx(700.0)
        assert np.linalg.norm(place[1] - place[0]) > 400.0


def test_a_footprint_is_that_of_the_stance_at_its_instant():
    stances, solution = part(demo(), 14).stances, walked()[0]
    ends = solution.t[np.stack([stances.start, stances.stop - 1])]
    truth = FootprintTruth(
        np.arange(4), np.eye(4)[:, :2], t=np.array([ends[0, 0], ends[1, 3], ends[1, 4] + 0.4, ends[0, 6] - 0.1])
    )
    row, place = coverage._find_footprints(solution, stances, truth)
    assert row.tolist() == stances.footfall[[0, 3, 6]].tolist()
    assert np.array_equal(place, truth.xy[[0, 1, 3]])


def test_simulated_ways_are_measured_with_heading_given_and_not(monkeypatch, tmp_path):
    monkeypatch.setattr(coverage, "FIELDS", (None, "smooth"))
    path = tmp_path / "coverage.json"
    coverage.main(["--only", "simulated", "--seeds", "1", "--length", "40", "--per-walk", "--json", str(path)])
    content = json.loads(path.read_text())
    assert {walk["section"] for walk in content["walks"]} == {
        f"simulated, {field}, heading {given}"
        for field in ("no magnetometer", "smooth")
        for given in ("given", "not given")
    }
    for walk in content["walks"]:
        assert not walk["failure"]
        assert walk["length"]["ratio"] > 0.0
    assert {figure["name"] for figure in content["figures"]} == joint_errors.FREEDOM.keys()


@needs_data
def test_a_surveyed_walk_is_measured():
    walks = coverage.walks.read_gdlbio(DATA, [48])
    row = coverage.measure_recorded("gdlbio", walks[0])
    assert not row.failure
    assert row.found.keys() == joint_errors.FREEDOM.keys() - {"height"}
    assert len(row.found["horizontal"].squared) == 8
