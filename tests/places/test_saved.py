"""Places in a file: what is read is what was written, and a damaged file is refused in a sentence."""

import zipfile
from contextlib import suppress
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fg_nav.errors import PlacesError
from fg_nav.places import SavedPlaces, Signature, read_places, trace_places, write_places
from fg_nav.places.saved import COLUMNS, VERSION, is_places
from tests.places.floors import LOOP, Floor, along, carry


@pytest.fixture(scope="module")
def places():
    path = carry(Floor.draw(1), along(LOOP))
    return SavedPlaces(path, np.full((len(path), 3), 0.3), "walk.csv")


@pytest.fixture
def file(places, tmp_path):
    write_places(tmp_path / "office.places", places)
    return tmp_path / "office.places"


def change(file, **changes):
    """Write the file again with other arrays; None leaves one out."""
    with np.load(file) as content:
        arrays = {**content} | changes
    with file.open("wb") as stream:
        np.savez(stream, **{name: array for name, array in arrays.items() if array is not None})


def test_what_is_read_is_what_was_written(file, places):
    assert is_places(file)
    back = read_places(file)
    assert back.recording == "walk.csv"
    assert np.array_equal(back.sigma_m, places.sigma_m)
    for one in fields(Signature):
        assert np.array_equal(getattr(back.path, one.name), getattr(places.path, one.name)), one.name


@pytest.mark.parametrize("name", sorted(set(COLUMNS) - {"seen"}))
def test_nothing_is_written_that_cannot_be_read(places, tmp_path, name):
    file = tmp_path / "office.places"
    for wrong in (np.nan, -1e30):
        columns = {**vars(places.path), "sigma_m": places.sigma_m}
        columns[name] = np.full_like(columns[name], wrong)
        with pytest.raises(PlacesError, match=f"cannot be saved, .* '{name}'"):
            write_places(file, SavedPlaces(sigma_m=columns.pop("sigma_m"), path=Signature(**columns)))
    assert not file.exists()


def test_too_few_points_are_neither_written_nor_read(file, places, tmp_path):
    columns = {name: column[:5] for name, column in vars(places.path).items()}
    with pytest.raises(PlacesError, match="5 points"):
        write_places(tmp_path / "few", SavedPlaces(Signature(**columns), places.sigma_m[:5]))
    change(file, sigma_m=places.sigma_m[:5], **columns)
    with pytest.raises(PlacesError, match="5 points"):
        read_places(file)


@pytest.mark.parametrize("name", COLUMNS)
def test_every_column_is_judged(file, places, name):
    with np.load(file) as content:
        column = content[name]
    wrong = [None, column[:-1], column[..., None], column.astype(np.complex128)]
    if name != "seen":
        wrong += [np.where(np.arange(column.size).reshape(column.shape) == 70, bad, column) for bad in (np.nan, 1e30)]
    for array in wrong:
        write_places(file, places)
        change(file, **{name: array})
        with pytest.raises(PlacesError, match=r"office\.places .*: save"):
            read_places(file)


def test_an_order_that_cannot_be_is_refused(file, places):
    for name in ("distance_m", "t"):
        write_places(file, places)
        change(file, **{name: getattr(places.path, name)[::-1]})
        with pytest.raises(PlacesError, match="order or sigmas"):
            read_places(file)
    write_places(file, places)
    change(file, sigma_m=-places.sigma_m)
    with pytest.raises(PlacesError, match="order or sigmas"):
        read_places(file)


def test_a_newer_version_and_another_file_are_refused(file, tmp_path):
    change(file, version=np.array(VERSION + 1))
    with pytest.raises(PlacesError, match=f"version {VERSION + 1}"):
        read_places(file)
    other = tmp_path / "other.npz"
    np.savez(other, t=np.arange(3.0))
    (tmp_path / "text").write_text("nothing")
    for one, said in ((other, "holds no places"), (tmp_path / "text", "holds no places"), (tmp_path, "directory")):
        assert not is_places(one)
        with pytest.raises(PlacesError, match=said):
            read_places(one)
    with pytest.raises(PlacesError, match="does not exist"):
        read_places(tmp_path / "none")


def test_objects_are_not_unpickled(file):
    change(file, recording=np.array([{"a": 1}], dtype=object))
    with pytest.raises(PlacesError, match="damaged"):
        read_places(file)


def test_what_unpacks_to_more_than_places_are_is_refused(file):
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", bytes(60_000_000))
    with pytest.raises(PlacesError, match="larger"):
        read_places(file)


@given(data=st.data())
def test_damaged_bytes_are_refused_or_read(places, tmp_path_factory, data):
    file = tmp_path_factory.getbasetemp() / "damaged.places"
    write_places(file, places)
    content = bytearray(file.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        content = content[:at]
    else:
        content[at] = data.draw(st.integers(0, 255))
    file.write_bytes(bytes(content))
    with suppress(PlacesError):
        read_places(file)


def test_too_short_a_walk_has_no_places():
    t = np.arange(100) / 10.0
    position = np.column_stack([t, 0 * t, 0 * t])
    with pytest.raises(PlacesError, match="too short"):
        trace_places(t, position, np.tile(np.eye(3), (100, 1, 1)), np.ones((100, 3)), t[:2], np.ones((2, 3)))


def test_sigmas_are_those_of_the_footfalls_around():
    t = np.arange(0.0, 100.0, 0.1)
    position = np.column_stack([t, 0 * t, 0 * t])
    sigma = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    found = trace_places(t, position, np.tile(np.eye(3), (len(t), 1, 1)), np.ones((len(t), 3)), t[[0, -1]], sigma)
    assert found.sigma_m[:, 1] == pytest.approx(2.0 * found.path.t / t[-1])
    assert found.path.seen.all()
