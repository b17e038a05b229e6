"""Which of several services owns the farm: docs/reliability.md, "Two services"."""
