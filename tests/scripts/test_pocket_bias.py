"""The script on the bias in a pocket: what it measures, and that it runs."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.lab.simulation import Choices, simulate
from tests.scripts import load_script

pocket_bias = load_script("pocket_bias")


def found(error):
    return pocket_bias.Found(np.asarray(error, dtype=float), 0.0, 3.0)


def test_found_is_for_good():
    assert found([0.1, 0.01, 0.03, 0.02, -0.01]).found_s == 3.0
    assert found([0.0, 0.01]).found_s == 0.0
    assert math.isinf(found([0.0, 0.01, 0.021]).found_s)


def test_the_excess_is_of_medians_and_after_a_minute():
    quiet, loud = np.full(100, 0.01), np.full(100, 0.02)
    ours, theirs = quiet.copy(), loud.copy()
    ours[30], ours[70] = 1.0, 0.05
    above, when = pocket_bias.above_paper([found(ours), found(-ours), found(ours)], [found(theirs)])
    assert above == pytest.approx(0.03)
    assert when == 70.0


def test_the_bound_is_that_of_a_straight_line_or_of_the_gyroscope():
    line = pocket_bias.upright_bound(60.0, 25.0, 0.5, 1e-9)
    assert line == pytest.approx(math.degrees(0.02) * math.sqrt(12 / (100 * 60.0**3)), rel=0.02)
    assert pocket_bias.upright_bound(60.0, 25.0, 1e-6, 0.01) == pytest.approx(0.01 / math.sqrt(59.0), rel=0.01)


def test_it_runs_and_says_what_is_asked(monkeypatch, capsys):
    """On one minute in the pocket instead of 39, in one field."""

    def short(_name, seed, _choices=None):
        chosen = Choices(worn="pocket", sensor="munoz-diaz-table-2", field="homogeneous", aligned=True)
        return simulate("demo", seed, chosen)

    monkeypatch.setattr(pocket_bias, "simulate", short)
    monkeypatch.setattr(pocket_bias, "FIELDS", ("munich",))
    one = pocket_bias.find_biases(1, 0.5)["munich"]
    assert set(one) == set(pocket_bias.methods_at(0.5))
    assert abs(one["batch"].error[-1]) < 0.02
    assert abs(one["batch"].yaw_deg) < 3.0
    long = {m: [replace(f, error=np.resize(f.error, 200))] for m, f in one.items()}
    pocket_bias.print_errors("munich", long)
    pocket_bias.print_ends(long)
    figures = pocket_bias.judge_field("munich", long)
    assert [f.high for f in figures if "yaw" in f.name] == [3.0, 3.0]
    assert "quarter" in capsys.readouterr().out
