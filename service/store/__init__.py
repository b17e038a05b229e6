"""Storage: database rows, content-addressed blobs, and films, which contain each sample exactly once."""
