"""Display of public types: one line in a shell, a small table in a notebook."""

from html import escape


class Displayed:
    """Give a type a repr of one line and an HTML table, both from `about`; its dataclass has `repr=False`."""

    def about(self) -> dict[str, object]:
        """Return what a reader wants to know of the object, by name."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self.about().items())})"
        )

    def _repr_html_(self) -> str:
        """Render the table for a notebook."""
        rows = "".join(
            f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{escape(str(value))}</td></tr>"
            for name, value in self.about().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
