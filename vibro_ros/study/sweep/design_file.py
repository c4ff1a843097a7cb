"""A sweep's design from its YAML file and from the words of the command line, which change what the file says."""

import argparse
import difflib
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vibro_ros.accuracy.starts import SETTLING
from vibro_ros.configuration.scene_file import config_folder, load_scene, scene_origin
from vibro_ros.configuration.strict_yaml import read_yaml
from vibro_ros.model.parameters import BY_NAME, parameter_named
from vibro_ros.study.measures import checked_names
from vibro_ros.study.options import settings_of
from vibro_ros.study.sweep.design import MOST_STARTS, Design
from vibro_ros.study.sweep.variation import sampling, sampling_in_words, varied, varied_in_words, whole_number

#: What a sweep is when neither file nor command line say otherwise; a scene and something that varies must be given.
DEFAULTS: Mapping[str, Any] = {"set": {}, "vary": {}, "sample": None, "measure": ["mean_speed"], "starts": 8,
                                  "settling": SETTLING, "duration": 10.0}
KEYS = ("scene", *DEFAULTS)


def shipped_sweeps() -> tuple[str, ...]:
    """Names of the sweeps that come with the package."""
    return tuple(sorted(path.stem for path in (config_folder() / "studies").glob("*.yaml")))


def sweep_path(name_or_path: str) -> Path:
    """The file of a shipped sweep's name, or `name_or_path` as a path (ValueError when there is neither)."""
    if name_or_path in shipped_sweeps():
        return config_folder() / "studies" / f"{name_or_path}.yaml"
    if os.path.isfile(name_or_path):
        return Path(name_or_path)
    raise ValueError(f"{name_or_path or repr(name_or_path)}: neither a shipped sweep nor a file; shipped sweeps are "
                     f"{', '.join(shipped_sweeps())}")


def read_sweep(path: Path) -> dict[str, Any]:
    """What the file at `path` says, checked key by key, for `design_of`; a relative path of its scene starts there.

    Raises
    ------
    ValueError
        Naming the file, the key, the value and the remedy.
    """
    document = read_yaml(path)
    try:
        if not isinstance(document, dict):
            raise ValueError(f"holds no mapping; give {', '.join(KEYS)}")
        for key in document:
            if key not in KEYS:
                near = difflib.get_close_matches(str(key), KEYS, n=1)
                raise ValueError(f"{key!r} is unknown; "
                                 f"{f'did you mean {near[0]}?' if near else 'give ' + ', '.join(KEYS)}")
        return {key: _checked(key, value, path.parent) for key, value in document.items()}
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _checked(key: str, value: object, folder: Path) -> Any:
    if key in ("set", "vary"):
        if not isinstance(value, dict):
            raise ValueError(f"{key}: {value!r} is no mapping; give parameters by name")
        check = varied if key == "vary" else (lambda name, given: parameter_named(name, BY_NAME).checked(given))
        return {str(name): check(str(name), given) for name, given in value.items()}
    if key == "scene":
        if not isinstance(value, str):
            raise ValueError(f"scene: {value!r} is no text; give a shipped scene's name or a path")
        return scene_origin(value, folder)
    if key == "sample":
        if not isinstance(value, dict) or not {"method", "count"} <= set(value) <= {"method", "count", "seed"}:
            raise ValueError(f"sample: {value!r} says not how; give method and count, and perhaps seed")
        return sampling(value["method"], value["count"], value.get("seed", 0))
    if key == "measure":
        if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
            raise ValueError(f"measure: {value!r} is no list of names; write [mean_speed, mean_power]")
        return list(checked_names(value))
    if key == "starts":
        return whole_number("starts", value, 0, MOST_STARTS)
    return _time(key, value)


def _time(key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{key}: {value!r} is not a number; give seconds")
    return float(value)


def given_in_words(options: argparse.Namespace) -> dict[str, Any]:
    """What the command line says, for `design_of`."""
    given = {key: getattr(options, key) for key in ("scene", "measure", "settling", "duration")}
    given["starts"] = None if options.starts is None else whole_number("--starts", options.starts, 0, MOST_STARTS)
    given["sample"] = sampling_in_words(options.sample) if options.sample else None
    said = {key: value for key, value in given.items() if value is not None}
    said["set"] = settings_of(options.set)
    said["vary"] = dict(varied_in_words(text) for text in options.vary)
    if len(said["vary"]) < len(options.vary):
        raise ValueError("--vary: a parameter is given twice; keep one")
    return said


def design_of(file: Mapping[str, Any], words: Mapping[str, Any]) -> Design:
    """The design that a sweep's file and the command line give together.

    A parameter that the command line sets or varies is no longer set or varied as the file says.

    Parameters
    ----------
    file, words : mapping
        From `read_sweep`, or empty, and `given_in_words`.

    Raises
    ------
    ValueError
        For what is missing, contradicts itself or has no meaning.
    """
    said = {**DEFAULTS, **file, **words}
    for key, other in (("set", "vary"), ("vary", "set")):
        kept = {name: value for name, value in file.get(key, {}).items() if name not in words.get(other, {})}
        said[key] = {**kept, **words.get(key, {})}
    for name in said["set"]:
        if name in said["vary"]:
            raise ValueError(f"{name}: is set and varied; keep one")
    if "scene" not in said:
        raise ValueError("scene: none given; give --scene NAME, or a sweep's file that names one")
    scene = load_scene(said["scene"]).with_parameters(said["set"])
    return Design(scene, tuple(said["vary"].values()), said["sample"], tuple(checked_names(said["measure"])),
                  said["starts"], said["settling"], said["duration"])
