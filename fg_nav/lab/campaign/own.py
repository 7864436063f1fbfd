"""A scenario of the user's own in a plan: the text of its file (`lab.simulation.scenario_file`), as workers get it.

Its group is the file's name, so that no built-in scenario has the same.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fg_nav.errors import CampaignError
from fg_nav.lab.simulation import Scenario
from fg_nav.lab.simulation.scenario_file import scenario_of


@dataclass(frozen=True)
class Own:
    """Name and text of the file."""

    name: str
    text: str

    @property
    def scenario(self) -> Scenario:
        """As the simulator takes it; raises `SimulationError` where the file describes what cannot be."""
        return scenario_of(self.name, self.text)

    @property
    def course(self) -> Any:
        """What the file says of the way: nothing else of the scenario tells it."""
        return tomllib.loads(self.text)["course"]


def read_own(path: Path) -> Own:
    """Read a file, and see that there is such a scenario; raises `CampaignError` or `SimulationError` otherwise."""
    try:
        own = Own(path.name, path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CampaignError(f"the scenario {path} cannot be read ({error.strerror}): name a file that can.") from None
    except UnicodeDecodeError as error:
        raise CampaignError(f"{path.name} is no TOML: {error}.") from None
    _ = own.scenario
    return own
