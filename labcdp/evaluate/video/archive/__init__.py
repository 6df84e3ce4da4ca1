"""Folders of videos on all cores or a cluster."""
