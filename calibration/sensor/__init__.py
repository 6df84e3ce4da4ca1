"""The sensor by itself: dark signal, noise, response, defect pixels, flat field."""
