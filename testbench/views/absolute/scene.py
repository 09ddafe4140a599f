"""A calibration as a scene for the Rerun viewer; importing this module imports rerun."""

from collections.abc import Sequence

import numpy as np

from testbench.bench.absolute_summary import Reported
from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.data.dataset import Ids
from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.state import State, in_batches, targets, tell
from testbench.views.absolute.words import words
from testbench.views.picked import evenly, picked
from testbench.views.recording.absolute import AbsoluteScene, Arrows

ARROWS = 800  #: Arrows that stand still at most, evenly picked.


def scene(cell: Cell, reported: Reported) -> AbsoluteScene:
    """The arm in poses of all series, where its targets were seen, and the words beside it."""
    found, report = reported.found, reported.report
    series = found.series
    drawn = _arrows(reported.as_drawn, series, reported.before)
    known = _arrows(found.calibration.state, series, reported.after)
    seen = np.concatenate([one.seen.any(axis=1) for one in series])
    some = picked(known.longest, np.flatnonzero(seen))
    text, rows = words(report), _rows(series, some, drawn, known, cell)
    static = np.flatnonzero(seen)
    static = evenly(static, ARROWS)
    made = AbsoluteScene(
        cell=cell,
        q=np.concatenate([one.q for one in series])[some],
        number=some + 1,
        drawn=drawn.of(some),
        calibrated=known.of(some),
        still=(drawn.of(static), known.of(static)),
        pose_words=[text.block("pose", row=row) for row in rows],
        tables="\n\n".join(
            f"### {title}\n\n{text.block(name)}"
            for name, title in (
                ("series", "Series"),
                ("steps", "What pays"),
                ("compliances", "Compliances"),
                ("spectrum", "Periodic errors of the joints"),
            )
        ),
        geometry=f"### Errors of geometry\n\n{text.block('geometry')}",
        spectrum=report.spectrum,
        summary=text.summary(),
    )
    reading = {"scale": made.scale, "top_mm": made.top_mm, "shown": len(some), "total": len(seen)}
    return made.saying(text.block("how_to_read", **reading))


def _arrows(state: State, series: Sequence[Series], left: Sequence[Array]) -> Arrows:
    """From every target by a model to where it was read, in the world."""
    where = (
        targets(tell(state, some.q, some.wrench, some.point), state.mount(some))
        for one in series
        for some in in_batches(one)
    )
    return Arrows(tuple(x for part in where for x in part), tuple(x for part in left for x in part))


def _rows(
    series: Sequence[Series], some: Ids, drawn: Arrows, known: Arrows, cell: Cell
) -> list[dict[str, object]]:
    """What is said of every pose that is shown."""
    names = [one.name for one in series for _ in range(one.rows)]
    ids = np.concatenate([one.row for one in series])
    q = np.concatenate([one.q for one in series])
    return [
        {
            "series": names[k],
            "row": int(ids[k]),
            "before_mm": MM * float(drawn.longest[k]),
            "after_mm": MM * float(known.longest[k]),
            "q": cell.arm.words(q[k]),
        }
        for k in some
    ]
