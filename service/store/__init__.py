"""Storage: database rows, content-addressed blobs, and films, which store each sample exactly once."""
