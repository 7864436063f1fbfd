"""Recordings of the tests of the commands by name: each is simulated once, and written once."""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fg_nav.detection import detect_stances
from fg_nav.io import write_canonical, write_tum
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.magnetic.axes import MagAxes
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from tests.magnetic.turning_walks import minute, tumble
from tests.online.walks import short_walk

FOLDER = tempfile.TemporaryDirectory(prefix="fg-nav-recordings-")
AXES = "-y,-x,z"  # A mirror.
OFF_DEG_S = {"still": (0.5, 0.0, 0.0), "a": (0.5, 0.0, 0.0), "b": (0.51, 0.01, 0.01), "c": (0.49, -0.01, -0.01)}


def _end(recording: Recording) -> Recording:
    """The walk from its tenth footfall on, with more noise."""
    part = recording.slice(int(detect_stances(recording).start[10]), len(recording))
    noise = np.random.default_rng(1).normal(0.0, 0.3, part.gyr.shape)
    return replace(part, mag=part.mag + noise, truth=None)


def _slow(recording: Recording) -> Recording:
    mag = np.full_like(recording.gyr, np.nan)
    mag[::200] = recording.mag[::200]
    return replace(recording, mag=mag)


def _of_one_sensor(name: str, recording: Recording) -> Recording:
    """With a bias that changes little from walk to walk; the field at rest alone."""
    rate = recording.gyr + np.radians(OFF_DEG_S[name])
    return replace(recording, gyr=rate, mag=recording.mag if name == "still" else None)


MADE = {
    "walk": lambda: simulate("demo", 5).recording,
    "part": lambda: recording("walk").slice(0, 4000),
    "half": lambda: recording("walk").slice(0, 6000),
    "end": lambda: _end(recording("walk")),
    "other": lambda: simulate("demo", 6).recording,
    "bare": lambda: replace(recording("part"), mag=None),
    "slow": lambda: _slow(recording("part")),
    "mirrored": lambda: replace(recording("bare"), gyr=-recording("bare").gyr),
    "thin": lambda: Recording(*(getattr(recording("walk"), name)[::10] for name in ("t", "acc", "gyr"))),  # at 20 Hz
    "pocket": lambda: simulate("demo", 103, Choices(worn="pocket", rate_hz=100.0)).recording.slice(0, 3500),
    "short": short_walk,
    "loop": lambda: simulate("calibration-loop", 101, Choices(rate_hz=200.0)).recording,
    "loop-bare": lambda: replace(recording("loop"), mag=None),
    "straight": lambda: recording("loop").slice(0, int(9.0 / recording("loop").period_s)),  # of one heading
    "tumbled": tumble,
    "still": lambda: _of_one_sensor("still", simulate("at-rest", 3).recording.slice(0, 3000)),
    **{name: lambda name=name: _of_one_sensor(name, simulate("demo", 3).recording.slice(0, 5000)) for name in "abc"},
    # twenty-seven seconds at 100 Hz, 22 ms late
    "turned": lambda: MagAxes(MagAxes.parse(AXES).P.T).apply_to(
        replace(minute(5, 0.022, rate_hz=100.0), truth=None).slice(0, 2700)
    ),
}


@cache
def recording(name: str) -> Recording:
    return MADE[name]()


@cache
def recorded(name: str) -> Path:
    """Its file."""
    path = Path(FOLDER.name) / f"{name}.csv"
    write_canonical(recording(name), path)
    return path


@cache
def truth_of(name: str, later_s: float = 0.0) -> Path:
    """File of the true path."""
    truth, path = recording(name).truth, Path(FOLDER.name) / f"{name}-{later_s:g}.tum"
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    write_tum(path, truth.t + later_s, truth.position, truth.nav_R_body)
    return path
