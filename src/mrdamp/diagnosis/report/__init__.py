"""The answer, its sentence, its page and the corrected simulator."""
