"""A person and a mount say what they are, and refuse what no one is."""

from dataclasses import fields, replace

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.foot import build_foot_motion
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.mount import HEEL, INSTEP, MOUNTS, Mount, find_mount
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Gait, Person, Shock, Variety
from fg_nav.lab.simulation.plan import Stairs, Stand, TurnOnSpot, Walk, plan


def test_default_walk_is_that_of_the_papers() -> None:
    walk = Person().walk
    assert walk.stride_m == 1.29
    assert walk.stride_s == 0.93
    assert np.rad2deg(walk.toe_down_rad) == pytest.approx(60)
    assert 20 < np.rad2deg(walk.toe_up_rad) < 35


def test_every_style_has_its_gait() -> None:
    person = Person()
    named = {style.name.lower(): person.gait(style) for style in Style}
    assert all(getattr(person, name) is gait for name, gait in named.items())
    assert len(person.gaits) == len(Style)
    assert person.run.stride_m / person.run.stride_s > 2 * person.walk.stride_m / person.walk.stride_s


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stride_s", 0.0),
        ("stride_m", -1.0),
        ("variation", -0.1),
        ("variation", 0.9),
        ("swing_share", 0.95),
        ("toe_down_rad", 2.0),
        ("sole_m", np.nan),
        ("slip_correlation", 1.0),
        ("climb", (0.8, 0.2)),
    ],
)
def test_gaits_that_cannot_be_are_refused(name: str, value: object) -> None:
    with pytest.raises(SimulationError, match=name):
        replace(Gait(), **{name: value})


@pytest.mark.parametrize("field", [field.name for field in fields(Shock)])
def test_shocks_are_not_negative(field: str) -> None:
    with pytest.raises(SimulationError, match=field):
        replace(Shock(1.0, 1.0, 20.0, 0.1), **{field: -1.0})


def test_sway_and_mounts_are_checked() -> None:
    with pytest.raises(SimulationError, match="sway_s"):
        replace(Person(), sway_s=0.0)
    with pytest.raises(SimulationError, match="tilt_sd_rad"):
        replace(INSTEP, tilt_sd_rad=(0.1, -0.1, 0.0))
    with pytest.raises(SimulationError, match="lever_m"):
        Mount(lever_m=(0.0, np.inf, 0.0))
    with pytest.raises(SimulationError, match=r"'toe'.*instep"):
        find_mount("toe")


def test_a_mounting_is_drawn_once() -> None:
    mounted = [INSTEP.draw(np.random.default_rng(seed)) for seed in range(300)]
    tilt = np.array([mount.tilt_rad for mount in mounted])
    np.testing.assert_allclose(tilt.mean(axis=0), INSTEP.tilt_rad, atol=0.03)
    np.testing.assert_allclose(tilt.std(axis=0), INSTEP.tilt_sd_rad, rtol=0.15)
    again = mounted[0].draw(np.random.default_rng(9))
    assert again == mounted[0]


def test_levers_scatter_and_shocks_are_one_mounts_own() -> None:
    for mount in (INSTEP, HEEL):
        mounted = [mount.draw(np.random.default_rng(seed)) for seed in range(300)]
        lever = np.array([one.lever_m for one in mounted])
        np.testing.assert_allclose(lever.mean(axis=0), mount.lever_m, atol=2.5e-3)
        np.testing.assert_allclose(lever.std(axis=0), mount.lever_sd_m, rtol=0.15)
        assert lever[:, 2].min() > 0.01
        assert len({one.shock_seed for one in mounted}) == len(mounted)


def test_a_scatter_that_cannot_be_is_refused() -> None:
    with pytest.raises(SimulationError, match="lever_sd_m"):
        replace(INSTEP, lever_sd_m=(0.1, -0.1, 0.0))
    with pytest.raises(SimulationError, match="toe_down"):
        Variety(toe_down=-0.1)


# ---- persons differ


def drawn(count: int) -> list[Person]:
    return [Person().draw(np.random.default_rng(seed)) for seed in range(count)]


def column(people: list[Person], name: str, gait: str = "walk") -> np.ndarray:
    return np.array([getattr(getattr(person, gait), name) for person in people])


def test_persons_can_be_and_scatter_about_the_default() -> None:
    """No one who is drawn is refused, though running leaves least room; medians stay, scatter is what is promised."""
    people, usual, sd = drawn(500), Person(), Variety()
    for name, promised in {
        "toe_down_rad": sd.toe_down,
        "toe_up_rad": sd.toe_up,
        "inversion_rad": sd.inversion,
        "yaw_wobble_rad": sd.yaw_wobble,
        "midswing_m": sd.height,
        "rollover_rad": sd.turning,
        "sole_m": sd.sole,
        "stride_m": sd.stride,
    }.items():
        of = column(people, name) / getattr(usual.walk, name)
        assert np.median(of) == pytest.approx(1.0, abs=0.15 * promised)
        assert np.log(of).std() == pytest.approx(promised, rel=0.15)
    assert column(people, "swing_share").std() == pytest.approx(sd.swing_share, rel=0.15)
    slip = column(people, "slip_m") / usual.walk.slip_m
    assert slip.min() > 0
    assert slip.max() < 2
    assert slip.mean() == pytest.approx(1.0, abs=0.1)
    strike = np.array([person.walk.strike.force_m_s2 for person in people]) / usual.walk.strike.force_m_s2
    assert np.log(strike).std() == pytest.approx(sd.shock, rel=0.15)


def test_who_walks_with_steep_toes_also_runs_so() -> None:
    people = drawn(100)
    for name in ("toe_up_rad", "inversion_rad", "clearance_m", "rollover_rad"):
        factors = [
            column(people, name, gait) / getattr(getattr(Person(), gait), name) for gait in ("walk", "stairs_up")
        ]
        np.testing.assert_allclose(*factors)
    assert np.corrcoef(column(people, "toe_down_rad"), column(people, "toe_down_rad", "run"))[0, 1] > 0.9


def test_plans_fix_what_they_fix() -> None:
    """Treads are as deep for all, and no one walks on the spot."""
    for gait in ("stairs_up", "stairs_down", "turn"):
        assert set(column(drawn(20), "stride_m", gait)) == {getattr(Person(), gait).stride_m}
    assert len(set(column(drawn(20), "stride_m"))) == 20


def test_the_same_numbers_draw_the_same_person() -> None:
    assert drawn(1)[0] == drawn(1)[0]
    assert Person().draw(np.random.default_rng(1)) != Person().draw(np.random.default_rng(2))
    nobody_differs = Variety(**dict.fromkeys((field.name for field in fields(Variety)), 0.0))
    assert Person().draw(np.random.default_rng(1), nobody_differs) == Person()


def test_everybody_can_walk_run_and_climb() -> None:
    for seed, person in enumerate(drawn(20)):
        rng = np.random.default_rng(seed)
        course = [Stand(1.0), Walk(straight(8.0)), TurnOnSpot(np.pi), Stairs(6), Stairs(6, up=False)]
        for sections in (course, [Walk(straight(15.0), Style.RUN), Stand(1.0)]):
            strides = plan(sections, person, rng)
            motion = build_foot_motion(strides, person, INSTEP, rng)
            state = motion.at(np.arange(0.0, strides.end_s, 5e-3))
            assert all(np.isfinite(getattr(state, name)).all() for name in ("position", "rate", "force"))
            assert np.linalg.norm(state.force, axis=1).max() < 50 * 9.81
            assert state.position[:, 2].min() > -0.1 - 8 * 0.17
            assert np.all(np.diff(motion.flat[1:-1]) > 0.009)


def test_axes_of_an_instep_sensor_point_up_along_the_instep() -> None:
    foot_R_body = INSTEP.foot_R_body
    np.testing.assert_allclose(foot_R_body @ foot_R_body.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(foot_R_body) == pytest.approx(1.0)
    forward = foot_R_body[:, 0]
    assert np.rad2deg(np.arcsin(forward[2])) == pytest.approx(25.0)


def test_heel_is_low_behind_and_hit_harder() -> None:
    assert find_mount("heel") is HEEL
    assert set(MOUNTS) == {"instep", "heel"}
    assert HEEL.lever_m[0] < INSTEP.lever_m[0]
    assert HEEL.lever_m[2] < INSTEP.lever_m[2]
    assert HEEL.shock > INSTEP.shock
    assert HEEL.unrest < INSTEP.unrest
