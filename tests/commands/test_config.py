"""`--config` and `--preset` choose parameters, `--set` changes them; several recordings are one call."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from fg_nav.commands import config
from fg_nav.commands.shared import Answer, answer_each
from fg_nav.ekf.presets import AS_PRINTED, GATED, NOT_RUN, PHYSICAL, PRESETS, TUNED, TUNED_PARAMETERS, find_parameters
from fg_nav.errors import ConfigError, EstimationError
from fg_nav.estimators import METHODS, choose_parameters
from fg_nav.magnetic.detectors import Detector
from fg_nav.pipeline import navigate, prepare_walk, run_method
from fg_nav.smoother import SmootherParameters
from fg_nav.text import Changes, change_parameters
from fg_nav.walk import Options, Walk
from tests.command_line import FgNav, names
from tests.commands.folders import read_json, summary
from tests.commands.recordings import recorded, recording


def test_a_configuration_gives_the_same_result(fg_nav: FgNav) -> None:
    settings = ("--set", "qsf.inertial.acc_density=0.03", "--set", "detector.threshold=2e4")
    given = ("--plots", "none", "--method", "qsf", "--preset", "physical", "--heading", "40", *settings)
    fg_nav("run", recorded("part"), *given, "--out", "first").succeeded()
    ran = fg_nav("run", recorded("part"), "--config", "first/config.json", "--plots", "none", "--out", "again")
    assert (ran.code, ran.err) == (0, "")
    for name in ("trajectory.tum", "strides.csv", "config.json"):
        assert Path("first", name).read_text() == Path("again", name).read_text()
    effective = read_json("again", "config.json")
    assert effective["parameters"]["inertial"]["acc_density"] == 0.03
    assert effective["detector"]["threshold"] == 2e4
    # Options and --set win over it, and another recording does not take the heading of this one.
    elsewhere = Path("other.csv")
    elsewhere.write_bytes(recorded("part").read_bytes())
    words = ("--config", "first/config.json", "--alignment", "se3", "--set", "qsf.inertial.acc_density=0.04", "--plots")
    ran = fg_nav("run", elsewhere, *words, "none", "--out", "third")
    assert ran.err == f"note: the configuration is of {recorded('part')}: its heading left out for other.csv\n"
    other = read_json("third", "config.json")
    assert other["parameters"]["inertial"]["acc_density"] == 0.04
    assert (other["alignment"], other["heading_deg"]) == ("se3", None)


def test_several_recordings_are_one_table_and_a_bad_one_stops_no_other(fg_nav: FgNav) -> None:
    Path("broken.csv").write_text("time_s,acc_x_m_s2\n")
    Path("part.csv").write_bytes(recorded("part").read_bytes())
    files = (recorded("part"), "broken.csv", "part.csv", recorded("part"))
    ran = fg_nav("run", *files, "--method", "iez", "--plots", "none", "--out", "out")
    assert ran.code == 1
    assert names(Path("out")) == {"part-iez", "part-2-iez"}
    assert ran.err.startswith("fg-nav: 1 of 3 recordings failed. broken.csv")
    assert [line.split()[0] for line in ran.out.splitlines()] == ["recording", str(files[0]), "broken.csv", "part.csv"]
    assert fg_nav("run", "missing.csv", "part.csv", "--method", "iez", "--plots", "none", "--out", "more").code == 1
    assert names(Path("more")) == {"part-iez"}
    ran = fg_nav("inspect", *files, "--json")
    assert ran.code == 1
    found = json.loads(ran.out)
    assert [one.get("usable") for one in found] == [True, None, True]
    assert found[1]["error"] in json.loads(ran.err)["error"]


def test_a_disk_that_fails_at_one_recording_stops_no_other() -> None:
    def answer(path: Path) -> Answer:
        if path.name == "a.csv":
            raise OSError("no space left on device")
        return Answer({"usable": True}, lambda: None)

    found = answer_each([Path("a.csv"), Path("b.csv")], answer, [])
    assert found.content == [{"recording": "a.csv", "error": "no space left on device"}, {"usable": True}]
    assert "a.csv: no space left" in str(found.failure)


def choose(known: config.Config | None, words: Sequence[str], methods: Sequence[str], preset: str = "tuned") -> Changes:
    """Parameters that a configuration and `--set` change in these methods."""
    return config.choose_changes(known, words, [METHODS["foot"][name] for name in methods], "foot", preset)


def test_settings_have_the_types_of_the_parameters() -> None:
    words = ["smoother.known_lever=[0, 0.1, 0.2]", "smoother.acc_density=1", "detector.threshold=null"]
    changes = choose(None, words, ["inertial"])
    assert changes == (
        ("smoother.known_lever", [0, 0.1, 0.2]),
        ("smoother.acc_density", 1),
        ("detector.threshold", None),
    )
    lever = config.select_changes(changes, "smoother")
    assert change_parameters(config.find_parameters("smoother"), lever).known_lever == (0.0, 0.1, 0.2)
    detector = config.find_parameters("ma2018").detector
    content = [{"name": one.name, "sigma": 1, "matters": 2.0} for one in detector.channels]
    changed = change_parameters(detector, (("channels", content),))
    assert isinstance(changed, Detector)
    assert [one.sigma for one in changed.channels] == [1.0] * len(content)
    assert not [name for name in config.list_settings("iez") if not name.startswith("iez.")]
    with pytest.raises(ConfigError, match=r"no parameter 'detector.threshold'"):
        choose(None, ["detector.threshold=1"], ["online"])


def test_changes_from_python_are_checked_as_on_the_command_line() -> None:
    for name, said in {"magnetic.differential": "the nearest is", "smoother.magnetic": "has parts"}.items():
        with pytest.raises(EstimationError, match=said):
            navigate(recording("part"), "iez", options=Options(changes=((name, False),)))


def test_card_has_compass_and_differential_field_alone(fg_nav: FgNav) -> None:
    set_all = (("smoother.magnetic.potential", True), ("smoother.acc_density", 0.02))
    found = choose_parameters(Options(magnetic="card", changes=set_all))
    assert found == METHODS["foot"]["card"].parameters(Options(changes=set_all), None)
    assert (found.magnetic.compass, found.magnetic.differential, found.acc_density) == (True, True, 0.02)
    assert (found.magnetic.potential, found.walk.places) == (False, False)
    fg_nav("run", recorded("part"), "--magnetic", "card", "--plots", "none", "--out", "one").succeeded()
    said, written = summary("one"), read_json("one", "config.json")
    assert (said["method"], written["given"]["magnetic"]) == ("smoother", "card")
    assert said["graph"]["field_potential"] == 0
    assert said["graph"]["magnetic_heading"] > 0
    # What it leaves out is not taken from its configuration by the smoother.
    known = config.read_config(Path("one/config.json"))
    changes = config.select_changes(choose(known, (), ["smoother"]), "smoother")
    assert change_parameters(SmootherParameters(), changes).magnetic.potential
    assert fg_nav("run", recorded("part"), "--method", "iez", "--magnetic", "card").code == 1


GIVEN = {
    "method": "iez", "mount": "foot", "preset": "tuned", "gate": "ma2018", "magnetic": "all", "use_magnetometer": True,
    "mag_axes": None, "calibration": None, "alignment": "yaw", "polish": False, "step_constant_m": None,
    "heading_deg": 3, "known_distance_m": None, "fixes": None, "truth": "t.tum", "detector": {},
    "parameters": {"acc_density": 1.0},
}  # fmt: skip


def written(path: Path, **changes: object) -> Path:
    path.write_text(json.dumps({"recording": "a.csv", "more": 1, "given": GIVEN | changes}))
    return path


def test_a_configuration_is_checked(tmp_path: Path) -> None:
    path = tmp_path / "config.json"
    known = config.read_config(written(path))
    assert choose(known, [], ["iez-rts"]) == (("iez.acc_density", 1.0),)
    own = known.bind(Options(heading_deg=7.0), Path("a.csv"))
    assert (own.heading_deg, own.truth_path) == (7.0, Path("t.tum"))
    assert known.bind(Options(), Path("b.csv")) == Options()
    with pytest.raises(ConfigError, match="of iez, not of smoother"):
        choose(known, [], ["smoother"])
    with pytest.raises(ConfigError, match="leave --preset out"):
        choose(known, [], ["iez"], preset="physical")
    with pytest.raises(EstimationError, match="the nearest is 'acc_density'"):
        choose(config.read_config(written(path, parameters={"acc_dens": 1.0})), [], ["iez"])
    for content in ({"mount": "hand"}, {"magic": 1}, {"polish": 1}):
        with pytest.raises(ConfigError, match=r"config.json is no config.json of a result \(given"):
            config.read_config(written(path, **content))
    with pytest.raises(ConfigError, match="more than 8 mib"):
        config.read_config(Path("/dev/zero"))
    with pytest.raises(ConfigError, match="cannot be read"):
        config.read_config(tmp_path / "none.json")
    path.write_text("{")
    with pytest.raises(ConfigError, match="Invalid JSON"):
        config.read_config(path)


# --- presets ---------------------------------------------------------------------------------------------------------


FILTERS = ("iez", *GATED, "aiez")


@pytest.fixture(scope="module")
def prepared() -> Walk:
    return prepare_walk(Walk.of(recording("half")))


@pytest.mark.parametrize("method", FILTERS)
def test_each_filter_runs_in_each_preset_by_default_as_tuned(prepared: Walk, method: str) -> None:
    assert find_parameters(method) == find_parameters(method, TUNED)
    assert (find_parameters(method, TUNED) == find_parameters(method, PHYSICAL)) == (method not in TUNED_PARAMETERS)
    ends = set()
    for preset in PRESETS:
        outcome = run_method(replace(prepared, options=replace(prepared.options, preset=preset)), method)
        said = preset == AS_PRINTED and method in NOT_RUN
        assert (NOT_RUN.get(method) in outcome.solution.notes) == said
        ends.add(tuple(outcome.solution.position[-1]))
    assert len(ends) >= 2


def test_compare_takes_filters_beside_the_smoother_and_says_what_of_a_preset_is_not_run(fg_nav: FgNav) -> None:
    words = ("--methods", "smoother,ma2018,aiez", "--preset", "as-printed", "--plots", "none", "--out", "out")
    fg_nav("compare", recorded("half"), *words).succeeded()
    ma, aiez = (read_json(f"out/{name}", "config.json")["parameters"] for name in ("ma2018", "aiez"))
    assert ma["levelled_by_force"] is aiez["hdr_as_printed"] is True
    assert NOT_RUN["ma2018"] in summary("out/ma2018")["notes"]


def test_unknown_filters_and_presets_are_refused() -> None:
    with pytest.raises(EstimationError, match=r"no preset 'physical' of 'smoother': .*aiez, matched"):
        find_parameters("smoother", PHYSICAL)
    with pytest.raises(EstimationError, match=r"no preset 'as-printed' of 'matched-rts': .*aiez\."):
        find_parameters("matched-rts", AS_PRINTED)
    with pytest.raises(EstimationError, match="no preset 'best'"):
        find_parameters("iez", "best")
