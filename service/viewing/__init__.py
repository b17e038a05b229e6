"""Live views: interactive pictures of scenes, rendered by workers without a job. One picture of each scene is stored."""
