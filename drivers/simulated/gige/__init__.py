"""The simulated camera on the wire."""
