"""What was asked beforehand, beside what was found."""

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.views.schema import Column, Table


@dataclass(frozen=True)
class Bar:
    """A number that was to be neither too small nor too large."""

    what: str
    found: float  #: A ratio, a share or a count.
    least: float | None  #: None for no limit.
    most: float | None

    @property
    def met(self) -> bool:
        """Whether it lies between both."""
        above = self.least is None or self.found >= self.least
        return above and (self.most is None or self.found <= self.most)


def bar_table(bars: Sequence[Bar], form: str) -> Table:
    """A row a bar; `form` is that of what was found."""
    columns = (
        Column("what", "what"),
        Column("found", "found", form=form),
        Column("least", "at least", form="g"),
        Column("most", "at most", form="g"),
        Column("met", "met", form="yes"),
    )
    return Table(columns, bars)
