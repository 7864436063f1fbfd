"""Which worker takes which cell."""

from fg_nav.lab.campaign.waiting import Waiting, walk_of
from tests.lab.campaign import fakes

METHODS = ("iez", "qsf", "ma2018", "smoother")


def taken(waiting, worker):
    cell = waiting.cell_for(worker)
    waiting.begin(worker, cell)
    assert len(cell.keys) == 1
    return cell


def test_with_walks_enough_each_is_one_workers_own():
    waiting = Waiting([fakes.job("demo", str(walk), *METHODS) for walk in range(4)])
    workers_of, order = {}, {}
    for _ in range(8):
        for worker in ("one", "two"):
            cell = taken(waiting, worker)
            workers_of.setdefault(cell.walk, set()).add(worker)
            order.setdefault(cell.walk, []).append(cell.keys[0].method)
    assert not waiting
    assert all(len(some) == 1 for some in workers_of.values())
    assert all(tuple(some) == METHODS for some in order.values())


def test_one_walk_is_shared_by_all():
    waiting = Waiting([fakes.job("demo", "1", *METHODS)])
    assert [taken(waiting, worker).keys[0].method for worker in ("one", "two", "one", "two")] == [
        "iez",
        "smoother",
        "qsf",
        "ma2018",
    ]
    assert not waiting


def test_help_goes_where_most_is_left_and_only_when_all_are_begun():
    waiting = Waiting([fakes.job("demo", "1", *METHODS), fakes.job("demo", "2", *METHODS[:2])])
    assert taken(waiting, "one").walk == "1"
    assert taken(waiting, "two").walk == "2"
    assert taken(waiting, "two").walk == "2"
    assert taken(waiting, "two").walk == "1"


def test_what_a_worker_that_is_gone_left_comes_before_helping():
    waiting = Waiting([fakes.job("demo", "1", *METHODS), fakes.job("demo", "2", *METHODS[:2])])
    assert taken(waiting, "one").walk == "1"
    assert taken(waiting, "two").walk == "2"
    waiting.leave("two")
    assert taken(waiting, "three").keys[0].method == METHODS[1]
    assert taken(waiting, "three").walk == "1"


def test_a_cell_that_comes_back_is_the_next_of_its_walk_and_none_is_lost_or_given_twice():
    waiting = Waiting([fakes.job("demo", "1", "iez"), fakes.job("demo", "2", "iez")])
    first = taken(waiting, "one")
    assert waiting.is_at("one", first)
    waiting.back(first)
    assert taken(waiting, "two").walk == "2"
    waiting.leave("one")
    assert not waiting.is_at("one", first)
    assert taken(waiting, "one") == first
    assert not waiting


def test_walks_of_two_campaigns_have_two_names():
    cell = fakes.job("demo", "1", "iez")
    assert Waiting([]).name_of(cell) != Waiting([]).name_of(cell)
    assert walk_of(cell) == ("demo", "smooth", "1")
