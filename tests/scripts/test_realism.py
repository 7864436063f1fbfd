"""The persons drawn walk as real ones do: in every fact but those that say why not."""

import numpy as np

from tests.real_data import DATA, needs_data
from tests.scripts import load_script

realism = load_script("realism")


@needs_data
def test_simulated_feet_lie_within_the_real_ones() -> None:
    real, ours = realism.compare_feet(DATA, (11, 12, 13, 14))  # not those on which the gait was chosen
    rows = realism.judge_facts(real, ours)
    assert len(rows) == 15
    assert all(mark == "inside" or reason for *_, mark, reason in rows), rows
    for fact in ("peak rate, roll (deg/s)", "peak rate, pitch (deg/s)", "sensor above the rolling point (cm)"):
        spread = [np.ptp([facts[fact] for facts in some if fact in facts]) for some in (real, ours)]
        assert 0.15 * spread[0] < spread[1] < 2.0 * spread[0], fact
