"""Data for clients that watch the farm: pictures from films, changed tiles, and notifications of changes."""
