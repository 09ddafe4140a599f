"""What differs in the inputs of runs: settings, files of arms, data, seeds, versions, commit."""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import TypeVar

from pydantic import JsonValue

from testbench.bench.truths import CALLED, TRUTHS, member
from testbench.errors import BenchError
from testbench.output.finished import Finished
from testbench.report.table import Row

ABSENT, NONE = "not said", "none"
SEEDS = (("first",), ("seed",))  #: Last keys of settings that say the first seed once more.
SHOWN = (".md", ".html", ".png", ".rrd", "manifest.json", "report.json")
"""Ends of files in the folder of a model that only tell of it."""
DIGITS = 10  #: Of a checksum that are shown.
LONGEST = 60  #: Text of a setting [characters].
CHECKSUM = re.compile("[0-9a-f]{40,64}")
AROUND = ("scenario", "scope", "tried", "campaign")  #: Tables that only hold settings together.
UNITS = ("mm", "um", "kg", "deg", "rad", "percent", "N", "m", "s")  #: Last parts of keys that are units.
NAMES = {
    "sigma": ("noise of a reading", "um", 1e6),
    "sigmas": ("noises of a reading", "um", 1e6),
    "sigma_rotation": ("noise of an orientation", "urad", 1e6),
    "payload": ("hung mass", "kg", 1.0),
    "max_load": ("heaviest hung weight", "N", 1.0),
    "force": ("largest force", "N", 1.0),
    "moment": ("largest moment", "N m", 1.0),
    "least": ("least deflection", "mm", 1e3),
    "most": ("largest deflection", "mm", 1e3),
    "distances": ("distances of the tracker", "m", 1.0),
    "lower": ("lower corner", "m", 1.0),
    "upper": ("upper corner", "m", 1.0),
    "cone": ("half angle", "deg", 57.29577951308232),
    "check_pose": ("poses held back", "", 1.0),
    "readings": ("file of readings", "", 1.0),
    "dataset": ("file of readings", "", 1.0),
    "full_pose": ("positions and orientations", "", 1.0),
    "station": ("work area of the calibration", "", 1.0),
    "area": ("work area of the calibration", "", 1.0),
    "anywhere": ("workspace", "", 1.0),
    "thin": ("of every so many readings one", "", 1.0),
}
"""Settings by their last key: words, unit, and how many of it an SI unit is; others keep their keys."""
Path = tuple[str, ...]  #: Keys from the manifest's scenario down to a setting.
K = TypeVar("K")


def inputs_differ(runs: Sequence[Finished]) -> list[Row]:
    """The inputs that are not the same in all runs, with their values in each; none if they are."""
    told = [run.manifest for run in runs]
    whole = {
        "command": [m.command for m in told],
        "seeds": [seeds_words(run) for run in runs],
        "commit": [_commit(m.git) for m in told],
    }
    rows = {what: _row(what, own) for what, own in whole.items() if len(set(own)) > 1}
    arms = [row for place in zip_longest(*(m.models.items() for m in told)) for row in _folder(place)]
    versions = _by_key("version of ", [m.versions for m in told])
    first, last = [rows.get("command")], [rows.get("seeds"), *arms, *versions, rows.get("commit")]
    return [row for row in (*first, *_settings(runs), *last) if row is not None]


def _row(what: str, values: Iterable[str], unit: str = "") -> Row:
    return Row(what=what, values=list(values), unit=unit)


def refuse_unlike(runs: Sequence[Finished]) -> None:
    """Refuse runs of other true arms, or one seed beside several: which errs less then says nothing.

    Raises:
        BenchError: Names the arms, or the seeds.
    """
    counts = {run.manifest.seeds for run in runs if run.manifest.seeds}
    problem, known = "", [(run, arms) for run in runs if (arms := _true_arms(run))]
    alone = {run.manifest.seed for run, _ in known if run.manifest.seeds == 1}
    if 1 in counts and len(counts) > 1:
        told = "; ".join(f"{run.folder}: {seeds_words(run)}" for run in runs)
        problem = f"one seed in each or several in each, as one seed has no spread, got seeds {told}"
    elif len({arms for _, arms in known}) > 1 or (len(alone) > 1 and len(known) > 1):
        told = "; ".join(
            f"{run.folder}: {', '.join(sorted(arms))}, seeds {seeds_words(run)}" for run, arms in known
        )
        problem = f"the same true arms, of one seed each the same seed, got {told}"
    if problem:
        raise BenchError(f"runs: expected {problem}; --anyway compares them all the same")


def _true_arms(run: Finished) -> frozenset[str]:
    """Which true arms a simulated run has met; none where it says of none."""
    manifest = run.manifest
    named = {leaf for path, leaf in _flat(manifest.scenario).items() if path[-1:] == ("true_arm",)}
    if len(named) != 1 or not isinstance(family := named.pop(), str) or not manifest.seeds:
        return frozenset()
    seeds = range(manifest.seed, manifest.seed + min(manifest.seeds, len(TRUTHS)))
    return frozenset(CALLED.get(name, name) for name in (member(family, seed) for seed in seeds))


def seeds_words(run: Finished) -> str:
    """The seeds of a run."""
    first, count = run.manifest.seed, run.manifest.seeds
    if not count:
        return NONE
    return str(first) if count == 1 else f"{first} to {first + count - 1}"


def _folder(place: Sequence[tuple[str, Mapping[str, str]] | None]) -> list[Row]:
    """The folder of an arm or a model in each run: its name, and the files in it that are read."""
    names = [own[0] if own else ABSENT for own in place]
    files = [{k: v for k, v in own[1].items() if not k.endswith(SHOWN)} if own else {} for own in place]
    told = _by_key(f"{' and '.join(dict.fromkeys(names))}, ", files)
    return [_row("folder of the arm or model", names), *told] if len(set(names)) > 1 else told


def _commit(git: str) -> str:
    commit, _, dirty = git.partition("-")
    return f"{_short(commit)}, changed" if dirty else _short(commit)


def _settings(runs: Sequence[Finished]) -> list[Row]:
    """Settings that differ, by their words; of runs of different commands those that all have."""
    told = [_told(run) for run in runs]
    alike = len({run.manifest.command for run in runs}) == 1
    return [
        _row(what, [_value(*own[what, unit]) if (what, unit) in own else ABSENT for own in told], unit)
        for what, unit in _keys(told)
        if (alike or all((what, unit) in own for own in told))
        and len({repr(own.get((what, unit), (ABSENT, 1.0))) for own in told}) > 1
    ]


def _told(run: Finished) -> dict[tuple[str, str], tuple[JsonValue, float]]:
    """Every setting by its words and unit, and how many of that an SI unit is."""
    found = {}
    for path, leaf in _flat(run.manifest.scenario).items():
        *tables, key = path or ("settings",)
        if (key,) not in SEEDS:
            words, unit, scale = _named(key)
            above = [_named(table)[0] for table in tables if table not in AROUND]
            found[", ".join([*above, words]), unit] = leaf, scale
    return found


def _named(key: str) -> tuple[str, str, float]:
    """What a key is called: of an unknown key its own words, its last one perhaps a unit."""
    if key in NAMES:
        return NAMES[key]
    *words, last = key.split("_")
    unit = last if words and last in UNITS else ""
    return " ".join(words if unit else [*words, last]), "%" if unit == "percent" else unit, 1.0


def _value(value: JsonValue, scale: float) -> str:
    """A setting's value, in the unit of its name."""
    text = _shown(value, scale)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _shown(value: JsonValue, scale: float) -> str:
    if value is None or value == []:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{scale * value:.6g}" if isinstance(value, float) or scale != 1 else str(value)
    if isinstance(value, list):
        return ", ".join(_shown(own, scale) for own in value)
    return _short(value) if isinstance(value, str) else "a table"


def _short(text: str) -> str:
    """A checksum or a commit by its first digits; any other text as it is."""
    return text[:DIGITS] if CHECKSUM.fullmatch(text) else text[:LONGEST]


def _flat(value: JsonValue, place: Path = ()) -> dict[Path, JsonValue]:
    """Leaves of nested tables by their paths; lists are leaves."""
    if not isinstance(value, dict):
        return {place: value}
    return {path: leaf for key, own in value.items() for path, leaf in _flat(own, (*place, key)).items()}


def _by_key(before: str, tables: Sequence[Mapping[str, str]]) -> list[Row]:
    """Texts of several tables that differ; what is before their keys says what they are."""
    return [
        _row(before + key, [_short(own[key]) if key in own else ABSENT for own in tables])
        for key in _keys(tables)
        if len({own.get(key) for own in tables}) > 1
    ]


def _keys(tables: Iterable[Mapping[K, object]]) -> list[K]:
    """Keys of several tables, each once, in the order in which they appear."""
    return list(dict.fromkeys(key for own in tables for key in own))
