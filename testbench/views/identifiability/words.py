"""What a dataset can tell of a structure, in sentences: what they claim is computed here."""

import math
from collections.abc import Mapping, Sequence

from testbench.identify.identifiability import Identifiability
from testbench.identify.identifiability_help import REPEAT, TASKS
from testbench.identify.identifiability_unseen import Direction
from testbench.views.identifiability import names
from testbench.views.markdown import TEMPLATES, Words

DECIDED = 0.05  #: Share of the data below which the prior decides a parameter.
SENTENCES = 6  #: Sentences about directions lost to the structure, and as many about those lost to the loads.
MOST = 3  #: Links and joints that are named of those that too few poses leave open.


def sentences(found: Identifiability) -> tuple[str, ...]:
    """The report for a person, the most important first."""
    values = {
        "found": found,
        "tasks": TASKS,
        "not_loaded": names.by_component(found, found.not_loaded) if found.not_loaded else "",
        "structure": _trades(found, found.lost_to_structure),
        "loads": _trades(found, _loaded(found)),
        "most": _held(found)[:MOST],
        "decided": _decided(found),
        "share": DECIDED,
        **_help(found),
    }
    text = Words(TEMPLATES, values, "identifiability.md.j2").block("statements")
    return tuple(line.removeprefix("- ") for line in text.splitlines() if line.strip())


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


def _decided(found: Identifiability) -> list[str]:
    """What the prior decides, a link or joint each."""
    texts = []
    for name in dict.fromkeys(found.component):
        own = [k for k, other in enumerate(found.component) if other == name]
        unseen = [k for k in own if found.share[k] < DECIDED]
        if len(unseen) == len(own):
            texts.append(name if len(own) == 1 else f"all of {name}")
        elif unseen:
            texts.append(names.of(found, unseen))
    return texts


def _help(found: Identifiability) -> Mapping[str, object]:
    """The best proposals, the one that shows most, and those that only average noise."""
    best = [p for p in found.proposals if p.place == 1]
    most = max(found.proposals, key=lambda p: p.rank)
    again = next(p for p in found.proposals if p.words == REPEAT)
    vain = [p.words for p in found.proposals[found.proposals.index(again) :] if p.rank == again.rank]
    return {"best": best, "widest": most, "vain": vain, "finite": math.isfinite}
