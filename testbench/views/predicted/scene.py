"""A prediction as a scene for the Rerun viewer; importing this module imports rerun."""

import numpy as np

from testbench.bench.prediction import Predicted
from testbench.bench.prediction_report import MOVED, PredictionReport, pose_row
from testbench.bench.rows import MM
from testbench.views.colours import GCO
from testbench.views.picked import picked
from testbench.views.predicted.words import words
from testbench.views.recording.error_maps import PlaceScene
from testbench.views.recording.prediction import PredictionScene


def scene(made: Predicted, report: PredictionReport) -> PredictionScene:
    """Some poses with what their loads do, the map, and the words beside them."""
    found, text = made.found, words(report)
    some = picked(found.size[:, 0], np.arange(len(found.size)))
    field = made.map
    drawn = PredictionScene(
        cell=made.cell,
        q=made.asked.q[some],
        number=some + 1,
        start=(found.position - found.deflection)[some],
        deflection=found.deflection[some],
        half_mm=MM * found.widest[some, 0],
        tool=found.position[some, 0],
        give=field.force * made.stiffness.give[some],
        axes=made.stiffness.axes[some],
        map=PlaceScene(report.map.errors, {MOVED: GCO}),
        pose_words=[text.block("pose", row=pose_row(made, int(k))) for k in some],
        summary=text.summary(),
        tables=f"### Poses\n\n{text.block('worst_poses')}\n\n### Model\n\n{text.block('model')}",
    )
    return drawn.saying(
        text.block(
            "how_to_read",
            scale=drawn.scale,
            give_scale=drawn.give_scale,
            shown=len(some),
            total=len(made.asked.q),
        )
    )
