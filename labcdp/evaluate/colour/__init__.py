"""How well a camera tells the colours of regions apart."""
