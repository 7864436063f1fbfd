"""The scripts that print the project's figures: what they measure, and how they judge it."""

import numpy as np
import pytest

from fg_nav.frames import GRAVITY_M_S2
from tests.scripts import SCRIPTS, load_script

harness = load_script("harness")
walks = load_script("walks")
long_walk = walks.simulate_long_walk


@pytest.mark.parametrize(
    ("measured", "low", "high", "asked", "mark"),
    [
        (0.5, -np.inf, 0.5, "<= 0.500", "ok"),
        (0.501, -np.inf, 0.5, "<= 0.500", "missed"),
        (7, 8, np.inf, ">= 8.000", "missed"),
        (1.2, 0.99, 1.01, "0.990 to 1.010", "missed"),
        (1.0, 0.99, 1.01, "0.990 to 1.010", "ok"),
        (9.9, -np.inf, np.inf, "", ""),
        (np.inf, -np.inf, 0.5, "<= 0.500", "missed"),
        (np.nan, -np.inf, 0.5, "<= 0.500", "missed"),
    ],
)
def test_a_figure_is_marked_by_what_was_asked(measured, low, high, asked, mark):
    figure = harness.Figure("section", "name", "method", measured, low, high)
    assert (figure.asked, figure.mark) == (asked, mark)


def test_figures_are_plain_text_in_a_pipe(capsys):
    figure = harness.Figure("section", "some name", "iez", float("inf"), high=0.2)
    harness.report_figures([figure])
    out = capsys.readouterr().out
    assert out.splitlines()[1].split() == ["section", "some", "name", "iez", "<=", "0.200", "inf", "missed"]
    assert "0 of 1 figures are as asked" in out


def test_data_folder_is_the_option_then_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("FG_NAV_DATA", str(tmp_path))
    assert walks.data_folder(None) == tmp_path
    assert walks.data_folder(SCRIPTS) == SCRIPTS


@pytest.fixture(scope="module")
def three_rounds():
    return long_walk(2.5, 5)


def test_rounds_of_a_long_walk_join_at_rest(three_rounds):
    """Where one round ends and the next begins the sensor stands: no jump, and the same bias on either side."""
    assert len(three_rounds) == 30000
    position = three_rounds.truth.position
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert step.max() < 0.05  # a foot at 10 m/s
    home = np.flatnonzero((np.linalg.norm(position[1:], axis=1) < 0.3) & (step < 1e-5))
    later = [part for part in np.split(home, np.flatnonzero(np.diff(home) > 200) + 1) if part[0] > 2000]
    assert [len(part) for part in later] == pytest.approx([2000, 2000], abs=120)  # 10 s, twice
    bias = three_rounds.gyr[:500].mean(axis=0)
    for part in later:
        middle = part[100:-100]
        strength = np.linalg.norm(three_rounds.acc[middle], axis=1)
        assert strength.mean() == pytest.approx(GRAVITY_M_S2, abs=0.1)
        assert np.abs(strength - strength.mean()).max() < 0.2
        assert three_rounds.gyr[middle].mean(axis=0) == pytest.approx(bias, abs=3e-4)


def test_a_long_walk_comes_from_its_seed():
    first, second, other = (long_walk(0.2, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.acc, second.acc)
    assert not np.array_equal(first.acc, other.acc)
