"""The compiled scene as arrays, and the names of their rows and columns: written by scene/, read by kernel/."""
