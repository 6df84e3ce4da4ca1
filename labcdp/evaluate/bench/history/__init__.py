"""All calibrations of a camera over time."""
