"""Storage: database rows, content-addressed blobs, and films in which each sample is stored once."""
