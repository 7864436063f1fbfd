"""Bad samples of a stream are those of a recording, however the samples come in blocks."""

import numpy as np
import pytest

from fg_nav.online.buffer import rows_of, taken_rows
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.intake import Intake
from fg_nav.samples.readings import LOOK_AHEAD
from tests.online.walks import short_walk

BAD = [0, 333, 334, 335, 700, 710]


def spoiled() -> np.ndarray:
    rows = rows_of(short_walk()).copy()
    rows[BAD, 6] += 60.0
    rows[1000:1005, 2] -= 1000.0
    rows[1005:1007, 5] += 60.0
    rows[600, [1, 5]] = 900.0, 60.0
    rows[[500, 712, 1006], 8] = 160.0
    return rows


@pytest.mark.parametrize("block", [1, 9, 5000])
def test_a_stream_leaves_out_what_a_recording_does_and_counts_it(block):
    rows, told = spoiled(), []
    judge = Intake(told.append)
    parts = [rows[i : i + block] for i in range(0, len(rows), block)]
    taken = [judge.push(part) for part in parts]
    whole = Recording.from_raw(
        RawRecording(rows[:, 0], rows[:, 1:4], rows[:, 4:7], np.arange(len(rows)), rows[:, 7:10])
    )
    np.testing.assert_array_equal(np.concatenate([*taken, judge.push(rows[:0], at_end=True)]), taken_rows(whole))
    assert judge.counts == {"gyr": len(BAD) + 3, "acc": 6, "mag": 3}
    assert len(whole) == len(rows) - 1
    sentence = "samples of the gyroscope are far off what those around allow, and not used, the first at t ="
    assert any(words.startswith(sentence) for words in told)
    behind = [rows[min((i + 1) * block, len(rows)) - 1, 0] - part[-1, 0] for i, part in enumerate(taken) if len(part)]
    assert max(behind) <= (LOOK_AHEAD + 1) * 0.01  # of 100 Hz
    assert sum(late > 0.0 for late in behind) < 0.1 * len(behind) + 1
