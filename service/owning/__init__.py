"""Who owns the farm where several services are started for it: docs/reliability.md, "Two services"."""
