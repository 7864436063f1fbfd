"""Ramps and bursts: their derivatives are derivatives, a ramp stays, and a burst leaves nothing behind."""

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.motion import PEAK, Bursts, Ramps

RNG = np.random.default_rng(0)
COUNT = 40


@pytest.fixture
def ramps() -> Ramps:
    """Many that overlap, of very different widths: some end before earlier ones do."""
    return Ramps.of(RNG.uniform(0, 10, COUNT), 10 ** RNG.uniform(-1.5, 0.5, COUNT), RNG.normal(size=COUNT), 0.7)


@pytest.fixture
def bursts() -> Bursts:
    return Bursts.of(
        RNG.uniform(0, 10, COUNT),
        RNG.uniform(0.05, 0.5, COUNT),
        2 * np.pi * RNG.uniform(8, 80, COUNT),
        RNG.uniform(0, 6, COUNT),
        RNG.normal(size=(COUNT, 2)),
    )


@pytest.mark.parametrize("kind", ["ramps", "bursts"])
def test_derivatives_are_derivatives(kind: str, request: pytest.FixtureRequest) -> None:
    pieces = request.getfixturevalue(kind)
    t, h = np.sort(RNG.uniform(-1, 14, 2000)), 1e-5
    before, now, after = (pieces.at(t + offset) for offset in (-h, 0.0, h))
    for order in (0, 1):
        slope = (after[order] - before[order]) / (2 * h)
        np.testing.assert_allclose(now[order + 1], slope, atol=2e-5 * np.abs(now[order + 1]).max())


@pytest.mark.parametrize("kind", ["ramps", "bursts"])
def test_acceleration_has_no_steps(kind: str, request: pytest.FixtureRequest) -> None:
    pieces = request.getfixturevalue(kind)
    edges = np.sort(np.concatenate([pieces.start, pieces.start + pieces.width]))
    h = 1e-7
    jump = np.abs(pieces.at(edges + h)[2] - pieces.at(edges - h)[2])
    assert jump.max() < 1e-4 * np.abs(pieces.at(np.linspace(0, 12, 5000))[2]).max()


def test_a_ramp_stays_where_it_rose_to(ramps: Ramps) -> None:
    value, slope, bend = ramps.at(np.array([-5.0, 100.0]))
    np.testing.assert_allclose(value, [0.7, 0.7 + ramps.rise.sum()], atol=1e-12)
    assert not slope.any()
    assert not bend.any()


def test_velocity_integrates_to_the_rise() -> None:
    single = Ramps.of(np.array([1.0]), np.array([0.5]), np.array([3.0]))
    t = np.linspace(0.9, 1.6, 70_001)
    _, slope, _ = single.at(t)
    assert np.trapezoid(slope, t) == pytest.approx(3.0, abs=1e-9)
    assert single.at(np.array([1.25]))[0, 0] == pytest.approx(1.5)


def test_a_burst_leaves_neither_velocity_nor_place(bursts: Bursts) -> None:
    ends = np.sort(bursts.start + bursts.width)
    alone = Bursts(*(getattr(bursts, name)[:1] for name in ("start", "width", "omega", "phase", "amplitude")))
    begin, end = alone.start[0], alone.start[0] + alone.width[0]
    outside = alone.at(np.array([begin - 1.0, begin, end, end + 1.0]))
    assert np.abs(outside).max() < 1e-12
    t = np.linspace(begin, end, 50_001)
    acceleration = alone.at(t)[2]
    velocity = np.trapezoid(acceleration, t, axis=0)
    place = np.trapezoid((end - t)[:, None] * acceleration, t, axis=0)
    assert np.abs(velocity).max() < 1e-6 * np.abs(alone.at(t)[1]).max()
    assert np.abs(place).max() < 1e-6 * np.abs(alone.at(t)[0]).max()
    assert not bursts.at(ends[-1:] + 1.0).any()


def test_a_burst_is_strongest_at_its_peak() -> None:
    slow = Bursts.of(np.zeros(1), np.ones(1), np.array([1e-9]), np.array([np.pi / 2]), np.array([[2.0]]))
    t = np.linspace(0, 1, 3001)
    value = slow.at(t)[0, :, 0]
    assert value.max() == pytest.approx(2.0, rel=1e-6)
    assert t[value.argmax()] == pytest.approx(PEAK, abs=1e-3)


@pytest.mark.parametrize("kind", ["ramps", "bursts"])
def test_blocks_make_no_difference(kind: str, request: pytest.FixtureRequest) -> None:
    pieces = request.getfixturevalue(kind)
    t = np.linspace(-1, 14, 3000)
    whole = pieces.at(t)
    parts = np.concatenate([pieces.at(t[i : i + 77]) for i in range(0, len(t), 77)], axis=1)
    np.testing.assert_array_equal(whole, parts)


def test_no_pieces_do_not_move() -> None:
    nothing = np.zeros(0)
    np.testing.assert_array_equal(Ramps.of(nothing, nothing, nothing, 2.0).at(np.arange(3.0))[0], 2.0)
    assert not Bursts.of(nothing, nothing, nothing, nothing, np.zeros((0, 6))).at(np.arange(3.0)).any()


def test_instants_must_rise(ramps: Ramps) -> None:
    with pytest.raises(SimulationError, match="instant 2 "):
        ramps.at(np.array([0.0, 2.0, 1.0]))


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan])
def test_a_ramp_takes_time(width: float) -> None:
    with pytest.raises(SimulationError, match="no time"):
        Ramps.of(np.zeros(1), np.array([width]), np.ones(1))
