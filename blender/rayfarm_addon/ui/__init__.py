"""The classes that are registered in Blender: engine, settings and panels."""
