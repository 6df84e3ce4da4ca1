"""Page and spreadsheet of a twin."""
