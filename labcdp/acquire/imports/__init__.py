"""Sessions imported from files of other programs."""
