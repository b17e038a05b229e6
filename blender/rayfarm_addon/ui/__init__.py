"""What Blender registers: the engine, settings, panels."""
