"""Parts that are cut out of a walk in progress know the sensor as the whole of it does."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import PartialWalk, ReportedFootfall, SampleBuffer
from fg_nav.samples.readings import find_clipping_levels
from tests.online.walks import footfall_at

RATE_HZ = 100.0


def moving(seconds: float, seed: int = 0) -> np.ndarray:
    """Specific force (n, 3) of a foot that is thrown about at random, 12 m/s^2 rms."""
    rng, n = np.random.default_rng(seed), round(seconds * RATE_HZ)
    smooth = gaussian_filter1d(rng.standard_normal((n, 3)), 5.0, axis=0)
    return np.asarray(12.0 * smooth / smooth.std())


def walk_of(*parts: np.ndarray) -> PartialWalk:
    """A walk of one footfall for each part, cut out as a whole behind the first."""
    walk, at = PartialWalk(SampleBuffer()), 0
    for k, acc in enumerate(parts):
        t, n = (at + np.arange(len(acc))) / RATE_HZ, len(acc)
        walk.buffer.append(np.column_stack([t, acc, np.full((n, 3), 0.01), np.full((n, 3), np.nan)]))
        walk.add(ReportedFootfall(footfall_at(np.array([at + 5]), np.array([at + n]), at + 6), k, at + n))
        at += n
        if k == 0:
            walk.cut_whole()
    return walk


def test_who_stands_does_not_clip_and_a_part_clips_where_the_walk_did() -> None:
    # Gravity that is flat between two taps, as the top of a peak is that was cut.
    standing = np.tile([0.0, 0.0, GRAVITY_M_S2], (1200, 1)) + 0.008 * np.random.default_rng(1).standard_normal(
        (1200, 3)
    )
    for start in range(110, len(standing), 370):
        standing[start : start + 2] *= 0.96
    assert np.isfinite(find_clipping_levels(standing)).any()  # by itself it looks like it
    acc, _ = walk_of(moving(10.0), standing).cut_recording(1000).clipping
    assert np.isinf(acc).all()
    acc, _ = walk_of(np.clip(moving(60.0), -25.0, 25.0), moving(1.0, 1)).cut_recording(6000).clipping
    np.testing.assert_allclose(acc, 25.0, rtol=0.03)
