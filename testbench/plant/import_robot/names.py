"""Names of a stranger's file made fit for MJCF, columns of a CSV and file names."""

import re
from collections.abc import Iterable
from dataclasses import replace

from testbench.plant.import_robot.chain import Chain, Part

LONGEST = 40  #: Characters of a name: room for what is put behind it.
RESERVED = ("world",)


def with_fit_names(chain: Chain) -> Chain:
    """The chain with names of letters, digits, `_` and `-` that differ in more than upper and lower case."""
    parts = fit_names(part.name for part in chain.parts)
    joints = iter(fit_names(part.joint.name for part in chain.parts if part.joint))
    renamed = tuple(
        replace(
            part,
            name=name,
            joint=part.joint and replace(part.joint, name=next(joints)),
            sites=tuple(replace(s, name=fit) for s, fit in zip(part.sites, _sites(part), strict=True)),
        )
        for part, name in zip(chain.parts, parts, strict=True)
    )
    pairs = [(old.name, new.name) for old, new in zip(chain.parts, renamed, strict=True)]
    pairs += [
        (old.joint.name, new.joint.name)
        for old, new in zip(chain.parts, renamed, strict=True)
        if old.joint and new.joint
    ]
    changed = [f"{old!r} is {new}" for old, new in pairs if old != new]
    notes = (f"names made fit: {', '.join(changed)}",) if changed else ()
    [name] = fit_names([chain.name])
    return replace(chain, name=name, parts=renamed, notes=(*chain.notes, *notes))


def _sites(part: Part) -> list[str]:
    return fit_names(site.name for site in part.sites)


def fit_names(names: Iterable[str]) -> list[str]:
    """Names of letters, digits, `_` and `-`, each different from all others."""
    found: list[str] = []
    for name in names:
        fit = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:LONGEST] or "x"
        plain, k = fit, 2
        taken = {other.lower() for other in (*found, *RESERVED)}
        while fit.lower() in taken:
            fit, k = f"{plain}_{k}", k + 1
        found.append(fit)
    return found
