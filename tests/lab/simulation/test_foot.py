"""The simulated foot is physics: its kinematics agree with each other and with how feet move."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.lab.simulation.foot import FootMotion, build_foot_motion
from fg_nav.lab.simulation.motion import Kinematics, Strides, Style
from fg_nav.lab.simulation.mount import HEEL, INSTEP, Mount
from fg_nav.lab.simulation.path import Pose, arc, straight
from fg_nav.lab.simulation.person import Gait, Person, Shock
from fg_nav.lab.simulation.plan import Section, Stairs, Stand, TurnOnSpot, Walk, end_of, plan
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.samples.gaps import compensate_coning

NONE = Shock(0.0, 0.0, 20.0, 0.1)
QUIET = dict.fromkeys(("strike", "crack", "slap", "toe_off", "tremor"), NONE)


@dataclass(frozen=True)
class Foot:
    """A motion with all that made it."""

    strides: Strides
    motion: FootMotion
    mount: Mount

    @property
    def t(self) -> np.ndarray:
        return np.arange(0.0, self.strides.end_s, 1e-3)

    def pivot(self, state: Kinematics) -> np.ndarray:
        """Pivot (N, 3) m."""
        return state.position - self.nav_R_foot(state) @ self.motion.lever_m

    def nav_R_foot(self, state: Kinematics) -> np.ndarray:
        return state.nav_R_body @ self.motion.foot_R_body.T


def section_of(style: Style, count: int, person: Person) -> Section:
    """About `count` strides of a style."""
    if style in (Style.WALK, Style.RUN):
        return Walk(straight(person.gait(style).stride_m * count), style)
    if style is Style.TURN:
        return TurnOnSpot(np.pi / 4 * count)
    return Stairs(2 * count, up=style is Style.STAIRS_UP)


def integration_errors(motion: FootMotion, strides: Strides, rate_hz: float, corrected: bool = False) -> np.ndarray:
    """Error (K, 3, 3) at the end of each stride: of attitude, mdeg; of velocity, mm/s; of position, mm."""
    found, period_s = [], 1 / rate_hz
    for begin, end in zip(strides.start, strides.start + strides.duration, strict=True):
        t = np.arange(np.ceil(begin * rate_hz), np.floor(end * rate_hz) + 1) / rate_hz
        rate, force = motion.sampled(t[:-1], period_s)
        if corrected:
            force, rate = compensate_coning(force, rate, np.full(len(rate), period_s))
        ends = motion.at(t[[0, -1]])
        state = NavState(ends.position[0], ends.velocity[0], ends.nav_R_body[0], np.zeros(3), np.zeros(3))
        turn, push = np.empty((3, 3)), np.empty(3)
        for n in range(len(rate)):
            strapdown(state, force[n], rate[n], period_s, GRAVITY_M_S2, turn, push)
        off = Rotation.from_matrix(state.nav_R_body.T @ ends.nav_R_body[1]).as_rotvec(degrees=True)
        found.append([off, state.velocity - ends.velocity[1], state.position - ends.position[1]])
    return 1e3 * np.array(found)


def joined(sections: list) -> list:
    """Sections with their paths moved to where each begins."""
    pose, placed = Pose(np.zeros(3), 0.0), []
    for section in sections:
        placed.append(replace(section, path=section.path.place(pose)) if isinstance(section, Walk) else section)
        pose = end_of(placed[-1], pose)
    return placed


def made(sections: list, person: Person = Person(), mount: Mount = INSTEP, seed: int = 1) -> Foot:
    rng = np.random.default_rng(seed)
    strides = plan(joined(sections), person, rng)
    return Foot(strides, build_foot_motion(strides, person, mount, rng), mount)


MIXED = [
    Stand(4.0),
    Walk(straight(15.0)),
    TurnOnSpot(np.pi),
    Walk(straight(12.0), Style.RUN),
    Stairs(8),
    Stand(5.0),
    Stairs(8, up=False),
    Walk(straight(6.0)),
    Stand(4.0),
]


@pytest.fixture(scope="module")
def mixed() -> Foot:
    return made(MIXED)


@pytest.fixture(scope="module")
def walk() -> Foot:
    return made([Stand(2.0), Walk(straight(75.0)), Stand(4.0)])


@pytest.fixture(scope="module")
def dense(walk: Foot) -> Kinematics:
    return walk.motion.at(walk.t)


# ---- kinematics agree with each other


def test_rate_and_force_are_the_derivatives_of_the_pose(mixed: Foot) -> None:
    seams = np.concatenate([mixed.strides.start, mixed.strides.start + mixed.strides.duration])
    t = np.sort(np.concatenate([np.random.default_rng(0).uniform(0.1, mixed.strides.end_s - 0.1, 3000), seams]))
    h = 1e-5
    before, now, after = (mixed.motion.at(t + offset) for offset in (-h, 0.0, h))
    acceleration = (after.velocity - before.velocity) / (2 * h)
    turn = Rotation.from_matrix(np.einsum("nji,njk->nik", before.nav_R_body, after.nav_R_body)).as_rotvec()
    force = np.einsum("nji,nj->ni", now.nav_R_body, acceleration + np.array([0, 0, GRAVITY_M_S2]))
    np.testing.assert_allclose(now.velocity, (after.position - before.position) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(now.rate, turn / (2 * h), atol=1e-4)
    np.testing.assert_allclose(now.force, force, atol=1e-2)


def test_attitude_is_a_rotation(mixed: Foot) -> None:
    R = mixed.motion.at(mixed.t[::50]).nav_R_body
    np.testing.assert_allclose(np.einsum("nij,nkj->nik", R, R), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)


def test_force_has_no_steps_where_styles_change(mixed: Foot) -> None:
    change = np.flatnonzero(np.diff(mixed.strides.style)) + 1
    assert len(change) >= 4
    t = mixed.strides.start[change]
    jump = mixed.motion.at(t + 1e-6).force - mixed.motion.at(t - 1e-6).force
    assert np.abs(jump).max() < 1e-2


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 400.0])
def test_a_sample_is_the_mean_over_its_period(walk: Foot, rate_hz: float) -> None:
    t = np.arange(3.0, 8.0, 1 / rate_hz)
    rate, force = walk.motion.sampled(t, 1 / rate_hz)
    fine = 50
    centres = (t[:, None] + (np.arange(fine) + 0.5) / fine / rate_hz).ravel()
    state = walk.motion.at(centres)
    np.testing.assert_allclose(rate, state.rate.reshape(-1, fine, 3).mean(axis=1), atol=2e-3)
    np.testing.assert_allclose(force, state.force.reshape(-1, fine, 3).mean(axis=1), atol=2e-2)


@pytest.mark.parametrize("mount", [INSTEP, HEEL], ids=["instep", "heel"])
@pytest.mark.parametrize("style", list(Style))
def test_samples_integrate_to_the_truth(style: Style, mount: Mount) -> None:
    """Plainly to second order; with coning and sculling within 0.3 mm/s and 0.2 mm of each stride at 400 Hz."""
    foot = made([Stand(1.0), section_of(style, 12, Person())], mount=mount)
    plain = [
        np.median(np.linalg.norm(integration_errors(foot.motion, foot.strides, hz), axis=2), axis=0)
        for hz in (200.0, 400.0, 800.0)
    ]
    ratio = np.array(plain[:-1]) / plain[1:]
    assert np.all((ratio > 3.5) & (ratio < 4.5)), ratio
    _, velocity, position = np.linalg.norm(
        integration_errors(foot.motion, foot.strides, 400.0, corrected=True), axis=2
    ).T.max(axis=1)
    assert velocity < 0.3  # a runner whose heel is hit: where shocks peak
    assert position < 0.2


def test_blocks_and_seeds_decide_nothing_else(mixed: Foot) -> None:
    t = np.arange(0.0, mixed.strides.end_s, 0.01)
    whole = mixed.motion.at(t)
    parts = [mixed.motion.at(t[i : i + 333]) for i in range(0, len(t), 333)]
    np.testing.assert_array_equal(whole.force, np.concatenate([part.force for part in parts]))
    np.testing.assert_array_equal(whole.force, made(MIXED).motion.at(t).force)
    assert not np.array_equal(whole.force, made(MIXED, seed=2).motion.at(t[:100]).force)


# ---- it moves as feet do


def test_a_walking_foot_swings_as_one(walk: Foot, dense: Kinematics) -> None:
    walking = (walk.t > walk.strides.start[3]) & (walk.t < walk.strides.start[-3])
    foot = walk.nav_R_foot(dense)
    pitch_deg = np.rad2deg(np.arcsin(-foot[walking, 2, 0]))
    rate_deg_s = np.rad2deg(dense.rate @ walk.motion.foot_R_body.T)[walking]
    each = [slice(np.searchsorted(walk.t, s), np.searchsorted(walk.t, s + 0.9)) for s in walk.strides.start[3:-3]]
    peak = np.rad2deg(dense.rate @ walk.motion.foot_R_body.T)[:, 1]
    assert 400 < np.median([peak[part].max() for part in each]) < 600
    assert 55 < np.percentile(pitch_deg, 99) < 70
    assert -35 < pitch_deg.min() < -25
    assert np.all(np.abs(rate_deg_s[:, [0, 2]]).max(axis=0) > 80)
    strength = np.linalg.norm(dense.force, axis=1)
    hardest = np.array([strength[part].max() for part in each])
    assert 3 * GRAVITY_M_S2 < np.median(hardest) < 8 * GRAVITY_M_S2
    assert 4 < np.linalg.norm(dense.velocity, axis=1).max() < 6.5
    assert 0.08 < np.ptp(dense.position[:, 2]) < 0.2


def test_heel_and_sole_stay_above_the_floor(walk: Foot, dense: Kinematics) -> None:
    """The rigid part: the forefoot bends in push-off."""
    pivot, foot = walk.pivot(dense), walk.nav_R_foot(dense)
    for ahead, below in ((0.0, 0.01), (-0.15, 0.015)):
        height = (pivot + foot @ np.array([ahead, 0.0, 0.0]))[:, 2]
        assert height.min() > -below
        assert height.max() > 0.08


def test_foot_stands_on_its_footprints(mixed: Foot) -> None:
    """At every heel-off the pivot is where the footprint is, but for what the sole gives way."""
    begin, end = mixed.motion.flat.T
    middle = (begin + end) / 2
    pivot = mixed.pivot(mixed.motion.at(middle))
    np.testing.assert_allclose(pivot[:, :2], mixed.strides.footprint[:, :2], atol=0.008)
    np.testing.assert_allclose(pivot[:, 2], mixed.strides.footprint[:, 2], atol=0.006)
    state = mixed.motion.at(np.array([0.0, mixed.strides.end_s]))
    np.testing.assert_allclose(mixed.pivot(state)[-1], mixed.strides.footprint[-1], atol=1e-9)
    heading = compute_heading(mixed.nav_R_foot(mixed.motion.at(middle)))
    turned = np.angle(np.exp(1j * (heading - mixed.strides.heading)))
    assert np.rad2deg(np.abs(turned)).max() < 3


def test_flat_is_when_the_foot_does_not_swing(walk: Foot, dense: Kinematics) -> None:
    begin, end = walk.motion.flat.T
    assert walk.motion.flat.shape == (len(walk.strides) + 1, 2)
    assert begin[0] == 0
    assert end[-1] == walk.strides.end_s
    assert np.all(end > begin)
    assert np.all(begin[1:] > end[:-1])
    inside = [(walk.t >= b) & (walk.t <= e) for b, e in walk.motion.flat[1:-1]]
    pivot = np.linalg.norm(np.gradient(walk.pivot(dense), walk.t, axis=0), axis=1)
    rate, speed = np.rad2deg(np.linalg.norm(dense.rate, axis=1)), np.linalg.norm(dense.velocity, axis=1)
    assert max(np.median(pivot[part]) for part in inside) < 0.02
    assert max(np.median(rate[part]) for part in inside) < 40
    assert pivot[np.any(inside, axis=0)].max() < 0.05
    assert speed[np.any(inside, axis=0)].max() < 0.12
    for e, b in zip(end[1:-2], begin[2:-1], strict=True):
        assert rate[(walk.t > e) & (walk.t < b)].max() > 300


def test_just_outside_of_flat_the_foot_lands_and_pushes_off(walk: Foot, dense: Kinematics) -> None:
    pivot = np.linalg.norm(np.gradient(walk.pivot(dense), walk.t, axis=0), axis=1)
    rate = np.rad2deg(np.linalg.norm(dense.rate, axis=1))
    begin, end = walk.motion.flat[1:-1].T
    middle, landing, pushing = (np.searchsorted(walk.t, t) for t in ((begin + end) / 2, begin - 0.05, end + 0.08))
    for moving in (landing, pushing):
        assert np.median(pivot[moving]) > 5 * np.median(pivot[middle])
        assert np.median(rate[moving]) > 4 * np.median(rate[middle])


@pytest.mark.parametrize("style", list(Style))
def test_a_foot_is_flat_once_between_two_strides(style: Style) -> None:
    """Of runners too, whose stance is short: who pushes off before he has landed is flat in the middle of the two."""
    foot = made([Stand(2.0), section_of(style, 60, Person()), Stand(2.0)])
    begin, end = foot.motion.flat.T
    assert (end - begin).min() > 0.009
    assert np.all(begin[1:] > end[:-1])
    middle = (begin + end)[1:-1] / 2
    swinging = foot.strides.start[:-1] + 0.4 * foot.strides.duration[:-1]
    speed, fast = (np.linalg.norm(foot.motion.at(t).velocity, axis=1) for t in (middle, swinging))
    assert speed.max() < 0.2
    if style is not Style.TURN:
        assert np.median(speed) < 0.1 * np.median(fast)


def test_in_stance_the_sensor_rolls_about_the_pivot(walk: Foot, dense: Kinematics) -> None:
    """Its velocity is that of a foot that turns by some degrees a second, and a little slip and settling."""
    mid = walk.motion.flat[4:-4].mean(axis=1)
    t = np.sort(np.concatenate([mid + offset for offset in np.linspace(-0.05, 0.05, 21)]))
    state = walk.motion.at(t)
    foot_rate = state.rate @ walk.motion.foot_R_body.T
    rolling = np.einsum("nij,nj->ni", walk.nav_R_foot(state), np.cross(foot_rate, walk.motion.lever_m))
    speed, rest = (np.sqrt(np.mean((v**2).sum(axis=1))) for v in (rolling, state.velocity - rolling))
    assert 0.008 < speed < 0.035
    assert rest < 0.5 * speed
    assert 5 < np.rad2deg(np.median(np.linalg.norm(foot_rate, axis=1))) < 20
    assert 3 < np.rad2deg(np.median(foot_rate[:, 1])) < 18  # forward: the toe goes down
    along = np.array([0.0, 1.0, 0.0])  # the walk goes north
    assert 0.005 < np.median(state.velocity @ along) < 0.03


def test_a_sensor_in_the_heel_stands_stiller_and_is_hit_harder() -> None:
    feet = [made([Stand(1.0), Walk(straight(50.0))], mount=mount) for mount in (INSTEP, HEEL)]
    speed, peak = [], []
    for foot in feet:
        mid = foot.motion.flat[4:-4].mean(axis=1)
        speed.append(np.median(np.linalg.norm(foot.motion.at(mid).velocity, axis=1)))
        strength = np.linalg.norm(foot.motion.at(foot.t).force, axis=1)
        peak.append(np.percentile(strength, 99.5))
    assert speed[1] < 0.7 * speed[0]
    assert peak[1] > 1.1 * peak[0]


def test_slip_is_forward_and_correlated() -> None:
    rolling_off = replace(Gait(), settle_rad=0.0, rollover_rad=0.0, stir_rad=0.0, circumduction_m=0.0, **QUIET)
    foot = made([Walk(straight(1.29 * 600))], Person(walk=rolling_off))
    begin, end = foot.motion.flat[3:-3].T
    reach = end - begin
    early, late = (foot.pivot(foot.motion.at(begin + share * reach)) for share in (0.25, 0.72))
    slip_mm = 1e3 * (late - early)[:, :2]
    assert 0.2 < slip_mm[:, 1].mean() < 1.0  # north, and only part of the stance is looked at
    assert slip_mm[:, 1].std() > 0.2
    assert slip_mm[:, 0].std() < 0.7 * slip_mm[:, 1].std()
    neighbours = np.corrcoef(slip_mm[:-1, 1], slip_mm[1:, 1])[0, 1]
    assert neighbours == pytest.approx(Gait().slip_correlation, abs=0.15)


def test_the_sole_gives_way_in_stance_and_springs_back(walk: Foot) -> None:
    begin, end = walk.motion.flat[4:-4].T
    early, late = (walk.pivot(walk.motion.at(t))[:, 2] for t in (begin + 0.55 * (end - begin), end))
    sunk = early - late
    assert 0.0003 < np.median(sunk) < 0.002
    # what a stance loses comes back: no height is lost over 75 m
    assert abs(np.median(late[-20:]) - np.median(late[:20])) < 8e-4


def test_a_standing_foot_sways_and_comes_back(walk: Foot) -> None:
    begin = walk.strides.start[-1] + walk.strides.duration[-1] + 0.3
    t = np.arange(begin, walk.strides.end_s, 1e-3)
    state = walk.motion.at(t)
    rate_deg_s = np.rad2deg(np.linalg.norm(state.rate, axis=1))
    assert 0.005 < np.sqrt(np.mean(rate_deg_s**2)) < 0.3
    assert rate_deg_s.max() < 1.0
    assert np.ptp(state.position, axis=0).max() < 1e-3
    still = replace(Person(), sway_rad=0.0)
    foot = made([Stand(2.0), Walk(straight(10.0)), Stand(4.0)], still)
    end = foot.motion.at(np.arange(foot.strides.end_s - 2.5, foot.strides.end_s, 1e-2))
    assert np.abs(end.rate).max() < 1e-12


def test_shocks_leave_nothing_behind(walk: Foot) -> None:
    """The same walk without shocks is the same wherever none is under way."""
    person = Person(walk=replace(Gait(), **QUIET))
    quiet = made([Stand(2.0), Walk(straight(75.0)), Stand(4.0)], person, replace(INSTEP, ringing=NONE))
    np.testing.assert_array_equal(quiet.strides.start, walk.strides.start)
    bursts = walk.motion.bursts
    assert len(bursts.start) > 8 * len(walk.strides)
    assert len(quiet.motion.bursts.start) == 0
    over = np.maximum.accumulate(bursts.start + bursts.width)[:-1]
    free = over < bursts.start[1:] - 1e-3
    t = ((over + bursts.start[1:]) / 2)[free]
    assert len(t) > len(walk.strides) / 2
    ours, theirs = walk.motion.at(t), quiet.motion.at(t)
    for name in ("position", "velocity", "nav_R_body", "rate", "force"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    sharp, smooth = (np.std(np.diff(foot.motion.at(walk.t).force, axis=0)) for foot in (walk, quiet))
    assert sharp > 1.2 * smooth


def test_every_style_is_its_own(mixed: Foot) -> None:
    state = mixed.motion.at(mixed.t)
    strength, pitch = np.linalg.norm(state.force, axis=1), -mixed.nav_R_foot(state)[:, 2, 0]
    peak, steep = {}, {}
    for style in Style:
        parts = [
            (mixed.t > start) & (mixed.t < start + duration)
            for start, duration, of in zip(
                mixed.strides.start, mixed.strides.duration, mixed.strides.style, strict=True
            )
            if of == style
        ]
        peak[style] = np.median([strength[part].max() for part in parts])
        steep[style] = np.rad2deg(np.median([np.arcsin(pitch[part].max()) for part in parts]))
    assert peak[Style.RUN] > 1.5 * peak[Style.WALK] > 1.5 * peak[Style.TURN]
    assert steep[Style.RUN] > steep[Style.WALK] > steep[Style.STAIRS_UP] > steep[Style.TURN]


def test_who_goes_upstairs_lifts_the_foot_first() -> None:
    up, down = (made([Stairs(16, up=up)], Person()) for up in (True, False))
    for foot, early in ((up, True), (down, False)):
        k = 3
        t = foot.strides.start[k] + 0.5 * foot.strides.duration[k] * Person().stairs_up.swing_share
        floor = foot.strides.footprint[k : k + 2, 2]
        height = foot.pivot(foot.motion.at(np.array([t])))[0, 2]
        assert height > floor.max() - (0.0 if early else 0.02)


# ---- strides that cannot be


def strides(**changes: object) -> Strides:
    good = Strides(
        start=np.array([1.0, 2.0]),
        duration=np.array([1.0, 1.0]),
        footprint=np.array([[0.0, 0.0, 0.0], [0.0, 1.3, 0.0], [0.0, 2.6, 0.0]]),
        heading=np.zeros(3),
        style=np.zeros(2, dtype=np.int64),
        end_s=4.0,
    )
    return replace(good, **changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration": np.array([1.1, 1.0])}, "stride 0,"),
        ({"duration": np.array([1.0, 0.0])}, "stride 1,"),
        ({"start": np.array([-0.5, 2.0])}, "stride 0,"),
        ({"end_s": 2.5}, "stride 1,"),
        ({"footprint": np.full((3, 3), np.nan)}, "footprint"),
        ({"heading": np.zeros(2)}, "footprint more than strides"),
    ],
)
def test_strides_that_cannot_be_are_refused(changes: dict, words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        build_foot_motion(strides(**changes), Person(), INSTEP, np.random.default_rng(0))


def test_a_foot_may_only_stand() -> None:
    alone = Strides(np.zeros(0), np.zeros(0), np.zeros((1, 3)), np.zeros(1), np.zeros(0, dtype=np.int64), 3.0)
    motion = build_foot_motion(alone, Person(), INSTEP, np.random.default_rng(0))
    state = motion.at(np.linspace(0, 3, 50))
    np.testing.assert_allclose(np.linalg.norm(state.force, axis=1), GRAVITY_M_S2, rtol=1e-3)
    np.testing.assert_array_equal(motion.flat, [[0.0, 3.0]])


def stance_velocity(person: Person) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocity (K, 3) m/s of the pivot in the middle of each stance between strides, its direction, and the speed."""
    foot = made([Stand(4.0), Walk(arc(8.0, 2.0)), Stand(3.0)], person)
    strides, flat = foot.strides, foot.motion.flat[1:-1].mean(axis=1)
    h = 1e-4
    before, after = (foot.pivot(foot.motion.at(flat + step)) for step in (-h, h))
    speed = np.linalg.norm(np.diff(strides.footprint, axis=0), axis=1) / strides.duration
    ahead = np.stack([np.sin(strides.heading), np.cos(strides.heading)], axis=1)
    return (after - before) / (2 * h), ahead[1:-1], speed[:-1]


def test_a_foot_moves_on_in_stance_by_its_shares_of_the_walking_speed() -> None:
    person = Person()
    still, ahead, speed = stance_velocity(person)
    moving = stance_velocity(replace(person, forward_s_m=0.02, sideways=-0.01))[0]
    moves = (moving - still)[:, :2]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    assert np.sum(moves * ahead, axis=1) == pytest.approx(0.02 * speed**2, rel=0.05)
    assert np.sum(moves * left, axis=1) == pytest.approx(-0.01 * speed, rel=0.05)


def test_a_foot_that_moves_on_stands_where_its_person_does_and_meets_its_footprints() -> None:
    person = replace(Person(), forward_s_m=0.03, sideways=0.02)
    foot = made([Stand(4.0), Walk(straight(20.0)), Stand(3.0)], person)
    still = made([Stand(4.0), Walk(straight(20.0)), Stand(3.0)])
    ends = np.array([1.0, foot.strides.end_s - 0.5])
    places = [one.motion.at(ends) for one in (foot, still)]
    assert places[0].position == pytest.approx(places[1].position, abs=1e-9)
    assert places[0].velocity == pytest.approx(places[1].velocity, abs=1e-9)


def test_moving_feet_are_drawn_for_their_seed_and_leave_all_else_as_it_is() -> None:
    still, moving = (simulate("demo", 1, Choices(feet=feet)) for feet in (None, "moving"))
    again = simulate("stairs", 1, Choices(feet="moving"))
    assert (still.person.forward_s_m, still.person.sideways) == (0.0, 0.0)
    assert 0.0 < moving.person.forward_s_m == again.person.forward_s_m
    assert replace(moving.person, forward_s_m=0.0, sideways=0.0) == still.person
    assert np.array_equal(moving.strides.footprint, still.strides.footprint)
    assert np.array_equal(moving.biases.gyr, still.biases.gyr)
    with pytest.raises(SimulationError, match="feet cannot be 'cold'"):
        simulate("demo", 1, Choices(feet="cold"))  # type: ignore[arg-type]
    with pytest.raises(SimulationError, match="forward_s_m"):
        Person(forward_s_m=0.5)
