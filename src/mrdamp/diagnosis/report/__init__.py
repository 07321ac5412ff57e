"""The answer, its summary sentence, its page and the corrected simulator."""
