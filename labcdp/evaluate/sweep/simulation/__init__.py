"""One simulated image, stage by stage."""
