"""Page, spreadsheet and figures of a video."""
