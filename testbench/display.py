"""How the types of `import testbench` show themselves: a line in a shell, a small table in a notebook."""

from html import escape


class Displayed:
    """A type that says what it is in a few words; a dataclass of it has `repr=False`."""

    def about(self) -> dict[str, object]:
        """What a reader wants to know of it, by name."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self.about().items())})"
        )

    def _repr_html_(self) -> str:
        """For a notebook."""
        rows = "".join(
            f"<tr><th>{escape(name.replace('_', ' '))}</th><td>{escape(str(value))}</td></tr>"
            for name, value in self.about().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
