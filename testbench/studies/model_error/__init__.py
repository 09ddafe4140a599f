"""What a real arm's disturbances cost a model that does not know them."""
