"""Parts that are cut out of a walk in progress know the sensor as the whole of it does."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from fg_nav.detection.causal import Footfall
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import PartialWalk, ReportedFootfall, SampleBuffer
from fg_nav.samples.readings import find_clipping_levels

RATE_HZ = 100.0


def moving(seconds: float, seed: int = 0) -> np.ndarray:
    """Specific force (n, 3) of a foot that is thrown about at random, 12 m/s^2 rms."""
    rng, n = np.random.default_rng(seed), round(seconds * RATE_HZ)
    smooth = gaussian_filter1d(rng.standard_normal((n, 3)), 5.0, axis=0)
    return np.asarray(12.0 * smooth / smooth.std())


def standing_with_taps(seconds: float) -> np.ndarray:
    """Gravity that is flat between two taps, as the top of a peak is that was cut."""
    rng, n = np.random.default_rng(1), round(seconds * RATE_HZ)
    force = np.tile([0.0, 0.0, GRAVITY_M_S2], (n, 1)) + 0.008 * rng.standard_normal((n, 3))
    for start in range(110, n, 370):
        force[start : start + 2] *= 0.96
    return force


def walk_of(*parts: np.ndarray) -> PartialWalk:
    """A walk of one footfall for each part, cut out as a whole behind the first."""
    walk, at = PartialWalk(SampleBuffer()), 0
    for k, acc in enumerate(parts):
        append(walk, acc)
        footfall = Footfall(np.array([at + 5]), np.array([at + len(acc)]), np.ones(1), at + 6, False)
        walk.add(ReportedFootfall(footfall, k, at + len(acc)))
        at += len(acc)
        if k == 0:
            walk.cut_whole()
    return walk


def append(walk: PartialWalk, acc: np.ndarray) -> None:
    """Append samples behind those that are there."""
    t = (walk.buffer.stop + np.arange(len(acc))) / RATE_HZ
    walk.buffer.append(np.column_stack([t, acc, np.full((len(acc), 3), 0.01), np.full((len(acc), 3), np.nan)]))


def test_who_stands_does_not_clip() -> None:
    standing = standing_with_taps(12.0)
    assert np.isfinite(find_clipping_levels(standing)).any()  # by themselves they look like it
    walk = walk_of(moving(10.0), standing)
    acc, _ = walk.cut_recording(1000).clipping
    assert np.isinf(acc).all()


def test_a_part_clips_where_the_walk_did() -> None:
    walk = walk_of(np.clip(moving(60.0), -25.0, 25.0), moving(1.0, 1))
    acc, _ = walk.cut_recording(6000).clipping
    np.testing.assert_allclose(acc, 25.0, rtol=0.03)
