"""The compiled scene as arrays, and the names of their rows and columns: what scene/ writes and kernel/ reads."""
