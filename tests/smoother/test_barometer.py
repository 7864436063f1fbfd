"""The barometer: heights of simulated and real walks with it, in batch and online, and its noise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.io import read
from fg_nav.lab.simulation.person import INSTEP
from fg_nav.lab.simulation.routes import stairs
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.heights import SCALE_HEIGHT_M, SCALE_SIGMA, average_pressures, calibrate_barometer
from fg_nav.smoother.parameters import SmootherParameters, WalkParameters
from fg_nav.smoother.strides import place_nodes
from fg_nav.solution import Solution
from tests.real_data import DATA, needs_data
from tests.simulated import PERSON, simulated

ALONE = SmootherParameters(walk=WalkParameters(floors=False))  # Heights by strides and pressure, without level floors.

GROUND_PA = 97_970.0


@cache
def climbed() -> Recording:
    """Two flights up and down again, a minute and a half."""
    return simulated(stairs(), PERSON, INSTEP, seed=1).recording


def with_barometer(
    recording: Recording,
    seed: int = 0,
    every: int = 8,
    white_pa: float = 2.0,
    drift_pa: float = 0.3,
    quantum_pa: float = 1.0,
    scale: float = 0.0,
) -> Recording:
    """A reading every few samples: white noise and a random walk in Pa, rounded, in air of another temperature."""
    rng, t = np.random.default_rng(seed), recording.t
    height = recording.truth.position[:, 2] - recording.truth.position[0, 2]
    drift = np.cumsum(rng.normal(0.0, drift_pa * np.sqrt(np.diff(t, prepend=t[0]))))
    read_pa = GROUND_PA * np.exp(-height / (SCALE_HEIGHT_M * (1.0 + scale))) + drift
    read_pa = quantum_pa * np.rint((read_pa + rng.normal(0.0, white_pa, len(t))) / quantum_pa)
    return replace(recording, pressure=np.where(np.arange(len(t)) % every == 0, read_pa, np.nan))


def smoothed(recording: Recording, p: SmootherParameters = ALONE) -> Solution:
    return smooth(recording, detect_stances(recording), p)


def height_errors(recording: Recording, solution: Solution) -> tuple[Floats, Floats]:
    """Errors (F,) m of the heights at the footfalls, and their sigmas."""
    truth, table = recording.truth.position[:, 2], solution.stances
    error = table.position[:, 2] - (truth[table.sample] - truth[table.sample[0]])
    return error, np.sqrt(table.position_cov[:, 2, 2])


def test_heights_are_better_with_a_barometer_and_their_sigma_honest() -> None:
    recording = climbed()
    plain, _ = height_errors(recording, smoothed(recording))
    walks = [with_barometer(recording, seed) for seed in range(4)]
    found = [height_errors(one, smoothed(one)) for one in walks]
    assert np.median([np.abs(error).max() for error, _ in found]) < 0.7 * np.abs(plain).max()
    ends = np.array([error[-1] / sigma[-1] for error, sigma in found])
    assert np.sqrt((ends**2).mean()) < 1.5
    assert all(np.mean(np.abs(error[1:]) < 2.0 * sigma[1:]) > 0.9 for error, sigma in found)


@pytest.mark.parametrize("scale", [-SCALE_SIGMA, SCALE_SIGMA])
def test_stairs_in_air_of_another_temperature_close_and_have_it_in_their_sigma(scale: float) -> None:
    recording = with_barometer(climbed(), scale=scale)
    found = smoothed(recording)
    error, sigma = height_errors(recording, found)
    assert abs(error[-1]) < 2.0 * sigma[-1]
    top = np.argmax(recording.truth.position[found.stances.sample, 2])
    assert abs(error[top]) < 2.0 * sigma[top]


def test_a_door_and_gusts_move_the_heights_by_less_than_their_sigma() -> None:
    recording = with_barometer(climbed())
    calm, sigma = height_errors(recording, smoothed(recording))
    gust = recording.pressure + np.where((recording.t % 20.0) < 0.7, 40.0, 0.0)
    gusty, _ = height_errors(recording, smoothed(replace(recording, pressure=gust)))
    assert np.abs(gusty - calm).max() < 1.5 * sigma.max()
    door = recording.pressure + np.where(recording.t > 0.5 * recording.t[-1], 25.0, 0.0)  # 2.1 m
    error, sigma = height_errors(recording, smoothed(replace(recording, pressure=door)))
    assert np.abs(error).max() < 2.1
    assert np.abs(error[-1]) < 3.0 * sigma[-1]


@pytest.mark.parametrize(("white_pa", "quantum_pa"), [(0.0, 0.01), (4.0, 1.0), (1.0, 100.0)])
def test_noise_is_that_of_the_recording(white_pa: float, quantum_pa: float) -> None:
    recording = with_barometer(climbed(), every=2, white_pa=white_pa, quantum_pa=quantum_pa, drift_pa=0.0)
    stances = detect_stances(recording)
    nodes = place_nodes(recording, stances, ALONE)
    seen = average_pressures(recording, stances, nodes)
    barometer = calibrate_barometer(recording, seen)
    truth = GROUND_PA * np.exp(-(recording.truth.position[:, 2] - recording.truth.position[0, 2]) / SCALE_HEIGHT_M)
    error = seen.mean - truth[nodes.sample[nodes.result]]
    sigma = barometer.sigma_m(seen.number) / barometer.m_per_pa
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.3
    assert sigma.max() < 3.0 if quantum_pa < 100.0 else sigma.min() > 0.25 * quantum_pa


def test_online_has_the_heights_of_the_batch() -> None:
    recording = with_barometer(climbed())
    navigator, rows = OnlineNavigator(OnlineOptions(parameters=ALONE)), rows_of(recording)
    for start in range(0, len(rows), 500):
        part = rows[start : start + 500]
        navigator.push(part[:, 0], part[:, 1:4], part[:, 4:7], None, part[:, 10])
    navigator.close()
    found, batch = navigator.finish(), smoothed(recording)
    moment = np.interp(batch.stances.t, found.moment.t, found.moment.position[:, 2])
    assert np.abs(moment - batch.stances.position[:, 2]).max() < 0.6
    error, sigma = height_errors(recording, found)
    assert np.mean(np.abs(error[1:]) < 2.0 * sigma[1:]) > 0.9
    at_end = np.interp(batch.stances.t, found.stances.t, found.stances.position[:, 2])
    assert np.abs(at_end - batch.stances.position[:, 2]).max() < 0.1
    assert found.graph["barometer"] > 50


def real(name: str) -> Recording:
    assert DATA is not None
    return replace(read(DATA / f"{name}.csv.gz", barometer=DATA / f"{name}.baro.csv.gz"), mag=None)


@needs_data
def test_a_real_staircase_is_as_high_down_as_up() -> None:
    """The barometer alone has 7.7 m up and 7.6 m down."""
    ends = [real(f"mtig710/2022_1_14_stair_walk_{way}_foot1") for way in ("up", "down")]
    up, down = (smoothed(one).stances.position[-1, 2] for one in ends)
    assert 7.4 < up < 8.3
    assert abs(up + down) < 0.3


@needs_data
@pytest.mark.parametrize("name", ["square_70m_1", "square_70m_3", "rectangle_1", "lap_360m_2"])
def test_real_rounds_of_one_floor_end_at_their_height(name: str) -> None:
    table = smoothed(real(f"mems_foot/{name}")).stances
    assert abs(table.position[-1, 2]) < 0.5
    assert abs(table.position[-1, 2]) < 2.0 * np.sqrt(table.position_cov[-1, 2, 2])
