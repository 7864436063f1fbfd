"""How long a campaign will still take."""

import pytest

from fg_nav.lab.campaign import dispatch
from fg_nav.lab.campaign.dispatch import RemainingTime
from fg_nav.lab.verbs.experiments import describe_progress
from tests.lab.campaign import fakes


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """Time that stands still but where a test moves it."""
    now = [100.0]
    monkeypatch.setattr(dispatch, "monotonic", lambda: now[0])
    return now


def tasks_of(group, walks, *methods):
    return [fakes.task(group, str(walk), *methods) for walk in range(walks)]


def left_s(remaining, workers):
    return remaining.progress(workers).left_s


def test_what_is_missing_takes_as_long_as_its_like_took():
    short, long = tasks_of("short", 4, "iez", "qsf"), tasks_of("long", 1, "iez")
    remaining = RemainingTime(5, [*short, *long])
    now = remaining.progress(2)
    assert (now.done, now.total, now.left_s) == (5, 14, None)
    assert "not known yet" in describe_progress(now)
    remaining.count(short[0].keys, 4.0)
    now = remaining.progress(2)
    assert (now.done, now.left_s) == (7, pytest.approx(7 * 2.0 / 2))
    remaining.count(long[0].keys, 100.0)
    assert left_s(remaining, 1) == pytest.approx(3 * 4.0)
    assert "12 s left" in describe_progress(remaining.progress(1))


def test_a_walk_that_takes_its_time_has_less_left_and_never_nothing(clock):
    tasks = tasks_of("demo", 2, "iez")
    remaining = RemainingTime(0, tasks)
    remaining.count(tasks[0].keys, 600.0)
    clock[0] += 500.0
    assert left_s(remaining, 8) == pytest.approx(100.0)
    clock[0] += 500.0
    assert left_s(remaining, 8) == pytest.approx(60.0)


def test_time_is_not_less_than_that_of_the_longest_walk():
    short, long = tasks_of("short", 101, "iez"), tasks_of("long", 2, "iez")
    remaining = RemainingTime(0, [*short, *long])
    remaining.count(short[0].keys, 1.0)
    remaining.count(long[0].keys, 300.0)
    assert left_s(remaining, 10) == pytest.approx(300.0)
    assert left_s(remaining, 1) == pytest.approx(400.0)


def test_a_result_that_killed_workers_says_nothing_of_the_others():
    tasks = tasks_of("demo", 3, "iez")
    remaining = RemainingTime(0, tasks)
    remaining.count(tasks[0].keys, 0.0)
    assert (remaining.progress(1).done, left_s(remaining, 1)) == (1, None)
    remaining.count(tasks[1].keys, 5.0)
    assert left_s(remaining, 1) == pytest.approx(5.0)


def test_nothing_is_left_at_the_end_and_no_worker_is_there_before():
    tasks = tasks_of("demo", 1, "iez", "qsf")
    remaining = RemainingTime(0, tasks)
    assert describe_progress(remaining.progress(0)).startswith("0 of 2 results, no workers yet")
    remaining.count(tasks[0].keys, 5.0)
    assert left_s(remaining, 4) == 0.0
