"""Plans and their methods: what they ask for, and one sentence for each that cannot be."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.calibration.of_recording import Calibration, write_calibration
from fg_nav.errors import CampaignError
from fg_nav.io import write_canonical
from fg_nav.lab.campaign import command as table
from fg_nav.lab.campaign.execute import parameters_of, run_task, settings_of, tasks_of
from fg_nav.lab.campaign.methods import Method, method_of, solve_by
from fg_nav.lab.campaign.plan import read_plan
from fg_nav.lab.campaign.walks import NONE, RAW, Recorded, Simulated, simulate_calibration
from fg_nav.lab.simulation import simulate
from fg_nav.lab.store.results import Key

GOOD = 'scenarios = ["demo"]\nseeds = 2\nmethods = ["iez", "smoother", "ma2018:physical"]\n'
OWN = 'like = "demo"\n[course]\npoints_m = [[0, 0], [0, 25]]\n'
RECORDED = 'recordings = ["walks"]\nmethods = ["ma2018"]\nmagnetometers = ["loop", "perfect", "walk", "raw", "none"]\n'


def plan(folder: Path, text: str):
    path = folder / "plan.toml"
    path.write_text(text)
    return read_plan(path)


def settings(found):
    return list(found.settings().values())


def column(found, name):
    """What its results have of a word of their key, each once."""
    return list(dict.fromkeys(getattr(key, name) for key in found.keys))


def test_a_plan_with_the_least_in_it(tmp_path):
    found = plan(tmp_path, GOOD)
    assert [column(found, name) for name in ("field", "magnetometer", "walk")] == [["indoor"], ["loop"], ["101", "102"]]
    assert column(found, "method") == ["iez", "smoother", "ma2018:physical"]
    assert column(plan(tmp_path, GOOD.replace("seeds", "first_seed = 7\nseeds")), "walk") == ["7", "8"]
    assert column(plan(tmp_path, GOOD.replace("= 2", "= [5, 3, 5]")), "walk") == ["5", "3"]
    twice = plan(tmp_path, 'scenarios = ["demo", "demo"]\nseeds = 1\nmethods = ["iez", "iez:tuned", "iez"]\n')
    assert twice.keys == [Key("demo", "indoor", "101", "loop", "iez")]
    (tmp_path / "plan.toml").write_text(GOOD, encoding="utf-8-sig")
    assert read_plan(tmp_path / "plan.toml") == found


GRIDS = {
    '["iez", "smoother"]\n[parameters.smoother]\nmagnetic.rounds = [1, 2]\n"walk.floors" = [false, true]\n': (
        "iez",
        *(f"smoother,magnetic.rounds={k},walk.floors={word}" for k in (1, 2) for word in ("false", "true")),
    ),
    # Those of a preset are before those of all; `iez` is the preset `tuned`, and its name alone is for all presets.
    **{
        f'["{word}", "iez:physical"]\n[parameters.iez]\ngravity = 9.8\nacc_density = 1.0\n[parameters."iez:tuned"]\n'
        "gravity = 9.7\n": ("iez,acc_density=1.0,gravity=9.7", "iez:physical,acc_density=1.0,gravity=9.8")
        for word in ("iez", "iez:tuned")
    },
    # A whole number is a real one.
    '["ma2018", "ma2018:physical"]\n[parameters.ma2018]\ncompass_sigma_deg = [5, 5.0]\n'
    '[parameters."ma2018:physical"]\ninertial.smoothed=true\n': (
        "ma2018,compass_sigma_deg=5.0",
        "ma2018:physical,compass_sigma_deg=5.0,inertial.smoothed=true",
    ),
}


def test_parameters_make_a_grid_of_a_method(tmp_path):
    for text, methods in GRIDS.items():
        found = plan(tmp_path, f'scenarios = ["demo"]\nseeds = 1\nmethods = {text}')
        assert column(found, "method") == list(methods)


BAD = {
    "colour = 1\n" + GOOD: "the file has no parameter 'colour': it knows scenarios, fields",
    "": "nothing to walk on",
    "scenarios = 'demo'": "scenarios cannot be 'demo': give a valid array",
    GOOD.replace("demo", "moon"): "no scenario 'moon'",
    GOOD.replace("seeds = 2", ""): "no seeds",
    GOOD.replace("= 2", "= true"): "cannot be True",
    GOOD.replace("= 2", "= [2]\nfirst_seed = 3"): "leave it out",
    GOOD.replace("= 2", "= 999_999_999"): "too many",
    GOOD.replace('"iez"', '"magic"'): "no method 'magic'",
    GOOD.replace('"iez"', '"iez:magic"'): "no preset 'magic'",
    GOOD.replace('"iez"', '"smoother:physical"'): "smoother has no presets",
    GOOD.replace('"iez"', '"iez,gravity=9"'): "write [parameters.iez]",
    'scenarios = ["demo"]\nseeds = 1': "no methods",
    'fields = ["rough"]\n' + GOOD: "no field 'rough'",
    'magnetometers = ["best"]\n' + GOOD: "no magnetometer 'best'",
    f'recordings = ["{"a" * 300}"]\n' + GOOD: "no folder",
    'recordings = ["empty"]\n' + GOOD: "holds no recordings",
    'recordings = ["walks", "other/walks"]\n' + GOOD: "two folders of recordings are named 'walks'",
    'recordings = ["walks"]\nmethods = ["iez"]\nseeds = 3': "of scenarios",
    'recordings = ["one"]\nmethods = ["iez"]': "'w/v.csv' of 'one' and 'w~v.csv' of 'one' would be kept in one file",
    'recordings = ["case"]\nmethods = ["iez"]': "'V.csv' of 'case' and 'v.csv' of 'case' would be kept in one file",
    GOOD + "[parameters]\niez = 3": "parameters.iez cannot be 3: give an object",
    GOOD + '[parameters."iez:physical"]\ngravity = 9.8': "'iez:physical', which is not among the methods",
    GOOD + "[parameters.smoother]\nmagnetic.magic = 1": "no parameter 'magnetic.magic'",
    GOOD + "[parameters.smoother]\nmagnetic.rounds = 1.5": "give a whole number",
    GOOD + "[parameters.smoother]\nmagnetic.gate = 'a/b'": "give one word",
    GOOD + "[parameters.smoother]\nknown_lever = [[1.0, 2.0, 3.0]]": "cannot be",
    GOOD + "[parameters.smoother]\nmagnetic.rounds = 1\n'magnetic.rounds' = [2, 3]": "is given twice",
    "seeds = = 3": "is no TOML",
    f"seeds = 1{'0' * 5000}": "too long",
    f"seeds = {'[' * 3000}{']' * 3000}": "too deep",
    GOOD.replace("demo", "none.toml"): "none.toml cannot be read",
    GOOD.replace("demo", "bad.toml"): "bad.toml: it has no table [course]",
    GOOD.replace("demo", "pocket.toml"): "on no foot",
    GOOD.replace('"demo"', '"own.toml", "walks/own.toml"'): "two scenarios are named 'own.toml'",
    f"{RECORDED}[reading.others]\nformat = 'xio'": "'others', which is no folder of recordings",
    f"{RECORDED}[reading.walks]\ncolour = 'red'": "reading.walks has no parameter 'colour': it knows format",
    f"{RECORDED}[reading.walks]\nformat = 'tum'": "no format 'tum'",
    f"{RECORDED}[reading.walks]\ncalibration = 'none.json'": "none.json does not exist",
    f"{RECORDED}[reading.walks]\ncalibration = 'empty.json'": "empty.json has no magnetometer",
}


def test_each_bad_plan_has_its_sentence(tmp_path):
    for folder in ("empty", "walks", "other/walks", "one/w", "case"):
        (tmp_path / folder).mkdir(parents=True)
    for name, text in {
        "walks/a.csv": "x\n", "other/walks/a.csv": "x\n", "own.toml": OWN, "walks/own.toml": OWN, "bad.toml": "",
        "one/w/v.csv": "x\n", "one/w~v.csv": "x\n", "case/v.csv": "x\n", "case/V.csv": "x\n",
        "pocket.toml": f'worn = "pocket"\n{OWN}',
    }.items():  # fmt: skip
        (tmp_path / name).write_text(text)
    write_calibration(tmp_path / "empty.json", Calibration())
    for text, words in BAD.items():
        with pytest.raises(CampaignError) as error:
            plan(tmp_path, text)
        said = str(error.value)
        assert words in said, text[:300]
        assert said.startswith("plan.toml")
        assert said.endswith(".")
        assert "\n" not in said

    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for name, words in (("none.toml", "cannot be read"), (".", "cannot be read"), ("bytes.toml", "is no TOML")):
        with pytest.raises(CampaignError, match=words):
            read_plan(tmp_path / name)


def test_the_page_has_a_plan_that_can_be_and_names_every_column(tmp_path):
    page = (Path(__file__).parents[3] / "docs" / "campaigns.md").read_text(encoding="utf-8")
    (tmp_path / "walks").mkdir()
    (tmp_path / "walks" / "one.csv").touch()
    found = plan(tmp_path, page.partition("```toml\n")[2].partition("```")[0])
    assert len(column(found, "method")) == 6
    assert column(found, "walk") == [*(str(seed) for seed in range(101, 121)), "one.csv"]
    rows = [row for row in page.splitlines() if row.startswith("| `")]
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])} == {
        *table.COLUMNS,
        *table.TIMING_COLUMNS,
    }


# --- files of the user's own -----------------------------------------------------------------------------------------


def test_a_scenario_of_a_file_is_walked_and_makes_others_when_it_changes(tmp_path):
    (tmp_path / "my walk.toml").write_text(OWN)
    text = 'scenarios = ["demo", "my walk.toml"]\nseeds = 1\nmethods = ["iez"]\nmagnetometers = ["raw"]\n'
    found = plan(tmp_path, text)
    assert column(found, "group") == ["demo", "my walk.toml"]
    _, own = tasks_of(found.settings(), found.find_source)
    [result] = run_task(own)
    assert (result.key.group, result.failed) == ("my walk.toml", "")
    (x0, y0), (x1, y1) = result.truth[0], result.truth[-1]
    assert ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5 == pytest.approx(25.0, abs=1.0)
    assert result.errors["origin"].end_m < 1.0
    builtin, before = settings(found)
    for text_of, same in (
        (f"# the same\n{OWN}", True),
        (OWN.replace("25]", "26]"), False),
        (OWN.replace('"demo"', '"mall"'), False),
        (OWN.replace("[course]", "[course]\npace = 1.1"), False),
    ):
        (tmp_path / "my walk.toml").write_text(text_of)
        assert settings(plan(tmp_path, text))[0] == builtin
        assert (settings(plan(tmp_path, text))[1] == before) == same


def test_recordings_are_read_as_asked_and_a_calibration_is_their_loop(tmp_path):
    (tmp_path / "walks").mkdir()
    write_canonical(simulate("demo", 101).recording, tmp_path / "walks" / "one.csv")
    before = plan(tmp_path, RECORDED)
    assert [key.magnetometer for key in before.keys] == ["walk", "raw", "none"]
    write_calibration(tmp_path / "foot.json", simulate_calibration("demo", 101))
    found = plan(tmp_path, f'{RECORDED}[reading.walks]\nformat = "canonical"\ncalibration = "foot.json"\n')
    asked = found.settings()
    by_name = {key.magnetometer: of for key, of in asked.items()}
    assert list(by_name) == ["loop", "walk", "raw", "none"]
    assert by_name["loop"]["magnetometer"]["magnetometer"]
    assert by_name["walk"] == settings(before)[0] | {"format": "canonical"}
    # The calibration goes with the task.
    [task] = tasks_of(asked, found.find_source)
    (tmp_path / "foot.json").unlink()
    notes = {one.key.magnetometer: "; ".join(one.notes) for one in run_task(task) if not one.failed}
    assert set(notes) == {"loop", "walk", "raw"}
    assert "corrected by the calibration" in notes["loop"]
    assert "corrected by the walk itself" in notes["raw"]
    wrong = plan(tmp_path, 'recordings = ["walks"]\nmethods = ["iez"]\n[reading.walks]\nformat = "broad"\n')
    [task] = tasks_of(wrong.settings(), wrong.find_source)
    assert "so it cannot be 'broad'" in run_task(task)[0].failed


# --- methods ---------------------------------------------------------------------------------------------------------


def test_parameters_reach_filter_and_smoother_and_the_settings():
    for word in ("iez", "iez:physical", "smoother,magnetic.gate=ma2018,magnetic.rounds=3,gravity=9.8"):
        assert method_of(word).word == word
    prepared = Simulated("demo", "smooth", 101).prepare(RAW)
    assert prepared.field is not None
    assert Simulated("demo", "smooth", 101).prepare(NONE).field is None
    walk = replace(prepared, truth=None)
    plain, other = (solve_by(word, walk).solution for word in ("ma2018", "ma2018,inertial.zero_velocity_density=0.5"))
    assert plain.parameters["inertial"]["zero_velocity_density"] != 0.5
    assert other.parameters["inertial"]["zero_velocity_density"] == 0.5
    assert abs(other.stances.position - plain.stances.position).max() > 1e-3
    smoothed = solve_by("inertial,roll_sigma_m=0.5", walk).solution
    assert (smoothed.method, smoothed.parameters["roll_sigma_m"]) == ("inertial", 0.5)
    assert "changes" not in parameters_of("iez")
    one, two = (parameters_of(f"iez,gravity={value}") for value in (9.7, 9.8))
    assert one["changes"] == {"gravity": 9.7}
    assert one["changed"] == two["changed"] == parameters_of("iez")
    key = Key("demo", "smooth", "101", "loop", "iez")
    assert settings_of(key, Recorded(Path("a.csv")))["walk"] == {"a.csv": ""}


def test_results_have_files_of_their_own():
    plain = Key("demo", "smooth", "101", "loop", "iez:physical")
    assert plain.file == "demo_smooth_loop_iez-physical_101.json"
    words = [Method("iez", "physical", (("gravity", value),)).word for value in (9.8, 9.81)]
    assert len({replace(plain, method=word).file for word in words} | {plain.file}) == 3
    long = [replace(plain, walk="x" * 240 + end).file for end in ("a", "b")]
    assert long[0] != long[1]
    assert max(map(len, long)) < 220
    assert "/" not in replace(plain, walk="folder/a b.csv").file
