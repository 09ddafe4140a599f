"""What a dataset can tell of a structure, in words: sentences and a table."""

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table

from testbench.identify.identifiability import Identifiability
from testbench.identify.identifiability_help import REPEAT, TASKS, Proposal
from testbench.identify.identifiability_unseen import Direction

AXES = (
    "stretch",
    "deflection along y",
    "deflection along z",
    "torsion",
    "rotation about y",
    "rotation about z",
)
"""What the diagonal entries of a link's compliance are, in its beam frame: c11 to c66."""
DECIDED = 0.05
"""Share of the data below which the prior decides a parameter."""
SENTENCES = 6
"""Sentences about directions lost to the structure, and as many about those lost to the loads."""
NAMED = 2
"""Couplings that are named; more are counted."""
MM = 1e3


def sentences(report: Identifiability) -> list[str]:
    """The report for a person, the most important first."""
    return [
        *_counts(report),
        *_lost_to_structure(report),
        *_lost_to_loads(report),
        *_lost_to_poses(report),
        *_decided(report),
        *_help(report),
    ]


def _counts(report: Identifiability) -> list[str]:
    n, seen = report.structure.n, report.rank
    first = (
        f"{report.structure.name} has {n} unknowns; the data ({_count(report.poses, 'pose')}, at most "
        f"{report.equations} independent equations) see {seen} directions of them"
    )
    if n == seen:
        return [f"{first}: all"]
    parts = (
        (len(report.lost_to_structure), "that no experiment sees, as links and joints can be traded"),
        (len(report.lost_to_loads), "that no pose shows under these loads and readings"),
        (report.lost_to_poses, "lost to too few poses"),
    )
    found = [f"{first}; not seen are {_listed([f'{k} {why}' for k, why in parts if k])}"]
    note = "axes are those of a link's beam, x along it"
    if report.in_links:
        note += f"; the spring of {_listed(report.in_links)} counts to the link before it"
    return [*found, note]


def _lost_to_structure(report: Identifiability) -> list[str]:
    texts = _grouped(report, report.lost_to_structure, "no experiment tells apart")
    return _cut(texts, "that no experiment sees")


def _lost_to_loads(report: Identifiability) -> list[str]:
    idle = [f"not loaded in any pose: {_by_component(report, report.not_loaded)}"] * bool(report.not_loaded)
    known = set(report.not_loaded)
    lost = [d for d in report.lost_to_loads if d.parameters[0] not in known]
    texts = _grouped(report, lost, "these loads do not tell apart")
    return [*idle, *_cut(texts, "that no pose shows under these loads")]


def _grouped(report: Identifiability, lost: Sequence[Direction], what: str) -> list[tuple[str, int]]:
    """A sentence for every set of links and joints that trade, and how many directions it is about."""
    groups: dict[frozenset[str], list[Direction]] = {}
    for d in lost:
        involved = frozenset(report.component[k] for k in (*d.parameters, *d.others))
        groups.setdefault(involved, []).append(d)
    ordered = sorted(groups.values(), key=lambda group: (len(group) > 1, len(group[0].parameters)))
    return [(f"{what}: {_traded(report, group)}", len(group)) for group in ordered]


def _lost_to_poses(report: Identifiability) -> list[str]:
    if not report.lost_to_poses:
        return []
    held = dict.fromkeys(report.component, 0.0)
    for name, part in zip(report.component, report.spread, strict=True):
        held[name] += float(part)
    most = sorted(held, key=lambda name: -held[name])[:3]
    return [
        f"lost to too few poses: {_count(report.lost_to_poses, 'direction')}, most of all in {_listed(most)}"
    ]


def _decided(report: Identifiability) -> list[str]:
    texts = []
    for name in dict.fromkeys(report.component):
        mine = [k for k, other in enumerate(report.component) if other == name]
        unseen = [k for k in mine if report.share[k] < DECIDED]
        if len(unseen) == len(mine):
            texts.append(name if len(mine) == 1 else f"all of {name}")
        elif unseen:
            texts.append(_of(report, unseen))
    if not texts:
        return []
    return [f"the prior decides (data add under {100 * DECIDED:g} %): {'; '.join(texts)}"]


def _help(report: Identifiability) -> list[str]:
    found = [
        f"at {TASKS} random poses under these loads predictions will be about {_mm(report.error)} off (RMS; "
        f"markers move {_mm(report.deflection)}; prior {report.prior}, {100 * report.uncertainty:.3g} %)"
    ]
    best = [p for p in report.proposals if p.place == 1]
    most = max(report.proposals, key=lambda p: p.rank)
    found.append(f"what would help most: {_listed([p.words for p in best])} ({_gain(report, best[0])})")
    if most.rank > best[0].rank:
        found.append(f"what would show most new directions: {most.words} ({_gain(report, most)})")
    again = next(p for p in report.proposals if p.words == REPEAT)
    vain = [p.words for p in report.proposals[report.proposals.index(again) :] if p.rank == again.rank]
    if len(vain) > 1:
        found.append(f"no better than {vain[0]} (no new direction, less noise): {', '.join(vain[1:])}")
    return found


def _gain(report: Identifiability, p: Proposal) -> str:
    more = p.rank - report.rank
    return f"{_count(more, 'new direction') if more else 'no new direction'}, error {_mm(p.error)}"


def table(report: Identifiability) -> Table:
    """What would help, the best first, for a terminal of 80 columns."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    table.add_column("")
    table.add_column("measured besides", no_wrap=True)
    table.add_column("seen", justify="right")
    table.add_column("expected\nerror mm", justify="right")
    table.add_row("", "nothing", str(report.rank), _number(report.error), style="dim")
    places = [p.place for p in report.proposals]
    for p in report.proposals:
        tie = "=" if places.count(p.place) > 1 else ""
        table.add_row(f"{p.place}{tie}", p.words, str(p.rank), _number(p.error))
    return table


def name(report: Identifiability, k: int) -> str:
    """A parameter in words, such as "torsion of link_1"."""
    return _of(report, [k])


def _of(report: Identifiability, parameters: Sequence[int]) -> str:
    """Parameters of one link or joint, in words."""
    component = report.component[parameters[0]]
    pairs = [(int(a), int(b)) for a, b in report.entry[list(parameters)]]
    if pairs[0][0] < 0:
        return component
    diagonal = [AXES[a] for a, b in sorted(pairs) if a == b]
    for kind in ("deflection along", "rotation about"):
        if {f"{kind} y", f"{kind} z"} <= set(diagonal):
            diagonal[diagonal.index(f"{kind} y")] = f"{kind} y and z"
            diagonal.remove(f"{kind} z")
    couplings = [f"coupling of {AXES[a]} with {AXES[b]}" for a, b in pairs if a != b]
    if len(couplings) > NAMED or (len(couplings) > 1 and diagonal):
        couplings = [f"{len(couplings)} couplings"]
    words = [*diagonal, *couplings]
    return f"{words[0]} of {component}" if len(words) == 1 else f"{component} ({', '.join(words)})"


def _traded(report: Identifiability, group: Sequence[Direction]) -> str:
    if len(group) == 1:
        return in_words(report, group[0])
    parts = {report.component[k] for d in group for k in (*d.parameters, *d.others)}
    order = [part for part in dict.fromkeys(report.component) if part in parts]
    led = _by_component(report, [d.parameters[0] for d in group])
    between = f"entries of {order[0]}" if len(order) == 1 else _listed(order)
    return f"{between}, in {len(group)} directions led by {led}"


def in_words(report: Identifiability, d: Direction) -> str:
    """One direction: link entries before joints, as joints are what everybody knows."""
    first, *rest = sorted(d.parameters, key=lambda k: int(report.entry[k, 0] < 0))
    what = name(report, first)
    if rest:
        little = ", with small changes elsewhere" if d.others else ""
        return f"{what} from {_by_component(report, rest)}{little}"
    if d.others:
        return f"{what} from small changes of {_by_component(report, d.others[:NAMED])}"
    return f"{what} is not loaded"


def _by_component(report: Identifiability, parameters: Sequence[int]) -> str:
    return _listed(
        [
            _of(report, [k for k in parameters if report.component[k] == other])
            for other in dict.fromkeys(report.component[k] for k in parameters)
        ]
    )


def _cut(texts: list[tuple[str, int]], what: str) -> list[str]:
    """The first sentences; of the others how many directions they are about."""
    more = sum(size for _, size in texts[SENTENCES:])
    last = [f"and {_count(more, 'more direction')} {what}"] if more else []
    return [*(text for text, _ in texts[:SENTENCES]), *last]


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _mm(metres: float) -> str:
    return f"{_number(metres)} mm" if math.isfinite(metres) else "unbounded (nothing fixes the scale)"


def _number(metres: float) -> str:
    return f"{MM * metres:.3f}" if math.isfinite(metres) else "unbounded"
