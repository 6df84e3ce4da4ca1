"""A map of CDP as result, picture, page and files."""
