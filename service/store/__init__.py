"""What is kept: rows in the database, blobs by hash, films with every sample once."""
