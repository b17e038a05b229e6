"""The classes registered in Blender: engine, settings and panels."""
