"""What noise costs, by method and structure."""
