"""The farm's service: takes scenes and jobs, hands out batches, keeps the films, and tells watchers."""
