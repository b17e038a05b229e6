"""Data for viewers: pictures from films, live tiles, and notifications of changes."""
