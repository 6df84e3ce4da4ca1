"""CDP of every edge of an image."""
