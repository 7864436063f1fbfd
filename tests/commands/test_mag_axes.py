"""A magnetometer with axes of its own: said by every verb, used only with `--mag-axes`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav.calibration.of_recording import read_calibration
from fg_nav.io import read, write_canonical
from fg_nav.magnetic.axes import MagAxes
from tests.command_line import FgNav
from tests.commands.folders import config, summary
from tests.magnetic.turning_walks import minute

AXES = "-y,-x,z"  # A mirror.


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty-seven seconds at 100 Hz, 22 ms late."""
    path = tmp_path_factory.mktemp("recordings") / "turned.csv"
    recording = replace(minute(5, 0.022, rate_hz=100.0), truth=None).slice(0, 2700)
    write_canonical(MagAxes(MagAxes.parse(AXES).P.T).apply_to(recording), path)
    return path


def test_a_run_leaves_it_out_and_says_what_to_give(fg_nav: FgNav, turned: Path) -> None:
    assert fg_nav("run", turned, "--method", "iez", "--plots", "none", "--out", "plain").code == 0
    said = summary("plain")
    assert "axes" in str(said["magnetometer"])
    assert f"--mag-axes={AXES}" in str(said["notes"])
    assert said["magnetometer_delay"] is None
    assert fg_nav("run", turned, "--method", "iez", f"--mag-axes={AXES}", "--out", "given").code == 0
    said = summary("given")
    assert "mag-axes" not in str(said["notes"])
    assert "ms late" in str(said["notes"])
    assert said["magnetometer_delay"]["tau_s"] == pytest.approx(0.022, abs=0.001)
    assert config("given")["mag_axes"] == AXES


def test_inspect_and_detect_say_it(fg_nav: FgNav, turned: Path) -> None:
    assert f"--mag-axes={AXES}" in "".join(fg_nav("inspect", turned).out.split("\n")).replace(" ", "")
    for detectors in ("ma2018", "munoz-diaz"):
        assert fg_nav("detect", turned, "--gate", detectors).refused(f"--mag-axes={AXES}")
        assert fg_nav("detect", turned, "--gate", detectors, f"--mag-axes={AXES}").code == 0


def test_a_calibration_is_of_the_axes_given(fg_nav: FgNav, turned: Path) -> None:
    calibrate = ("calibrate", turned, "--out", "c.json", "--method")
    assert fg_nav(*calibrate, "levelled").refused(f"--mag-axes={AXES}")
    ran = fg_nav(*calibrate, "walk", f"--mag-axes={AXES}")
    assert ran.code == 0, ran.err
    assert f"--mag-axes={AXES}" in ran.out.replace("\n", "")
    write_canonical(MagAxes.parse(AXES).apply_to(read(turned)), Path("right.csv"))
    assert fg_nav("calibrate", Path("right.csv"), "--out", "right.json", "--method", "walk").code == 0
    given, right = (read_calibration(Path(name)).magnetometer for name in ("c.json", "right.json"))
    np.testing.assert_allclose(given.hard_iron_uT, right.hard_iron_uT, atol=1e-3)


@pytest.mark.usefixtures("solved_here")
def test_a_stream_is_turned_row_by_row(fg_nav: FgNav, turned: Path) -> None:
    short = Path("short.csv")
    short.write_text("".join(turned.read_text().splitlines(keepends=True)[:2400]))
    assert f"--mag-axes={AXES}" in fg_nav("stream", short, "--speed", "max", "--lag", "30").err
    ran = fg_nav("stream", short, "--speed", "max", f"--mag-axes={AXES}", "--out", "out")
    assert ran.code == 0
    assert "mag-axes" not in ran.err
    assert "ms late" in str(summary("out")["notes"])
    assert config("out")["mag_axes"] == AXES
