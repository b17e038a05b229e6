"""The farm's service: receives scenes and jobs, schedules batches of samples on workers, stores films, and serves viewers."""
