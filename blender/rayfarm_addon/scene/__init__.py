"""From what Blender shows to the files of a scene."""
