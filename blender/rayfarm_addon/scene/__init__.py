"""Export of Blender's scenes to scene files."""
