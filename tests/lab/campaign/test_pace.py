"""How long a campaign will still take."""

import pytest

from fg_nav.lab.campaign.pace import Pace
from fg_nav.report.campaign import in_words
from tests.lab.campaign import fakes


def jobs_and_keys(group, walks, *methods):
    jobs = [fakes.job(group, str(walk), *methods) for walk in range(walks)]
    return jobs, [key for job in jobs for key in job.keys]


def test_what_is_missing_takes_as_long_as_its_like_took():
    short, of_short = jobs_and_keys("short", 4, "iez", "qsf")
    long, of_long = jobs_and_keys("long", 1, "iez")
    pace = Pace.of(5, [*short, *long])
    now = pace.standing(2)
    assert (now.done, now.joined, now.total, now.left_s) == (5, 5, 14, None)
    assert "not known yet" in in_words(now)
    pace.came(of_short[:1], 2.0)
    now = pace.standing(2)
    assert (now.done, now.left_s) == (6, pytest.approx(8 * 2.0 / 2))
    pace.came(of_short[1:2], 6.0)
    assert pace.standing(1).left_s == pytest.approx(3 * 2.0 + 3 * 6.0 + 4.0)
    pace.came(of_long, 100.0)
    assert pace.standing(1).left_s == pytest.approx(3 * 2.0 + 3 * 6.0)
    assert "24 s left" in in_words(pace.standing(1))


def test_points_of_a_grid_count_as_one_method_and_not_as_others():
    jobs, keys = jobs_and_keys("demo", 1, "iez", "smoother,rounds=1", "smoother,rounds=2", "smoother,rounds=3")
    pace = Pace.of(0, jobs)
    pace.came(keys[:1], 1.0)
    pace.came(keys[1:2], 10.0)
    assert pace.standing(1).left_s == pytest.approx(2 * 10.0)


def test_what_somebody_is_at_has_less_left_and_never_nothing():
    jobs, keys = jobs_and_keys("demo", 8, "iez")
    pace = Pace.of(0, jobs)
    pace.came(keys[:1], 600.0)
    assert pace.standing(8, dict.fromkeys(keys[1:], 500.0)).left_s == pytest.approx(100.0)
    assert pace.standing(8, dict.fromkeys(keys[1:], 700.0)).left_s == pytest.approx(70.0)


def test_the_last_one_takes_its_time_however_many_workers_there_are():
    jobs, keys = jobs_and_keys("demo", 2, "iez")
    pace = Pace.of(0, jobs)
    pace.came(keys[:1], 600.0)
    assert pace.standing(16).left_s == pytest.approx(600.0)
    assert pace.standing(16, {keys[1]: 60.0}).left_s == pytest.approx(540.0)


def test_time_is_not_less_than_that_of_the_longest():
    short, of_short = jobs_and_keys("short", 101, "iez")
    long, of_long = jobs_and_keys("long", 2, "iez")
    pace = Pace.of(0, [*short, *long])
    pace.came(of_short[:1], 1.0)
    pace.came(of_long[:1], 300.0)
    assert pace.standing(10, {of_long[1]: 0.0}).left_s == pytest.approx(300.0)
    assert pace.standing(1, {of_long[1]: 0.0}).left_s == pytest.approx(400.0)


def test_a_cell_that_killed_workers_tells_nothing_of_the_others():
    jobs, keys = jobs_and_keys("demo", 3, "iez")
    pace = Pace.of(0, jobs)
    pace.came(keys[:1], None)
    assert (pace.standing(1).done, pace.standing(1).left_s) == (1, None)
    pace.came(keys[1:2], 5.0)
    assert pace.standing(1).left_s == pytest.approx(5.0)


def test_nothing_is_left_at_the_end_and_nobody_is_said_to_work_before():
    jobs, keys = jobs_and_keys("demo", 1, "iez")
    pace = Pace.of(0, jobs)
    assert in_words(pace.standing(0)).startswith("0 of 1 results, no workers yet")
    pace.came(keys, 5.0)
    assert pace.standing(4).left_s == 0.0
