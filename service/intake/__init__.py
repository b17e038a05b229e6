"""Intake of requests and uploads: validation, storage, and resolution to a job's settings."""
