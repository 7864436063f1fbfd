"""A person and a mount say what they are, and refuse what nobody is."""

from dataclasses import fields, replace

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.simulation.footsteps import Style
from fg_nav.simulation.person import HEEL, INSTEP, MOUNTS, Gait, Mount, Person, Shock, mount_named


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
        mount_named("toe")


def test_a_mounting_is_drawn_once() -> None:
    mounted = [INSTEP.drawn(np.random.default_rng(seed)) for seed in range(300)]
    tilt = np.array([mount.tilt_rad for mount in mounted])
    np.testing.assert_allclose(tilt.mean(axis=0), INSTEP.tilt_rad, atol=0.03)
    np.testing.assert_allclose(tilt.std(axis=0), INSTEP.tilt_sd_rad, rtol=0.15)
    again = mounted[0].drawn(np.random.default_rng(9))
    assert again == mounted[0]


def test_axes_of_an_instep_sensor_point_up_along_the_instep() -> None:
    foot_R_body = INSTEP.foot_R_body
    np.testing.assert_allclose(foot_R_body @ foot_R_body.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(foot_R_body) == pytest.approx(1.0)
    forward = foot_R_body[:, 0]
    assert np.rad2deg(np.arcsin(forward[2])) == pytest.approx(25.0)


def test_heel_is_low_behind_and_hit_harder() -> None:
    assert mount_named("heel") is HEEL
    assert set(MOUNTS) == {"instep", "heel"}
    assert HEEL.lever_m[0] < INSTEP.lever_m[0]
    assert HEEL.lever_m[2] < INSTEP.lever_m[2]
    assert HEEL.shock > INSTEP.shock
    assert HEEL.unrest < INSTEP.unrest
