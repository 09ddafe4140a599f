"""What a dataset can tell of a structure, as a dict for JSON: numbers, and the words for them."""

import math
from collections.abc import Sequence
from typing import Any

from testbench.identify.identifiability import Identifiability
from testbench.identify.identifiability_unseen import Direction
from testbench.views.identifiability_text import DECIDED, MM, in_words, name, sentences


def to_dict(report: Identifiability) -> dict[str, Any]:
    """The report for JSON: numbers, and the words for them."""
    names = [name(report, k) for k in range(report.structure.n)]

    def directions(lost: Sequence[Direction]) -> list[dict[str, Any]]:
        return [
            {
                "parameters": [names[k] for k in d.parameters],
                "others_a_little": [names[k] for k in d.others],
                "text": in_words(report, d),
            }
            for d in lost
        ]

    return {
        "structure": report.structure.name,
        "prior": report.prior,
        "prior_uncertainty": report.uncertainty,
        "unknowns": report.structure.n,
        "seen": report.rank,
        "seen_by_these_loads": report.rank_of_loads,
        "seen_by_any_experiment": report.rank_of_structure,
        "lost_to_structure": len(report.lost_to_structure),
        "lost_to_experiment": report.lost_to_experiment,
        "lost_to_loads": len(report.lost_to_loads),
        "lost_to_poses": report.lost_to_poses,
        "poses": report.poses,
        "independent_equations": report.equations,
        "joints_in_links": list(report.in_links),
        "not_loaded": [names[k] for k in report.not_loaded],
        "unseen": {
            "structure": directions(report.lost_to_structure),
            "loads": directions(report.lost_to_loads),
        },
        "parameters": [
            {
                "component": report.component[k],
                "entry": [int(i) + 1 for i in report.entry[k]] if report.entry[k, 0] >= 0 else None,
                "name": names[k],
                "data_share": float(report.share[k]),
                "decided_by": "prior" if report.share[k] < DECIDED else "data and prior",
            }
            for k in range(report.structure.n)
        ],
        "blocks": _blocks(report),
        "expected_error_mm": _finite(report.error),
        "expected_deflection_mm": _finite(report.deflection),
        "help": [
            {
                "place": p.place,
                "measure": p.words,
                "seen": p.rank,
                "more_directions": p.rank - report.rank,
                "expected_error_mm": _finite(p.error),
            }
            for p in report.proposals
        ],
        "sentences": sentences(report),
    }


def _blocks(report: Identifiability) -> list[dict[str, Any]]:
    found = []
    for block in dict.fromkeys(report.component):
        share = [float(s) for s, other in zip(report.share, report.component, strict=True) if other == block]
        unseen = sum(s < DECIDED for s in share)
        found.append(
            {
                "component": block,
                "parameters": len(share),
                "data_share": sum(share) / len(share),
                "decided_by_prior": unseen,
            }
        )
    return found


def _finite(metres: float) -> float | None:
    return MM * metres if math.isfinite(metres) else None
