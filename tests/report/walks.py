"""A walk, its stances, and solutions of it with errors of known size: for tests."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.stance import Stances
from fg_nav.evaluation import evaluate
from fg_nav.evaluation.comparison import compare
from fg_nav.lab.simulation import SimulatedWalk, simulate
from fg_nav.recording import Recording
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from fg_nav.walk import Options, Outcome, Walk

STILL_M_S = 0.1


def true_stances(walk: SimulatedWalk) -> Stances:
    """Stances where the foot is truly flat and has landed; the statistic is its speed over 10 cm/s, squared."""
    recording, flat = walk.recording, walk.flat
    assert isinstance(recording.truth, TrajectoryTruth)
    assert flat is not None
    landed = flat[:, 0] + 0.3 * np.diff(flat)[:, 0]
    standing = np.searchsorted(landed, recording.t) > np.searchsorted(flat[:, 1], recording.t)
    speed = np.linalg.norm(np.gradient(recording.truth.position, recording.t, axis=0), axis=1)
    found = Stances.from_mask(standing, "TRUE SPEED")
    return replace(found, threshold=STILL_M_S, statistic=(speed / STILL_M_S) ** 2 + 1e-4)


def drifting(recording: Recording, stances: Stances, method: str = "smoother", drift_deg: float = 2.0) -> Solution:
    """Return the truth bent by a heading that is `drift_deg` wrong at the end."""
    truth, t = recording.truth, recording.t
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    turn = Rotation.from_rotvec(np.outer(np.deg2rad(drift_deg) * t / t[-1], [0, 0, 1]))
    step = turn.apply(np.diff(truth.position, axis=0, prepend=truth.position[:1]))
    position, attitude = np.cumsum(step, axis=0), turn.as_matrix() @ truth.nav_R_body
    k = np.arange(len(stances))
    table = stance_table(
        t, position, attitude, (stances.start + stances.stop) // 2,
        gyro_bias=np.tile(np.deg2rad([0.1, -0.05, 0.08]), (len(k), 1)),
        position_cov=(0.002 + 0.004 * k[:, None, None]) ** 2 * np.array([[1, 0.3, 0], [0.3, 0.4, 0], [0, 0, 0.2]]),
        heading_sigma=np.deg2rad(0.2 + 0.03 * k),
        gyro_bias_sigma=np.deg2rad(np.outer(0.02 + 0.2 * np.exp(-k / 10), [1, 1, 2])),
    )  # fmt: skip
    return Solution(
        method, t, position, np.gradient(position, t, axis=0), attitude, table, runtime_s=0.25,
        parameters={"noise": {"acc_m_s2": 0.3}, "unknown": float("nan")}, notes=("made for a test",),
    )  # fmt: skip


def stance_table(t: Floats, position: Floats, attitude: Floats, sample: Ints, **known: Floats) -> StanceTable:
    """Stances at these samples, of which no field was used."""
    words = ("none",) * len(sample), ("not used, as yet",) * len(sample)
    return StanceTable(
        sample=sample, t=t[sample], position=position[sample], nav_R_body=attitude[sample], field=words[0],
        field_reason=words[1], **known,
    )  # fmt: skip


def walk(seed: int = 1) -> Walk:
    """Return the demonstration walk with its true stances."""
    simulated = simulate("demo", seed)
    return Walk(simulated.recording, true_stances(simulated), simulated.recording.truth, Options())


def outcome(walk: Walk, method: str = "smoother", drift_deg: float = 2.0) -> Outcome:
    solution = drifting(walk.recording, walk.stances, method, drift_deg)
    if walk.truth is None:
        return Outcome(solution, evaluate(solution), None)
    return Outcome(solution, evaluate(solution, walk.truth), compare(solution, walk.truth))


def with_footprints(walk: Walk) -> Walk:
    """Return the same walk, of which only every third footprint is known, in a frame of its own."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    sample = (walk.stances.start + walk.stances.stop) // 2
    stride = np.arange(0, len(sample), 3)
    xy = truth.position[sample[stride], :2] @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + [5.0, 2.0]
    return replace(walk, truth=FootprintTruth(stride, xy, len(sample) - 1))


def without_truth(walk: Walk) -> Walk:
    return replace(walk, truth=None)
