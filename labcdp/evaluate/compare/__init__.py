"""Results of one kind side by side."""
