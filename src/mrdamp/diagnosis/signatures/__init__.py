"""What loops of force over displacement show without a law."""
