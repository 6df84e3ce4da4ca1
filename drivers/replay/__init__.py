"""A recorded session as devices."""
