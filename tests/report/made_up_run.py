"""A made-up run: what its page draws, and its words."""

import numpy as np

from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.colours import GCO, MEASURED, Look
from testbench.report.markdown import Markdown
from testbench.report.report import Report
from testbench.report.scene import Layer, ModelLine, PageContent, PlaceMap, PoseGroup, RunChart, Scene
from testbench.report.schema import Table
from testbench.report.schema import columns as quantities
from testbench.report.table import Row

POSES, PLACES = 5, 7
LOOK = Look(GCO, 0, prior=True)
REPORT = Report(
    scenario="made_up",
    question=Markdown("How far is it off?"),
    title=Markdown("Made up."),
    answer=Markdown("It is 3.000 mm off."),
    worst=Markdown("Worst in pose d."),
    claims=[Markdown("Nothing else.")],
    numbers={},
    tables={"models": Table(quantities("name"), [Row(name="one")])},
    body=["models"],
)


def made_up_run(arm_6r):
    """Five poses with layers of every kind, one target lost; seven places and their map; a chart."""
    rng = np.random.default_rng(7)
    q = rng.uniform(-1, 1, (POSES, 6))
    theta = 0.05 * rng.uniform(-1, 1, (POSES, 48))
    at = rng.uniform(-1, 1, (POSES, 3, 3))
    at[2, 1] = np.nan  # a target that was lost
    layers = [
        Layer("target as read", MEASURED, "dots", at, labels=("P1", "", "P3")),
        Layer("error of one", GCO, "arrows", at, at + 0.1),
        Layer("intended path", GCO, "lines", at[:1, :2], at[:1, 1:]),
        Layer("hidden", GCO, "specks", at[:1], shown=False),
    ]
    rigid = rigid_frames(arm_6r.room, q)
    runs = PoseGroup(
        "Runs", list("abcde"), [f"{k} mm off" for k in range(POSES)], rigid,
        elastic_frames(arm_6r.plant, q, theta), layers, first=3,
    )  # fmt: skip
    whole = rigid_frames(arm_6r.room, rng.uniform(-1, 1, (PLACES, 6)))
    places = PoseGroup("Places", list("ABCDEFG"), ["here"] * PLACES, whole, None, ())
    size = np.array([1.0, 0.5, np.nan, 3.0, 2.0])
    lines = [
        ModelLine("other", Look(MEASURED, 1, prior=False), size[::-1]),
        ModelLine("one", LOOK, size, (size - 0.1, size + 0.1)),
    ]
    mm = np.array([1.0, 2.0, 3.0, np.nan, 5.0, 4.0, 0.5])
    field = PlaceMap("Error (mm)", 1, rng.uniform(-1, 1, (PLACES, 3)), [ModelLine("one", LOOK, mm)])
    return PageContent(
        Scene(arm_6r, "Errors x 10.", [runs, places]),
        field,
        [RunChart("Left (mm)", 0, "run", "abcde", lines)],
    )
