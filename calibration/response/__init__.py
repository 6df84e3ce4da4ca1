"""Response curves from exposure brackets."""
