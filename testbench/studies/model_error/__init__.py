"""What a real arm's vices cost a model that does not know them."""
