"""An identified model as a scene for the Rerun viewer; importing this module imports rerun."""

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.explained import Explained
from testbench.views.absolute.scene import ARROWS
from testbench.views.colours import MEASURED, look
from testbench.views.identified.report import IdentifiedReport
from testbench.views.identified.words import words
from testbench.views.markdown import Words
from testbench.views.picked import evenly, picked
from testbench.views.recording.absolute import AbsoluteScene, Arrows
from testbench.views.recording.error_maps import PlaceScene


def scene(cell: Cell, made: Explained, report: IdentifiedReport) -> AbsoluteScene:
    """The arm in its runs, how far its targets moved, and what the model leaves of that."""
    data, fits = made.runs.every, made.found.fits
    left = made.left[report.recommended]
    moved = np.where(data.seen[..., None], data.deflection, 0.0)
    deflected = Arrows(tuple(data.before), tuple(moved))
    residual = Arrows(tuple(data.before + moved - left), tuple(left))
    seen = np.flatnonzero(data.seen.any(axis=1))
    some = picked(made.taken, seen)
    static = evenly(seen, ARROWS)
    text = words(fits, report)
    [best] = [m for m in fits.models if m.name == report.recommended]
    own = look(best.structure, best.constraint, best.prior)
    drawn = AbsoluteScene(
        cell=cell,
        q=data.q[some],
        number=data.run[some],
        drawn=deflected.of(some),
        calibrated=residual.of(some),
        still=(deflected.of(static), residual.of(static)),
        pose_words=[text.block("pose", row=report.residuals[k], q=cell.arm.words(data.q[k])) for k in some],
        summary=text.summary(then=()),
        tables="\n\n".join(
            f"### {title}\n\n{text.block(name)}"
            for name, title in (("models", "Models"), ("runs", "What is left in each run"))
        ),
        geometry=f"### What the runs tell\n\n{text.block('seen')}",
        spectrum=(),
        models={
            "deflection": ("Deflection as read", MEASURED),
            "residual": (f"Left by {report.recommended}", own.colour),
        },
        kind="identified",
        beside="What the runs tell",
        apart=True,
        plot="Left in a run; half width at a place (mm)",
        map=_map(made, report, text),
    )
    reading = {"scales": drawn.scales, "tops": drawn.tops_mm, "shown": len(some), "total": made.runs.total}
    return drawn.saying(text.block("how_to_read", **reading)).saying(text.block("statements"))


def _map(made: Explained, report: IdentifiedReport, text: Words) -> PlaceScene | None:
    """Half widths of the compared models; None where there is no map, or no bound at all."""
    found = report.map
    if found is None or not found.bounded:
        return None
    looks = {m.name: look(m.structure, m.constraint, m.prior).colour for m in made.found.fits.models}
    return PlaceScene(found.errors, looks, text.block("apart"))
