"""Validates and stores uploads and requests, and resolves a request to a job's render settings."""
