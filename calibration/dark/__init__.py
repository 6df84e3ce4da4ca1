"""Dark signal over exposure and temperature."""
