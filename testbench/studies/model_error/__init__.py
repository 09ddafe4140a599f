"""What disturbances cost a model that does not know them."""
