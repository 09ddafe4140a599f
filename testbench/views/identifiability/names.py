"""Parameters and directions of a structure as a colleague names them: "torsion of link_1"."""

from collections.abc import Sequence

from testbench.identify.identifiability import Identifiability
from testbench.identify.identifiability_unseen import Direction
from testbench.views.markdown import listed

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


def of(found: Identifiability, parameters: Sequence[int]) -> str:
    """Parameters of one link or joint, in words."""
    component = found.component[parameters[0]]
    pairs = [(int(a), int(b)) for a, b in found.entry[list(parameters)]]
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


def by_component(found: Identifiability, parameters: Sequence[int]) -> str:
    """Parameters of several links and joints, in words."""
    groups: dict[str, list[int]] = {}
    for k in parameters:
        groups.setdefault(found.component[k], []).append(k)
    return listed([of(found, group) for group in groups.values()])


def direction(found: Identifiability, d: Direction) -> str:
    """A direction that is not seen: link entries before joints, as joints are what everybody knows."""
    first, *rest = sorted(d.parameters, key=lambda k: int(found.entry[k, 0] < 0))
    what = of(found, [first])
    if rest:
        little = ", with small changes elsewhere" if d.others else ""
        return f"{what} from {by_component(found, rest)}{little}"
    if d.others:
        return f"{what} from small changes of {by_component(found, d.others[:NAMED])}"
    return f"{what} is not loaded"


def traded(found: Identifiability, group: Sequence[Direction]) -> str:
    """Directions between the same links and joints."""
    if len(group) == 1:
        return direction(found, group[0])
    parts = {found.component[k] for d in group for k in (*d.parameters, *d.others)}
    order = [part for part in dict.fromkeys(found.component) if part in parts]
    led = by_component(found, [d.parameters[0] for d in group])
    between = f"entries of {order[0]}" if len(order) == 1 else listed(order)
    return f"{between}, in {len(group)} directions led by {led}"
