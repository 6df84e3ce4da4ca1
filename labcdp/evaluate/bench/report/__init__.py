"""Page, spreadsheet and figures of a session."""
