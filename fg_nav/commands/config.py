"""Configurations: `--config` takes back what a `config.json` says was asked for, `--set` changes parameters in it.

What wins, the later: the defaults, `--preset`, `--config`, the other options, `--set`. Heading, truth, fixes and known
distance belong to a recording: they are taken for the one that the configuration names, and left out for others.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Strict, ValidationError

from fg_nav.detection import StanceParameters
from fg_nav.errors import ConfigError, describe_reason
from fg_nav.estimators import CARD, CARD_CHANGES, Method, find_method, find_parameters, name_owners
from fg_nav.magnetic.detectors import DEFAULT
from fg_nav.report.terminal import remark
from fg_nav.text import (
    DETECTOR,
    Changes,
    Value,
    change_parameters,
    describe_invalid,
    explain_no_parameter,
    flatten,
    list_names,
    read_small,
    select_changes,
)
from fg_nav.walk import Mount, Options

BY_OTHER_MEANS = ("magnetic.gate", "smoothed", "inertial.smoothed")  # `--gate` and the method's name decide them.


class Given(BaseModel):
    """What was asked for, as `fg_nav.report.files.describe_given` writes it."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    method: str
    mount: Literal["foot", "pocket"]
    preset: str
    gate: str
    magnetic: Literal["all", "card"]
    use_magnetometer: bool
    mag_axes: str | None
    calibration: str | None
    places: str | None = None
    alignment: Literal["yaw", "none", "origin", "se3"]
    polish: bool
    step_constant_m: float | None
    heading_deg: float | None
    known_distance_m: float | None
    fixes: str | None
    gnss: str | None = None
    truth: str | None
    detector: dict[str, Any]
    parameters: dict[str, Any]


class Config(BaseModel):
    """A configuration: of which recording, and what was asked for."""

    recording: Annotated[str | None, Strict()]
    given: Given

    def list_defaults(self) -> dict[str, object]:
        """Return the values that it gives to command-line options, by option name."""
        given = self.given
        same = ("method", "mount", "preset", "magnetic", "mag_axes", "calibration", "places", "alignment", "polish")
        return {name: getattr(given, name) for name in same} | {
            "gate": None if given.gate == DEFAULT else given.gate,
            "no_mag": not given.use_magnetometer,
            "step_constant": given.step_constant_m,
        }

    def is_of(self, recording: Path) -> bool:
        """Whether it was written for this recording."""
        return self.recording is not None and Path(self.recording).resolve() == recording.resolve()

    def bind(self, options: Options, recording: Path) -> Options:
        """Return the options, completed by what belongs to the recording where this was written for it."""
        given = self.given
        own = {"heading_deg": given.heading_deg, "known_distance_m": given.known_distance_m} | {
            f"{name}_path": None if file is None else Path(file)
            for name, file in (("fixes", given.fixes), ("gnss", given.gnss), ("truth", given.truth))
        }
        taken = {key: value for key, value in own.items() if value is not None and getattr(options, key) is None}
        if taken and not self.is_of(recording):
            names = ", ".join(key.rpartition("_")[0] for key in taken)
            words = f"note: the configuration is of {self.recording}: its {names} left out for {recording}"
            remark(words, logging.WARNING)
            return options
        return replace(options, **taken)  # type: ignore[arg-type]


def read_config(path: Path) -> Config:
    """Read the `config.json` of a result; raises `ConfigError` where it is none."""
    try:
        return Config.model_validate_json(read_small(path))
    except ValidationError as error:
        what = describe_invalid(error, Config).removesuffix(".")
        words = f"{path} is no config.json of a result ({what}): give one as `fg-nav run` writes it."
    except OSError as error:
        words = f"{path} cannot be read ({describe_reason(error)}): give the config.json of a result."
    raise ConfigError(words)


def choose_changes(
    config: Config | None, words: Sequence[str], methods: Sequence[Method], mount: Mount, preset: str
) -> Changes:
    """Return (name, value) of the parameters that a configuration and the `words` of `--set` change in these methods.

    Raises `ConfigError` if the configuration is for none of these methods, or there is no such parameter;
    `EstimationError` if a value is of another type.
    """
    if mount == "pocket":
        return ()
    owners = {one.owner: find_parameters(one.name, preset) for one in methods if one.parameters is not None}
    if any("stances" in one.uses for one in methods):  # others find theirs as they go
        owners[DETECTOR] = StanceParameters()
    known = [name for owner, parameters in owners.items() for name in list_settings(owner, parameters)]
    # `--set name=value`: a value is JSON, or else a word
    settings: list[tuple[str, Value]] = []
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            raise ConfigError(f"--set {word} gives no value: write --set {name or 'NAME'}=VALUE.")
        if name.strip() not in known:
            raise ConfigError(explain_no_parameter(name.strip(), known))
        try:
            settings.append((name.strip(), json.loads(text)))
        except (ValueError, RecursionError):  # a word, or brackets without end
            settings.append((name.strip(), text))
    changes: Changes = tuple(settings)
    if config is not None:
        given, owner = config.given, find_method(config.given.method).owner
        names = [one.name for one in methods]
        if given.method not in names and owner not in owners:
            raise ConfigError(f"--config has the parameters of {given.method}, not of {', '.join(names)}: choose that.")
        if preset != given.preset:
            raise ConfigError(f"--config has all parameters, of the preset {given.preset}: leave --preset out.")
        # `--config`: all but what the gate, the name of the method and `--magnetic card` decide
        found = (*flatten(given.detector, DETECTOR), *flatten(given.parameters, owner))
        card = CARD in (given.method, given.magnetic)
        others = (*BY_OTHER_MEANS, *(name for name, _ in CARD_CHANGES if card))
        kept = tuple((name, value) for name, value in found if name.partition(".")[2] not in others)
        changes = (*kept, *settings)
    # are their values of the right type?
    for owner, parameters in owners.items():
        change_parameters(parameters, select_changes(changes, owner), owner)
    return changes


def list_settings(owner: str, parameters: object = None) -> list[str]:
    """Return the names that `--set` takes of an owner of parameters, or of the stances; of its own by default."""
    if parameters is None:
        parameters = StanceParameters() if owner == DETECTOR else find_parameters(name_owners()[owner])
    return [f"{owner}.{name}" for name in list_names(parameters) if name not in BY_OTHER_MEANS]
