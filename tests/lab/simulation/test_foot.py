"""The simulated foot is physics: kinematics agree with each other and with how feet move and rock; persons differ."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection import detect_stances
from fg_nav.detection.rest import find_rests
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.simulation.foot import SLIP_CORRELATION, FootMotion, build_foot_motion
from fg_nav.lab.simulation.motion import Kinematics, Ramps, Strides, Style
from fg_nav.lab.simulation.path import Pose, arc, straight
from fg_nav.lab.simulation.person import HEEL, INSTEP, SWING_SHARE_SD, VARIETY, Gait, Mount, Person
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk, end_of, plan

NO_SHOCK = {"shock_m_s2": 0.0, "shock_rad_s": 0.0}


@dataclass(frozen=True)
class Foot:
    """A motion with all that made it."""

    strides: Strides
    motion: FootMotion

    @property
    def t(self) -> np.ndarray:
        return np.arange(0.0, self.strides.end_s, 1e-3)

    def pivot(self, state: Kinematics) -> np.ndarray:
        """Pivot (N, 3) m."""
        return state.position - self.nav_R_foot(state) @ self.motion.lever_m

    def nav_R_foot(self, state: Kinematics) -> np.ndarray:
        return state.nav_R_body @ self.motion.foot_R_body.T


def section_of(style: Style, count: int) -> Section:
    """About `count` strides of a style."""
    if style in (Style.WALK, Style.RUN):
        return Walk(straight(Person().gait(style).stride_m * count), style)
    if style is Style.TURN:
        return TurnOnSpot(np.pi / 4 * count)
    return Stairs(2 * count, up=style is Style.STAIRS_UP)


def made(
    sections: list, person: Person = Person(), mount: Mount = INSTEP, seed: int = 1, restless: bool = False
) -> Foot:
    """A foot along sections, their paths moved to where each begins."""
    rng, pose, placed = np.random.default_rng(seed), Pose(np.zeros(3), 0.0), []
    for section in sections:
        placed.append(replace(section, path=section.path.place(pose)) if isinstance(section, Walk) else section)
        pose = end_of(placed[-1], pose)
    strides = plan(placed, person, rng)
    return Foot(strides, build_foot_motion(strides, person, mount, rng, restless))


MIXED = [
    *[Stand(4.0), Walk(straight(15.0)), TurnOnSpot(np.pi), Walk(straight(12.0), Style.RUN), Stairs(8), Stand(5.0)],
    *[Stairs(8, up=False), Walk(straight(6.0)), Stand(4.0)],
]
AHEAD = [Stand(2.0), Walk(straight(75.0)), Stand(4.0)]
TWICE = [Stand(4.0), Walk(straight(20.0)), Stand(6.0), Walk(straight(20.0)), Stand(4.0)]


@pytest.fixture(scope="module")
def mixed() -> Foot:
    return made(MIXED)


@pytest.fixture(scope="module")
def walk() -> Foot:
    return made(AHEAD)


@pytest.fixture(scope="module")
def dense(walk: Foot) -> Kinematics:
    return walk.motion.at(walk.t)


# ---- ramps

RNG = np.random.default_rng(0)


@pytest.fixture
def ramps() -> Ramps:
    """Many that overlap, of very different widths: some end before earlier ones do."""
    return Ramps.of(RNG.uniform(0, 10, 40), 10 ** RNG.uniform(-1.5, 0.5, 40), RNG.normal(size=40), 0.7)


def test_ramps_have_exact_smooth_derivatives_and_stay_where_they_rose_to(ramps: Ramps) -> None:
    t, h = np.sort(RNG.uniform(-1, 14, 2000)), 1e-5
    before, now, after = (ramps.at(t + offset) for offset in (-h, 0.0, h))
    for order in (0, 1):
        slope = (after[order] - before[order]) / (2 * h)
        np.testing.assert_allclose(now[order + 1], slope, atol=2e-5 * np.abs(now[order + 1]).max())
    edges = np.sort(np.concatenate([ramps.start, ramps.start + ramps.width]))
    jump = np.abs(ramps.at(edges + 1e-7)[2] - ramps.at(edges - 1e-7)[2])
    assert jump.max() < 1e-4 * np.abs(now[2]).max()
    value, slope, bend = ramps.at(np.array([-5.0, 100.0]))
    np.testing.assert_allclose(value, [0.7, 0.7 + ramps.rise.sum()], atol=1e-12)
    assert not slope.any()
    assert not bend.any()
    blocks = np.concatenate([ramps.at(t[i : i + 77]) for i in range(0, len(t), 77)], axis=1)
    np.testing.assert_array_equal(now, blocks)
    single = Ramps.of(np.array([1.0]), np.array([0.5]), np.array([3.0]))
    assert single.at(np.array([1.25]))[0, 0] == pytest.approx(1.5)
    np.testing.assert_array_equal(Ramps.of(*[np.zeros(0)] * 3, 2.0).at(np.arange(3.0))[0], 2.0)
    with pytest.raises(SimulationError, match="instant 2 "):
        ramps.at(np.array([0.0, 2.0, 1.0]))


# ---- kinematics agree with each other


@pytest.mark.parametrize("restless", [False, True])
def test_rate_and_force_are_the_derivatives_of_the_pose(restless: bool) -> None:
    foot = made(MIXED, mount=HEEL if restless else INSTEP, restless=restless)
    seams = np.concatenate([foot.strides.start, foot.strides.start + foot.strides.duration])
    t = np.sort(np.concatenate([np.random.default_rng(0).uniform(0.1, foot.strides.end_s - 0.1, 3000), seams]))
    h = 1e-5
    before, now, after = (foot.motion.at(t + offset) for offset in (-h, 0.0, h))
    acceleration = (after.velocity - before.velocity) / (2 * h)
    turn = Rotation.from_matrix(np.einsum("nji,njk->nik", before.nav_R_body, after.nav_R_body)).as_rotvec()
    force = np.einsum("nji,nj->ni", now.nav_R_body, acceleration + np.array([0, 0, GRAVITY_M_S2]))
    np.testing.assert_allclose(now.velocity, (after.position - before.position) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(now.rate, turn / (2 * h), atol=1e-4)
    np.testing.assert_allclose(now.force, force, atol=1e-2)
    R = now.nav_R_body
    np.testing.assert_allclose(np.einsum("nij,nkj->nik", R, R), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    jump = foot.motion.at(foot.strides.start + 1e-6).force - foot.motion.at(foot.strides.start - 1e-6).force
    assert np.abs(jump).max() < 1e-2


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_a_sample_is_the_mean_over_its_period(walk: Foot, rate_hz: float) -> None:
    t = np.arange(3.0, 8.0, 1 / rate_hz)
    rate, force = walk.motion.sampled(t, 1 / rate_hz)
    state = walk.motion.at((t[:, None] + (np.arange(50) + 0.5) / 50 / rate_hz).ravel())
    np.testing.assert_allclose(rate, state.rate.reshape(-1, 50, 3).mean(axis=1), atol=2e-3)
    np.testing.assert_allclose(force, state.force.reshape(-1, 50, 3).mean(axis=1), atol=2e-2)


# ---- it moves as feet do


def test_a_walking_foot_swings_as_one(walk: Foot, dense: Kinematics) -> None:
    walking = (walk.t > walk.strides.start[3]) & (walk.t < walk.strides.start[-3])
    foot = walk.nav_R_foot(dense)
    pitch_deg = np.rad2deg(np.arcsin(-foot[walking, 2, 0]))
    rate_deg_s = np.rad2deg(dense.rate @ walk.motion.foot_R_body.T)
    each = [slice(np.searchsorted(walk.t, s), np.searchsorted(walk.t, s + 0.9)) for s in walk.strides.start[3:-3]]
    assert 400 < np.median([rate_deg_s[part, 1].max() for part in each]) < 600
    assert 55 < np.percentile(pitch_deg, 99) < 70
    assert -35 < pitch_deg.min() < -25
    assert np.all(np.abs(rate_deg_s[walking][:, [0, 2]]).max(axis=0) > 80)
    strength = np.linalg.norm(dense.force, axis=1)
    assert 3 * GRAVITY_M_S2 < np.median([strength[part].max() for part in each]) < 8 * GRAVITY_M_S2
    assert 4 < np.linalg.norm(dense.velocity, axis=1).max() < 6.5
    assert 0.08 < np.ptp(dense.position[:, 2]) < 0.2
    # heel and sole stay above the floor; the forefoot bends in push-off
    for ahead, below in ((0.0, 0.01), (-0.15, 0.015)):
        height = (walk.pivot(dense) + foot @ np.array([ahead, 0.0, 0.0]))[:, 2]
        assert height.min() > -below
        assert height.max() > 0.08


def test_foot_stands_on_its_footprints(mixed: Foot) -> None:
    """In the middle of each stance the pivot is where the footprint is, but for slip and what the sole gives way."""
    middle = mixed.motion.flat.mean(axis=1)
    state = mixed.motion.at(middle)
    pivot = mixed.pivot(state)
    np.testing.assert_allclose(pivot[:, :2], mixed.strides.footprint[:, :2], atol=0.008)
    np.testing.assert_allclose(pivot[:, 2], mixed.strides.footprint[:, 2], atol=0.006)
    turned = np.angle(np.exp(1j * (compute_heading(mixed.nav_R_foot(state)) - mixed.strides.heading)))
    assert np.rad2deg(np.abs(turned)).max() < 3
    place, yaw = mixed.motion.pivot_at(middle)
    np.testing.assert_allclose(place, pivot, atol=1e-9)
    np.testing.assert_allclose(np.cos(yaw + mixed.strides.heading - np.pi / 2 - 0 * turned), 1.0, atol=2e-3)


def test_flat_is_when_the_foot_does_not_swing(walk: Foot, dense: Kinematics) -> None:
    begin, end = walk.motion.flat.T
    assert walk.motion.flat.shape == (len(walk.strides) + 1, 2)
    assert begin[0] == 0
    assert end[-1] == walk.strides.end_s
    inside = [(walk.t >= b) & (walk.t <= e) for b, e in walk.motion.flat[1:-1]]
    pivot = np.linalg.norm(np.gradient(walk.pivot(dense), walk.t, axis=0), axis=1)
    rate, speed = np.rad2deg(np.linalg.norm(dense.rate, axis=1)), np.linalg.norm(dense.velocity, axis=1)
    assert max(np.median(pivot[part]) for part in inside) < 0.02
    assert max(np.median(rate[part]) for part in inside) < 40
    assert pivot[np.any(inside, axis=0)].max() < 0.05
    assert speed[np.any(inside, axis=0)].max() < 0.12
    for e, b in zip(end[1:-2], begin[2:-1], strict=True):
        assert rate[(walk.t > e) & (walk.t < b)].max() > 300
    # just outside it lands and pushes off
    begin, end = begin[1:-1], end[1:-1]
    middle, landing, pushing = (np.searchsorted(walk.t, t) for t in ((begin + end) / 2, begin - 0.05, end + 0.08))
    for moving in (landing, pushing):
        assert np.median(pivot[moving]) > 5 * np.median(pivot[middle])
        assert np.median(rate[moving]) > 4 * np.median(rate[middle])


@pytest.mark.parametrize("style", list(Style))
def test_a_foot_is_flat_once_between_two_strides(style: Style) -> None:
    """Of runners too, whose stance is short: who pushes off before he has landed is flat in the middle of the two."""
    foot = made([Stand(2.0), section_of(style, 60), Stand(2.0)])
    begin, end = foot.motion.flat.T
    assert (end - begin).min() > 0.009
    assert np.all(begin[1:] > end[:-1])
    swinging = foot.strides.start[:-1] + 0.4 * foot.strides.duration[:-1]
    speed, fast = (np.linalg.norm(foot.motion.at(t).velocity, axis=1) for t in ((begin + end)[1:-1] / 2, swinging))
    assert speed.max() < 0.2
    if style is not Style.TURN:
        assert np.median(speed) < 0.1 * np.median(fast)


def test_in_stance_the_sensor_rolls_about_the_pivot_which_sinks_and_springs_back(walk: Foot) -> None:
    """Its velocity is that of a foot that turns by some degrees a second, and a little slip and settling."""
    mid = walk.motion.flat[4:-4].mean(axis=1)
    state = walk.motion.at(np.sort(np.concatenate([mid + offset for offset in np.linspace(-0.05, 0.05, 21)])))
    foot_rate = state.rate @ walk.motion.foot_R_body.T
    rolling = np.einsum("nij,nj->ni", walk.nav_R_foot(state), np.cross(foot_rate, walk.motion.lever_m))
    speed, rest = (np.sqrt(np.mean((v**2).sum(axis=1))) for v in (rolling, state.velocity - rolling))
    assert 0.008 < speed < 0.035
    assert rest < 0.5 * speed
    assert 5 < np.rad2deg(np.median(np.linalg.norm(foot_rate, axis=1))) < 20
    assert 3 < np.rad2deg(np.median(foot_rate[:, 1])) < 18  # forward: the toe goes down
    assert 0.005 < np.median(state.velocity[:, 1]) < 0.03  # the walk goes north
    begin, end = walk.motion.flat[4:-4].T
    early, late = (walk.pivot(walk.motion.at(t))[:, 2] for t in (begin + 0.55 * (end - begin), end))
    assert 0.0003 < np.median(early - late) < 0.002
    # what a stance loses comes back: no height is lost over 75 m
    assert abs(np.median(late[-20:]) - np.median(late[:20])) < 8e-4


def test_a_sensor_in_the_heel_stands_stiller_and_is_hit_harder() -> None:
    feet = [made([Stand(1.0), Walk(straight(50.0))], mount=mount) for mount in (INSTEP, HEEL)]
    instep, heel = (
        np.median(np.linalg.norm(f.motion.at(f.motion.flat[4:-4].mean(axis=1)).velocity, axis=1)) for f in feet
    )
    assert heel < 0.7 * instep
    instep, heel = (np.percentile(np.linalg.norm(f.motion.at(f.t).force, axis=1), 99.5) for f in feet)
    assert heel > 1.1 * instep


def test_slip_is_forward_and_correlated() -> None:
    person = Person(walk=replace(Gait(), rollover_rad=0.0, **NO_SHOCK))
    foot = made([Walk(straight(1.29 * 600))], person)
    begin, end = foot.motion.flat[3:-3].T
    early, late = (foot.pivot(foot.motion.at(begin + share * (end - begin))) for share in (0.25, 0.72))
    slip_mm = 1e3 * (late - early)[:, :2]
    assert 0.2 < slip_mm[:, 1].mean() < 1.0  # north, and only part of the stance is looked at
    of_gait = Gait().slip_sd_m / Gait().slip_m
    assert slip_mm[:, 1].std() / slip_mm[:, 1].mean() == pytest.approx(of_gait, rel=0.12)
    assert slip_mm[:, 0].std() < 0.7 * slip_mm[:, 1].std()
    assert np.corrcoef(slip_mm[:-1, 1], slip_mm[1:, 1])[0, 1] == pytest.approx(SLIP_CORRELATION, abs=0.15)


def test_a_heel_strike_is_felt_and_leaves_nothing_behind(walk: Foot) -> None:
    quiet = made(AHEAD, Person(walk=replace(Gait(), **NO_SHOCK)))
    np.testing.assert_array_equal(quiet.strides.start, walk.strides.start)
    swing_s = Gait().swing_share * walk.strides.duration
    for share in (0.3, 0.6, 1.3):
        ours, theirs = (foot.motion.at(walk.strides.start + share * swing_s) for foot in (walk, quiet))
        for name in ("position", "velocity", "nav_R_body", "rate", "force"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-9)
    hit, none = (foot.motion.at(walk.t) for foot in (walk, quiet))
    force, rate = (np.linalg.norm(getattr(hit, name) - getattr(none, name), axis=1) for name in ("force", "rate"))
    each = [(walk.t > s) & (walk.t < s + 0.9) for s in walk.strides.start[3:-3]]
    assert np.median([force[part].max() for part in each]) == pytest.approx(Gait().shock_m_s2, rel=0.4)
    assert np.median([rate[part].max() for part in each]) == pytest.approx(Gait().shock_rad_s, rel=0.4)


def test_every_style_is_its_own_and_who_goes_upstairs_lifts_the_foot_first(mixed: Foot) -> None:
    state = mixed.motion.at(mixed.t)
    strength, pitch = np.linalg.norm(state.force, axis=1), -mixed.nav_R_foot(state)[:, 2, 0]
    peak, steep = {}, {}
    for style in Style:
        of = mixed.strides.style == style
        parts = [
            (mixed.t > start) & (mixed.t < start + duration)
            for start, duration in zip(mixed.strides.start[of], mixed.strides.duration[of], strict=True)
        ]
        peak[style] = np.median([strength[part].max() for part in parts])
        steep[style] = np.rad2deg(np.median([np.arcsin(pitch[part].max()) for part in parts]))
    assert peak[Style.RUN] > 1.5 * peak[Style.WALK] > 1.5 * peak[Style.TURN]
    assert steep[Style.RUN] > steep[Style.WALK] > steep[Style.STAIRS_UP] > steep[Style.TURN]
    for up in (True, False):
        foot = made([Stairs(16, up=up)])
        t = foot.strides.start[3] + 0.5 * foot.strides.duration[3] * Person().stairs_up.swing_share
        height = foot.pivot(foot.motion.at(np.array([t])))[0, 2]
        assert height > foot.strides.footprint[3:5, 2].max() - (0.0 if up else 0.02)


# ---- rocking and moving on


def measure_rate(foot: Foot, standing: bool = False) -> np.ndarray:
    """Rms rate (3,) deg/s in the foot's axes, in the middle thirds of the stances, or of the standing."""
    begin, end = foot.motion.flat.T
    spans = foot.motion.flat[(end - begin > 1.0) == standing]
    t = np.concatenate([np.arange(b + (e - b) / 3, e - (e - b) / 3, 5e-3) for b, e in spans])
    rate = foot.motion.at(t).rate @ foot.motion.foot_R_body.T
    return np.asarray(np.rad2deg(np.sqrt(np.mean(rate**2, axis=0))))


def test_a_heel_rocks_at_4_to_9_deg_s_about_all_axes_and_stands_still_unless_restless() -> None:
    persons = [Person().draw(np.random.default_rng(seed)) for seed in range(12)]
    axes = np.array([measure_rate(made(TWICE, one, HEEL, seed=k)) for k, one in enumerate(persons)])
    total = np.linalg.norm(axes, axis=1)
    assert 4.5 < np.median(total) < 7.5
    assert total.min() > 3.0
    assert total.max() < 10.0
    roll, pitch, yaw = np.median(axes, axis=0)
    assert min(roll, pitch) > yaw > 1.0
    for mount in (HEEL, INSTEP):
        still, restless = (
            np.linalg.norm(measure_rate(made(TWICE, mount=mount, restless=one), standing=True)) for one in (False, True)
        )
        assert 0.005 < still < 0.3
        assert 4.0 < restless < 8.0


def test_it_rocks_about_the_floor_beneath_the_sensor_and_goes_nowhere() -> None:
    """What rocking adds to the velocity is what it adds to the rate, times the height above the floor."""
    rocking, still = (made(TWICE, mount=replace(HEEL, rocking=share), restless=share > 0) for share in (1.0, 0.0))
    t = np.arange(rocking.strides.end_s - 3.0, rocking.strides.end_s - 1.0, 5e-3)
    rocks, stands = (foot.motion.at(t) for foot in (rocking, still))
    nav_rate = np.einsum("nij,nj->ni", rocks.nav_R_body, rocks.rate - stands.rate)
    height = np.array([0.0, 0.0, rocking.motion.lever_m[2]])
    expected, added = np.cross(nav_rate, height), rocks.velocity - stands.velocity
    assert np.sqrt(np.mean((added - expected) ** 2)) < 0.1 * np.sqrt(np.mean(added**2))
    # what a stance turns is taken back in the swing, up to 0.13 m times half the square of an angle
    swinging = rocking.motion.flat.mean(axis=1)[1:-1] + 0.6
    moved = np.diff([foot.motion.at(swinging).position for foot in (still, rocking)], axis=0)[0]
    assert np.abs(moved).max() < 5e-3
    assert np.abs(moved.mean(axis=0)).max() < 5e-4


@pytest.mark.parametrize(("worn", "rests"), [("heel", "rocking"), ("instep", "none")])
def test_no_rest_is_found_where_a_foot_rocks(worn: str, rests: str) -> None:
    second = Walk(straight(20.0).place(Pose(np.array([0.0, 20.0, 0.0]), 0.0)))
    course = [*TWICE[:3], second, TWICE[4]]
    short = replace(SCENARIOS["teaching-building"], name="short", route=lambda rng: course)
    for seed in (1, 2, 3):
        still, restless = (simulate(short, seed, Choices(worn=worn, rests=one)) for one in (None, rests))
        assert len(find_rests(still.recording)) == 3
        assert not find_rests(restless.recording)
        assert 0 <= len(still.strides) - len(restless.strides) <= 2  # two half strides less, and one by rounding
        if rests == "none":  # it begins and ends in a stance
            assert restless.strides.start[0] == pytest.approx(0.35, abs=1e-3)
            assert abs(len(detect_stances(restless.recording)) - len(restless.strides) - 1) <= 1
    with pytest.raises(SimulationError, match="without its rests"):
        simulate("at-rest", 1, Choices(rests="none"))


def stance_velocity(person: Person) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocity (K, 3) m/s of the pivot in the middle of each stance between strides, its direction, and the speed."""
    foot = made([Stand(4.0), Walk(arc(8.0, 2.0)), Stand(3.0)], person)
    strides, flat = foot.strides, foot.motion.flat[1:-1].mean(axis=1)
    before, after = (foot.pivot(foot.motion.at(flat + step)) for step in (-1e-4, 1e-4))
    speed = np.linalg.norm(np.diff(strides.footprint, axis=0), axis=1) / strides.duration
    ahead = np.stack([np.sin(strides.heading), np.cos(strides.heading)], axis=1)
    return (after - before) / 2e-4, ahead[1:-1], speed[:-1]


def test_a_foot_moves_on_in_stance_by_its_shares_of_the_walking_speed_and_meets_its_footprints() -> None:
    moved = replace(Person(), forward_s_m=0.02, sideways=-0.01)
    still, ahead, speed = stance_velocity(Person())
    moves = (stance_velocity(moved)[0] - still)[:, :2]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    assert np.sum(moves * ahead, axis=1) == pytest.approx(0.02 * speed**2, rel=0.05)
    assert np.sum(moves * left, axis=1) == pytest.approx(-0.01 * speed, rel=0.05)
    foot, stood = made(AHEAD, moved), made(AHEAD)
    ends = np.array([1.0, foot.strides.end_s - 0.5])
    one, other = (f.motion.at(ends) for f in (foot, stood))
    assert one.position == pytest.approx(other.position, abs=1e-9)
    assert one.velocity == pytest.approx(other.velocity, abs=1e-9)


def test_moving_feet_are_drawn_for_their_seed_and_leave_all_else_as_it_is() -> None:
    still, moving = (simulate("demo", 1, Choices(feet=feet)) for feet in (None, "moving"))
    again = simulate("stairs", 1, Choices(feet="moving"))
    assert 0.0 < moving.person.forward_s_m == again.person.forward_s_m
    assert replace(moving.person, forward_s_m=0.0, sideways=0.0) == still.person
    assert np.array_equal(moving.strides.footprint, still.strides.footprint)
    assert np.array_equal(moving.biases.gyr, still.biases.gyr)


# ---- persons and mounts


def test_persons_scatter_about_the_default_and_all_their_gaits_alike() -> None:
    """No one who is drawn is refused, though running leaves least room; medians stay, scatter is what is promised."""
    people, usual = [Person().draw(np.random.default_rng(seed)) for seed in range(500)], Person()

    def column(name: str, gait: str = "walk") -> np.ndarray:
        return np.array([getattr(getattr(one, gait), name) for one in people])

    for names, sd in VARIETY.items():
        of = [column(name) / getattr(usual.walk, name) for name in names]
        assert np.median(of[0]) == pytest.approx(1.0, abs=0.15 * sd)
        assert np.log(of[0]).std() == pytest.approx(sd, rel=0.15)
        np.testing.assert_allclose(of[0], of[-1])
    assert column("swing_share").std() == pytest.approx(SWING_SHARE_SD, rel=0.15)
    slip = column("slip_m") / usual.walk.slip_m
    assert (slip.min(), slip.mean(), slip.max()) == pytest.approx((0.0, 1.0, 2.0), abs=0.1)
    for name in ("toe_up_rad", "inversion_rad", "clearance_m", "rollover_rad"):
        of = [column(name, gait) / getattr(getattr(usual, gait), name) for gait in ("walk", "stairs_up")]
        np.testing.assert_allclose(*of)
    # treads are as deep for all, and no one walks on the spot
    assert all(len(set(column("stride_m", gait))) == 1 for gait in ("stairs_up", "stairs_down", "turn"))
    assert people[0] == Person().draw(np.random.default_rng(0)) != people[1]


def test_everybody_can_walk_run_and_climb() -> None:
    for seed in range(20):
        person = Person().draw(np.random.default_rng(seed))
        for sections in (
            [Stand(1.0), Walk(straight(8.0)), TurnOnSpot(np.pi), Stairs(6), Stairs(6, up=False)],
            [Walk(straight(15.0), Style.RUN), Stand(1.0)],
        ):
            foot = made(sections, person, seed=seed)
            state = foot.motion.at(np.arange(0.0, foot.strides.end_s, 5e-3))
            assert np.linalg.norm(state.force, axis=1).max() < 50 * 9.81
            assert np.isfinite(state.rate).all()
            assert state.position[:, 2].min() > -0.1 - 8 * 0.17
            assert np.all(np.diff(foot.motion.flat[1:-1]) > 0.009)


def test_a_mounting_is_drawn_once_about_its_mean() -> None:
    for mount in (INSTEP, HEEL):
        mounted = [mount.draw(np.random.default_rng(seed)) for seed in range(300)]
        for name in ("lever", "tilt"):
            unit = "m" if name == "lever" else "rad"
            mean, sd = (np.array(getattr(mount, f"{name}{of}_{unit}")) for of in ("", "_sd"))
            values = np.array([getattr(one, f"{name}_{unit}") for one in mounted])
            np.testing.assert_allclose(values.mean(axis=0), mean, atol=0.25 * sd.max())
            np.testing.assert_allclose(values.std(axis=0), sd, rtol=0.15)
        assert mounted[0].draw(np.random.default_rng(9)) == mounted[0]
        assert mount.mirror().mirror() == mount != mounted[0].mirror()
    forward = INSTEP.foot_R_body[:, 0]
    assert np.rad2deg(np.arcsin(forward[2])) == pytest.approx(25.0)  # up along the instep


# ---- what cannot be


def test_what_cannot_be_is_refused() -> None:
    for make, words in (
        (lambda: Gait(stride_s=0.0), "stride_s cannot be 0.0"),
        (lambda: Person(forward_s_m=0.5), "forward_s_m"),
        (lambda: Mount(lever_m=(0.0, np.inf, 0.0)), "lever_m"),
    ):
        with pytest.raises(SimulationError, match=words):
            make()


def test_a_foot_may_only_stand() -> None:
    alone = Strides(np.zeros(0), np.zeros(0), np.zeros((1, 3)), np.zeros(1), np.zeros(0, dtype=np.int64), 3.0)
    motion = build_foot_motion(alone, Person(), INSTEP, np.random.default_rng(0))
    state = motion.at(np.linspace(0, 3, 50))
    np.testing.assert_allclose(np.linalg.norm(state.force, axis=1), GRAVITY_M_S2, rtol=1e-3)
    np.testing.assert_array_equal(motion.flat, [[0.0, 3.0]])
