"""What noise costs, by method and structure, and what better instruments are worth."""
