"""What a dataset can tell of a structure, in sentences: what they claim is computed here."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from testbench.identify.identifiability import Identifiability
from testbench.identify.identifiability_help import REPEAT, TASKS
from testbench.identify.identifiability_unseen import Direction
from testbench.trials.gain import Gain, gained
from testbench.views.identifiability import names
from testbench.views.markdown import TEMPLATES, Words, as_plain

MM = 1e3
DECIDED = 0.05  #: Share of the data below which the prior decides a parameter.
SENTENCES = 6  #: Sentences about directions lost to the structure, and as many about those lost to the loads.
MOST = 3  #: Links and joints that are named of those that too few poses leave open.


@dataclass(frozen=True)
class Decided:
    """Unknowns of a link or joint that the prior decides."""

    name: str  #: Of the link or joint.
    count: int  #: How many they are.
    words: str


@dataclass(frozen=True)
class Least:
    """The link or joint of which data tell least."""

    name: str
    count: int  #: Its unknowns.
    share: float  #: Of data in what is known of them, the mean [1].


def gain(found: Identifiability) -> Gain | None:
    """The error expected with what would help most measured besides, beside that by these runs alone."""
    best = found.proposals[0]
    if not math.isfinite(found.error):
        return None
    return gained(best.words, "these runs alone", [MM * best.error], [MM * found.error])


def words(found: Identifiability, arm: str = "") -> Words:
    """The words for a terminal, and for parts of other reports.

    Args:
        found: What the runs can tell.
        arm: Its name.
    """
    values = {
        "found": found,
        "arm": arm,
        "gain": gain(found),
        "least": _least(found),
        "tasks": TASKS,
        "not_loaded": names.by_component(found, found.not_loaded) if found.not_loaded else "",
        "structure": _trades(found, found.lost_to_structure),
        "loads": _trades(found, _loaded(found)),
        "most": _held(found)[:MOST],
        "decided": _decided(found),
        "share": DECIDED,
        **_help(found),
    }
    return Words(TEMPLATES, values, "identifiability.md.j2")


def sentences(found: Identifiability) -> tuple[str, ...]:
    """The report for a person, the most important first."""
    said = words(found)
    lines = [*said.block("statements").splitlines(), *said.block("more").splitlines()]
    return tuple(as_plain(line.removeprefix("- ")) for line in lines if line.strip())


def _least(found: Identifiability) -> Least:
    """The first of those of which data tell least."""
    shares: dict[str, list[float]] = {}
    for name, share in zip(found.component, found.share.tolist(), strict=True):
        shares.setdefault(name, []).append(share)
    name, own = min(shares.items(), key=lambda item: fmean(item[1]))
    return Least(name, len(own), fmean(own))


def _loaded(found: Identifiability) -> list[Direction]:
    """Directions lost to the loads, without those of parameters that no load touches."""
    return [d for d in found.lost_to_loads if d.parameters[0] not in set(found.not_loaded)]


def _trades(found: Identifiability, lost: Sequence[Direction]) -> dict[str, object]:
    """Words for every set of links and joints that trade, single directions first; the rest is counted."""
    groups: dict[frozenset[str], list[Direction]] = {}
    for d in lost:
        involved = frozenset(found.component[k] for k in (*d.parameters, *d.others))
        groups.setdefault(involved, []).append(d)
    ordered = sorted(groups.values(), key=lambda group: (len(group) > 1, len(group[0].parameters)))
    return {
        "words": [names.traded(found, group) for group in ordered[:SENTENCES]],
        "more": sum(map(len, ordered[SENTENCES:])),
    }


def _held(found: Identifiability) -> list[str]:
    """Links and joints by how many of the directions lost to too few poses they hold, the most first."""
    held = dict.fromkeys(found.component, 0.0)
    for name, part in zip(found.component, found.spread, strict=True):
        held[name] += float(part)
    return sorted(held, key=lambda name: -held[name])


def _decided(found: Identifiability) -> list[Decided]:
    """What the prior decides, a link or joint each."""
    every = []
    for name in dict.fromkeys(found.component):
        own = [k for k, other in enumerate(found.component) if other == name]
        unseen = [k for k in own if found.share[k] < DECIDED]
        if len(unseen) == len(own):
            every.append(Decided(name, len(own), name if len(own) == 1 else f"all of {name}"))
        elif unseen:
            every.append(Decided(name, len(unseen), names.of(found, unseen)))
    return every


def _help(found: Identifiability) -> Mapping[str, object]:
    """The best proposals, the one that shows most, and those that only average noise."""
    best = [p for p in found.proposals if p.place == 1]
    most = max(found.proposals, key=lambda p: p.rank)
    again = next(p for p in found.proposals if p.words == REPEAT)
    vain = [p.words for p in found.proposals[found.proposals.index(again) :] if p.rank == again.rank]
    return {"best": best, "widest": most, "vain": vain, "finite": math.isfinite}
