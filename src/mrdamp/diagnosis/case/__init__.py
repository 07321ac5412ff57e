"""The case as read, and an audit of its records."""
