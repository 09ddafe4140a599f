"""What the page and the recording draw: the tool drawn off by the process, and put back."""

import numpy as np

from testbench.campaign.baselines import JOINTS
from testbench.campaign.campaign import Cell
from testbench.campaign.rows import MM
from testbench.errors import Array
from testbench.plant import settle
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.table import Trials
from testbench.studies.compensation.jobs import jobs
from testbench.studies.compensation.settings import ADVISED, DEFAULT, DRAWN, IDEAL, LEAST_SQUARES, Settings
from testbench.studies.compensation.trial import work
from testbench.views.colours import CHOICE, LOAD, MEASURED, TASK, Look, look
from testbench.views.scene import Layer, Line, Poses, RunChart, Scene, Seen, arrow_scale

LOOKS = {
    JOINTS: look("Joints", "none"),
    LEAST_SQUARES: look("MLS56", "none"),
    "MGCO56": look("MGCO56", "psd"),
    DEFAULT: CHOICE,
}
"""How models are drawn."""
DRAWN_AS = {
    "not corrected": Look(MEASURED, 1, prior=True),
    "corrected by joint stiffness only": LOOKS[JOINTS],
    "corrected by the default model": LOOKS[DEFAULT],
}
"""How the tool is drawn, not corrected and corrected by each model; what wins is last."""
LONGEST, FORCE = 0.3, 1e-4  #: Most errors as they are drawn [m]; length of the force's arrow [m/N].


def seen(true: Cell, asked: Settings, first: Trials, seed: int) -> Seen:
    """The jobs of a trial: where the tool was asked to be, and where it is without correction and with.

    Args:
        true: The true arm.
        asked: Its programs are in the scene.
        first: Rows of the trial.
        seed: Of the trial.
    """
    own, rows = work(asked, seed), first.where(arm=IDEAL, **vars(ADVISED))
    every = [_off(rows.where(name=name)) for name in DRAWN]
    off = dict(zip(DRAWN_AS, (every[0][0], *(both[1] for both in every)), strict=True))
    size = {name: MM * np.linalg.norm(metres, axis=1) for name, metres in off.items()}
    where = np.concatenate([job.position for job in jobs()])
    labels = [f"{job.name} {k + 1}" for job in jobs() for k in range(len(job.position))]
    M = arrow_scale(off["not corrected"], LONGEST)
    bent, rest = (settle(true.plant, own.q, *load) for load in ((own.load.wrench, own.load.point), ()))
    tip = where + M * off["not corrected"]
    group = Poses(
        name="Jobs",
        names=[label.capitalize() for label in labels],
        words=[
            ", ".join(f"{name} {mm[k]:.3f} mm off" for name, mm in size.items()) + "."
            for k in range(len(labels))
        ],
        rigid=rigid_frames(true.room, own.q),
        bent=elastic_frames(true.plant, own.q, M * (bent.theta - rest.theta)),
        layers=[
            Layer("tool asked, all points", TASK, "dots", where[None]),
            *(
                Layer(f"tool, {name}", own.colour, "arrows", where[:, None], (where + M * off[name])[:, None])
                for name, own in DRAWN_AS.items()
            ),
            Layer("force", LOAD, "arrows", (tip - FORCE * own.load.wrench[:, :3])[:, None], tip[:, None]),
        ],
        first=int([*size.values()][-1].argmax()),
    )
    lines = [Line(name, look, size[name]) for name, look in DRAWN_AS.items()]
    chart = RunChart("How far the tool is off at each point (mm)", 0, "point", labels, lines)
    return Seen(scene=Scene(true, f"What is off, and how the arm bends, x {M:g}.", [group]), runs=[chart])


def _off(rows: Trials) -> Array:
    """Where the tool is off by one model, not corrected and corrected, (2, points, 3) [m]."""
    parts = [np.reshape(rows.where(job=job.name)["off_mm"][0], (2, -1, 3)) for job in jobs()]
    return np.concatenate(parts, axis=1) / MM
