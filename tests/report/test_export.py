"""A path that is exported is the same where another program reads it."""

import json
import shutil
import struct
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pymap3d
import pytest
from pymap3d.vincenty import vdist
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from fg_nav.errors import FgNavError, FormatError, OutputError
from fg_nav.report.export import EXPORTS, export_track
from fg_nav.report.export.maps import outline_ellipses
from fg_nav.report.export.track import POSITION, ExportTrack, Origin, parse_start, read_result
from fg_nav.report.files import write_json, write_paths
from fg_nav.solution import Solution
from tests.command_line import FgNav
from tests.report.walks import stance_table

N, EVERY = 401, 50
AT = np.arange(0, N, EVERY)
MUNICH = Origin(48.137, 11.575, 520.0)
KML = {"k": "http://www.opengis.net/kml/2.2"}


def walked() -> Solution:
    """Return a spiral up some stairs, 20 s at 20 Hz, with a footfall every 2.5 s; covariances are of any shape."""
    t = np.arange(N) / 20.0 + 3.0
    angle = 0.3 * (t - 3.0)
    position = np.stack([t * np.cos(angle), t * np.sin(angle), 0.1 * t], axis=1)
    position -= position[0]
    attitude = Rotation.from_euler("zyx", np.stack([angle, 0.2 * np.sin(t), 0.1 * np.cos(t)], axis=1)).as_matrix()
    k, shape = np.arange(len(AT)), np.array([[1.0, 0.3, 0.1], [0.3, 0.4, -0.05], [0.1, -0.05, 0.2]])
    stances = stance_table(
        t, position, attitude, AT, gyro_bias=np.tile([0.01, 0.02, 0.03], (len(k), 1)), heading_sigma=0.01 * (k + 1),
        position_cov=(0.05 * (k + 1))[:, None, None] ** 2 * shape, gyro_bias_sigma=np.full((len(k), 3), 1e-3),
    )  # fmt: skip
    return Solution("smoother", t, position, np.gradient(position, t, axis=0), attitude, stances, runtime_s=0.1)


@pytest.fixture(scope="module")
def solution() -> Solution:
    return walked()


@pytest.fixture(scope="module")
def folder(solution: Solution, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of a result, without pictures."""
    place = tmp_path_factory.mktemp("results") / "office-smoother-1"
    place.mkdir()
    write_paths(place, solution)
    write_json(place / "summary.json", {"method": "smoother", "magnetometer": "not used"})
    write_json(place / "config.json", {"heading_deg": None})
    return place


@pytest.fixture(scope="module")
def track(folder: Path) -> ExportTrack:
    return read_result(folder)


def test_the_folder_of_a_result_says_what_the_solution_says(solution: Solution, track: ExportTrack) -> None:
    direct = ExportTrack.of(solution)
    assert (track.name, track.method) == ("office-smoother-1", "smoother")
    for name in ("t", "position", "nav_R_body", "velocity"):
        np.testing.assert_allclose(getattr(track, name), getattr(direct, name), atol=3e-7)
    pd.testing.assert_frame_equal(track.footfalls, direct.footfalls, rtol=1e-8)
    np.testing.assert_allclose(track.cov, solution.stances.position_cov, rtol=1e-7)
    for n in range(N - 4, N):  # the line that is drawn reaches the end
        assert replace(track, t=track.t[:n]).line[[0, -1]].tolist() == [0, n - 1]
    assert "sensor's x axis" in track.notes[0]


@pytest.mark.parametrize("angle_deg", [90.0, 30.0])
def test_turning_is_clockwise_and_turns_all_that_has_a_direction(
    solution: Solution, track: ExportTrack, angle_deg: float
) -> None:
    """What was north is to the east; against the path of one who walked turned."""
    R, stances = Rotation.from_euler("z", -angle_deg, degrees=True).as_matrix(), solution.stances
    walked_turned = replace(
        solution,
        position=solution.position @ R.T,
        velocity=solution.velocity @ R.T,
        nav_R_body=R @ solution.nav_R_body,
        stances=replace(
            stances,
            position=stances.position @ R.T,
            nav_R_body=R @ stances.nav_R_body,
            position_cov=R @ stances.position_cov @ R.T,
        ),
    )
    turned, expected = track.turn(angle_deg), ExportTrack.of(walked_turned)
    for name in ("position", "velocity", "nav_R_body", "cov"):
        np.testing.assert_allclose(getattr(turned, name), getattr(expected, name), atol=3e-7, err_msg=name)
    pd.testing.assert_frame_equal(turned.footfalls, expected.footfalls, rtol=1e-6, atol=1e-9)
    pd.testing.assert_frame_equal(turned.tabulate(), expected.tabulate(), rtol=1e-4, atol=1e-6)


def test_a_kilometer_is_a_kilometer_on_the_earth() -> None:
    walk_m = np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [0.0, 1000.0, 0.0], [600.0, -800.0, 0.0]])
    for latitude in (0.0, -33.9, 78.2):
        place = Origin(latitude, 11.575).locate(walk_m)
        np.testing.assert_allclose(place[0], [11.575, latitude, 0.0], atol=1e-12)
        for (longitude, north, _), toward_deg in zip(place[1:], (90.0, 0.0, 143.130102), strict=True):
            distance_m, azimuth_deg = vdist(latitude, 11.575, north, longitude)
            assert distance_m == pytest.approx(1000.0, abs=1e-3)
            assert np.cos(np.deg2rad(azimuth_deg - toward_deg)) == pytest.approx(1.0, abs=1e-8)


def returned(place: np.ndarray) -> np.ndarray:
    """East, north, up of longitude, latitude, height."""
    longitude, latitude, height = np.asarray(place, dtype=float).T
    return np.stack(pymap3d.geodetic2enu(latitude, longitude, height, 48.137, 11.575, 520.0), axis=1)


def test_geojson_returns_the_path(track: ExportTrack, tmp_path: Path) -> None:
    export_track(track, tmp_path / "walk.geojson", MUNICH)
    content = json.loads((tmp_path / "walk.geojson").read_text())
    kinds = [feature["properties"]["kind"] for feature in content["features"]]
    assert kinds == ["ellipse"] * len(AT) + ["path"] + ["footfall"] * len(AT)
    path = content["features"][len(AT)]
    np.testing.assert_allclose(returned(path["geometry"]["coordinates"]), track.position[track.line], atol=1e-3)
    for k, feature in enumerate(content["features"][len(AT) + 1 :]):
        np.testing.assert_allclose(returned([feature["geometry"]["coordinates"]])[0], track.position[AT[k]], atol=1e-3)
        known = feature["properties"]
        assert (known["index"], known["time_s"]) == (k, track.t[AT[k]])
        assert known["sigma_x_m"] == pytest.approx(0.05 * (k + 1))
        assert "time_utc" not in known


def test_an_ellipse_is_95_percent_and_turns_left(track: ExportTrack) -> None:
    _, corner = outline_ellipses(track)
    np.testing.assert_array_equal(corner[:, 0], corner[:, -1])
    from_centre = corner[:, :, :2] - track.footfalls[POSITION].to_numpy()[:, None, :2]
    distance2 = np.einsum("eci,eij,ecj->ec", from_centre, np.linalg.inv(track.cov[:, :2, :2]), from_centre)
    np.testing.assert_allclose(np.exp(-distance2 / 2), 0.05, rtol=1e-9)
    x, y = np.moveaxis(corner, 2, 0)[:2]
    assert ((x[:, :-1] * y[:, 1:] - x[:, 1:] * y[:, :-1]).sum(axis=1) > 0).all()


@pytest.mark.parametrize(("ending", "layers"), [(".geojson", 1), (".kml", 3)])
def test_gdal_opens_the_maps(track: ExportTrack, tmp_path: Path, ending: str, layers: int) -> None:
    pyogrio = pytest.importorskip("pyogrio", reason="of the extra checks")
    file = tmp_path / f"walk{ending}"
    export_track(replace(track, start=parse_start("2026-05-04T09:30:00Z")), file, MUNICH)
    names = [name for name, _ in pyogrio.list_layers(file)]
    assert len(names) == layers
    name = "footfalls" if ending == ".kml" else names[0]
    about, _, geometry, columns = pyogrio.raw.read(file, layer=name)
    fields = dict(zip(about["fields"], columns, strict=True))
    point = np.array([len(wkb) == 29 for wkb in geometry])  # little-endian, type, three doubles
    assert point.sum() == len(AT)
    places = [struct.unpack("<3d", wkb[5:]) for wkb in geometry[point]]
    np.testing.assert_allclose(returned(places), track.position[AT], atol=1e-3)
    for column in ("time_s", "heading_deg", "sigma_x_m", "cov_xy_m2"):
        np.testing.assert_allclose(fields[column][point].astype(float), track.footfalls[column], rtol=1e-6)
    if ending == ".kml":
        drawn = pyogrio.raw.read(file, sql="SELECT OGR_STYLE FROM path", sql_dialect="OGRSQL")[3]
        assert drawn[0][0].startswith("PEN(c:#0072B2FF,w:3.0")
    assert "WGS 84" in about["crs"] or "4326" in about["crs"]


def test_kml_has_looks_heights_and_times(track: ExportTrack, tmp_path: Path) -> None:
    export_track(track, tmp_path / "walk.kml", Origin(48.137, 11.575))
    start = parse_start("2026-05-04T09:30:00+02:00")
    export_track(replace(track, start=start), tmp_path / "timed.kml", MUNICH)
    plain, timed = (ElementTree.parse(tmp_path / f"{name}.kml").getroot() for name in ("walk", "timed"))
    placemarks = plain.findall(".//k:Placemark", KML)
    assert len(placemarks) == 2 * len(AT) + 1
    assert all(len(one.findall("k:Style", KML)) == 1 for one in placemarks)
    # opacity, blue, green, red
    for style, colors in (
        ("Line", {"66b27200", "ffb27200"}),
        ("Poly", {"14b27200"}),
        ("Icon", {"ffb27200"}),
    ):
        assert {one.text for one in plain.iterfind(f".//k:{style}Style/k:color", KML)} == colors, style
    assert {one.text for one in plain.iterfind(".//k:altitudeMode", KML)} == {"clampToGround"}
    assert not plain.findall(".//k:when", KML)
    when = [one.text for one in timed.iterfind(".//k:when", KML)]
    assert (len(when), when[1]) == (len(AT), "2026-05-04T07:30:02.500Z")
    assert {one.text for one in timed.iterfind(".//k:altitudeMode", KML)} == {"absolute"}
    # rings are closed, and where the ellipses are
    rings = [one.text.split() for one in timed.iterfind(".//k:LinearRing/k:coordinates", KML)]
    assert all(ring[0] == ring[-1] for ring in rings)
    found = [returned([row.split(",") for row in ring]) for ring in rings]
    np.testing.assert_allclose(found, outline_ellipses(track)[1], atol=2e-3)


def test_gpx_returns_footfalls_and_their_times(track: ExportTrack, tmp_path: Path) -> None:
    gpxpy = pytest.importorskip("gpxpy")
    start = parse_start("2026-05-04T09:30:00Z")
    export_track(replace(track, start=start), tmp_path / "walk.gpx", MUNICH)
    (line,) = gpxpy.parse((tmp_path / "walk.gpx").read_text()).tracks
    (segment,) = line.segments
    places = [(point.longitude, point.latitude, point.elevation) for point in segment.points]
    np.testing.assert_allclose(returned(places), track.position[AT], atol=1e-3)
    assert [(point.time - start).total_seconds() for point in segment.points] == list(track.t[AT] - track.t[0])
    assert [float(point.extensions[1].text) for point in segment.points] == list(track.footfalls["sigma_y_m"])
    export_track(track, tmp_path / "timeless.gpx", MUNICH)
    assert "<time>" not in (tmp_path / "timeless.gpx").read_text()


def test_matlab_has_covariances_and_says_what_is_what(track: ExportTrack, tmp_path: Path) -> None:
    export_track(track, tmp_path / "walk.mat")
    found = loadmat(tmp_path / "walk.mat", simplify_cells=True)
    np.testing.assert_array_equal(found["path"]["position_m"], track.position)
    np.testing.assert_array_equal(found["path"]["time_s"], track.t)
    quaternion = found["path"]["quaternion_wxyz"]
    back = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(back, track.nav_R_body, atol=1e-12)
    assert found["footfalls"]["position_cov_m2"].shape == (3, 3, len(AT))
    np.testing.assert_array_equal(found["footfalls"]["position_cov_m2"][:, :, 4], track.cov[4])
    assert list(found["footfalls"]["field_reason"]) == ["not used, as yet"] * len(AT)
    assert "East-North-Up" in found["about"]["frame"]
    assert found["about"]["start_utc"] == "not known"


def test_parquet_has_path_and_footfalls(track: ExportTrack, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="of the extra parquet")
    absolute = replace(track, t=track.t + 1.7e9, footfalls=track.footfalls.assign(time_s=track.t[AT] + 1.7e9))
    files = export_track(absolute, tmp_path / "walk.parquet")
    assert [file.name for file in files] == ["walk.parquet", "walk-footfalls.parquet"]
    path, footfalls = (pd.read_parquet(file) for file in files)
    np.testing.assert_array_equal(path[["x_m", "y_m", "z_m"]], track.position)
    assert path["time_utc"].iloc[0] == pd.Timestamp("2023-11-14T22:13:23Z")
    pd.testing.assert_frame_equal(footfalls.drop(columns="time_utc"), absolute.footfalls, check_dtype=False)
    assert "East-North-Up" in path.attrs["frame"]


def test_a_ros_bag_returns_odometry_and_path(track: ExportTrack, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="of the extra ros")
    from rosbags.highlevel import AnyReader

    export_track(track, tmp_path / "walk.mcap")
    with AnyReader([tmp_path / "walk.mcap"]) as reader:
        read = {
            connection.topic: [
                (stamp, reader.deserialize(raw, connection.msgtype)) for _, stamp, raw in reader.messages([connection])
            ]
            for connection in reader.connections
        }
    odometry = read["/fg_nav/odometry"]
    stamps = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec for _, message in odometry]
    np.testing.assert_allclose(stamps, track.t, atol=1e-9)
    np.testing.assert_allclose([1e-9 * stamp for stamp, _ in odometry], track.t, atol=1e-9)
    at = [message.pose.pose.position for _, message in odometry]
    np.testing.assert_array_equal([(p.x, p.y, p.z) for p in at], track.position)
    turned = [message.pose.pose.orientation for _, message in odometry]
    attitude = Rotation.from_quat([(q.x, q.y, q.z, q.w) for q in turned]).as_matrix()
    np.testing.assert_allclose(attitude, track.nav_R_body, atol=1e-12)
    moving = np.array([(v.x, v.y, v.z) for v in (message.twist.twist.linear for _, message in odometry)])
    np.testing.assert_allclose(np.einsum("nij,nj->ni", attitude, moving), track.velocity, atol=1e-9)
    covariance = odometry[AT[3]][1].pose.covariance.reshape(6, 6)
    np.testing.assert_allclose(covariance[:3, :3], track.cov[3], rtol=1e-9)
    assert covariance[5, 5] == pytest.approx(0.04**2, rel=1e-6)
    np.testing.assert_array_equal(covariance[[3, 4], [3, 4]], 1e6)  # not known
    ((_, path),) = read["/fg_nav/path"]
    places = [(pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) for pose in path.poses]
    np.testing.assert_allclose(places, track.position[AT], atol=1e-8)
    assert (path.header.frame_id, odometry[0][1].child_frame_id) == ("odom", "foot")
    with pytest.raises(FgNavError, match="--start"):  # beyond the clocks of ROS
        export_track(replace(track, t=track.t + 1e10), tmp_path / "w.mcap")
    assert not (tmp_path / "w.mcap").exists()


def test_of_an_odd_track_all_is_written_that_is_known(solution: Solution, tmp_path: Path) -> None:
    odd = ExportTrack.of(solution, "B\u00fcro \u8d70 <&>\x01\udce4")
    odd = replace(odd, footfalls=odd.footfalls.assign(sigma_x_m=np.nan, cov_xy_m2=np.nan))
    for ending in (".geojson", ".kml", ".gpx"):
        export_track(odd, tmp_path / f"walk{ending}", MUNICH)
        assert "nan" not in (tmp_path / f"walk{ending}").read_text().lower()
    assert not len(outline_ellipses(odd)[0])
    name = ElementTree.parse(tmp_path / "walk.kml").getroot().findtext("k:Document/k:name", namespaces=KML)
    assert name == json.loads((tmp_path / "walk.geojson").read_text())["name"] == "B\u00fcro \u8d70 <&>??"
    assert odd.format_utc(odd.t) is None
    absolute = replace(odd, t=odd.t + 1.7e9)
    assert absolute.format_utc(absolute.t[:1]) == ["2023-11-14T22:13:23.000Z"]
    began = replace(absolute, start=parse_start("2026-05-04T09:30:00Z"))
    assert began.format_utc(began.t[[0, -1]]) == ["2026-05-04T09:30:00.000Z", "2026-05-04T09:30:20.000Z"]


def test_the_command_writes_several_files(fg_nav: FgNav, folder: Path) -> None:
    ran = fg_nav(
        "export", folder, "a.kml", "a.mat", "--origin=-33.9,151.2", "--start", "2026-05-04T09:30:00Z"
    ).succeeded()
    assert "a.kml" in ran.out
    assert "a.mat" in ran.out
    assert "2026-05-04T09:30:00" in ran.out
    assert "--turn" in ran.out
    ran = fg_nav("export", folder, "b.gpx", "--origin=-33.9,151.2", "--turn", "-4", "--json")
    assert json.loads(ran.out)["files"] == ["b.gpx"]
    assert json.loads(ran.out)["footfalls"] == len(AT)
    assert json.loads(ran.out)["remarks"] == []
    for name, words in (("plain", ()), ("turned", ("--turn", "90"))):
        assert fg_nav("export", folder, f"{name}.tum", *words).code == 0
    plain, turned = np.loadtxt("plain.tum"), np.loadtxt("turned.tum")
    np.testing.assert_allclose(turned[:, 1:4], plain[:, [2, 1, 3]] * [1, -1, 1], atol=1e-6)  # north becomes east
    before = Path("a.mat").read_bytes()
    assert fg_nav("export", folder, "a.mat").refused("a.mat already exists", "--force")
    assert Path("a.mat").read_bytes() == before
    assert fg_nav("export", folder, "a.mat", "--force", "--quiet").out == ""
    own = folder / "trajectory.tum"
    assert fg_nav("export", folder, own, "--turn", "9", "--force").refused("trajectory.tum", "result itself")


def test_bad_requests_are_refused_in_a_sentence(fg_nav: FgNav, folder: Path) -> None:
    for words, said in (
        (("w.shp",), ("'.shp'", ".geojson, .kml, .gpx")),
        (("w.kml",), ("--origin",)),
        (("w.mat", "--origin", "48,11"), ("leave --origin out",)),
        (("w.kml", "--origin", "131.2,-33.9"), ("latitude 131.2", "try -33.9,131.2")),
        (("w.kml", "--origin", "48,211"), ("longitude 211", "latitude first")),
        (("w.kml", "--origin", "nan,11"), ("not on the Earth",)),
        (("w.kml", "--origin", "48,11", "--start", "yesterday"), ("ISO 8601",)),
        (("w.kml", "--origin", "48,11", "--start", "2026-05-04T09:30:00"), ("no zone",)),
    ):
        assert fg_nav("export", folder, *words).refused(*said), words
    assert not list(Path().iterdir())


def test_what_is_no_result_is_told_in_a_sentence(folder: Path, tmp_path: Path) -> None:
    def refuse(place: Path, words: str) -> None:
        with pytest.raises(FormatError, match=words):
            read_result(place)

    refuse(tmp_path / "nowhere", "is not there")
    refuse(folder / "strides.csv", "is a file")
    refuse(tmp_path, "no result of `fg-nav run`")
    (tmp_path / "comparison.json").write_text("[]")
    (tmp_path / "iez").mkdir()
    (tmp_path / "iez" / "trajectory.tum").touch()
    refuse(tmp_path, r"folder of one method in it \(iez\)")
    broken, text = tmp_path / "broken", (folder / "strides.csv").read_text()
    shutil.copytree(folder, broken)
    for name, damaged, words in (
        ("strides.csv", text.replace("cov_xy_m2", "cov"), "no column cov_xy_m2"),
        ("strides.csv", text.splitlines()[0], "no footfall"),
        ("strides.csv", text.replace("\n1,", "\none,"), "is damaged"),
        ("strides.csv", "", "is damaged"),
        ("summary.json", "{", "is damaged"),
        ("trajectory.tum", "1 2 3\n", "trajectory.tum"),
    ):
        (broken / name).write_text(damaged)
        refuse(broken, words)
        shutil.copy(folder / name, broken / name)


def test_an_extra_that_is_absent_is_named(track: ExportTrack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for ending, format in EXPORTS.items():
        if format.extra is None:
            continue
        _, module = format.extra
        monkeypatch.setitem(__import__("sys").modules, module, None)
        with pytest.raises(OutputError, match=rf"needs {module}: install it, `pip install '{module}[-\w]*>=[\d.]+'`"):
            export_track(track, tmp_path / f"w{ending}")
    assert not list(tmp_path.iterdir())
