"""The script of the verdicts: recordings are spoiled as they say, judged, and counted."""

import pickle
from functools import partial

import numpy as np
import pytest

from tests.scripts import load_script

verdicts = load_script("verdicts")


@pytest.fixture(scope="module")
def simulated():
    return verdicts._simulate(verdicts.FIRST_SEED)


def test_spoiled_as_they_say(simulated):
    clipped = verdicts.clip(simulated, 0.5)
    assert np.abs(clipped.gyr).max() == pytest.approx(0.5 * np.abs(simulated.gyr).max())
    thin = verdicts.thin_out(simulated, 20.0)
    assert np.median(np.diff(thin.t)) == pytest.approx(0.05, rel=1e-3)
    swapped = verdicts.turn_gyr(simulated, np.eye(3)[[1, 0, 2]])
    assert np.array_equal(swapped.gyr[:, 0], simulated.gyr[:, 1])


def test_a_loose_sensor_keeps_its_physics(simulated):
    """The gyroscope turns with the sensor: what it integrates to differs by no more than the slack."""
    loose = verdicts.loosen(simulated, 1)
    np.testing.assert_allclose(np.linalg.norm(loose.acc, axis=1), np.linalg.norm(simulated.acc, axis=1))
    turned = ((loose.gyr - simulated.gyr)[:-1] * np.diff(simulated.t)[:, None]).sum(axis=0)
    assert np.linalg.norm(turned) < 20 * verdicts.SLACK_RAD
    assert np.abs(loose.gyr - simulated.gyr).max() > 0.5


def test_good_ones_are_to_be_trusted_and_others_not(simulated, capsys):
    cases = [
        verdicts.Case(verdicts.GOOD, "a", lambda: simulated),
        verdicts.Case("clipped", "b", partial(verdicts.clip, simulated, 0.5)),
        verdicts.Case("wrong axes", "c", partial(verdicts.turn_gyr, simulated, -np.eye(3))),
    ]
    judged = [verdicts.judge_case(case, "iez") for case in cases]
    assert [one.word == "trusted" for one in judged] == [True, False, False]
    verdicts.print_paths("iez", judged, per_walk=False)
    assert all(figure.mark == "ok" for figure in verdicts.check_paths("iez", judged))
    out = capsys.readouterr().out
    assert "wrong axes" in out
    assert "good, a" not in out


def test_every_case_can_go_to_another_process(tmp_path):
    (tmp_path / "vicon").mkdir()
    for day in range(1, 21):
        (tmp_path / "vicon" / f"2017-11-{day:02d}.mat").touch()
    cases = verdicts.list_cases(tmp_path)
    assert {"loose", "clipped", "wrong axes"} <= {case.kind for case in cases}
    assert [case.name for case in pickle.loads(pickle.dumps(cases))] == [case.name for case in cases]
