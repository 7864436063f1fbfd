"""What the field integrates to along a way that is known, on a foot that swings, pitches and turns."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.magnetic_field import E_H, SIZE, FieldPotential
from fg_nav.frames import yaw_rotation
from fg_nav.lab.simulation.fields import magnet
from fg_nav.smoother import field_factors

EARTH = np.array([3.0, 20.0, -43.0])
RATE_HZ, STRIDES, STRIDE_M, STRIDE_S, STANDS = 200.0, 12, 1.3, 1.1, 0.4
MOUNT = Rotation.from_euler("xyz", [6.0, -15.0, 20.0], degrees=True).as_matrix()
MOMENT = np.array([2.0, -1.0, 3.0])


@dataclass(frozen=True)
class Trodden:
    """Time (N,) s, position (N, 3) m and attitude (N, 3, 3) of a foot, and its footfalls."""

    t: Floats
    position: Floats
    nav_R_body: Floats
    footfall: Ints

    def mag(self, nav_field: Floats, hard_iron: Floats = np.zeros(3)) -> Floats:
        """(N, 3) uT, in the body frame."""
        return np.einsum("nji,nj->ni", self.nav_R_body, np.broadcast_to(nav_field, (len(self.t), 3))) + hard_iron

    def turned(self, angle: float) -> "Trodden":
        """As a trajectory with another heading has it."""
        turn = yaw_rotation(angle)
        return replace(self, position=self.position @ turn.T, nav_R_body=turn @ self.nav_R_body)


def round_a_circle(mount: Floats = MOUNT) -> Trodden:
    """Once round: the foot stands, and swings with its heel up and then its toes."""
    n = round(STRIDES * STRIDE_S * RATE_HZ) + 1
    t = np.arange(n) / RATE_HZ
    stride, phase = np.divmod(t / STRIDE_S + 1e-9, 1.0)
    swing = np.clip((phase - STANDS) / (1.0 - STANDS), 0.0, 1.0)
    angle = 2 * np.pi * (stride + swing**2 * (3 - 2 * swing)) / STRIDES
    radius = STRIDES * STRIDE_M / (2 * np.pi)
    up = 0.15 * np.sin(np.pi * swing) ** 2
    position = np.stack([radius * np.cos(angle), radius * np.sin(angle), up], axis=1)
    ahead = Rotation.from_rotvec(np.outer(angle + np.pi / 2, [0.0, 0.0, 1.0]))
    pitch = Rotation.from_rotvec(np.outer(0.9 * np.sin(2 * np.pi * swing), [0.0, 1.0, 0.0]))
    attitude = ahead * pitch * Rotation.from_matrix(mount)
    footfall = np.round(np.arange(STRIDES + 1) * STRIDE_S * RATE_HZ).astype(np.int64)
    return Trodden(t, position, attitude.as_matrix(), footfall)


def along(trodden: Trodden, mag: Floats) -> field_factors.FieldPath:
    walked = trodden.position, trodden.nav_R_body, trodden.footfall
    return field_factors.integrate_path(trodden.t, mag, *walked, EARTH[2])


@pytest.mark.parametrize("angle", [0.3, -2.0, np.pi])
def test_where_the_trajectory_heads_makes_no_difference(angle: float) -> None:
    trodden = round_a_circle()
    mag = trodden.mag(EARTH + magnet(np.array([2.8, 0.4, -0.2]), MOMENT).at(trodden.position), np.array([1.0, 2, 5]))
    right, wrong = along(trodden, mag), along(trodden.turned(angle), mag)
    for name in ("u", "level_path", "by_up", "body_move", "distance_m", "level_R_body"):
        np.testing.assert_allclose(getattr(wrong, name), getattr(right, name), atol=1e-9, err_msg=name)
    moved = along(replace(trodden, position=trodden.position + np.array([100.0, -50.0, 3.0])), mag)
    np.testing.assert_allclose(moved.u, right.u, atol=1e-9)


def test_attitudes_that_are_tilted_give_the_residual_of_the_true_ones() -> None:
    """The path keeps level, the field turns with the attitude: the pose of the footfall tells by how much."""
    trodden = round_a_circle()
    mag = trodden.mag(EARTH + magnet(np.array([2.8, 0.4, -0.2]), MOMENT).at(trodden.position))
    tilt = Rotation.from_rotvec(np.radians([0.2, -0.15, 0.0])).as_matrix()
    true, tilted = along(trodden, mag), along(replace(trodden, nav_R_body=tilt @ trodden.nav_R_body), mag)
    left = residual_of(tilted, trodden) - residual_of(true, trodden)
    assert np.abs(tilted.u - true.u).max() > 0.15
    assert np.abs(left).max() < 0.01 * np.abs(tilted.u - true.u).max()


def residual_of(path: field_factors.FieldPath, trodden: Trodden) -> Floats:
    """Of the line integrals at the true poses, uT m; without a potential."""
    poses = np.zeros((len(path.u), 4, 4))
    poses[:, :3, :3] = trodden.nav_R_body[trodden.footfall[:-1]]
    state = np.zeros((len(path.u), SIZE))
    state[:, E_H] = EARTH[:2]
    integrals = FieldPotential(
        path.u, path.level_path, path.by_up, path.body_move, path.nav_R_level, np.ones(len(path.u))
    )
    return integrals.evaluate([poses, state, state], with_jacobians=False)[0][:, 0]


def test_rows_without_a_sample_are_passed_over() -> None:
    trodden = round_a_circle()
    field = EARTH + magnet(np.array([2.9, 0.6, -0.6]), MOMENT).at(trodden.position)
    mag = trodden.mag(field)
    slow = np.full_like(mag, np.nan)
    slow[::4] = mag[::4]
    held = mag[np.arange(len(mag)) // 4 * 4]
    whole, found, false = along(trodden, mag), along(trodden, slow), along(trodden, held)
    np.testing.assert_allclose(found.u, whole.u, atol=0.02)
    np.testing.assert_allclose(found.level_path, whole.level_path, atol=2e-3)
    assert np.isfinite(found.sigma_uT_m).all()
    assert np.abs(false.u - whole.u).max() > 0.2  # were they held


def strides_unseen(trodden: Trodden, start: float, stop: float) -> Ints:
    """Without samples of the field from stride `start` to stride `stop`."""
    mag = trodden.mag(EARTH)
    at = trodden.t / STRIDE_S
    mag[(at > start) & (at < stop)] = np.nan
    return np.flatnonzero(np.isinf(along(trodden, mag).sigma_uT_m))


@pytest.mark.parametrize(
    ("start", "stop", "unseen"),
    [
        (3.0, 4.0, [3]),  # a swing, from footfall to footfall
        (3.6, 3.8, [3]),  # a part of a swing
        (2.6, 5.5, [2, 3, 4, 5]),
        (2.9, 3.7, [2, 3]),  # from swing to swing: nobody knows which of them had how much of it
        (-1.0, 3.7, [0, 1, 2, 3]),  # the magnetometer begins late
        (9.7, 99.0, [9, 10, 11]),  # and stops early
        (3.05, 3.3, []),  # while the foot stands
    ],
)
def test_a_stride_whose_swing_was_not_seen_measured_nothing(start: float, stop: float, unseen: list[int]) -> None:
    assert strides_unseen(round_a_circle(), start, stop).tolist() == unseen


@pytest.mark.parametrize("tilt_deg", [0.0, 10.0, -40.0, 80.0])
@pytest.mark.parametrize("roll_deg", [0.0, 3.0])
def test_forward_is_the_body_s_x_axis_as_far_as_it_is_level(tilt_deg: float, roll_deg: float) -> None:
    mount = Rotation.from_euler("yx", [tilt_deg, roll_deg], degrees=True).as_matrix()
    trodden = round_a_circle(mount=mount)
    forward, left, up = along(trodden, trodden.mag(EARTH)).level_R_body
    R = trodden.nav_R_body[0]
    level_x = R[:, 0] * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(R @ forward, level_x / np.linalg.norm(level_x), atol=1e-9)
    np.testing.assert_allclose(R @ left, np.cross([0.0, 0.0, 1.0], R @ forward), atol=1e-9)
    np.testing.assert_allclose(R @ up, [0.0, 0.0, 1.0], atol=1e-9)


SEEDS = range(20)


def draw(rng: np.random.Generator, sigma: float, length_m: float, distance_m: Floats) -> Floats:
    """(F,) a stationary process of this spread and correlation length at F places along a way."""
    x = np.empty(len(distance_m) + 1)
    x[0] = sigma * rng.standard_normal()
    for k, d in enumerate(distance_m):
        left = np.exp(-d / length_m)
        x[k + 1] = left * x[k] + sigma * np.sqrt(1 - left**2) * rng.standard_normal()
    return x


def draw_field(
    seed: int, white_uT: float, across: field_factors.Roughness, regional_uT: float, count: int = 4000
) -> tuple[Floats, Floats]:
    """Deviations at footfalls, and the strides between them."""
    rng = np.random.default_rng(seed)
    distance = STRIDE_M * (1 + 0.1 * rng.uniform(-1, 1, count))
    own = white_uT * rng.standard_normal(count + 1)
    alike = draw(rng, across.sigma, across.length_m, distance)
    return own + alike + draw(rng, regional_uT, field_factors.REGIONAL_LENGTH_M, distance), distance


def measure(deviation: Floats, distance_m: Floats) -> field_factors.FieldRoughness:
    return field_factors.measure_roughness(deviation, np.ones(len(deviation), dtype=np.bool_), distance_m)


@pytest.mark.parametrize(
    ("white_uT", "across", "regional_uT"),
    [
        (5.0, field_factors.Roughness(4.0, 3.0), 2.0),
        (2.0, field_factors.Roughness(2.0, 2.0), 2.0),
        (0.0, field_factors.Roughness(5.0, 1.5), 0.0),
        (0.0, field_factors.Roughness(5.0, 6.0), 0.0),
        (5.0, field_factors.Roughness(0.0, 3.0), 0.0),
        (5.0, field_factors.Roughness(0.0, 3.0), 2.0),
    ],
)
def test_spread_length_and_regional_part_of_a_process_are_found(
    white_uT: float, across: field_factors.Roughness, regional_uT: float
) -> None:
    """A walk of 5 km: the mean over seeds to a tenth of the whole spread, one alone to a third."""
    found = [measure(*draw_field(seed, white_uT, across, regional_uT)) for seed in SEEDS]
    parts = np.array([[one.white_uT, one.across.sigma, one.regional.sigma] for one in found])
    expected = np.array([white_uT, across.sigma, regional_uT])
    whole = np.linalg.norm(expected)
    np.testing.assert_allclose((parts**2).mean(axis=0), expected**2, atol=0.1 * whole**2)
    np.testing.assert_allclose(parts**2, np.tile(expected**2, (len(parts), 1)), atol=0.33 * whole**2)
    np.testing.assert_allclose(
        [one.potential.sigma for one in found], field_factors.POTENTIAL_PER_FIELD_M * whole, rtol=0.1
    )
    if across.sigma > 0.3 * whole:
        assert np.mean([one.across.length_m for one in found]) == pytest.approx(across.length_m, rel=0.15)


def test_a_magnet_on_the_way_does_not_set_the_scale() -> None:
    deviation, distance = draw_field(3, 1.0, field_factors.Roughness(2.0, 3.0), 0.5, 300)
    clean = measure(deviation, distance)
    deviation[[20, 21, 150, 290]] = 500.0, -300.0, 1e4, -80.0
    found = measure(deviation, distance)
    assert found.potential.sigma == pytest.approx(clean.potential.sigma, rel=0.2)
    assert found.across.sigma == pytest.approx(clean.across.sigma, rel=0.25)
    assert found.white_uT < 2.0
    assert np.std(deviation) > 100 * found.white_uT


def test_footfalls_that_were_not_seen_are_left_out() -> None:
    deviation, distance = draw_field(6, 1.0, field_factors.Roughness(3.0, 4.0), 1.0)
    seen = np.arange(len(deviation)) % 5 > 0
    found, hidden = (
        field_factors.measure_roughness(np.where(seen, deviation, value), seen, distance) for value in (np.nan, 1e3)
    )
    assert found == hidden
    whole = measure(deviation, distance)
    assert found.across.sigma == pytest.approx(whole.across.sigma, rel=0.1)
    assert found.across.length_m == pytest.approx(whole.across.length_m, rel=0.25)
    assert found.white_uT == pytest.approx(whole.white_uT, abs=0.3)


def test_a_short_walk_keeps_to_what_was_assumed() -> None:
    """Eight strides, of which each deviates for itself or all alike."""
    for across in (field_factors.Roughness(0.0, 3.0), field_factors.Roughness(4.0, 300.0)):
        found = [measure(*draw_field(seed, 5.0 - across.sigma, across, 0.0, 8)) for seed in SEEDS]
        whole = np.array([one.potential.sigma / field_factors.POTENTIAL_PER_FIELD_M for one in found])
        shares = np.array([[one.across.sigma, one.regional.sigma] for one in found]) ** 2 / whole[:, None] ** 2
        np.testing.assert_allclose(
            shares.mean(axis=0), [field_factors.ASSUMED_SHARE, field_factors.REGIONAL_SHARE], atol=0.15
        )


@pytest.mark.parametrize("seen", [np.zeros(30, dtype=np.bool_), np.arange(30) == 29], ids=["none", "the last"])
def test_where_nothing_was_seen_the_spread_is_the_sensor_s(seen: np.ndarray) -> None:
    found = field_factors.measure_roughness(np.zeros(30), seen, np.full(29, STRIDE_M))
    assert found.potential.sigma == pytest.approx(field_factors.POTENTIAL_PER_FIELD_M * field_factors.MIN_SIGMA_UT)
    assert found.across.sigma == found.regional.sigma == field_factors.MIN_REGIONAL_UT
    assert found.white_uT < 0.02


def test_the_changes_of_a_potential_keep_their_variance_where_a_share_of_it_is_lost() -> None:
    one, distance = field_factors.Roughness(6.0, 12.0), np.array([0.0, 1.3, 40.0])
    for share in (0.0, 0.3, 0.9):
        telescoping, noise = field_factors.split_potential(one, share, distance)
        changes = 2.0 * telescoping.sigma**2 * (1.0 - telescoping.correlation(distance)) + noise**2
        np.testing.assert_allclose(changes, 2.0 * one.sigma**2 * (1.0 - one.correlation(distance)))


def test_a_deviation_along_the_field_hardly_hangs_on_the_heading() -> None:
    """A turn by a degree moves that across by 0.35 uT, and that along by a hundredth of it; its median is none."""
    rng = np.random.default_rng(2)
    field, reference = np.array([6.0, 19.0, -43.0]) + rng.standard_normal((99, 3)), np.tile([6.0, 19.0], (99, 1))
    turn = np.radians(1.0)
    turned = field.copy()
    turned[:, :2] = field[:, :2] @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    along, same = field_factors.deviate_along(field, reference), field_factors.deviate_along(turned, reference)
    np.testing.assert_allclose(along, same, atol=0.07)
    expected = field[:, :2] @ reference[0] / np.hypot(6.0, 19.0)
    np.testing.assert_allclose(along, expected - np.median(expected))
