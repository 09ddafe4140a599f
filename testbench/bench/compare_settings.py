"""Settings in words, as a reader of two manifests needs them; what has no word here keeps its key's."""

import re
from dataclasses import dataclass

from pydantic import JsonValue

Path = tuple[str, ...]  #: Keys from the manifest's scenario down to a setting.
DIGITS = 10  #: Of a checksum that are shown.
LONGEST = 60  #: Text of a setting [characters].
CHECKSUM = re.compile("[0-9a-f]{40,64}")
AROUND = ("scenario", "scope", "tried", "campaign")  #: Tables that only hold settings together.
UNITS = ("mm", "um", "kg", "deg", "rad", "percent", "N", "m", "s")  #: Last parts of keys that are units.


@dataclass(frozen=True)
class Named:
    """A setting for people."""

    words: str
    unit: str = ""
    scale: float = 1.0  #: From SI.


UM = 1e6
NAMES = {
    "sigma": Named("noise of a reading", "um", UM),
    "sigmas": Named("noises of a reading", "um", UM),
    "sigma_rotation": Named("noise of an orientation", "urad", UM),
    "payload": Named("hung mass", "kg"),
    "max_load": Named("heaviest hung weight", "N"),
    "force": Named("largest force", "N"),
    "moment": Named("largest moment", "N m"),
    "least": Named("least deflection", "mm", 1e3),
    "most": Named("largest deflection", "mm", 1e3),
    "distances": Named("distances of the tracker", "m"),
    "lower": Named("lower corner", "m"),
    "upper": Named("upper corner", "m"),
    "cone": Named("half angle", "deg", 57.29577951308232),
    "noise": Named("noisy readings"),
    "truth": Named("kind of truth"),
    "first": Named("first seed of all"),
    "magnification": Named("magnification of what is drawn"),
    "check_pose": Named("poses held back"),
    "readings": Named("file of readings"),
    "dataset": Named("file of readings"),
    "mapping": Named("map of columns"),
    "robust": Named("without outliers"),
    "intervals": Named("intervals asked for"),
    "full_pose": Named("positions and orientations"),
    "station": Named("work area of the calibration"),
    "area": Named("work area of the calibration"),
    "workspace": Named("workspace"),
    "anywhere": Named("workspace"),
    "m": Named("order of the search"),
    "per": Named("noise of the paper is that of a"),
    "ordered": Named("seeds in which the order is searched"),
    "thin": Named("of every so many readings one"),
}
"""By the last key."""


def words_of(path: Path) -> tuple[str, str]:
    """A setting's name, with what it belongs to, and its unit."""
    *tables, key = path or ("settings",)
    own, unit = _named(key)
    above = [_named(table)[0].words for table in tables if table not in AROUND]
    return ", ".join([*above, own.words]), unit


def show_setting(path: Path, value: JsonValue) -> str:
    """A setting's value, in the unit of its name."""
    own, _ = _named(path[-1] if path else "")
    text = _shown(value, own.scale)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def short(text: str) -> str:
    """A checksum or a commit by its first digits; any other text as it is."""
    return text[:DIGITS] if CHECKSUM.fullmatch(text) else text[:LONGEST]


def _named(key: str) -> tuple[Named, str]:
    """What a key is called, and its unit: of an unknown key its own words, its last one perhaps a unit."""
    if key in NAMES:
        return NAMES[key], NAMES[key].unit
    *words, last = key.split("_")
    unit = last if words and last in UNITS else ""
    name = " ".join(words if unit else [*words, last])
    return Named(name), "%" if unit == "percent" else unit


def _shown(value: JsonValue, scale: float) -> str:
    if value is None or value == []:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{scale * value:.6g}" if isinstance(value, float) or scale != 1 else str(value)
    if isinstance(value, list):
        return ", ".join(_shown(own, scale) for own in value)
    return short(value) if isinstance(value, str) else "a table"
