"""Plans: what they ask for, and one sentence for each that cannot be."""

import re
from pathlib import Path

import pyarrow as pa
import pytest

from fg_nav.errors import CampaignError
from fg_nav.io import write_canonical
from fg_nav.lab.campaign import folder as table
from fg_nav.lab.campaign.plan import read_plan
from fg_nav.lab.simulation import simulate
from tests.command_line import FgNav

GOOD = 'scenarios = ["demo"]\nseeds = 2\nmethods = ["iez", "smoother", "ma2018:physical"]\n'


def plan(folder: Path, text: str):
    path = folder / "plan.toml"
    path.write_text(text)
    return read_plan(path)


def test_a_plan_with_the_least_in_it(tmp_path):
    found = plan(tmp_path, GOOD)
    assert (found.fields, found.magnetometers, list(found.seeds)) == (("indoor",), ("loop",), [101, 102])
    assert found.methods == ("iez", "smoother", "ma2018:physical")
    assert list(plan(tmp_path, GOOD + "first_seed = 7").seeds) == [7, 8]
    assert list(plan(tmp_path, GOOD.replace("= 2", "= [5, 3, 5]")).seeds) == [5, 3]


def test_what_is_named_twice_is_made_once(tmp_path):
    found = plan(tmp_path, 'scenarios = ["demo", "demo"]\nseeds = 1\nmethods = ["iez", "iez:tuned", "iez"]\n')
    assert (found.scenarios, found.methods) == (("demo",), ("iez",))


def test_parameters_make_a_grid_of_a_method(tmp_path):
    found = plan(tmp_path, GOOD + '[parameters.smoother]\nmagnetic.rounds = [1, 2]\n"walk.floors" = [false, true]\n')
    assert found.methods == (
        "iez",
        "smoother,magnetic.rounds=1,walk.floors=false",
        "smoother,magnetic.rounds=1,walk.floors=true",
        "smoother,magnetic.rounds=2,walk.floors=false",
        "smoother,magnetic.rounds=2,walk.floors=true",
        "ma2018:physical",
    )


def test_parameters_of_a_preset_are_its_own_and_before_those_of_all(tmp_path):
    """`iez` is the preset `tuned`, whichever way it is written; its name alone is for all presets."""
    for written in ("iez", "iez:tuned"):
        text = f'scenarios = ["demo"]\nseeds = 1\nmethods = ["{written}", "iez:physical"]\n'
        text += '[parameters.iez]\ngravity = 9.8\nacc_density = 1.0\n[parameters."iez:tuned"]\ngravity = 9.7\n'
        assert plan(tmp_path, text).methods == (
            "iez,acc_density=1.0,gravity=9.7",
            "iez:physical,acc_density=1.0,gravity=9.8",
        )


def test_a_mark_before_the_text_is_no_part_of_it(tmp_path):
    """As editors of another system put it there."""
    (tmp_path / "plan.toml").write_text(GOOD, encoding="utf-8-sig")
    assert read_plan(tmp_path / "plan.toml") == plan(tmp_path, GOOD)


def test_parameters_of_a_method_go_to_its_presets_and_a_whole_number_is_a_real_one(tmp_path):
    text = 'scenarios = ["demo"]\nseeds = 1\nmethods = ["ma2018", "ma2018:physical"]\n'
    text += (
        '[parameters.ma2018]\ncompass_sigma_deg = [5, 5.0]\n[parameters."ma2018:physical"]\ninertial.smoothed=true\n'
    )
    assert plan(tmp_path, text).methods == (
        "ma2018,compass_sigma_deg=5.0",
        "ma2018:physical,compass_sigma_deg=5.0,inertial.smoothed=true",
    )


BAD = {
    "colour = 1\n" + GOOD: "no 'colour' in a plan",
    "": "nothing to walk on",
    "scenarios = []": "scenarios cannot be []",
    "scenarios = 'demo'": "give a list",
    GOOD.replace("demo", "moon"): "no scenario 'moon'",
    GOOD.replace("demo", "pocket-street"): "on no foot",
    GOOD.replace("demo", "at-rest"): "on no foot",
    GOOD.replace("seeds = 2", ""): "no seeds",
    GOOD.replace("= 2", "= -2"): "seeds cannot be",
    GOOD.replace("= 2", "= true"): "seeds cannot be",
    GOOD.replace("= 2", "= []"): "seeds cannot be",
    GOOD.replace("= 2", "= 10_000_000_000_000_000_000_000"): "seeds cannot be",
    GOOD.replace("= 2", "= 999_999_999"): "too many",
    GOOD.replace("= 2", "= 500_000"): "too many",
    GOOD.replace('"iez"', '"magic"'): "no method 'magic'",
    GOOD.replace('"iez"', '"pocket"'): "pocket",
    GOOD.replace('"iez"', '"iez:magic"'): "no preset 'magic'",
    GOOD.replace('"iez"', '"matched:as-printed"'): "no preset 'as-printed' of 'matched'",
    GOOD.replace('"iez"', '"smoother:physical"'): "smoother has no presets",
    GOOD.replace('"iez"', '"iez,gravity=9"'): "write [parameters.iez]",
    'scenarios = ["demo"]\nseeds = 1': "no methods",
    'fields = ["rough"]\n' + GOOD: "no field 'rough'",
    'magnetometers = ["best"]\n' + GOOD: "no magnetometer 'best'",
    'recordings = ["nowhere"]\n' + GOOD: "no folder",
    'recordings = ["empty"]\n' + GOOD: "holds no recordings",
    'recordings = ["walks", "other/walks"]\n' + GOOD: "two folders of recordings are named 'walks'",
    'recordings = ["walks"]\nmethods = ["iez"]\nseeds = 3': "of scenarios",
    GOOD + "parameters = 3": "write [parameters.METHOD]",
    GOOD + "[parameters]\niez = 3": "write [parameters.METHOD]",
    GOOD + "[parameters.aiez]\ngravity = 9.8": "'aiez', which is not among the methods",
    GOOD + "[parameters.smoother]\nmagic = 1": "no parameter 'magic'",
    GOOD + "[parameters.smoother]\nmagnetic.magic = 1": "no parameter 'magnetic.magic'",
    GOOD + "[parameters.smoother]\ngravity.magic = 1": "no parameter 'gravity.magic'",
    GOOD + "[parameters.smoother]\nmagnetic = 1": "has parts",
    GOOD + "[parameters.smoother]\nmagnetic.rounds = 1.5": "give a whole number",
    GOOD + "[parameters.smoother]\nmagnetic.rounds = []": "cannot be []",
    GOOD + "[parameters.smoother]\nwalk.floors = 1": "give true or false",
    GOOD + "[parameters.smoother]\ngravity = true": "give a number",
    GOOD + "[parameters.smoother]\ngravity = nan": "give a number",
    GOOD + f"[parameters.smoother]\ngravity = 1{'0' * 400}": "give a number",
    GOOD + "[parameters.smoother]\nmagnetic.gate = 'a/b'": "give one word",
    GOOD + "[parameters.smoother]\nknown_lever = 1": "cannot be 1",
    GOOD + "[parameters.smoother]\nknown_lever = [[1.0, 2.0, 3.0]]": "cannot be",
    GOOD + "[parameters.smoother]\nmagnetic.rounds = 1\n'magnetic.rounds' = [2, 3]": "is given twice",
    GOOD + '[parameters."iez:magic"]\ngravity = 9.8': "'iez:magic', which is not among the methods",
    GOOD + '[parameters."iez:physical"]\ngravity = 9.8': "'iez:physical', which is not among the methods",
    f'recordings = ["{"a" * 300}"]\n' + GOOD: "no folder",
    "seeds = = 3": "is no TOML",
    f"seeds = 1{'0' * 5000}": "too long",
    f"seeds = {'[' * 3000}{']' * 3000}": "too deep",
}


@pytest.mark.parametrize(("text", "words"), BAD.items(), ids=range(len(BAD)))
def test_each_bad_plan_has_its_sentence(tmp_path, text, words):
    for folder in ("empty", "walks", "other/walks"):
        (tmp_path / folder).mkdir(parents=True)
    for folder in ("walks", "other/walks"):
        (tmp_path / folder / "a.csv").write_text("nothing\n")
    with pytest.raises(CampaignError) as error:
        plan(tmp_path, text)
    said = str(error.value)
    assert words in said
    assert said.startswith("plan.toml")
    assert "\n" not in said
    assert said.endswith(".")


def test_a_plan_that_is_none(tmp_path, fg_nav: FgNav):
    assert fg_nav("lab", "campaign", tmp_path / "none.toml").refused("cannot be read", "none.toml")
    assert fg_nav("lab", "campaign", tmp_path).refused("cannot be read")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    assert fg_nav("lab", "campaign", tmp_path / "bytes.toml").refused("bytes.toml is no TOML")
    (tmp_path / "plan.toml").write_text(GOOD)
    assert fg_nav("lab", "campaign", tmp_path / "plan.toml", "--scheduler", "x", "--workers", 2).refused("--workers")


def test_the_page_has_a_plan_that_can_be_and_names_every_column(tmp_path):
    page = (Path(__file__).parents[3] / "docs" / "campaigns.md").read_text(encoding="utf-8")
    (tmp_path / "walks").mkdir()
    (tmp_path / "walks" / "one.csv").touch()
    found = plan(tmp_path, page.partition("```toml\n")[2].partition("```")[0])
    assert (len(found.methods), len(found.walks), len(found.seeds)) == (6, 1, 20)
    columns = {*table.results_schema(pa).names, *table.timings_schema(pa).names}
    told = {
        name for row in page.splitlines() if row.startswith("| `") for name in re.findall(r"`(\w+)`", row.split("|")[1])
    }
    assert columns <= told
    assert told - columns == set()


def test_folders_of_recordings_are_found_from_where_the_file_is(tmp_path):
    (tmp_path / "walks").mkdir()
    write_canonical(simulate("demo", 1).recording, tmp_path / "walks" / "one.csv")
    found = plan(tmp_path, 'recordings = ["walks"]\nmethods = ["iez"]\n')
    assert [(walk.group, walk.name) for walk in found.walks] == [("walks", "one.csv")]
    assert not list(found.seeds)
