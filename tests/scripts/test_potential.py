"""The script on the field along the way: what its fit and its controls find, and that it runs."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

field_potential = load_script("field_potential")

EARTH, IRON_UT, STRIDE_M = np.array([4.0, 20.0]), 0.7, 1.4


def square(rounds=4, sigma=6.0, seed=0, sums_up=False):
    """A way round and round a square of 40 strides; phi is that of the place, or errors of strides that sum up."""
    rng = np.random.default_rng(seed)
    course = np.tile(np.repeat([0.0, 1.0, 2.0, 3.0], 10) * np.pi / 2, rounds)
    steps = STRIDE_M * np.stack([np.cos(course), np.sin(course), np.zeros_like(course)], axis=1)
    position = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    n = len(position)
    phi = np.tile(rng.normal(0.0, sigma, 40), rounds + 1)[:n]
    if sums_up:
        phi = np.cumsum(rng.normal(0.0, sigma, n))
    s = np.zeros((n, 3))
    s[:, 0] = STRIDE_M * np.arange(n)
    u = position[:, :2] @ EARTH + IRON_UT * s[:, 0] - phi
    R = np.stack([yaw_rotation(angle) for angle in np.append(course, course[-1])])
    field = np.einsum("nba,b->na", R, np.append(EARTH, -40.0)) + rng.normal(0.0, 1.0, (n, 3))
    stance = np.einsum("nab,nb->na", R, field)
    trajectory = field_potential.Trajectory(R, position)
    return field_potential.Way(np.arange(float(n)), field, trajectory, np.arange(n), u - u[0], s, stance)


def test_the_fit_finds_earth_and_iron():
    exact = field_potential.fitted(square(sigma=0.0))
    np.testing.assert_allclose(exact.earth, EARTH, atol=0.02)
    assert exact.iron[0] == pytest.approx(IRON_UT, abs=0.01)
    fit = field_potential.fitted(square())
    assert fit.strength == pytest.approx(np.hypot(*EARTH), abs=1.0)
    assert fit.iron_along(square()) == pytest.approx(IRON_UT, abs=0.15)
    assert fit.rms == pytest.approx(6.0, rel=0.25)
    assert fit.rms_m == fit.rms / fit.strength
    assert abs(fit.correlation(7)) < 0.4 < fit.correlation(40)  # the next round


def test_shuffled_strides_separate_what_telescopes_from_what_sums_up():
    rng = np.random.default_rng(1)
    for sums_up, low, high in ((False, 0.0, 0.01), (True, 0.05, 1.0)):
        p = []
        for seed in range(5):
            way = square(seed=seed, sums_up=sums_up)
            p.append(field_potential.as_good(field_potential.shuffled(way, 60, rng), field_potential.fitted(way)))
        assert low <= np.mean(p) <= high


def test_places_passed_twice_have_one_potential():
    first, again = square(rounds=2).passed_twice()
    assert set(again - first) == {40, 80}
    pairs, anywhere, there, left, _, tied, tied_there, *_ = field_potential.of_places(square(rounds=3))
    assert (pairs, anywhere) == (len(square(rounds=3).passed_twice()[0]), pytest.approx(np.sqrt(2) * left))
    assert max(there, tied_there) < 1.0 < 4.0 < tied < 1.1 * left
    assert field_potential.of_places(square(rounds=3, sums_up=True))[6] > 3.0


def test_the_field_of_other_strides_keeps_its_mean():
    way = square()
    same, other = (field_potential.shifted(way, k, field_potential._in_nav) for k in (0, 37))
    np.testing.assert_allclose(same[:-1], way.body_field[:-1], atol=1e-9)
    nav = np.einsum("nab,nb->na", way.trajectory.nav_R_body, other)
    np.testing.assert_allclose(nav.mean(axis=0), way.stance_field.mean(axis=0), atol=0.3)
    assert np.abs(other - way.body_field).max() > 1.0
    holed = replace(way, body_field=np.where(np.arange(len(way.t))[:, None] == 5, np.nan, way.body_field))
    assert np.isnan(field_potential.shifted(holed, 3, field_potential._in_nav)).any(axis=1).nonzero()[0].tolist() == [5]


def test_it_prints_a_simulated_scenario(capsys, monkeypatch):
    monkeypatch.setattr(field_potential, "LEVELS", ("indoor",))
    field_potential.main(["--seeds", "1", "--scenarios", "demo", "--no-real", "--jobs", "1"])
    row = capsys.readouterr().out.splitlines()[-1].split()
    assert row[:2] == ["demo,", "indoor"]
    share, direction = float(row[2]), float(row[5])
    assert share == pytest.approx(1.0, abs=0.2)
    assert abs(direction) < 15.0


@needs_data
def test_it_measures_a_real_walk(capsys):
    field_potential.main(["--seeds", "0", "--data", str(DATA), "--walks", "gdin 24"])
    lines = capsys.readouterr().out.splitlines()
    row = next(line for line in lines[lines.index("Places passed twice (uT m)") :] if line.startswith("gdin 24"))
    pairs, anywhere, there = (float(x) for x in row.split()[2:5])
    assert pairs > 20
    assert there < 0.3 * anywhere
