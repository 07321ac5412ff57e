"""From fits to evidence, probabilities and a verdict."""
