"""What differs in the inputs of runs: settings, files of arms, data, seeds, versions, commit."""

import re
from collections.abc import Mapping, Sequence

from pydantic import JsonValue

from testbench.campaign.true_arms import CALLED, TRUTHS, member
from testbench.errors import BenchError
from testbench.output.manifest import Finished
from testbench.report.table import Row

ABSENT, NONE = "not said", "none"
SEEDS = ("first", "seed")  #: Last keys of settings that say the first seed once more.
SHOWN = (".md", ".html", ".png", ".rrd", "manifest.json", "report.json", "run.log")
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
    "least": ("least deflection", "mm", 1e3),
    "most": ("largest deflection", "mm", 1e3),
    "cone": ("half angle", "deg", 57.29577951308232),
    "check_pose": ("poses held out", "", 1.0),
    "dataset": ("file of readings", "", 1.0),
    "readings": ("file of readings", "", 1.0),
    "area": ("work area", "", 1.0),
    "station": ("work area", "", 1.0),
}
"""Settings by their last key: words, unit, and how many of it an SI unit is; others keep their keys."""
FILES = ("dataset", "readings")  #: Last keys of files; one file is one input: its name and checksum.
Path = tuple[str, ...]  #: Keys of nested tables down to a setting.


def inputs_differ(runs: Sequence[Finished]) -> list[Row]:
    """The inputs that are not the same in all runs, with their values in each; none if they are.

    Of runs of different commands settings count that all of them have.
    """
    told = [_told(run) for run in runs]
    alike = len({run.manifest.command for run in runs}) == 1
    return [
        Row(what=what, values=[_value(own, (what, unit)) for own in told], unit=unit)
        for what, unit in dict.fromkeys(key for own in told for key in own)
        if (alike or all((what, unit) in own for own in told))
        and len({repr(own.get((what, unit))) for own in told}) > 1
    ]


def _told(run: Finished) -> dict[tuple[str, str], tuple[JsonValue, float]]:
    """Every input by its words and unit, and how many of that an SI unit is."""
    m = run.manifest
    commit, _, dirty = m.git.partition("-")
    whole: dict[str, JsonValue] = {"command": m.command, "scenario": m.scenario, "seeds": seeds_words(run)}
    for k, (name, files) in enumerate(m.models.items(), 1):
        read: dict[str, JsonValue] = {own: sha for own, sha in files.items() if not own.endswith(SHOWN)}
        whole[f"arm or model{'' if k == 1 else f' {k}'}"] = {"folder": name, **read}
    whole["version"] = dict(m.versions)
    whole["commit"] = _short(commit) + (", changed" if dirty else "")
    leaves = {path: leaf for path, leaf in _flat(whole).items() if path and path[-1] not in SEEDS}
    return {_words(path): (leaf, _named(path[-1])[2]) for path, leaf in leaves.items()}


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


def _words(path: Path) -> tuple[str, str]:
    """A setting's name, with what it belongs to, and its unit."""
    *tables, key = path
    words, unit, _ = _named(key)
    return ", ".join([*(_named(table)[0] for table in tables if table not in AROUND), words]), unit


def _named(key: str) -> tuple[str, str, float]:
    """What a key is called: of an unknown key its own words, its last one perhaps a unit."""
    if key in NAMES or "." in key:  # names of files stay as they are
        return NAMES.get(key, (key, "", 1.0))
    *words, last = key.split("_")
    unit = last if words and last in UNITS else ""
    return " ".join(words if unit else [*words, last]), "%" if unit == "percent" else unit, 1.0


def _value(told: Mapping[tuple[str, str], tuple[JsonValue, float]], key: tuple[str, str]) -> str:
    """An input's value, in the unit of its name."""
    text = _shown(*told[key]) if key in told else ABSENT
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _shown(value: JsonValue, scale: float) -> str:
    if value is None or value == []:
        return NONE
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
    if place and place[-1] in FILES and len(value) == 1:
        [(name, digest)] = value.items()
        return {place: f"{name} {_short(str(digest))}"}
    return {path: leaf for key, own in value.items() for path, leaf in _flat(own, (*place, key)).items()}
