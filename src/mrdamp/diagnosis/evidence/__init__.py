"""Evidence, probabilities and verdict from the fits."""
