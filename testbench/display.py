"""Display of public types: one line in a shell, a small table in a notebook."""

from dataclasses import fields, is_dataclass
from html import escape

import numpy as np
import numpy.typing as npt

MAX_VALUE_CHARACTERS = 60  #: Most characters of a value that is shown; of a longer one its type is shown.
MAX_ARRAY_NUMBERS = 6  #: Most numbers of an array that are shown; of a larger one its shape is shown.


def span(values: npt.NDArray[np.float64]) -> str:
    """Write the range of some numbers as text, such as "3.53 to 7.78"; "none" for an empty array."""
    if not np.size(values):
        return "none"
    ends = f"{np.min(values):.3g}", f"{np.max(values):.3g}"
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)


class Displayed:
    """Define the display of a dataclass with `repr=False`: a line in a shell, a table in a notebook."""

    def summary(self) -> dict[str, object]:
        """Summarise the object by name and value; fields by default, an array by its shape."""
        assert is_dataclass(self)
        return {field.name: _short(getattr(self, field.name)) for field in fields(self)}

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self.summary().items())})"
        )

    def _repr_html_(self) -> str:
        """Render the table for a notebook."""
        rows = "".join(
            f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{escape(str(value))}</td></tr>"
            for name, value in self.summary().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


def _short(value: object) -> str:
    """Write a value in few characters: the shape of a large array, the type of anything else that is long."""
    if isinstance(value, np.ndarray):
        few = value.ndim == 1 and value.size <= MAX_ARRAY_NUMBERS
        return f"[{', '.join(f'{x:.6g}' for x in value)}]" if few else f"array{value.shape}"
    text = repr(value)
    return text if len(text) <= MAX_VALUE_CHARACTERS and "\n" not in text else f"<{type(value).__name__}>"
