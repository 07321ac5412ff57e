"""The catalogue of effects in its forms, and causes outside the catalogue."""
