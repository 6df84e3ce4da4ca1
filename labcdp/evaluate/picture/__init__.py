"""CDP of pictures."""
