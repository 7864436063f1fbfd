"""What a verb wrote into a folder, read back."""

import json
from pathlib import Path
from typing import Any

import pandas as pd

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
