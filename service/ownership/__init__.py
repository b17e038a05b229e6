"""Ownership of the farm among several services: docs/reliability.md, "Two services"."""
