"""Exports Blender's scenes to scene files."""
