"""What a sensor does by itself: dark signal, noise, response, defect pixels, flat field."""
