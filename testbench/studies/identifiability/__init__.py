"""What the data cannot see, and what a prior is worth."""
