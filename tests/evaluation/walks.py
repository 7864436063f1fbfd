"""Made-up solutions with known errors."""

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.solution import Solution, StanceTable


def stance_table(position: Floats, t: Floats | None = None, position_cov: Floats | None = None) -> StanceTable:
    count = len(position)
    return StanceTable(
        sample=np.arange(count),
        t=np.arange(count, dtype=float) if t is None else t,
        position=position,
        nav_R_body=np.broadcast_to(np.eye(3), (count, 3, 3)),
        gyro_bias=np.zeros((count, 3)),
        position_cov=np.broadcast_to(1e-4 * np.eye(3), (count, 3, 3)) if position_cov is None else position_cov,
        heading_sigma=np.full(count, 0.01),
        gyro_bias_sigma=np.zeros((count, 3)),
        field=("none",) * count,
        field_reason=("",) * count,
    )


def solution(
    t: Floats,
    position: Floats,
    stance_rows: np.ndarray | None = None,
    nav_R_body: Floats | None = None,
) -> Solution:
    rows = np.arange(len(t)) if stance_rows is None else stance_rows
    attitude = np.broadcast_to(np.eye(3), (len(t), 3, 3)) if nav_R_body is None else nav_R_body
    return Solution(
        method="made up",
        t=t,
        position=position,
        velocity=np.zeros_like(position),
        nav_R_body=attitude,
        stances=stance_table(position[rows], t[rows]),
        runtime_s=0.0,
    )


def winding_path(rng: np.random.Generator, count: int = 200) -> Floats:
    """(count, 3) m: a smooth walk that turns and climbs, so that no alignment is degenerate."""
    heading = np.cumsum(0.1 * rng.standard_normal(count))
    step = np.column_stack([np.cos(heading), np.sin(heading), 0.1 * np.sin(0.05 * np.arange(count))])
    return np.cumsum(0.3 * step, axis=0)
