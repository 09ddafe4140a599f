"""The paper's sections, one case each: single link, 6R arm, solvers, loaded stiffness; its numbers."""

from testbench.studies.paper.verdicts import EQ_22 as EQ_22
from testbench.studies.paper.verdicts import EQ_23 as EQ_23
from testbench.studies.paper.verdicts import SECTION_5_2 as SECTION_5_2
from testbench.studies.paper.verdicts import SECTION_6 as SECTION_6
