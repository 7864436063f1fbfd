"""The script that measures two feet in one graph, on a walk of a minute."""

from argparse import Namespace

import numpy as np
import pytest

from tests.real_data import DATA, needs_data
from tests.scripts import load_script

feet = load_script("two_feet")


def test_both_feet_are_measured_alone_and_together_and_compared(capsys):
    figures = feet.measure_simulated(Namespace(scenarios=["demo"], seeds=1, first=1, jobs=1))
    assert [figure.high for figure in figures] == [0.7, 0.7, 1.0, 1.0]
    assert all(0.2 < figure.measured < 2.0 for figure in figures)
    printed = capsys.readouterr().out
    assert "demo, without, m" in printed
    assert "demo, with, deg" in printed


def test_the_better_foot_is_that_with_the_smaller_rms():
    def errors(size):
        return feet.Errors(size, 10.0 * size, 1.0, 0.5)

    seen = [
        {(False, together, side): errors(size) for (together, side), size in sizes.items()}
        for sizes in (
            {(False, "left"): 0.3, (False, "right"): 0.4, (True, "left"): 0.2, (True, "right"): 0.2},
            {(False, "left"): 0.4, (False, "right"): 0.2, (True, "left"): 0.2, (True, "right"): 0.2},
        )
    ]
    row, figure = feet.compare_feet("x", seen, False, "position_m", "m", "without")
    better = np.sqrt((0.4**2 + 0.2**2) / 2)
    assert figure.measured == pytest.approx(0.2 / better)
    assert row[4] == f"{0.2 / np.sqrt((0.3**2 + 0.4**2 + 0.4**2 + 0.2**2) / 4):.2f}"


@needs_data
def test_motion_captured_feet_are_better_together_than_each_alone(capsys):
    """Rms of the samples of zupt_fgo and gaitmap."""
    figures = feet.measure_real(Namespace(data=DATA))
    assert all(figure.measured <= 1.1 * figure.high for figure in figures)
    lines = capsys.readouterr().out.splitlines()
    rows = [line.split() for line in lines if line.startswith(("zupt_fgo", "gaitmap, 39"))]
    assert len(rows) == 4
    errors = np.array([[float(x) for x in (row[-8:-5] if "+-" in row else row[-6:-3])] for row in rows])
    iez, smoother, both = errors.reshape(2, 2, 3).transpose(2, 0, 1)  # (walks, feet)
    assert (both <= 1.02 * iez).all()
    assert ((both**2).sum(axis=1) < (smoother**2).sum(axis=1)).all()
    assert (both < smoother + 0.005).all()  # a foot with a rest is within 2 cm on its own, one without drifts
