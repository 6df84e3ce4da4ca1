"""Common parts of pages, spreadsheets and figures."""
