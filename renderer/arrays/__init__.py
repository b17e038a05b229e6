"""The arrays of a compiled scene, and the names of their rows and columns.

The package renderer/scene writes the arrays; renderer/kernel reads them.
"""
