"""Live views: interactive pictures of scenes, rendered by workers without a job, of which one picture a scene is kept."""
