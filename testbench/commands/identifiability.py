"""What `testbench identifiability` says and draws: what runs can tell of a model, before any fit."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

import numpy as np

from testbench.campaign.identifiability import TASKS, Identifiability
from testbench.campaign.rows import MM
from testbench.identify.observability import Direction
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, finite
from testbench.views.colours import GCO, GREY, Look
from testbench.views.gains import gained
from testbench.views.markdown import Markdown, listed
from testbench.views.scene import Line, RunChart, Seen
from testbench.views.schema import Table

AXES = (
    "stretch",
    "deflection along y",
    "deflection along z",
    "torsion",
    "rotation about y",
    "rotation about z",
)
"""What the diagonal entries of a link's compliance are, in its beam frame: c11 to c66."""
NAMED = 2  #: Couplings that are named; more are counted.
MOST = 3  #: Links and joints that are named of those that too few poses leave open.
DECIDED = 0.05  #: Share of the data below which the prior decides a parameter [1].


def report(found: Identifiability, arm: str = "") -> Report:
    """What the runs see of a model, what they do not, and what would help."""
    f = _numbers(found, arm)
    nothing = Row(place=None, measure="nothing", rank=f.seen, expected_error_mm=f.expected_error_mm)
    return Report(
        scenario="identifiability",
        question=say("What do these runs tell of {structure}?", f),
        title=say(
            "{structure} of {arm} by {poses:counted pose}, {prior} known to {prior_uncertainty_percent:.3g} "
            "%: what else could be measured",
            f,
        ),
        answer=lines(_answer(f)),
        worst=say(
            "Least is told of {part}: data give {data_share_percent:.0f} % of what is known of its "
            "{parameters:counted unknown}, the prior the rest.",
            min(f.blocks, key=lambda block: float(block["data_share_percent"])),
        ),
        claims=list(_claims(found, f)),
        numbers=f,
        tables={"help": Table(columns("place measure rank expected_error_mm"), [nothing, *f.help])},
        body=["help"],
    )


def _numbers(found: Identifiability, arm: str) -> Row:
    parts = np.array(found.component)
    blocks = [
        Row(
            part=part,
            parameters=int(own.sum()),
            data_share_percent=100 * found.share[own].mean(),
            prior_decides=int((found.share[own] < DECIDED).sum()),
        )
        for part in dict.fromkeys(found.component)
        for own in [parts == part]
    ]
    return Row(
        arm=arm,
        structure=found.structure.name,
        prior=found.prior,
        prior_uncertainty_percent=100 * found.uncertainty,
        unknowns=found.structure.n,
        seen=found.rank,
        lost_to_structure=len(found.lost_to_structure),
        lost_to_loads=len(found.lost_to_loads),
        lost_to_poses=found.lost_to_poses,
        poses=found.poses,
        equations=found.equations,
        prior_decides=sum(block.prior_decides for block in blocks),
        blocks=blocks,
        expected_error_mm=finite(MM * found.error),
        expected_deflection_mm=finite(MM * found.deflection),
        help=[
            Row(place=p.place, measure=p.words, rank=p.rank, expected_error_mm=finite(MM * p.error))
            for p in found.proposals
        ],
    )


def _answer(f: Row) -> Iterator[Markdown]:
    """The error to expect, and what would help most; without a bound nothing else."""
    if f.expected_error_mm is None:
        yield say("These runs bound no prediction of {structure}: nothing fixes the scale.", f)
        return
    yield say(
        "{structure} will be about {expected_error_mm:.3f} mm off by these runs, of "
        "{expected_deflection_mm:.3f} mm (RMS in {tasks} random poses).",
        f,
        tasks=TASKS,
    )
    best = f.help[0]
    gain = gained(best.measure, "these runs alone", [best.expected_error_mm], [f.expected_error_mm])
    yield say("What would help most: {measure}, {expected_error_mm:.3f} mm, {it:less}.", best, it=gain)


def _claims(found: Identifiability, f: Row) -> Iterator[Markdown]:
    """What is seen and what is not, then every direction that is not."""
    every = ": all" if f.seen == f.unknowns else ""
    yield say(
        "{structure} has {unknowns:counted unknown}; the data ({poses:counted pose}, at most "
        f"{{equations:counted independent equation}}) see {{seen:counted direction}} of them{every}.",
        f,
    )
    lost = {
        "that no experiment sees": f.lost_to_structure,
        "that no pose shows under these loads and readings": f.lost_to_loads,
        "lost to too few poses": f.lost_to_poses,
    }
    if told := [f"{count} {why}" for why, count in lost.items() if count]:
        yield say("Not seen are {told:list}.", told=told)
    if f.prior_decides:
        yield say(
            "The prior decides {prior_decides} of the {unknowns} unknowns: data add under {share:g} %.",
            f,
            share=100 * DECIDED,
        )
    if f.lost_to_poses:
        held = {b.part: found.spread[np.array(found.component) == b.part].sum() for b in f.blocks}
        most = sorted(held, key=lambda name: -held[name])[:MOST]
        yield say(
            "Lost to too few poses: {n:counted direction}, most of all in {most:list}.",
            n=f.lost_to_poses,
            most=most,
        )
    if f.seen < f.unknowns:
        springs = "; the spring of {joints:list} counts to the link before it" if found.in_links else ""
        yield say(f"Axes are those of a link's beam, x along it{springs}.", joints=list(found.in_links))
    yield from (
        say("No experiment tells apart: {text}.", text=t) for t in _traded(found, found.lost_to_structure)
    )
    if found.not_loaded:
        yield say("Not loaded in any pose: {text}.", text=_by_part(found, found.not_loaded))
    loads = [d for d in found.lost_to_loads if d.parameters[0] not in set(found.not_loaded)]
    yield from (say("These loads do not tell apart: {text}.", text=t) for t in _traded(found, loads))
    for block in f.blocks:
        own = [k for k, part in enumerate(found.component) if part == block.part and found.share[k] < DECIDED]
        if own:
            yield say("The prior decides {text}.", text=_named(found, own))


def _traded(found: Identifiability, lost: Sequence[Direction]) -> list[str]:
    """Every set of links and joints that trade, single directions first."""
    groups: dict[frozenset[str], list[Direction]] = {}
    for d in lost:
        groups.setdefault(frozenset(found.component[k] for k in (*d.parameters, *d.others)), []).append(d)
    ordered = sorted(groups.items(), key=lambda own: (len(own[1]) > 1, len(own[1][0].parameters)))
    texts = []
    for parts, (first, *rest) in ordered:
        between = listed([part for part in dict.fromkeys(found.component) if part in parts])
        texts.append(f"{between}, in {1 + len(rest)} directions" if rest else _direction(found, first))
    return texts


def _direction(found: Identifiability, d: Direction) -> str:
    """A direction that is not seen: link entries before joints, as joints are what everybody knows."""
    first, *rest = sorted(d.parameters, key=lambda k: int(found.entry[k, 0] < 0))
    what = _named(found, [first])
    if rest:
        little = ", with small changes elsewhere" if d.others else ""
        return f"{what} from {_by_part(found, rest)}{little}"
    if d.others:
        return f"{what} from small changes of {_by_part(found, d.others[:NAMED])}"
    return f"{what} is not loaded"


def _by_part(found: Identifiability, parameters: Sequence[int]) -> str:
    """Parameters of several links and joints, in words."""
    groups: dict[str, list[int]] = {}
    for k in parameters:
        groups.setdefault(found.component[k], []).append(k)
    return listed([_named(found, group) for group in groups.values()])


def _named(found: Identifiability, parameters: Sequence[int]) -> str:
    """Parameters of one link or joint as a colleague names them: "torsion of link_1"."""
    part = found.component[parameters[0]]
    pairs = [(int(a), int(b)) for a, b in found.entry[list(parameters)]]
    if pairs[0][0] < 0:
        return part
    diagonal = [AXES[a] for a, b in sorted(pairs) if a == b]
    for kind in ("deflection along", "rotation about"):
        if {f"{kind} y", f"{kind} z"} <= set(diagonal):
            diagonal[diagonal.index(f"{kind} y")] = f"{kind} y and z"
            diagonal.remove(f"{kind} z")
    couplings = [f"coupling of {AXES[a]} with {AXES[b]}" for a, b in pairs if a != b]
    if len(couplings) > NAMED or (len(couplings) > 1 and diagonal):
        couplings = [f"{len(couplings)} couplings"]
    words = [*diagonal, *couplings]
    return f"{words[0]} of {part}" if len(words) == 1 else f"{part} ({', '.join(words)})"


def seen(told: Report) -> Seen:
    """Of every link and joint how much the data tell, and how many of its unknowns the prior decides."""
    blocks = told.numbers["blocks"]
    data = np.array([block.data_share_percent for block in blocks])
    parts = [block.part for block in blocks]
    prior = np.array([100 * block.prior_decides / block.parameters for block in blocks])
    shown = [
        Line("the data tell", Look(GCO, 0, prior=True), data),
        Line("unknowns decided by the prior", Look(GREY, 1, prior=True), prior),
    ]
    title = "Of what is known of each link and joint (%)"
    return Seen(runs=[RunChart(title, 0, "link or joint", parts, shown, joined=False)])


def write(told: Report, file: Path | IO[bytes]) -> None:
    """The same as a PNG."""
    from testbench.views.figure import save  # here: matplotlib takes half a second
    from testbench.views.run_figure import overview

    save(overview(told, seen(told)), file)
