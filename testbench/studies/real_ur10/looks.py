"""Colour and marker of every model of the ladder, the same in figures and recordings."""

from testbench.studies.real_ur10 import ladder
from testbench.views.colours import CHOICE, GREENS, GREY, JOINTS, ORANGES, Look

LOOKS = {
    ladder.GEOMETRY.name: Look(GREY, 0, prior=True),
    ladder.JOINTS.name: Look(JOINTS, 2, prior=True),
    ladder.LINKS_LS.name: Look(ORANGES[0], 1, prior=True),
    ladder.LINKS_GCO.name: Look(GREENS[1], 1, prior=True),
    ladder.LINKS_PRIOR.name: Look(GREENS[3], 1, prior=True),
    ladder.WAVES.name: Look(GREENS[0], 0, prior=True),
    ladder.ALL.name: Look(GREENS[2], 3, prior=True),
    ladder.CHOSEN.name: CHOICE,
}
