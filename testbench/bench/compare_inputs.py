"""What differs in the inputs of runs: settings, files of arms, data, seeds, versions, commit."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TypeVar

from pydantic import JsonValue

from testbench.bench.compare_settings import Path, short, show_setting, words_of
from testbench.bench.truths import CALLED, TRUTHS, member
from testbench.errors import BenchError
from testbench.output.finished import Finished

ABSENT, NONE = "not said", "none"
SEEDS = (("first",), ("seed",))  #: Last keys of settings that say the first seed once more.

SHOWN = (".md", ".html", ".png", ".rrd", "manifest.json", "report.json")
"""Ends of files in the folder of a model that only tell of it."""

K = TypeVar("K")


@dataclass(frozen=True)
class InputRow:
    """An input that differs."""

    what: str  #: In words.
    values: tuple[str, ...]  #: Of every run.
    unit: str = ""  #: Of the values.

    @property
    def title(self) -> str:
        """What it is, with its unit."""
        return f"{self.what}, {self.unit}" if self.unit else self.what

    @property
    def words(self) -> str:
        """The same with its values."""
        *first, last = self.values
        return f"{self.what} {', '.join(first)} and {last}{' ' if self.unit else ''}{self.unit}"


def inputs_differ(runs: Sequence[Finished]) -> list[InputRow]:
    """The inputs that are not the same in all runs; none if they are."""
    told = [run.manifest for run in runs]
    whole = {
        "command": [m.command for m in told],
        "seeds": [seeds_words(run) for run in runs],
        "commit": [_commit(m.git) for m in told],
    }
    rows = {what: InputRow(what, tuple(own)) for what, own in whole.items() if len(set(own)) > 1}
    arms = [row for place in zip_longest(*(m.models.items() for m in told)) for row in _folder(place)]
    versions = _by_key("version of ", [m.versions for m in told])
    first, last = [rows.get("command")], [rows.get("seeds"), *arms, *versions, rows.get("commit")]
    return [row for row in (*first, *_settings(runs), *last) if row is not None]


def true_arms(run: Finished) -> frozenset[str]:
    """Which true arms a simulated run has met; none where it says of none."""
    manifest = run.manifest
    named = {leaf for path, leaf in _flat(manifest.scenario).items() if path[-1:] == ("true_arm",)}
    if len(named) != 1 or not isinstance(family := named.pop(), str) or not manifest.seeds:
        return frozenset()
    seeds = range(manifest.seed, manifest.seed + min(manifest.seeds, len(TRUTHS)))
    return frozenset(CALLED.get(name, name) for name in (member(family, seed) for seed in seeds))


def refuse_unlike(runs: Sequence[Finished]) -> None:
    """Refuse runs of other true arms, or one seed beside several: which errs less then says nothing.

    Raises:
        BenchError: Names the arms, or the seeds.
    """
    counts = {run.manifest.seeds for run in runs if run.manifest.seeds}
    if 1 in counts and len(counts) > 1:
        told = "; ".join(f"{run.folder}: {seeds_words(run)}" for run in runs)
        problem = f"expected one seed in each or several in each, as one seed has no spread, got seeds {told}"
        raise BenchError(f"runs: {problem}; --anyway compares them all the same")
    known = [(run, arms) for run in runs if (arms := true_arms(run))]
    alone = {run.manifest.seed for run, _ in known if run.manifest.seeds == 1}
    if len({arms for _, arms in known}) > 1 or (len(alone) > 1 and len(known) > 1):
        told = "; ".join(
            f"{run.folder}: {', '.join(sorted(arms))}, seeds {seeds_words(run)}" for run, arms in known
        )
        problem = f"expected the same true arms, of one seed each the same seed, got {told}"
        raise BenchError(f"runs: {problem}; --anyway compares them all the same")


def seeds_words(run: Finished) -> str:
    """The seeds of a run."""
    first, count = run.manifest.seed, run.manifest.seeds
    if not count:
        return NONE
    return str(first) if count == 1 else f"{first} to {first + count - 1}"


def _folder(place: Sequence[tuple[str, Mapping[str, str]] | None]) -> list[InputRow]:
    """The folder of an arm or a model in each run: its name, and the files in it that are read."""
    names = tuple(own[0] if own else ABSENT for own in place)
    files = [{k: v for k, v in own[1].items() if not k.endswith(SHOWN)} if own else {} for own in place]
    told = _by_key(f"{' and '.join(dict.fromkeys(names))}, ", files)
    return [InputRow("folder of the arm or model", names), *told] if len(set(names)) > 1 else told


def _commit(git: str) -> str:
    commit, _, dirty = git.partition("-")
    return f"{short(commit)}, changed" if dirty else short(commit)


def _settings(runs: Sequence[Finished]) -> list[InputRow]:
    """Settings that differ, by their words; of runs of different commands those that all have."""
    told = [_told(run) for run in runs]
    alike = len({run.manifest.command for run in runs}) == 1
    return [
        InputRow(what[0], tuple(show_setting(*own[what]) if what in own else ABSENT for own in told), what[1])
        for what in _keys(told)
        if (alike or all(what in own for own in told))
        and any(own.get(what, ((), ABSENT))[1] != told[0].get(what, ((), ABSENT))[1] for own in told)
    ]


def _told(run: Finished) -> dict[tuple[str, str], tuple[Path, JsonValue]]:
    """Every setting by its words and unit."""
    leaves = _flat(run.manifest.scenario)
    return {words_of(path): (path, leaf) for path, leaf in leaves.items() if path[-1:] not in SEEDS}


def _flat(value: JsonValue, place: Path = ()) -> dict[Path, JsonValue]:
    """Leaves of nested tables by their paths; lists are leaves."""
    if not isinstance(value, dict):
        return {place: value}
    return {path: leaf for key, own in value.items() for path, leaf in _flat(own, (*place, key)).items()}


def _by_key(before: str, tables: Sequence[Mapping[str, str]]) -> list[InputRow]:
    """Texts of several tables that differ; what is before their keys says what they are."""
    return [
        InputRow(before + key, tuple(short(own[key]) if key in own else ABSENT for own in tables))
        for key in _keys(tables)
        if len({own.get(key) for own in tables}) > 1
    ]


def _keys(tables: Iterable[Mapping[K, object]]) -> list[K]:
    """Keys of several tables, each once, in the order in which they appear."""
    return list(dict.fromkeys(key for own in tables for key in own))
