"""What a verb wrote into a folder, read back."""

import json
from pathlib import Path
from typing import Any

import pandas as pd

from fg_nav.io import write_tum
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth

METHOD_FILES = {"trajectory.tum", "strides.csv", "gait.csv", "summary.json", "config.json"}
PICTURES = {"trajectory.png", "heading.png", "gyro_bias.png"}


def read_json(folder: str | Path, name: str) -> dict[str, Any]:
    content = json.loads(Path(folder, name).read_text())
    assert isinstance(content, dict)
    return content


def summary(folder: str | Path) -> dict[str, Any]:
    return read_json(folder, "summary.json")


def config(folder: str | Path) -> dict[str, Any]:
    return read_json(folder, "config.json")


def strides(folder: str | Path, name: str = "strides.csv") -> pd.DataFrame:
    return pd.read_csv(Path(folder, name), keep_default_na=False, na_values=[""])


def write_truth(path: Path, recording: Recording, later_s: float = 0.0) -> None:
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    write_tum(path, truth.t + later_s, truth.position, truth.nav_R_body)
