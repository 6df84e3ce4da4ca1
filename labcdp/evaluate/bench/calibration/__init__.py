"""Page, spreadsheet and figures of a calibration."""
