"""What is said to a farm, and what it answers. Nothing here knows of Blender."""
