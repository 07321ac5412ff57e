"""The case as read, and what an audit of its records finds."""
