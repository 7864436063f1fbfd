"""What a plan tells of the user's own: scenarios in files, and how recordings are read."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.calibration.of_recording import Calibration, write_calibration
from fg_nav.errors import CampaignError
from fg_nav.io import write_canonical
from fg_nav.lab.campaign.execute import run_task
from fg_nav.lab.campaign.plan import read_plan
from fg_nav.lab.campaign.walks import NONE, RAW, Simulated, pack, simulate_calibration
from fg_nav.lab.simulation import simulate

WALK = 'like = "demo"\n[course]\npoints_m = [[0, 0], [0, 25]]\n'
PLAN = 'scenarios = ["demo", "walks/my walk.toml"]\nseeds = 1\nmethods = ["iez"]\nmagnetometers = ["raw"]\n'
RECORDED = 'recordings = ["walks"]\nmethods = ["ma2018"]\nmagnetometers = ["loop", "perfect", "walk", "raw", "none"]\n'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "walks").mkdir()
    (tmp_path / "walks" / "my walk.toml").write_text(WALK)
    return tmp_path


def plan(folder, text):
    (folder / "plan.toml").write_text(text)
    return read_plan(folder / "plan.toml")


def tasks(found):
    """Everything, as it comes to a worker."""
    keys = found.list_keys()
    packed = [replace(task, source=pack(task.source)) for task in found.tasks(keys, found.settings(keys))]
    return pickle.loads(pickle.dumps(packed))


def settings(found):
    return list(found.settings(found.list_keys()).values())


def test_a_scenario_of_a_file_is_walked(folder):
    more = tasks(plan(folder, PLAN.replace("seeds = 1", "seeds = 3")))
    assert [task.source.seed for task in more] == 2 * [101, 102, 103]
    found = plan(folder, PLAN)
    assert found.scenarios == ("demo", "my walk.toml")
    _, own = tasks(found)
    [result] = run_task(own).results
    assert (result.key.group, result.failed) == ("my walk.toml", "")
    ends = np.array(result.truth)[[0, -1]]
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(25.0, abs=1.0)
    assert result.errors["origin"].end_m < 1.0


@pytest.mark.parametrize(
    ("was", "becomes"), [("25]", "26]"), ('"demo"', '"mall"'), ("[course]", "[course]\npace = 1.1")]
)
def test_a_scenario_that_changed_makes_other_results(folder, was, becomes):
    builtin, before = settings(plan(folder, PLAN))
    (folder / "walks" / "my walk.toml").write_text(f"# the same\n{WALK}")
    assert settings(plan(folder, PLAN)) == [builtin, before]
    (folder / "walks" / "my walk.toml").write_text(WALK.replace(was, becomes))
    same, after = settings(plan(folder, PLAN))
    assert same == builtin
    assert after != before


def test_without_a_magnetometer_there_is_no_field():
    walk = Simulated("demo", "smooth", 101)
    assert walk.prepare(RAW).field is not None
    assert walk.prepare(NONE).field is None


def test_recordings_are_read_as_told_and_a_calibration_is_their_loop(folder):
    recording = simulate("demo", 101).recording
    write_canonical(recording, folder / "walks" / "one.csv")
    before = settings(plan(folder, RECORDED))
    assert [key.magnetometer for key in plan(folder, RECORDED).list_keys()] == ["walk", "raw", "none"]
    write_calibration(folder / "foot.json", simulate_calibration("demo", 101))
    told = f'{RECORDED}[reading.walks]\nformat = "canonical"\ncalibration = "foot.json"\n'
    found = plan(folder, told)
    assert [key.magnetometer for key in found.list_keys()] == ["loop", "walk", "raw", "none"]
    [sent] = tasks(found)
    (folder / "foot.json").unlink()  # a worker may have another disk
    by_name = {one.key.magnetometer: one for one in run_task(sent).results}
    by_calibration, by_itself = (
        {name for name, one in by_name.items() if any(words in note for note in one.notes)}
        for words in ("corrected by the calibration", "corrected by the walk itself")
    )
    assert "loop" in by_calibration
    assert not {"raw", "none"} & by_calibration
    assert "raw" in by_itself
    assert not {"loop", "none"} & by_itself
    assert [name for name, one in by_name.items() if one.failed] == ["none"]
    assert "needs a magnetometer that is used" in by_name["none"].failed
    with_file, walk = [sent.missing[name]["ma2018"] for name in ("loop", "walk")]
    assert with_file["magnetometer"]["magnetometer"]
    assert walk == before[0] | {"format": "canonical"}


def test_a_wrong_format_is_told_by_the_result(folder):
    write_canonical(simulate("demo", 101).recording, folder / "walks" / "one.csv")
    [sent] = tasks(plan(folder, 'recordings = ["walks"]\nmethods = ["iez"]\n[reading.walks]\nformat = "broad"\n'))
    assert "so it cannot be 'broad'" in run_task(sent).results[0].failed


BAD = {
    PLAN.replace("my walk", "none"): "none.toml cannot be read",
    PLAN.replace("my walk", "bad"): "bad.toml: it has no table [course]",
    PLAN.replace("my walk", "pocket"): "on no foot",
    PLAN.replace('"demo"', '"my walk.toml"'): "two scenarios are named 'my walk.toml'",
    f"{RECORDED}reading = 3": "write [reading.FOLDER]",
    f"{RECORDED}[reading]\nformat = 'xio'": "write [reading.FOLDER]",
    f"{RECORDED}[reading.others]\nformat = 'xio'": "'others', which is no folder of recordings",
    f"{RECORDED}[reading.walks]\ncolour = 'red'": "no 'colour' in reading.walks",
    f"{RECORDED}[reading.walks]\nformat = 3": "format of reading.walks cannot be 3",
    f"{RECORDED}[reading.walks]\nformat = 'tum'": "no format 'tum'",
    f"{RECORDED}[reading.walks]\ncalibration = 'none.json'": "none.json does not exist",
    f"{RECORDED}[reading.walks]\ncalibration = 'empty.json'": "empty.json has no magnetometer",
}


@pytest.mark.parametrize(("text", "words"), BAD.items(), ids=range(len(BAD)))
def test_each_bad_plan_has_its_sentence(folder, text, words):
    (folder / "my walk.toml").write_text(WALK)
    (folder / "walks" / "bad.toml").write_text("")
    (folder / "walks" / "pocket.toml").write_text(f'worn = "pocket"\n{WALK}')
    (folder / "walks" / "one.csv").write_text("x\n")
    write_calibration(folder / "empty.json", Calibration())
    with pytest.raises(CampaignError) as error:
        plan(folder, text)
    said = str(error.value)
    assert words in said
    assert said.startswith("plan.toml")
    assert said.endswith(".")
    assert "\n" not in said
