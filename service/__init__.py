"""The farm's service: accepts scenes and jobs, schedules batches, stores films, and serves viewers."""
