"""Live views: interactive pictures of scenes, rendered by workers without a job and not stored."""
