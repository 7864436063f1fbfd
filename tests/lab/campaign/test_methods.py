"""Methods with parameters of their own: in words, and in what they then do."""

from dataclasses import replace

import pytest

from fg_nav.errors import EstimationError
from fg_nav.estimators import METHODS, find_parameters
from fg_nav.lab.campaign.execute import parameters_of, settings_of
from fg_nav.lab.campaign.methods import Method, method_of, solve_by
from fg_nav.lab.campaign.walks import Simulated
from fg_nav.lab.store.results import Key


@pytest.fixture(scope="module")
def walk():
    return replace(Simulated("demo", "smooth", 101).prepare("raw"), truth=None)


@pytest.mark.parametrize("word", ["iez", "iez:physical", "smoother,magnetic.gate=ma2018,magnetic.rounds=3,gravity=9.8"])
def test_a_word_says_what_was_written(word):
    assert method_of(word).word == word


def test_every_method_tells_what_it_begins_with():
    assert all(find_parameters(name) is not None for name in METHODS["foot"])
    with pytest.raises(EstimationError, match="no method 'magic'"):
        find_parameters("magic")


def test_parameters_reach_filter_and_smoother(walk):
    plain, other = (solve_by(word, walk).solution for word in ("ma2018", "ma2018,inertial.zero_velocity_density=0.5"))
    assert plain.parameters["inertial"]["zero_velocity_density"] != 0.5
    assert other.parameters["inertial"]["zero_velocity_density"] == 0.5
    assert abs(other.stances.position - plain.stances.position).max() > 1e-3
    smoothed = solve_by("inertial,roll_sigma_m=0.5", walk).solution
    assert (smoothed.method, smoothed.parameters["roll_sigma_m"]) == ("inertial", 0.5)


def test_settings_differ_with_the_parameters_and_are_of_old_without():
    assert "changes" not in parameters_of("iez")
    one, other = (parameters_of(f"iez,gravity={value}") for value in (9.7, 9.8))
    assert one["changes"] == {"gravity": 9.7}
    assert one["changed"] == other["changed"] == parameters_of("iez")
    key = Key("demo", "smooth", "101", "loop", "iez")
    assert settings_of(key, recorded=True)["walk"] is None
    assert settings_of(key, recorded=True, files={"a.csv": "1"})["walk"] == {"a.csv": "1"}


def test_results_with_parameters_have_files_of_their_own():
    plain = Key("demo", "smooth", "101", "loop", "iez:physical")
    assert plain.file == "demo_smooth_loop_iez-physical_101.json"
    words = [Method("iez", "physical", (("gravity", value),)).word for value in (9.8, 9.81)]
    files = {replace(plain, method=word).file for word in words}
    assert len(files | {plain.file}) == 3
    long = [replace(plain, walk="x" * 240 + end).file for end in ("a", "b")]
    assert long[0] != long[1]
    assert max(map(len, long)) < 220
    assert "/" not in replace(plain, walk="folder/a b.csv").file
