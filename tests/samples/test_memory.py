"""What a long recording holds besides its samples: nothing that can be made again, and no zeros."""

import numpy as np
import pytest

from fg_nav.recording import Recording, find_extra_sigmas
from fg_nav.samples import gaps
from tests.smoother.walks import demo


@pytest.fixture(scope="module")
def recording() -> Recording:
    whole = demo().recording
    return Recording(whole.t[:2400], whole.acc[:2400], whole.gyr[:2400])


def test_samples_are_prepared_in_blocks_as_in_one(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    there = np.r_[0:698, 703:2400]  # a gap, which begins at the end of a block
    t, acc, gyr = (samples[there] for samples in (recording.t, recording.acc, recording.gyr))
    whole = Recording(t, acc, gyr).integrable
    monkeypatch.setattr(gaps, "BLOCK", 100)
    for one, blocks in zip(whole, Recording(t, acc, gyr).integrable, strict=True):
        np.testing.assert_allclose(blocks, one, rtol=1e-9, atol=1e-11)


def test_what_was_not_cut_takes_no_memory(recording: Recording) -> None:
    whole = Recording(recording.t, recording.acc, recording.gyr)
    for peaks, samples in zip(whole.peaks, (whole.acc, whole.gyr), strict=True):
        assert np.shares_memory(peaks.whole, samples)
        assert peaks.sigma.strides == peaks.run.strides == (0, 0)
    assert all(sigma.strides == (0, 0) for sigma in find_extra_sigmas(whole, 0.3))
