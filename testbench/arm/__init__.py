"""An arm as its folder describes it: bodies, elastic properties, frames."""
