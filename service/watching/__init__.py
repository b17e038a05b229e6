"""Data for viewers: pictures of a film at any time, live tiles, and notifications of changes."""
