"""Colour and marker of every model of the ladder, the same in figures and recordings."""

from testbench.studies.real_ur10 import ladder
from testbench.views.colours import CHOICE, GCO, GREY, JOINTS, JOINTS_PRIOR, LEAST_SQUARES, Look, look

LOOKS = {
    ladder.GEOMETRY.name: Look(GREY, 0, prior=True),
    ladder.JOINTS.name: Look(JOINTS, 2, prior=True),
    ladder.LINKS_LS.name: Look(LEAST_SQUARES, 1, prior=True),
    ladder.LINKS_GCO.name: look("ALL153", "psd"),
    ladder.LINKS_PRIOR.name: look("ALL153", "psd", prior=True),
    ladder.WAVES.name: Look(JOINTS_PRIOR, 0, prior=True),
    ladder.ALL.name: Look(GCO, 3, prior=True),
    ladder.CHOSEN.name: CHOICE,
}
